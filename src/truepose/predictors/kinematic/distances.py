"""Distances from fixed points as rows of a fit.

A distance d from o to the tool point p + e shows e along the unit vector u from o to p + e alone. It is a row of
position whose noise is that of the distance along u, and so large across u that these components tell nothing.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.predictors.distances import DistanceRows

_ACROSS: Final = 1e3  # mm, the standard deviation of the components that are not measured
_SAME_JOINTS: Final = 2e-3  # rad


def aimed(rows: DistanceRows, p: FloatArray, e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the unit vectors u and the errors along them, linearised at estimated errors, both (m, 3).

    With v = p + e - o: d = |p + e' - o| is |v| + u (e' - e) to first order, so that u e' = d - |v| + u e.

    Parameters
    ----------
    rows : DistanceRows
        The distances.
    p, e : (m, 3) arrays [mm], base frame
        The nominal positions of the tool point, and their estimated errors.
    """
    v = p + e - rows.origin
    length = np.linalg.norm(v, axis=1)
    u = v / length[:, None]
    return u, u * (rows.distance - length + np.einsum("ma,ma->m", u, e))[:, None]


def noise_blocks(variance: FloatArray, weight: FloatArray, u: FloatArray, std: FloatArray) -> FloatArray:
    """Return the noise covariances of all rows of a fit, (n, 3, 3) [mm²], with those of distances at the end.

    Parameters
    ----------
    variance : (n, 3) array [mm²]
        The noise variances of all rows, without the readings of distances.
    weight : (n,) array
        The weights of the rows.
    u : (m, 3) array
        The unit vectors of the distances.
    std : (m,) array [mm]
        The standard deviations of the distances.
    """
    blocks = variance[:, :, None] * np.eye(3)
    along = u[:, :, None] * u[:, None, :]
    blocks[-len(u) :] += (std**2 / weight[-len(u) :])[:, None, None] * along + _ACROSS**2 * (np.eye(3) - along)
    return blocks


def widened(variance: FloatArray, weight: FloatArray, u: FloatArray, std: FloatArray) -> FloatArray:
    """Return what small weights add to `noise_blocks`, (n, 3, 3) [mm²]; parameters are those of it."""
    blocks = (variance * (1.0 - weight[:, None]))[:, :, None] * np.eye(3)
    own = weight[-len(u) :]
    blocks[-len(u) :] += (std**2 * (1.0 - own) / own)[:, None, None] * u[:, :, None] * u[:, None, :]
    return blocks


def owners(rows: DistanceRows, q: FloatArray) -> IntArray:
    """Return the sample (n, dof) [rad] at whose pose each distance was read, (m,); n, n + 1 … for a pose of its own.

    Distances are left out together with the sample of their pose.
    """
    apart = np.abs(rows.q[:, None, :] - q[None]).max(axis=2)
    nearest = apart.argmin(axis=1)
    return np.where(apart.min(axis=1) <= _SAME_JOINTS, nearest, len(q) + np.arange(len(rows)))
