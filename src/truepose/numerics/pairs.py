"""Sums over all pairs of points, by distance bin: the compiled core of theory (4) and of the permutation envelope.

Pairs are visited once, in tiles of near points; a tile that lies beyond the largest lag of a point is passed over. No
array of n² is made. The rows are dealt out to a fixed number of tasks whose sums are added in order, so that a result
does not depend on the number of threads.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from truepose._typing import FloatArray, IntArray
from truepose.numerics.kernels import BLOCK, REORDER, compiled, pack, squared_distances
from truepose.numerics.threads import in_threads

CellArray = NDArray[np.int32]

TASKS: Final = 64
ROWS: Final = 64
CELLS: Final = 1024
BITS: Final = 11
"""Bits of an order statistic that are found at a time."""
TOP: Final = 64 - 64 % BITS
"""The place of the first of them that are found."""
LANES: Final = 4
"""Columns that are summed as one vector."""


def pair_sums(
    x: FloatArray,
    e: FloatArray,
    edges: FloatArray,
    axis: FloatArray,
    tolerance: float,
    bandwidth: float,
    *,
    roots: bool = False,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return, by bin, the number of pairs, the sum of their distances and the sums of their squared differences.

    Parameters
    ----------
    x : (n, d) array
        The coordinates.
    e : (n, c) array
        The columns whose differences are squared.
    edges : (k + 1,) array
        The increasing edges; bin b holds edges[b] < h <= edges[b + 1].
    axis : (d,) or (0,) array
        The unit vector of a direction; empty for all directions.
    tolerance : float [rad]
        The largest angle between a pair and the axis.
    bandwidth : float
        The largest distance of one point from the axis through the other.
    roots : bool
        Whether square roots of absolute differences are summed instead of squares.

    Returns
    -------
    pairs : (k + 1,) array of int
        Entry 0 counts the pairs at or below edges[0]; entry b + 1 those of bin b.
    distance : (k + 1,) array
        The sum of the distances of each bin.
    squares : (k + 1, c) array
        The sums of squared differences of each bin.
    """
    n, c = e.shape
    groups = -(-(c + 1) // LANES)
    order = by_place(x, BLOCK)
    x, e = x[order], e[order]
    points = pack(x)
    blocks, _, block = points.shape
    starts = np.arange(0, n, block)
    lowest, highest = np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)
    values = np.zeros((blocks * block, groups * LANES))
    values[:n, :c] = e
    values[:, c] = 1.0  # the lane in which pairs are counted: nothing is taken off it
    home = values.copy()
    home[:, c] = 0.0
    upper = np.append(edges, np.inf)
    width = edges[-1] / CELLS
    cells = np.arange(CELLS + 2) * width
    first = np.searchsorted(upper, cells[:-1] * (1 - 1e-12), side="left").astype(np.int32)
    steps = int((np.searchsorted(upper[:-1], cells[1:] * (1 + 1e-12), side="left") - first).max())
    shape = (blocks, block, groups * LANES)
    distance, sums = np.zeros((TASKS, upper.size)), np.zeros((TASKS, upper.size, groups * LANES))
    in_threads(
        _pair_sums,
        TASKS,
        points,
        lowest,
        highest,
        (edges[-1] * (1 + 1e-9)) ** 2,
        home.reshape(shape),
        values.reshape(shape),
        n,
        upper,
        first,
        max(steps, 1),
        1 / width,
        axis,
        math.cos(tolerance) ** 2,
        bandwidth**2,
        roots,
        distance,
        sums,
    )
    k = len(edges)
    total = sums.sum(axis=0)[:k]
    return np.rint(total[:, c]).astype(np.int64), distance.sum(axis=0)[:k], total[:, :c]


def by_place(x: FloatArray, size: int) -> IntArray:
    """Return an order of the rows of x (n, d) in which each `size` of them, from the first on, lie near one another.

    The rows are halved along their widest coordinate until a part is small enough.
    """
    done: list[IntArray] = []
    waiting: list[IntArray] = [np.arange(len(x))]
    while waiting:
        rows = waiting.pop()
        if len(rows) <= size:
            done.append(rows)
            continue
        axis = int(np.ptp(x[rows], axis=0).argmax())
        half = -(-len(rows) // (2 * size)) * size  # parts end where blocks do
        rows = rows[np.argpartition(x[rows, axis], half - 1)]
        waiting += [rows[half:], rows[:half]]
    return np.concatenate(done)


def largest_distance(x: FloatArray) -> float:
    """Return the largest distance between two rows of x (n, d).

    Two rows are never farther apart than the sum of their distances from the centre, so the rows far from it are
    compared with few others, and the rows near it with none.
    """
    away = np.linalg.norm(x - x.mean(axis=0), axis=1)
    order = np.argsort(-away)
    x, away = x[order], away[order]
    largest = 0.0
    for start in range(0, len(x), ROWS):
        least = largest * (1 - 1e-12) - away[start]  # of the other row; less for rounding
        stop = int(np.searchsorted(-away, -least, side="right"))
        if stop <= start:
            break
        largest = max(largest, float(cdist(x[start : start + ROWS], x[start:stop]).max()))
    return largest


def middle_gaps(
    x: FloatArray, e: FloatArray, edges: FloatArray, axis: FloatArray, tolerance: float, bandwidth: float
) -> FloatArray:
    """Return, by bin, the medians of the absolute differences of pairs, (k + 1, c); NaN in an empty bin.

    The parameters are those of `pair_sums`. No difference is kept: the bits of the order statistics are found some at
    a time, from counts of the differences that agree in the bits before.
    """
    shape = len(edges), e.shape[1]

    def count(known: NDArray[np.uint64], shift: int) -> IntArray:
        found = np.zeros((*shape, 1 << BITS), np.int64)
        _count_bits(x, e, edges, axis, math.cos(tolerance) ** 2, bandwidth**2, known, shift, found)
        return found

    first = count(np.zeros(shape, np.uint64), TOP)
    pairs: IntArray = first.sum(axis=2)
    low, high = (_order_statistics(count, first, np.maximum(rank, 0)) for rank in ((pairs - 1) // 2, pairs // 2))
    return np.where(pairs > 0, (low + high) / 2, np.nan)


def _order_statistics(
    count: Callable[[NDArray[np.uint64], int], IntArray], found: IntArray, rank: IntArray
) -> FloatArray:
    """Return the differences of some ranks (from 0); `found` are the counts of their highest bits."""
    known = np.zeros(rank.shape, np.uint64)
    for shift in range(TOP, -1, -BITS):
        found = found if shift == TOP else count(known, shift)
        reached = np.cumsum(found, axis=2)
        bits = np.minimum((reached <= rank[..., None]).sum(axis=2), (1 << BITS) - 1)  # beyond all in an empty bin
        before = np.take_along_axis(reached - found, bits[..., None], axis=2)[..., 0]
        known, rank = known << np.uint64(BITS) | bits.astype(np.uint64), rank - before
    return known.view(np.float64)


@compiled(nogil=True)
def _count_bits(
    x: FloatArray, e: FloatArray, edges: FloatArray, axis: FloatArray, cosine2: float, bandwidth2: float,
    known: NDArray[np.uint64], shift: int, count: IntArray,
) -> None:  # fmt: skip
    """Count, by bin and column, the `BITS` bits from `shift` on of absolute differences with known bits above."""
    gap = np.empty(1)
    key = gap.view(np.uint64)
    low, high, mask = np.uint64(shift), np.uint64(shift + BITS), np.uint64((1 << BITS) - 1)
    for i in range(len(x)):
        for j in range(i):
            square, along = 0.0, 0.0
            for a in range(x.shape[1]):
                square += (x[j, a] - x[i, a]) ** 2
            if axis.size > 0 and square > 0.0:
                for a in range(x.shape[1]):
                    along += (x[j, a] - x[i, a]) * axis[a]
                if along * along < cosine2 * square or square - along * along > bandwidth2:
                    continue
            h = math.sqrt(square)
            if h > edges[-1]:
                continue
            b = np.searchsorted(edges, h)
            for c in range(e.shape[1]):
                gap[0] = abs(e[j, c] - e[i, c])
                if high > 63 or key[0] >> high == known[b, c]:
                    count[b, c, (key[0] >> low) & mask] += 1


@compiled()
def smallest_gap(z: FloatArray, k: int) -> float:
    """Return the k-th smallest (from 1) of z_j − z_i, i < j, of sorted z: bisection, counting with two fingers."""
    low, high = -1.0, z[-1] - z[0]  # fewer than k gaps are <= low; k or more are <= high
    while True:
        middle = 0.0 if low < 0.0 else (low + high) / 2
        if not (low < middle < high):
            return float(high)
        count, i, largest = 0, 0, 0.0
        for j in range(z.size):
            while z[j] - z[i] > middle:
                i += 1
            count += j - i
            largest = max(largest, z[j] - z[i])
        if count >= k:
            high = largest  # the largest gap that is <= middle
        else:
            low = middle


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
def _distances_and_bins(
    square: FloatArray, per_cell: float, first: CellArray, upper: FloatArray, steps: int, bins: CellArray
) -> None:
    """Replace squared distances by distances, and find the bin of each: from a table of cells, then step by step."""
    last = first.size - 1.0
    for j in range(square.size):
        square[j] = math.sqrt(square[j])
    for j in range(square.size):
        bins[j] = np.int32(min(square[j] * per_cell, last))
    for j in range(square.size):
        q = first[bins[j]]
        bins[j] = q + (1 if square[j] > upper[q] else 0)
    for _ in range(1, steps):
        for j in range(square.size):
            bins[j] += 1 if square[j] > upper[bins[j]] else 0


@compiled(fastmath=REORDER)
def _add_squares(
    h: FloatArray, bins: CellArray, mine: FloatArray, theirs: FloatArray, start: int, stop: int,
    distance: FloatArray, sums: FloatArray,
) -> None:  # fmt: skip
    m0, m1, m2, m3 = mine[0], mine[1], mine[2], mine[3]
    for j in range(start, stop):  # loads before stores, so that the four columns become one vector
        q = bins[j]
        distance[q] += h[j]
        z0, z1, z2, z3 = theirs[j, 0] - m0, theirs[j, 1] - m1, theirs[j, 2] - m2, theirs[j, 3] - m3
        s0, s1 = sums[q, 0] + z0 * z0, sums[q, 1] + z1 * z1
        s2, s3 = sums[q, 2] + z2 * z2, sums[q, 3] + z3 * z3
        sums[q, 0], sums[q, 1], sums[q, 2], sums[q, 3] = s0, s1, s2, s3


@compiled(fastmath=REORDER)
def _add_many_squares(
    h: FloatArray, bins: CellArray, mine: FloatArray, theirs: FloatArray, start: int, stop: int,
    distance: FloatArray, sums: FloatArray,
) -> None:  # fmt: skip
    for j in range(start, stop):
        q = bins[j]
        distance[q] += h[j]
        for a in range(mine.size):
            z = theirs[j, a] - mine[a]
            sums[q, a] += z * z


@compiled(fastmath=REORDER)
def _add_roots(
    h: FloatArray, bins: CellArray, mine: FloatArray, theirs: FloatArray, start: int, stop: int,
    distance: FloatArray, sums: FloatArray,
) -> None:  # fmt: skip
    for j in range(start, stop):
        q = bins[j]
        distance[q] += h[j]
        for a in range(mine.size):
            sums[q, a] += math.sqrt(abs(theirs[j, a] - mine[a]))


@compiled(nogil=True)
def _pair_sums(
    begin: int, end: int, points: FloatArray, lowest: FloatArray, highest: FloatArray, farthest2: float,
    home_values: FloatArray, values: FloatArray, n: int, upper: FloatArray, first: CellArray, steps: int,
    per_cell: float, axis: FloatArray, cosine2: float, bandwidth2: float, roots: bool, distance: FloatArray,
    sums: FloatArray,
) -> None:  # fmt: skip
    blocks, d, width = points.shape
    lanes = values.shape[2]
    h, along, bins, x = np.empty(width), np.empty(width), np.empty(width, np.int32), np.empty(d)
    for task in range(begin, end):
        for i in range(task, n, TASKS):
            home, place = i // width, i % width
            x[:] = points[home, :, place]
            mine = home_values[home, place]
            for b in range(home, blocks):
                away2 = 0.0
                for a in range(d):
                    away = max(lowest[b, a] - x[a], x[a] - highest[b, a], 0.0)
                    away2 += away * away
                if away2 > farthest2:
                    continue
                squared_distances(x, points[b], h)
                if axis.size > 0:
                    _leave_out_other_directions(x, points[b], axis, cosine2, bandwidth2, h, along)
                _distances_and_bins(h, per_cell, first, upper, steps, bins)
                start = place + 1 if b == home else 0
                stop = min(width, n - b * width)
                if roots:
                    _add_roots(h, bins, mine, values[b], start, stop, distance[task], sums[task])
                elif lanes == LANES:
                    _add_squares(h, bins, mine, values[b], start, stop, distance[task], sums[task])
                else:
                    _add_many_squares(h, bins, mine, values[b], start, stop, distance[task], sums[task])
