"""Gross readings, which take no part in a map: one list for registration, folds, predictors and comparison.

A reading is gross if the robust registration marks it as an outlier, and if the other readings contradict it as well
when errors of the arm are allowed for. Large errors alone are not gross: errors of an arm may be large at few poses.
The errors of the readings that are not marked are modelled as in `truepose.verification.campaign`, without smooth
fields:

    e = X x + r,        x ~ N(0, (10 T)²),   r ~ N(0, σ²)

X are the columns of the arm's deviations and of the station, T their tolerances. A marked reading is gross if it is
farther from the prediction of this model than 10 standard deviations of the prediction, as in
`truepose.predictors.outliers`, and if none of its neighbours is off by about the same vector.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import KDTree

from truepose._typing import BoolArray, FloatArray
from truepose.cell import Cell
from truepose.error_map.campaign import campaign_of
from truepose.geometry import Registration
from truepose.predictors.outliers import FEWEST, GROSS, robust_factor
from truepose.robots import Robot
from truepose.samples import Samples

_TOLERANCES: Final = 10.0  # standard deviation of the arm's deviations: a joint may be mastered wrongly
_STATION: Final = np.repeat([10.0, 0.01], 3)  # mm, rad: standard deviation of the station
_FLOOR: Final = 1e-3  # of σ [mm]
_STEPS: Final = 4  # for σ
_FREEDOM: Final = 10.0  # degrees of freedom that an estimate of σ needs
_NEIGHBOURS: Final = 3
_ALIKE: Final = 0.5  # of the length of a deviation


def gross_readings(
    cell: Cell, robot: Robot, samples: Samples, registration: Registration, tf_flange_tool: FloatArray
) -> FloatArray:
    """Return how far each gross reading is from the prediction by the others, (n,) [standard deviations].

    It is 0 for the readings that are not gross. With a registration that is not robust, or fewer than 10 readings that
    it does not mark, none are.

    Parameters
    ----------
    cell : Cell
        The cell that was measured.
    robot : Robot
        The nominal robot.
    samples : Samples
        The samples.
    registration : Registration
        The registration of the samples.
    tf_flange_tool : (4, 4) array [mm]
        The tool fitted with it, or as stated.
    """
    found, marked = np.zeros(len(samples)), registration.outliers
    if not marked.any() or (~marked).sum() < FEWEST:
        return found
    campaign = campaign_of(cell, robot, samples, registration, tf_flange_tool)
    columns = np.concatenate([_TOLERANCES * campaign.columns, _STATION * campaign.rigid], axis=2)
    k = columns.shape[2]
    x, e = columns[~marked].reshape(-1, k), campaign.e[~marked].reshape(-1)
    sigma = max(registration.noise_std, _FLOOR)  # errors of the arm included
    for _ in range(_STEPS):
        normal = cho_factor(x.T @ x / sigma**2 + np.eye(k), lower=True)
        beta, covariance, used = cho_solve(normal, x.T @ e / sigma**2), cho_solve(normal, np.eye(k)), sigma
        freedom = len(e) - k + float(np.trace(covariance))
        if freedom < _FREEDOM:
            break
        sigma = max(float(np.sqrt(np.sum((e - x @ beta) ** 2) / freedom)), _FLOOR)
    off, own = campaign.e - columns @ beta, columns[marked]
    spread = np.einsum("iap,pq,ibq->iab", own, covariance, own) + used**2 * np.eye(3)
    surprise = np.sqrt(np.einsum("ia,ia->i", off[marked], np.linalg.solve(spread, off[marked][..., None])[..., 0]))
    found[marked] = np.where((surprise > GROSS) & ~shared(campaign.coordinates, off)[marked], surprise, 0.0)
    return found


def shared(coordinates: FloatArray, off: FloatArray) -> BoolArray:
    """Return whether a neighbour of each reading is off by about the same vector, as errors of the arm are, (n,).

    Parameters
    ----------
    coordinates : (n, d) array
        The coordinates over which errors of the arm are smooth: joints or positions.
    off : (n, 3) array [mm]
        The deviations.
    """
    _, near = KDTree(coordinates).query(coordinates, k=1 + _NEIGHBOURS)
    difference = np.linalg.norm(off[near] - off[:, None], axis=2)
    difference[near == np.arange(len(off))[:, None]] = np.inf  # of several rows at one pose any may be the first
    return np.asarray(difference.min(axis=1) < _ALIKE * np.linalg.norm(off, axis=1))


def gross_held_out(coordinates: FloatArray, residual: FloatArray, std: FloatArray) -> FloatArray:
    """Return how far each gross reading is from the prediction of a map without it, (n,) [standard deviations].

    It is 0 for the readings that are not gross, and with fewer than 10 readings. The scale of the predicted standard
    deviations is checked with the median residual, which single readings hardly affect.

    Parameters
    ----------
    coordinates : (n, d) array
        The coordinates over which errors of the arm are smooth: joints or positions.
    residual, std : (n, 3) arrays [mm]
        The residuals and their predicted standard deviations.
    """
    if len(residual) < FEWEST:
        return np.zeros(len(residual))
    surprise = np.linalg.norm(residual / std, axis=1)
    surprise = surprise / robust_factor(float(np.median(surprise)))
    return np.where((surprise > GROSS) & ~shared(coordinates, residual), surprise, 0.0)


def without_gross(samples: Samples, registration: Registration, gross: FloatArray) -> Samples:
    """Return the samples without gross readings, which are named in `Samples.excluded`.

    Parameters
    ----------
    samples : Samples
        The samples.
    registration : Registration
        Their registration.
    gross : (n,) array
        The result of `gross_readings`.
    """
    return named_gross(samples, np.linalg.norm(registration.residuals, axis=1), gross)


def named_gross(samples: Samples, size: FloatArray, gross: FloatArray) -> Samples:
    """Return the samples without gross readings, named in `Samples.excluded`; `size` (n,) [mm] is how far each is off.

    `gross` (n,) is the result of `gross_readings` or `gross_held_out`.
    """
    named = [{**samples.identify(i), "reason": contradicted(size[i], gross[i])} for i in np.flatnonzero(gross).tolist()]
    return replace(samples[gross == 0], excluded=(*samples.excluded, *named))


def contradicted(size: float, surprise: float) -> str:
    """Return the reason to leave out a reading that the others contradict: its error [mm] in standard deviations."""
    return f"error of {size:.3f} mm, {surprise:.1f} standard deviations from the prediction by the others"
