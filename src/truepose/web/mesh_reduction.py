"""Fewer triangles: corners of equal place become one, then edges collapse where the surface changes least."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.robots.io.triangles import IntArray

_TOLERATED: Final = 1.2
_DOUBLINGS: Final = 40


def reduced(points: FloatArray, triangles: IntArray, most: int) -> tuple[FloatArray, IntArray]:
    """Return a mesh of at most about `most` triangles that looks like another one.

    Parameters
    ----------
    points : (n, 3) array
    triangles : (m, 3) array of int32
    most : int
        The number of triangles that is wanted.

    Returns
    -------
    (n', 3) array and (m', 3) array of int32
        Without triangles that have no area by their corners, and without points that no triangle uses.
    """
    import fast_simplification  # compiled, and only needed here

    points, triangles = welded(points, triangles)
    if len(triangles) <= most:
        return points, triangles
    fewer, corners = fast_simplification.simplify(points, triangles, target_count=max(most, 4))
    if np.isfinite(fewer).all() and 0 < len(corners) <= _TOLERATED * most:
        return welded(fewer, corners)
    return _clustered(points, triangles, most)


def welded(points: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """Return a mesh whose points differ as 32-bit numbers, without unused points and triangles with equal corners."""
    used, corners = np.unique(triangles, return_inverse=True)
    places = np.ascontiguousarray(points[used].reshape(-1, 3), np.float32) + np.float32(0.0)  # −0 is 0
    _, first, number = np.unique(places.view("V12").ravel(), return_index=True, return_inverse=True)
    corners = number[corners].reshape(-1, 3)
    a, b, c = corners.T
    kept = corners[(a != b) & (b != c) & (c != a)]
    left, kept = np.unique(kept, return_inverse=True)
    return places[first[left]].astype(np.float64), kept.astype(np.int32).reshape(-1, 3)


def _clustered(points: FloatArray, triangles: IntArray, most: int) -> tuple[FloatArray, IntArray]:
    """Return a mesh whose points lie on a grid as fine as the number of triangles allows.

    For triangles that do not hang together: they have no edge between two of them that could collapse.
    """
    low = points.min(axis=0)
    cell = float(np.ptp(points, axis=0).max()) / 1024 or 1.0
    for _ in range(_DOUBLINGS):
        coarse, corners = welded(low + cell * np.round((points - low) / cell), triangles)
        corners = corners[np.unique(np.sort(corners, axis=1), axis=0, return_index=True)[1]]
        if len(corners) <= most:
            return welded(coarse, corners)
        cell *= 2
    return points[:0], triangles[:0]


def areas(points: FloatArray, triangles: IntArray) -> float:
    """Return the area of a mesh in the square of its unit."""
    a, b, c = (points[corner] for corner in triangles.T)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def shares(budget: int, counts: list[int], weights: list[float]) -> list[int]:
    """Return how many triangles each mesh gets: by its weight, and never more than it has.

    Examples
    --------
    >>> shares(100, [10, 500, 500], [1.0, 1.0, 2.0])
    [10, 30, 60]
    """
    given = np.zeros(len(counts), np.int64)
    open_ = np.ones(len(counts), bool)
    have, weight = np.array(counts), np.maximum(np.array(weights, float), 1e-12)
    while open_.any():
        left = budget - given[~open_].sum()
        share = np.floor(left * weight / weight[open_].sum()).astype(np.int64)
        full = open_ & (have <= share)
        if not full.any():
            given[open_] = share[open_]
            break
        given[full] = have[full]
        open_ &= ~full
    return [int(one) for one in given]
