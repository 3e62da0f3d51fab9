"""Sums over all pairs of points, by distance bin: the compiled core of equation (4) and of the permutation envelope.

Every pair is visited once, in tiles; no array of n² is made. The rows are dealt out to a fixed number of tasks whose
sums are added in order, so that a result does not depend on the number of threads.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import prange
from numpy.typing import NDArray

from truepose.similarity.compiled import BLOCK, REORDER, compiled, pack

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
CellArray = NDArray[np.uint32]

TASKS: Final = 64
CELLS: Final = 1024


def pair_sums(
    x: FloatArray, e: FloatArray, edges: FloatArray, axis: FloatArray, tolerance: float, bandwidth: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return, by bin, the number of pairs, the sum of their distances and the sums of their squared differences.

    Parameters
    ----------
    x : (n, d) array
        Coordinates.
    e : (n, c) array
        Columns whose differences are squared.
    edges : (k + 1,) array
        Increasing; bin b holds edges[b] < h <= edges[b + 1].
    axis : (d,) or (0,) array
        Unit vector of a direction; empty for all directions.
    tolerance : float [rad]
        Largest angle between a pair and the axis.
    bandwidth : float
        Largest distance of one point from the axis through the other.

    Returns
    -------
    pairs : (k + 1,) array of int
        Entry 0 counts the pairs at or below edges[0]; entry b + 1 those of bin b.
    distance : (k + 1,) array
    squares : (k + 1, c) array
    """
    n, c = e.shape
    groups = -(-c // 4)
    blocks = -(-n // BLOCK)
    values = np.zeros((blocks * BLOCK, groups * 4))
    values[:n, :c] = e
    upper = np.append(edges, np.inf)
    width = edges[-1] / CELLS
    first = np.searchsorted(upper, np.arange(CELLS + 1) * width * (1 - 1e-12), side="left")
    pairs, distance, squares = _pair_sums(
        pack(x),
        values.reshape(blocks, BLOCK, groups, 4),
        n,
        upper,
        first,
        1 / width,
        axis,
        math.cos(tolerance) ** 2,
        bandwidth**2,
    )
    k = len(edges)
    return pairs.sum(axis=0)[:k], distance.sum(axis=0)[:k], squares.sum(axis=0).reshape(k + 1, -1)[:k, :c]


def largest_distance(x: FloatArray) -> float:
    """Return the largest distance between two rows of x (n, d)."""
    return math.sqrt(_largest_square(pack(x), len(x)).max())


@compiled(fastmath=REORDER)
def _squared_distances(x: FloatArray, block: FloatArray, out: FloatArray) -> None:
    out[:] = 0.0
    for a in range(x.size):
        row = block[a]
        for j in range(out.size):
            z = row[j] - x[a]
            out[j] += z * z


@compiled(fastmath=REORDER)
def _leave_out_other_directions(
    x: FloatArray,
    block: FloatArray,
    axis: FloatArray,
    cosine2: float,
    bandwidth2: float,
    square: FloatArray,
    along: FloatArray,
) -> None:
    """Set the squared distance of pairs outside the cone or the band to infinity."""
    along[:] = 0.0
    for a in range(x.size):
        row = block[a]
        for j in range(along.size):
            along[j] += (row[j] - x[a]) * axis[a]
    for j in range(along.size):
        along2 = along[j] * along[j]
        if square[j] > 0.0 and (along2 < cosine2 * square[j] or square[j] - along2 > bandwidth2):
            square[j] = np.inf


@compiled(fastmath=REORDER)
def _distances_and_cells(square: FloatArray, per_cell: float, last: float, cell: CellArray) -> None:
    for j in range(square.size):
        square[j] = math.sqrt(square[j])
    for j in range(square.size):
        cell[j] = np.uint32(min(square[j] * per_cell, last))


@compiled(fastmath=REORDER)
def _accumulate(
    h: FloatArray, cell: CellArray, first: IntArray, upper: FloatArray, mine: FloatArray, theirs: FloatArray,
    start: int, stop: int, pairs: IntArray, distance: FloatArray, squares: FloatArray,
) -> None:  # fmt: skip
    for j in range(start, stop):
        q = first[cell[j]]
        while h[j] > upper[q]:
            q += 1
        pairs[q] += 1
        distance[q] += h[j]
        for g in range(mine.shape[0]):  # four columns at a time: loads before stores, so that they become one vector
            z0, z1 = mine[g, 0] - theirs[j, g, 0], mine[g, 1] - theirs[j, g, 1]
            z2, z3 = mine[g, 2] - theirs[j, g, 2], mine[g, 3] - theirs[j, g, 3]
            s0, s1 = squares[q, g, 0] + z0 * z0, squares[q, g, 1] + z1 * z1
            s2, s3 = squares[q, g, 2] + z2 * z2, squares[q, g, 3] + z3 * z3
            squares[q, g, 0], squares[q, g, 1], squares[q, g, 2], squares[q, g, 3] = s0, s1, s2, s3


@compiled(parallel=True)
def _pair_sums(
    points: FloatArray, values: FloatArray, n: int, upper: FloatArray, first: IntArray, per_cell: float,
    axis: FloatArray, cosine2: float, bandwidth2: float,
) -> tuple[IntArray, FloatArray, FloatArray]:  # fmt: skip
    blocks, d, width = points.shape
    groups = values.shape[2]
    pairs = np.zeros((TASKS, upper.size), np.int64)
    distance = np.zeros((TASKS, upper.size))
    squares = np.zeros((TASKS, upper.size, groups, 4))
    for task in prange(TASKS):
        h, along, cell, x = np.empty(width), np.empty(width), np.empty(width, np.uint32), np.empty(d)
        for i in range(task, n, TASKS):
            home, place = i // width, i % width
            x[:] = points[home, :, place]
            for b in range(home, blocks):
                _squared_distances(x, points[b], h)
                if axis.size > 0:
                    _leave_out_other_directions(x, points[b], axis, cosine2, bandwidth2, h, along)
                _distances_and_cells(h, per_cell, first.size - 1.0, cell)
                start = place + 1 if b == home else 0
                stop = min(width, n - b * width)
                _accumulate(
                    h,
                    cell,
                    first,
                    upper,
                    values[home, place],
                    values[b],
                    start,
                    stop,
                    pairs[task],
                    distance[task],
                    squares[task],
                )
    return pairs, distance, squares


@compiled(parallel=True)
def _largest_square(points: FloatArray, n: int) -> FloatArray:
    blocks, d, width = points.shape
    largest = np.zeros(TASKS)
    for task in prange(TASKS):
        square, x = np.empty(width), np.empty(d)
        best = 0.0
        for i in range(task, n, TASKS):
            x[:] = points[i // width, :, i % width]
            for b in range(i // width, blocks):
                _squared_distances(x, points[b], square)
                best = max(best, square[: min(width, n - b * width)].max())
        largest[task] = best
    return largest
