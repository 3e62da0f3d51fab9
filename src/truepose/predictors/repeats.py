"""Repeated measurements of one point: averaged, with their scatter as an estimate of the noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from truepose.errors import KrigingError

FloatArray = NDArray[np.float64]

AGREE = 1e-9
"""Repeats agree when they differ by less than this share of the largest error."""


@dataclass(frozen=True, eq=False)
class Points:
    """The distinct points among n samples; a repeat has exactly the coordinates of another sample.

    Attributes
    ----------
    x : (u, d) array
        Distinct points; in the order of the samples when nothing is repeated.
    inverse : (n,) array of int
        The point of each sample.
    count : (u,) array of int
    """

    x: FloatArray
    inverse: NDArray[np.int64]
    count: NDArray[np.int64]

    @classmethod
    def of(cls, x: FloatArray) -> Self:
        """Find the distinct rows of x (n, d)."""
        points, inverse, count = np.unique(x, axis=0, return_inverse=True, return_counts=True)
        if len(points) == len(x):
            return cls(x, np.arange(len(x)), np.ones(len(x), np.int64))
        return cls(points, inverse.reshape(-1), count)

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

    def _sum(self, values: FloatArray) -> FloatArray:
        total = np.zeros((len(self.x), values.shape[1]))
        np.add.at(total, self.inverse, values)
        return total
