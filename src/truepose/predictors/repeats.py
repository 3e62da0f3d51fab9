"""Repeated measurements of one point: averaged, with their scatter as an estimate of the noise.

Points nearer to each other than the last digits of their coordinates are one point. Points that are only near must not
contradict each other where a prediction is to pass through both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from truepose._typing import FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.similarity import VariogramModel

AGREE: Final = 1e-9
"""Repeats agree when they differ by less than this share of the largest error."""

SAME: Final = 1e-10
"""Points are one point when they are apart by less than this share of the points' extent."""

NEAR: Final = 0.01
"""Points are near when they are apart by less than this share of the usual distance to the nearest point; the errors
of near points differ when they do so by more than this share of the standard deviation of all."""

CONTRADICTION: Final = 30.0
"""Near points contradict each other when their errors differ by this many standard deviations of the variogram."""


@dataclass(frozen=True, eq=False)
class Points:
    """The distinct points among n samples; a repeat has the coordinates of another sample, to their last digits.

    Attributes
    ----------
    x : (u, d) array
        Distinct points; in the order of the samples when nothing is repeated.
    inverse : (n,) array of int
        The point of each sample.
    count : (u,) array of int
    """

    x: FloatArray
    inverse: IntArray
    count: IntArray

    @classmethod
    def of(cls, x: FloatArray) -> Self:
        """Find the distinct rows of x (n, d)."""
        points, inverse = np.unique(x, axis=0, return_inverse=True)
        first, group = _alike(points)
        if len(first) == len(x):
            return cls(x, np.arange(len(x)), np.ones(len(x), np.int64))
        inverse = group[inverse.reshape(-1)]
        return cls(points[first], inverse, np.bincount(inverse))

    @property
    def repeated(self) -> bool:
        """Whether any point was measured more than once."""
        return len(self.x) < len(self.inverse)

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
                f"rows {', '.join(map(str, rows[:5]))} are one point, but their errors differ by "
                f"{spread[bad[0]].max():.3g}, and exact Kriging cannot pass through both; "
                "use exact=False, give noise_std, or average them"
            )

    def refuse_near_contradictions(
        self, e: FloatArray, models: tuple[VariogramModel, ...], coordinates: FloatArray
    ) -> None:
        """Raise KrigingError, naming the rows, where near points differ more than the variograms allow.

        Parameters
        ----------
        e : (u, k) array
            Errors of the points, which have no noise.
        models : tuple of k VariogramModel
        coordinates : (u, d) array
            The points in the coordinates of the variograms: without columns that are drift only.
        """
        if len(self.x) < 3:
            return
        found = KDTree(self.x).query(self.x, k=2)
        distance, nearest = np.asarray(found[0])[:, 1], np.asarray(found[1])[:, 1]
        i = np.flatnonzero(distance < NEAR * np.median(distance))
        j = nearest[i]
        for c, model in enumerate(models):
            scale = e[:, c].var() / (model.nugget + model.sill) if model.bounded else 1.0
            expected = 2 * scale * model.semivariance_between(coordinates[i], coordinates[j])
            difference = np.abs(e[i, c] - e[j, c])
            ratio = np.where(difference > NEAR * e[:, c].std(), difference / np.sqrt(np.maximum(expected, 1e-30)), 0.0)
            if ratio.size and ratio.max() > CONTRADICTION:
                worst = int(np.argmax(ratio))
                rows = sorted(int(np.flatnonzero(self.inverse == point)[0]) for point in (i[worst], j[worst]))
                raise KrigingError(
                    f"rows {rows[0]} and {rows[1]} are {distance[i[worst]]:.3g} apart, but their errors differ by "
                    f"{difference[worst]:.3g}, {ratio[worst]:.3g} standard deviations of the "
                    "variogram, and exact Kriging would swing between them; use exact=False with a nugget, give "
                    "noise_std, or drop one"
                )

    def _sum(self, values: FloatArray) -> FloatArray:
        total = np.zeros((len(self.x), values.shape[1]))
        np.add.at(total, self.inverse, values)
        return total


def _alike(points: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the first of each group of points that differ in their last digits only, and the group of each point."""
    alone = np.arange(len(points))
    reach = SAME * float(np.linalg.norm(np.ptp(points, axis=0)))
    pairs = KDTree(points).query_pairs(reach, output_type="ndarray") if len(points) > 1 else np.empty((0, 2), np.int64)
    if not len(pairs):
        return alone, alone
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    _, group = connected_components(graph, directed=False)
    return np.unique(group, return_index=True)[1], group.astype(np.int64)
