"""Whether a map is better than no map: what it leaves on blocks of samples that it has not seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.stats import t as student_t

from truepose._typing import FloatArray, IntArray
from truepose.errors import TrueposeError
from truepose.numerics.threads import blas_threads
from truepose.predictors import block_folds

FEW: Final = 40
"""Samples up to which hyperparameters count: a map is fitted anew without each block, these included."""
_BLOCKS: Final = 5
_FEWEST: Final = 5  # samples; with fewer nothing is known of the map


@dataclass(frozen=True)
class Worth:
    """Mean lengths of errors over blocks of samples that a map was fitted without [mm], and what it gains.

    Attributes
    ----------
    n : int
        Samples of the map.
    nothing_mm : float
        The errors after the map's registration: what no correction leaves.
    left_mm : float, optional
        What the map leaves of the errors: with its hyperparameters and its registration; of few samples (`FEW`) it is
        fitted anew without each block, from the registration on.
    registration_mm : float, optional
        The errors after a registration that the block took no part in: what a station found without it leaves.
    gain_over_nothing, gain_over_registration : pair of float [mm], optional
        95 % intervals of the mean difference, paired by sample, from the spread of the differences (Student's t).
    note : str
        Why nothing was compared; empty where it was.
    """

    n: int
    nothing_mm: float
    left_mm: float | None = None
    registration_mm: float | None = None
    gain_over_nothing: tuple[float, float] | None = None
    gain_over_registration: tuple[float, float] | None = None
    note: str = ""

    @property
    def weak(self) -> bool:
        """Whether the map is not better than nothing, or than registration alone, beyond the interval."""
        gains = self.gain_over_nothing, self.gain_over_registration
        return not all(gain is not None and gain[0] > 0.0 for gain in gains)

    @property
    def words(self) -> str:
        """What was found, in one sentence."""
        if self.gain_over_nothing is None or self.left_mm is None:
            return f"nothing shows that the map is better than none: {self.note}"
        low, high = self.gain_over_nothing
        verdict = "not better than none beyond its interval" if self.weak else "better than none"
        return (
            f"the map is {verdict}: it leaves {self.left_mm:.3f} mm on blocks of samples that it was fitted without, "
            f"registration alone {self.nothing_mm:.3f} mm (gain {low:.3f} to {high:.3f} mm, 95 %)"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, whether the map is weak among them."""
        return {"weak": self.weak, **asdict(self)}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Worth:
        """Return what `to_dict` gave."""
        known = {key: value for key, value in values.items() if key != "weak"}
        gains = {key: value and tuple(value) for key, value in known.items() if key.startswith("gain")}
        return cls(**{**known, **gains})


class LeftOut(NamedTuple):
    """Errors of samples, (n, 3) [mm], each without its block.

    Attributes
    ----------
    left : (n, 3) array
        What a map that was fitted without the block leaves of the errors.
    alone : (n, 3) array
        The errors after a registration without the block.
    """

    left: FloatArray
    alone: FloatArray


def worth(p_cmd: FloatArray, e: FloatArray, without: Callable[[IntArray], LeftOut]) -> Worth:
    """Compare a fitted map with registration alone and with nothing, on blocks of the workspace.

    Parameters
    ----------
    p_cmd : (n, 3) array [mm]
        Positions of the samples, which the blocks are made of.
    e : (n, 3) array [mm]
        Their errors after the registration of the map.
    without : callable
        Takes the block of each sample, (n,).
    """
    n, nothing = len(e), np.linalg.norm(e, axis=1)
    mean = float(nothing.mean())
    if n < _FEWEST:
        return Worth(n, mean, note=f"{n} samples are too few to leave some out; measure {_FEWEST} or more")
    try:
        with blas_threads(n):
            left, alone = (np.linalg.norm(one, axis=1) for one in without(block_folds(p_cmd, _BLOCKS)))
    except (TrueposeError, np.linalg.LinAlgError) as error:
        return Worth(n, mean, note=f"without a block of samples it cannot be fitted ({error})")
    gains = _interval(nothing - left), _interval(alone - left)
    return Worth(n, mean, float(left.mean()), float(alone.mean()), *gains)


def _interval(difference: FloatArray) -> tuple[float, float]:
    """Return the 95 % interval of the mean of paired differences."""
    n, mean = len(difference), float(difference.mean())
    half = float(student_t.ppf(0.975, n - 1) * difference.std(ddof=1) / np.sqrt(n))
    return mean - half, mean + half
