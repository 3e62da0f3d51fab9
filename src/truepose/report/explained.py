"""The part of the measured errors that errors of the kinematic parameters explain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map import ErrorMap
from truepose.errors import RobotError
from truepose.similarity import ExperimentalVariogram, experimental_variogram, model_based_variogram

TYPICAL_MM: Final = 0.3
TYPICAL_RAD: Final = 3e-4
"""Typical errors of the parameters of an arm (docs/virtual-cell.md); only their ratio matters here."""


@dataclass(frozen=True, eq=False)
class Explained:
    """What errors of the kinematic parameters explain.

    Attributes
    ----------
    share : float
        Of the sum of squared errors, taken away by a least-squares fit of the parameters, less chance.
    rank : int
        Parameters that the samples can tell.
    theory : ExperimentalVariogram
        Theory (6) of typical parameter errors, of a size that fits their share: the similarity that they imply.
    residual : ExperimentalVariogram
        Of what the fit leaves.
    """

    share: float
    rank: int
    theory: ExperimentalVariogram
    residual: ExperimentalVariogram


def kinematic_columns(error_map: ErrorMap) -> FloatArray | None:
    """Return the effect of one typical error of each parameter after registration, (n, 3, p) [mm]; nothing without q.

    What registration (and the fit of the tool) would take away is projected out, since errors are told after it.
    """
    robot, q = error_map.robot, error_map.samples.q
    if q is None:
        return None
    fitted = ["base", "tool"] if error_map.tool_fitted else ["base"]
    try:
        J = robot.error_jacobian(q, tool=error_map.tf_flange_tool)
        G = robot.error_jacobian(q, tool=error_map.tf_flange_tool, parameters=fitted)
    except RobotError:  # a chain that has no Denavit-Hartenberg parameters
        return None
    std = [TYPICAL_RAD if name.startswith(("theta", "alpha", "beta")) else TYPICAL_MM for name in robot.parameter_names]
    columns, taken = (J * std).reshape(-1, J.shape[2]), G.reshape(-1, G.shape[2])
    taken = taken / np.maximum(np.linalg.norm(taken, axis=0), 1e-300)
    left = columns - taken @ np.linalg.lstsq(taken, columns, rcond=1e-10)[0]
    return np.asarray(left.reshape(J.shape))


def explained_by_kinematics(
    x: FloatArray, e: FloatArray, effect: FloatArray, edges: FloatArray, measured: ExperimentalVariogram
) -> Explained | None:
    """Return what `kinematic_columns` (n, 3, p) explain of errors e (n, 3); nothing with too few samples."""
    n, c, p = effect.shape
    columns = effect.reshape(n * c, p)
    solution, _, rank, _ = np.linalg.lstsq(columns, e.ravel(), rcond=1e-8)
    if n * c <= 2 * rank:
        return None
    residual = e - (columns @ solution).reshape(n, c)
    left = float((residual**2).sum() / (e**2).sum())
    implied = model_based_variogram(x, effect, np.ones(p), edges)
    weights = measured.pairs / np.maximum(np.nan_to_num(measured.vector), 1e-30) ** 2
    used = measured.pairs > 0
    share = 1 - left * n * c / (n * c - int(rank))
    theory_size = max(share, 0.0) * _ratio(measured.vector[used], implied.vector[used], weights[used])
    theory = ExperimentalVariogram(
        implied.lag,
        theory_size * implied.semivariance,
        theory_size * implied.vector,
        implied.pairs,
        implied.edges,
        implied.repeats,
        implied.repeat_semivariance,
        implied.dimensions,
        "model",
    )
    return Explained(share, int(rank), theory, experimental_variogram(x, residual, edges))


def _ratio(measured: FloatArray, implied: FloatArray, weights: FloatArray) -> float:
    return float((weights * measured) @ implied / ((weights * implied) @ implied))
