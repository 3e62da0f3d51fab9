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
"""Typical errors of kinematic parameters (docs/virtual-cell.md); only their ratio matters here."""


@dataclass(frozen=True, eq=False)
class Explained:
    """The part of the errors that errors of the kinematic parameters explain.

    Attributes
    ----------
    share : float
        The share of the sum of squared errors explained by a least-squares fit of the parameters, adjusted for chance.
    rank : int
        The number of parameters that the samples determine.
    theory : ExperimentalVariogram
        The variogram that typical parameter errors imply, theory (6), scaled to the explained share.
    residual : ExperimentalVariogram
        The variogram of the residuals of the fit.
    """

    share: float
    rank: int
    theory: ExperimentalVariogram
    residual: ExperimentalVariogram


def kinematic_columns(error_map: ErrorMap) -> FloatArray | None:
    """Return the effect of a typical error of each parameter on the positions, (n, 3, p) [mm]; None without joints.

    The part that the registration (and the fit of the tool) would absorb is projected out.
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
    """Return the part of errors e (n, 3) that `kinematic_columns` (n, 3, p) explain; None with too few samples."""
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
