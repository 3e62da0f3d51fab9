"""Repeated measurements of one point: averaged, with their scatter as an estimate of the noise.

Points nearer to each other than the last digits of their coordinates are one point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from truepose._typing import FloatArray, IntArray
from truepose.errors import KrigingError

AGREE: Final = 1e-9
"""Repeats agree when they differ by less than this share of the largest error."""

SAME: Final = 1e-10
"""Points are one point when they are apart by less than this share of the points' extent."""


@dataclass(frozen=True, eq=False)
class Points:
    """The distinct points among n samples; a repeat has the coordinates of another sample, to their last digits.

    Attributes
    ----------
    x : (u, d) array
        The distinct points; in the order of the samples when nothing is repeated.
    inverse : (n,) array of int
        The point of each sample.
    count : (u,) array of int
        The number of samples at each point.
    """

    x: FloatArray
    inverse: IntArray
    count: IntArray

    @classmethod
    def of(cls, x: FloatArray) -> Self:
        """Find the distinct rows of x (n, d)."""
        if _apart(x):
            return cls(x, np.arange(len(x)), np.ones(len(x), np.int64))
        points, inverse = np.unique(x, axis=0, return_inverse=True)
        first, group = _alike(points)
        inverse = group[inverse.reshape(-1)]
        return cls(points[first], inverse, np.bincount(inverse))

    @property
    def repeated(self) -> bool:
        """Whether any point was measured more than once."""
        return len(self.x) < len(self.inverse)

    @property
    def first(self) -> IntArray:
        """The first sample at each point, (u,)."""
        return np.unique(self.inverse, return_index=True)[1]

    def scatter(self, e: FloatArray) -> FloatArray:
        """Return the pooled variance of the repeats about their means, (k,); 0 where nothing is repeated."""
        freedom = len(e) - len(self.x)
        if not freedom:
            return np.zeros(e.shape[1])
        squares: FloatArray = ((e - self._sum(e)[self.inverse] / self.count[self.inverse, None]) ** 2).sum(axis=0)
        return squares / freedom

    def average(self, e: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean of each point weighted by 1/variance, and its variance, both (u, k)."""
        if not self.repeated:
            return e, variance
        weights = 1 / np.maximum(variance, 1e-200)
        total = self._sum(weights)
        return self._sum(weights * e) / total, np.where(total > 1e199, 0.0, 1 / total)

    def refuse_contradictions(self, e: FloatArray) -> None:
        """Raise KrigingError, naming the rows, where repeats without noise differ."""
        if not self.repeated:
            return
        order = np.argsort(self.inverse, kind="stable")
        starts = np.concatenate([[0], np.cumsum(self.count)[:-1]])
        spread = np.maximum.reduceat(e[order], starts) - np.minimum.reduceat(e[order], starts)
        bad = np.flatnonzero((spread > AGREE * np.abs(e).max()).any(axis=1))
        if bad.size:
            rows = np.flatnonzero(self.inverse == bad[0])
            raise KrigingError(
                f"{{rows}} are one point, but their errors differ by {spread[bad[0]].max():.3g}, and exact Kriging "
                "cannot pass through both; use exact=False, give noise_std, or average them",
                rows[:5].tolist(),
            )

    def _sum(self, values: FloatArray) -> FloatArray:
        total = np.zeros((len(self.x), values.shape[1]))
        np.add.at(total, self.inverse, values)
        return total


def _reach(x: FloatArray) -> float:
    """Return the distance up to which points are one point."""
    return SAME * math.dist(x.max(axis=0), x.min(axis=0))


def _apart(x: FloatArray) -> bool:
    """Whether no two rows are one point: seen from one coordinate if possible, otherwise from a tree."""
    first = np.sort(x[:, 0])
    if len(x) < 2 or (first[1:] - first[:-1]).min() > 2 * SAME * math.sqrt(np.vdot(x, x)):  # at least `_reach`
        return True
    tree = KDTree(x)
    return bool(tree.count_neighbors(tree, _reach(x)) == len(x))  # each point with itself


def _alike(points: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the first of each group of points that differ in their last digits only, and the group of each point."""
    alone = np.arange(len(points))
    pairs = KDTree(points).query_pairs(_reach(points), output_type="ndarray")
    if not len(pairs):
        return alone, alone
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    _, group = connected_components(graph, directed=False)
    return np.unique(group, return_index=True)[1], group.astype(np.int64)
