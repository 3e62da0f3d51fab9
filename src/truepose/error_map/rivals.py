"""Whether another kind of predictor would do far better than that of a map, so that nobody stops at a poor one."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map.conditions import with_conditions
from truepose.error_map.prediction import PredictingMap
from truepose.error_map.selection import CellSamples
from truepose.errors import TrueposeError
from truepose.predictors import Predictor
from truepose.predictors.registry import predictor_spec
from truepose.samples import Samples

_MOST: Final = 100
"""Samples that a rival is fitted to, so that it takes about a second; with all of them it would do better still."""
FAR: Final = 0.7
"""The largest ratio of the mean errors at which a rival counts as far better."""


@dataclass(frozen=True)
class Better:
    """A predictor that does far better than that of a map.

    Attributes
    ----------
    predictor : str
        The predictor of the map.
    mean_mm : float
        The mean length of the errors that it leaves.
    rival : str
        The predictor that was compared.
    rival_mean_mm : float
        The mean length of the errors that the rival leaves at the same samples.
    at : str
        The samples: "the held-out poses", or "each sample, predicted from the others".
    """

    predictor: str
    mean_mm: float
    rival: str
    rival_mean_mm: float
    at: str

    @property
    def words(self) -> str:
        """The result in one sentence."""
        ratio = f"{self.rival_mean_mm:.3f} mm (mean over {self.at}), {self.predictor} {self.mean_mm:.3f} mm"
        return (
            f"another predictor would do far better: {self.rival} leaves {ratio}; fit again with "
            f"--predictor {self.rival}, or auto"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain values, for JSON."""
        return asdict(self)


def better_predictor(error_map: PredictingMap, held_out: Samples | None = None) -> Better | None:
    """Return a predictor that does far better than that of a map; None where no rival does.

    The rival is `KinematicKriging`, or `OrdinaryKriging` where the arm is not known; it is fitted to at most 100
    samples of the map. A map that knows the arm already, or that was chosen among candidates with the rival, has none.

    Parameters
    ----------
    error_map : ErrorMap
        The map.
    held_out : Samples, optional
        The samples to compare at; by default those of the map, each predicted from the others.

    Examples
    --------
    >>> from truepose import VirtualCell, fit_cell
    >>> virtual = VirtualCell("paper")
    >>> error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(40)), "registration")
    >>> better_predictor(error_map).rival
    'kinematic-kriging'
    """
    measured = CellSamples(error_map.cell, error_map.robot, error_map.samples, accepted=True)
    errors = measured.errors(error_map.registration, error_map.tf_flange_tool)
    rival = "kinematic-kriging" if errors.supports("kinematic-kriging") else "ordinary-kriging"
    known = {error_map.predictor_name, *(row["predictor"] for row in error_map.ranking)}
    if rival in known or predictor_spec(error_map.predictor_name).family.arm_parameters:
        return None
    n = len(error_map.samples)
    rows = np.arange(n) if n <= _MOST else np.random.default_rng(0).choice(n, _MOST, replace=False)
    try:
        model, _ = errors.fit(rival, rows)
        theirs = _mean(_left(error_map, model, predictor_spec(rival).space, held_out))
    except (TrueposeError, np.linalg.LinAlgError):  # too few samples
        return None
    left = _left(error_map, error_map.predictor, error_map.space, held_out)
    own = _mean(left[rows] if held_out is None else left)
    if theirs > FAR * own:
        return None
    at = "each sample, predicted from the others" if held_out is None else "the held-out poses"
    return Better(error_map.predictor_name, own, rival, theirs, at)


def _left(error_map: PredictingMap, model: Predictor, space: str, held_out: Samples | None) -> FloatArray:
    """Return the errors that a predictor leaves, (n, 3) [mm]."""
    if held_out is None:
        return model.leave_one_out().residual
    x = held_out.q if space == "joint" else error_map.commanded_positions(held_out)
    if x is None:
        raise TrueposeError(f"{held_out.source}: joints are not known")
    return np.asarray(error_map.errors(held_out) - model.predict(with_conditions(x, model, held_out, error_map.cell)))


def _mean(left: FloatArray) -> float:
    return float(np.linalg.norm(left, axis=1).mean())
