"""Coordinates and bins for semivariograms: joint space with its weights, approach signs, equal counts."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import pdist

from truepose._typing import FloatArray
from truepose.errors import DataError, KrigingError
from truepose.similarity.experimental import check_points

MOST_PAIRS: Final = 4_000_000


def lever_arm_weights(position_jacobian: ArrayLike) -> FloatArray:
    """Return w_k = mean ‖∂P/∂q_k‖² [mm²/rad²], (dof,): joint distances then are about the motion of the tool in mm.

    Parameters
    ----------
    position_jacobian : (n, 3, dof) array_like [mm/rad]
        The derivative of the position by the joints.

    Examples
    --------
    >>> lever_arm_weights([[[300.0], [400.0], [0.0]]])
    array([250000.])
    """
    J = np.asarray(position_jacobian, dtype=np.float64)
    if J.ndim != 3 or 0 in J.shape or not np.isfinite(J).all():
        raise DataError(f"position_jacobian has shape {J.shape}; expected (n, 3, dof) finite numbers")
    return np.asarray((J**2).sum(axis=1).mean(axis=0))


def joint_coordinates(
    q: ArrayLike,
    weights: ArrayLike | None = None,
    approach: ArrayLike | None = None,
    approach_weights: ArrayLike = 1.0,
) -> FloatArray:
    """Return coordinates whose plain distance is sqrt(Σ w_k (q_k − q'_k)² + Σ v_k (s_k − s'_k)²/4), (n, dof | 2 dof).

    Parameters
    ----------
    q : (n, dof) array_like [rad]
        The joints.
    weights : (dof,) array_like, optional
        The weights w; ones when not given. See `lever_arm_weights`.
    approach : (n, dof) array_like, optional
        s: sign of the last motion of each joint, −1, 0 (not known) or 1.
    approach_weights : float or (dof,) array_like
        v: the squared distance of two samples that differ in the direction of approach alone.

    Examples
    --------
    >>> pdist(joint_coordinates([[0.0], [0.0]], approach=[[1], [-1]], approach_weights=0.25))
    array([0.5])
    """
    joints, _ = check_points(q, np.zeros(len(np.atleast_1d(q))), weights)
    if approach is None:
        return joints
    signs = np.asarray(approach, dtype=np.float64)
    v = np.asarray(approach_weights, dtype=np.float64)
    if signs.shape != joints.shape or not np.isin(signs, (-1, 0, 1)).all():
        raise DataError(f"approach has shape {signs.shape}; expected {joints.shape}, each -1, 0 or 1")
    if v.shape not in ((), joints.shape[1:]) or not (v >= 0).all():
        raise DataError(f"approach_weights is {v}; expected a number >= 0, or one for each joint")
    return np.hstack([joints, signs * np.sqrt(v) / 2])


def equal_count_bins(
    x: ArrayLike,
    bins: int = 20,
    max_lag: float | None = None,
    *,
    weights: ArrayLike | None = None,
    rng: np.random.Generator | int = 0,
) -> FloatArray:
    """Return edges (bins + 1,) between which lie equally many pairs, for `experimental_variogram`.

    Of more than 4 million pairs, those of a random part of the points are counted.

    Parameters
    ----------
    x : (n, d) array_like
        The points.
    bins : int
        The number of bins.
    max_lag : float, optional
        The largest lag; half the largest distance when not given.
    weights : (d,) array_like, optional
        The weights of the distance.
    rng : Generator or int
        The generator or seed for the random part.

    Examples
    --------
    >>> equal_count_bins(np.arange(6.0)[:, None] ** 2, 2, 25.0)
    array([ 0. , 10.5, 25. ])
    """
    points, _ = check_points(x, np.zeros(len(np.atleast_1d(x))), weights)
    most = int(np.sqrt(2 * MOST_PAIRS))
    if len(points) > most:
        points = points[np.random.default_rng(rng).choice(len(points), most, replace=False)]
    h = np.sort(pdist(points))
    if not h[-1] > 0:
        raise KrigingError(f"all {len(points)} points are the same; bins need points that are apart")
    longest = float(h[-1]) / 2 if max_lag is None else max_lag
    h = h[(h > 0) & (h <= longest)]
    if bins < 1 or len(h) < bins:
        raise DataError(f"{len(h)} pairs lie within max_lag; they cannot fill {bins} bins of equal count")
    last = np.ceil(np.arange(1, bins) * len(h) / bins).astype(int)
    return np.unique(np.concatenate([[0.0], (h[last - 1] + h[last]) / 2, [longest]]))
