"""Registration with several reflectors on the flange: the tracker's station and the place of their body together.

The body of the reflectors is rigid and its shape is known. A reading P of the reflector at c on the body, at the flange
pose (R_i, p_i), is explained by the station (R, t) and the body on the flange (G, g):

    residual = R P + t − (p_i + R_i (G c + g))                                                  [mm], base frame
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.geometry.plausibility import write_hint
from truepose.geometry.registration import Registration, register_with_tool
from truepose.geometry.robust import OUTLIER_LIMIT, robust_scale, tukey_weights
from truepose.geometry.station import MINIMAL, kabsch
from truepose.geometry.transforms import apply_transform, cross_matrix, make_transform

_STEPS: Final = 100
_SETTLED: Final = 1e-9  # mm
_ON_A_LINE: Final = 1.0  # mm
_NEGLIGIBLE: Final = 1e-9  # of the largest singular value


@dataclass(frozen=True, eq=False)
class _Fit:
    """A station and a body, as transforms (4, 4) [mm]: tracker to base, and stated flange frame to flange."""

    tf_base_tracker: FloatArray
    tf_flange_body: FloatArray

    def residuals(self, tf_base_flange: FloatArray, p_measured: FloatArray, p_body: FloatArray) -> FloatArray:
        placed = apply_transform(self.tf_flange_body, p_body)
        p = np.einsum("nij,nj->ni", tf_base_flange[:, :3, :3], placed) + tf_base_flange[:, :3, 3]
        return np.asarray(apply_transform(self.tf_base_tracker, p_measured) - p)


def register_with_body(
    tf_base_flange: FloatArray,
    p_measured: FloatArray,
    p_body: FloatArray,
    which: IntArray,
    p_flange_tool: FloatArray,
    robust: bool = True,
) -> tuple[Registration, FloatArray]:
    """Fit the tracker's station and the place of a body of several reflectors on the flange.

    Parameters
    ----------
    tf_base_flange : (n, 4, 4) array [mm]
        The commanded flange pose of each reading.
    p_measured : (n, 3) array [mm], tracker frame
        The readings.
    p_body : (n, 3) array [mm], flange frame
        The stated position of the reflector that was read.
    which : (n,) array of int
        The number of that reflector.
    p_flange_tool : (3,) array [mm], flange frame
        The stated tool point, which belongs to the body.
    robust : bool
        Whether outliers are found and left out.

    Returns
    -------
    registration : Registration
        The station and the tool point, with their covariance (9, 9).
    tf_flange_body : (4, 4) array [mm]
        The motion of the body from its stated place on the flange to its fitted one. Reflectors on one line do not show
        a turn about it, and none is made.

    Raises
    ------
    DataError, IdentifiabilityError
        As `truepose.geometry.register_with_tool` with the readings of the reflector that was read most often.

    Examples
    --------
    >>> rng, corners = np.random.default_rng(0), np.array([[80.0, 0, 100], [-40, 70, 100], [-40, -70, 100]])
    >>> flange = make_transform(Rotation.random(12, rng=rng), rng.uniform(-500, 500, (12, 3))).repeat(3, axis=0)
    >>> stated, placed = np.tile(corners, (12, 1)), np.tile(corners + [1.0, 2.0, 3.0], (12, 1))
    >>> p = np.einsum("nij,nj->ni", flange[:, :3, :3], placed) + flange[:, :3, 3]
    >>> _, motion = register_with_body(flange, p, stated, np.tile(range(3), 12), np.zeros(3))
    >>> (motion[:3, 3] + 0.0).round(6)
    array([1., 2., 3.])
    """
    fit = _start(tf_base_flange, p_measured, p_body, which, robust)
    outliers = np.zeros(len(p_measured), np.bool_)
    if robust:
        for _ in range(_STEPS):
            norms = np.linalg.norm(fit.residuals(tf_base_flange, p_measured, p_body), axis=1)
            scale = robust_scale(norms, MINIMAL, _SETTLED)
            before = fit
            fit = _step(fit, tf_base_flange, p_measured, p_body, tukey_weights(norms, scale))[0]
            if _change(before, fit, p_body) <= 1e-6 * scale:
                break
        norms = np.linalg.norm(fit.residuals(tf_base_flange, p_measured, p_body), axis=1)
        outliers = norms > OUTLIER_LIMIT * robust_scale(norms, MINIMAL, _SETTLED)
    weight = np.where(outliers, 0.0, 1.0)
    for _ in range(_STEPS):
        before = fit
        fit, covariance = _step(fit, tf_base_flange, p_measured, p_body, weight)
        if _change(before, fit, p_body) <= _SETTLED:
            break
    return _registration(fit, tf_base_flange, p_measured, p_body, outliers, covariance, p_flange_tool)


def _start(
    tf_base_flange: FloatArray, p_measured: FloatArray, p_body: FloatArray, which: IntArray, robust: bool
) -> _Fit:
    """Return a fit from the reflector that was read most often, and the places of the others seen from its station."""
    number = int(np.bincount(which).argmax())
    rows = which == number
    station = register_with_tool(tf_base_flange[rows], p_measured[rows], p_body[rows][0], robust=robust)
    p_base = station.apply(p_measured)
    in_flange = np.einsum("nji,nj->ni", tf_base_flange[:, :3, :3], p_base - tf_base_flange[:, :3, 3])
    numbers = np.unique(which)
    stated = np.array([p_body[which == k][0] for k in numbers])
    seen = np.array([np.median(in_flange[which == k], axis=0) for k in numbers])
    return _Fit(station.tf_base_tracker, _motion(stated, seen))


def _motion(stated: FloatArray, seen: FloatArray) -> FloatArray:
    """Return the rigid motion (4, 4) [mm] from stated points (m, 3) to seen ones; the least turn for points in line."""
    spread = np.linalg.svd(stated - stated.mean(axis=0))
    if len(stated) > 2 and spread[1][1] > _ON_A_LINE:
        return make_transform(*kabsch(stated, seen, np.ones(len(stated))))
    turn = np.eye(3)
    if len(stated) > 1:
        a, b = spread[2][0], np.linalg.svd(seen - seen.mean(axis=0))[2][0]
        b = b * np.sign((stated[-1] - stated[0]) @ a) * np.sign((seen[-1] - seen[0]) @ b)
        axis = np.cross(a, b)
        size = float(np.linalg.norm(axis))
        turn = Rotation.from_rotvec(axis * (np.arctan2(size, a @ b) / size if size else 0.0)).as_matrix()
    return make_transform(turn, seen.mean(axis=0) - turn @ stated.mean(axis=0))


def _step(
    fit: _Fit, tf_base_flange: FloatArray, p_measured: FloatArray, p_body: FloatArray, weight: FloatArray
) -> tuple[_Fit, FloatArray]:
    """Return the fit after one step of Gauss–Newton, and (JᵀWJ)⁻¹ (12, 12) of its parameters.

    The parameters are translation and rotation of the station about the mean reading, and of the body on the flange
    about the mean reflector.
    """
    p_base = apply_transform(fit.tf_base_tracker, p_measured)
    placed = apply_transform(fit.tf_flange_body, p_body)
    centre, middle = p_base.mean(axis=0), placed.mean(axis=0)
    turn = tf_base_flange[:, :3, :3]
    columns = np.empty((len(p_base), 3, 12))
    columns[..., :3] = np.eye(3)
    columns[..., 3:6] = -cross_matrix(p_base - centre)
    columns[..., 6:9] = -turn
    columns[..., 9:] = turn @ cross_matrix(placed - middle)
    root = np.repeat(np.sqrt(weight), 3)
    length = np.linalg.norm(columns.reshape(-1, 12), axis=0)
    length[length == 0.0] = 1.0
    matrix = root[:, None] * columns.reshape(-1, 12) / length
    residual = root * fit.residuals(tf_base_flange, p_measured, p_body).ravel()
    inverse = np.linalg.pinv(matrix, rcond=_NEGLIGIBLE)
    step = -(inverse @ residual) / length
    covariance = (inverse @ inverse.T) / np.outer(length, length)
    return _Fit(_moved(fit.tf_base_tracker, step[:6], centre), _moved(fit.tf_flange_body, step[6:], middle)), covariance


def _moved(tf: FloatArray, step: FloatArray, centre: FloatArray) -> FloatArray:
    """Return a transform followed by a translation and a rotation about a centre."""
    turn = Rotation.from_rotvec(step[3:]).as_matrix()
    return make_transform(turn @ tf[:3, :3], centre + turn @ (tf[:3, 3] - centre) + step[:3])


def _change(before: _Fit, after: _Fit, p_body: FloatArray) -> float:
    """Return how far a step moved the reflectors on the flange and the station, the larger [mm]."""
    body = apply_transform(after.tf_flange_body, p_body) - apply_transform(before.tf_flange_body, p_body)
    station = after.tf_base_tracker[:3, 3] - before.tf_base_tracker[:3, 3]
    return float(max(np.abs(body).max(), np.abs(station).max()))


def _registration(
    fit: _Fit,
    tf_base_flange: FloatArray,
    p_measured: FloatArray,
    p_body: FloatArray,
    outliers: BoolArray,
    inverse: FloatArray,
    p_flange_tool: FloatArray,
) -> tuple[Registration, FloatArray]:
    """Return the registration with the covariance of station and tool point, and the motion of the body."""
    residuals = fit.residuals(tf_base_flange, p_measured, p_body)
    freedom = max(3 * int((~outliers).sum()) - 12, 1)
    noise_std = float(np.sqrt((residuals[~outliers] ** 2).sum() / freedom))
    tool = apply_transform(fit.tf_flange_body, p_flange_tool[None])[0]
    middle = apply_transform(fit.tf_flange_body, p_body).mean(axis=0)
    centre = apply_transform(fit.tf_base_tracker, p_measured).mean(axis=0)
    to = np.zeros((9, 12))
    to[:6, :6] = np.eye(6)
    to[:3, 3:6] = -cross_matrix(fit.tf_base_tracker[:3, 3] - centre)
    to[6:, 6:9] = np.eye(3)
    to[6:, 9:] = -cross_matrix(tool - middle)
    return Registration(
        tf_base_tracker=fit.tf_base_tracker,
        residuals=residuals,
        outliers=outliers,
        covariance=noise_std**2 * (to @ inverse @ to.T),
        noise_std=noise_std,
        p_flange_tool=tool,
        swapped=np.empty((0, 2), dtype=np.intp),
        hint=write_hint(outliers, np.empty((0, 2), dtype=np.intp)),
    ), fit.tf_flange_body
