"""Whether a map is better than no map, by the errors that it leaves on unseen blocks of samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.special import stdtrit

from truepose._typing import FloatArray, IntArray
from truepose.errors import TrueposeError
from truepose.numerics.threads import blas_threads
from truepose.predictors.folds import split_samples

FEW: Final = 40
"""Samples up to which a map is fitted again without each block, hyperparameters included."""
_BLOCKS: Final = 5
_FEWEST: Final = 5  # samples that a comparison needs


@dataclass(frozen=True)
class Worth:
    """Mean lengths of errors over blocks of samples that a map was fitted without [mm], and their differences.

    Attributes
    ----------
    n : int
        The number of samples of the map.
    nothing_mm : float
        The errors after the map's registration, without corrections.
    left_mm : float, optional
        The errors that the map leaves, with its hyperparameters and its registration; with few samples (`FEW`) it is
        fitted again without each block, from the registration on.
    registration_mm : float, optional
        The errors after a registration without the block.
    gain_over_nothing, gain_over_registration : pair of float [mm], optional
        The 95 % intervals of the mean difference, paired by sample (Student's t).
    note : str
        The reason why nothing was compared; empty otherwise.
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
        """Whether the map is not significantly better than nothing, or than registration alone."""
        gains = self.gain_over_nothing, self.gain_over_registration
        return not all(gain is not None and gain[0] > 0.0 for gain in gains)

    @property
    def words(self) -> str:
        """The result in one sentence."""
        if self.gain_over_nothing is None or self.left_mm is None:
            return f"nothing shows that the map is better than none: {self.note}"
        low, high = self.gain_over_nothing
        verdict = "not better than none beyond its interval" if self.weak else "better than none"
        return (
            f"the map is {verdict}: it leaves {self.left_mm:.3f} mm on blocks of samples that it was fitted without, "
            f"registration alone {self.nothing_mm:.3f} mm (gain {low:.3f} to {high:.3f} mm, 95 %)"
        )

    @property
    def brief(self) -> str:
        """The result in a few words."""
        if self.left_mm is None:
            return f"weak map: {self.note}"
        verdict = "weak map, not shown to be better than none" if self.weak else "better than none"
        return f"{verdict}: {self.left_mm:.3f} mm left on unseen blocks, {self.nothing_mm:.3f} mm without the map"

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain values, ``weak`` included."""
        return {"weak": self.weak, **asdict(self)}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Worth:
        """Return the object that `to_dict` described."""
        known = {key: value for key, value in values.items() if key != "weak"}
        gains = {key: value and tuple(value) for key, value in known.items() if key.startswith("gain")}
        return cls(**{**known, **gains})


class LeftOut(NamedTuple):
    """Errors of samples, (n, 3) [mm], each without its block.

    Attributes
    ----------
    left : (n, 3) array
        The errors that a map fitted without the block leaves.
    alone : (n, 3) array
        The errors after a registration without the block.
    """

    left: FloatArray
    alone: FloatArray


def worth(
    p_cmd: FloatArray, e: FloatArray, without: Callable[[IntArray], LeftOut], pose: IntArray | None = None
) -> Worth:
    """Compare a fitted map with registration alone and with nothing, on blocks of the workspace.

    Parameters
    ----------
    p_cmd : (n, 3) array [mm]
        The positions of the samples, which define the blocks.
    e : (n, 3) array [mm]
        Their errors after the registration of the map.
    without : callable
        A function of the block of each sample, (n,).
    pose : (n,) array of int, optional
        The pose of each sample; samples of one pose stay in one block.
    """
    n, nothing = len(e), np.linalg.norm(e, axis=1)
    mean = float(nothing.mean())
    if n < _FEWEST:
        return Worth(n, mean, note=f"{n} samples are too few to leave some out; measure {_FEWEST} or more")
    try:
        with blas_threads(n):
            blocks = split_samples(["blocks"], {"cartesian": p_cmd}, folds=_BLOCKS, pose=pose)["blocks"]
            left, alone = (np.linalg.norm(one, axis=1) for one in without(blocks))
    except (TrueposeError, np.linalg.LinAlgError) as error:
        return Worth(n, mean, note=f"without a block of samples it cannot be fitted ({error})")
    gains = _interval(nothing - left), _interval(alone - left)
    return Worth(n, mean, float(left.mean()), float(alone.mean()), *gains)


def _interval(difference: FloatArray) -> tuple[float, float]:
    """Return the 95 % interval of the mean of paired differences."""
    n, mean = len(difference), float(difference.mean())
    half = float(stdtrit(n - 1, 0.975) * difference.std(ddof=1) / np.sqrt(n))
    return mean - half, mean + half
