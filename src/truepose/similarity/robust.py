"""Estimators of the semivariance from the differences of a bin; those that resist gross errors, and the cloud.

Matheron is theory (4). With N differences z:

========= ============================================================== ======================================
cressie   (1/N Σ |z|^½)⁴ / (0.457 + 0.494/N + 0.045/N²) / 2              N. Cressie & D. Hawkins, Math. Geology 12
                                                                         (1980)
dowd      2.198 median(|z|)² / 2                                         P. A. Dowd, in: Geostatistics for Natural
                                                                         Resources Characterization (1984)
genton    (2.2191 {|z_i − z_j|; i < j}_(k))² / 2, k = C(⌊N/2⌋ + 1, 2)    M. G. Genton, Math. Geology 30 (1998)
========= ============================================================== ======================================

Genton's z have signs: here each pair is taken in the order in which its first coordinate that differs rises, so that
the order of the samples does not matter. Dowd and Genton need all differences at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.numerics.kernels import compiled
from truepose.numerics.pairs import pair_sums

ESTIMATORS: Final = ("matheron", "cressie", "dowd", "genton")

MOST_POINTS: Final = 5000
"""Points whose pairs are held in memory: some 12 million."""


class Cloud(NamedTuple):
    """All pairs of points: the variogram cloud.

    Attributes
    ----------
    first, second : (N,) arrays of int
        The points of each pair, ordered so that the first coordinate that differs rises.
    distance : (N,) array
        The distances, in the unit of the coordinates.
    """

    first: IntArray
    second: IntArray
    distance: FloatArray


def estimate(
    estimator: str,
    x: FloatArray,
    e: FloatArray,
    edges: FloatArray,
    axis: FloatArray,
    tolerance: float,
    bandwidth: float,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return by bin, entry 0 at or below edges[0], the pairs, the sum of distances, and the semivariance (k + 1, c)."""
    if estimator not in ESTIMATORS:
        raise DataError(f"variogram estimator {estimator!r} is not known; use one of {', '.join(ESTIMATORS)}")
    if estimator in ("matheron", "cressie"):
        pairs, distance, sums = pair_sums(x, e, edges, axis, tolerance, bandwidth, roots=estimator == "cressie")
        with np.errstate(invalid="ignore", divide="ignore"):
            mean, n = sums / pairs[:, None], pairs[:, None]
            return pairs, distance, mean / 2 if estimator == "matheron" else mean**4 / (0.914 + 0.988 / n + 0.09 / n**2)
    of_differences = _dowd if estimator == "dowd" else _genton
    return _from_cloud(of_differences, x, e, edges, axis, tolerance, bandwidth)


def cloud(x: FloatArray, axis: FloatArray, tolerance: float, bandwidth: float, longest: float = np.inf) -> Cloud:
    """Return all pairs of points (n, d) along an axis (or all), up to a distance; n at most `MOST_POINTS`."""
    n = len(x)
    if n > MOST_POINTS:
        raise DataError(
            f"{n} points have too many pairs to be held at once (at most {MOST_POINTS} points); "
            "use the estimators matheron or cressie, or a part of the points"
        )
    i, j = np.triu_indices(n, 1)
    step = x[j] - x[i]
    distance = np.sqrt(np.einsum("nd,nd->n", step, step))
    keep = distance <= longest
    if axis.size:
        along2 = (step @ axis) ** 2
        square = distance**2
        inside = (along2 >= np.cos(tolerance) ** 2 * square) & (square - along2 <= bandwidth**2)
        keep &= inside | (distance == 0)
    turned = np.take_along_axis(step, (step != 0).argmax(axis=1)[:, None], axis=1)[:, 0] < 0
    i, j = np.where(turned, j, i)[keep], np.where(turned, i, j)[keep]
    return Cloud(i, j, distance[keep])


def _from_cloud(
    of_differences: Callable[[FloatArray], float],
    x: FloatArray,
    e: FloatArray,
    edges: FloatArray,
    axis: FloatArray,
    tolerance: float,
    bandwidth: float,
) -> tuple[IntArray, FloatArray, FloatArray]:
    found = cloud(x, axis, tolerance, bandwidth, float(edges[-1]))
    bins = np.searchsorted(edges, found.distance, side="left")
    order = np.argsort(bins, kind="stable")
    count = np.bincount(bins, minlength=len(edges))
    limits = np.concatenate([[0], np.cumsum(count)])
    distance = np.bincount(bins, found.distance, minlength=len(edges))
    gamma = np.full((len(edges), e.shape[1]), np.nan)
    for c in range(e.shape[1]):
        z = (e[found.second, c] - e[found.first, c])[order]
        for b in np.flatnonzero(count):
            gamma[b, c] = of_differences(z[limits[b] : limits[b + 1]])
    return count.astype(np.int64), distance.astype(np.float64), gamma


def _dowd(z: FloatArray) -> float:
    return float(2.198 * np.median(np.abs(z)) ** 2 / 2)


def _genton(z: FloatArray) -> float:
    n = len(z)
    if n < 2:
        return np.nan
    half = n // 2 + 1
    return float((2.2191 * _smallest_gap(np.sort(z), half * (half - 1) // 2)) ** 2 / 2)


@compiled()
def _smallest_gap(z: FloatArray, k: int) -> float:
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
