"""Fewer triangles: corners of equal place become one, then edges collapse where the surface changes least."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._extras import needed
from truepose._typing import FloatArray
from truepose.robots.io.triangles import IntArray

_TOLERATED: Final = 1.2
_FINEST: Final = 2048  # cubes along the longest side
_DOUBLINGS: Final = 12


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
    with needed("a mesh of an arm", "app"):
        import fast_simplification  # compiled, and only needed here

    points, triangles, most = *welded(points, triangles), max(most, 4)
    if len(triangles) <= most:
        return points, triangles
    extent = float(np.ptp(points, axis=0).max())
    coarse, corners = points, triangles
    # edges of slivers and of triangles that do not hang together cannot collapse: then their points are merged first
    for step in range(_DOUBLINGS):
        fewer, left = fast_simplification.simplify(coarse, corners, target_count=most)
        if 0 < len(left) <= _TOLERATED * most and np.isfinite(fewer).all():
            return welded(fewer, left)
        coarse, corners = _merged(points, triangles, extent / _FINEST * 2**step)
        if len(corners) <= most:
            break
    return coarse, corners


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


def _merged(points: FloatArray, triangles: IntArray, cell: float) -> tuple[FloatArray, IntArray]:
    """Return a mesh in which all points of a cube of a grid are one point, their mean."""
    cubes = np.round((points - points.min(axis=0)) / cell).astype(np.int32)
    number, count = np.unique(cubes.view("V12").ravel(), return_inverse=True, return_counts=True)[1:]
    means = np.column_stack([np.bincount(number, axis) for axis in points.T]) / count[:, None]
    coarse, corners = welded(means, number[triangles].astype(np.int32))
    return coarse, corners[np.unique(np.sort(corners, axis=1), axis=0, return_index=True)[1]]


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
