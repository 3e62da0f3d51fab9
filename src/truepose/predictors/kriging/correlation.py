"""The correlation of a variogram model between points, and its mean over boxes.

A correlation is a sum of structures, each with scaled coordinates u of its own, in which its range is 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.similarity.model import VariogramModel
from truepose.similarity.structure import correlation, cross_correlation, weighted_gradient, weighted_sum

MOST_NODES: Final = 4096
"""Largest number of nodes in a box."""
NODES: Final = 6
"""Nodes along each edge of a box; even, since a node at a sample in the centre would see the cusp of ρ alone."""
FEWER_NODES: Final = 4
"""The same in many dimensions, where the mean over a box is smoother."""
MOST_DIFFERENCES: Final = 65536
"""The number of differences at which the correlation within a box is computed, at most."""


@dataclass(frozen=True, eq=False)
class Structure:
    """One structure of a correlation.

    Attributes
    ----------
    code : int
        The family, as the kernels number it.
    shape : float
        The shape parameter of the family; 0 where it has none.
    share : float
        The share of the partial sill; the shares have the sum 1.
    axes : (d, d) array
        The matrix of u = x · axes.
    """

    code: int
    shape: float
    share: float
    axes: FloatArray

    def scaled(self, x: FloatArray) -> FloatArray:
        """Return u of positions x (n, d)."""
        return np.ascontiguousarray(x @ self.axes)


@dataclass(frozen=True, eq=False)
class Correlation:
    """rho(x, x') of a variogram model: its signal's covariance over its partial sill.

    Attributes
    ----------
    structures : tuple of Structure
        The structures.
    """

    structures: tuple[Structure, ...]

    @classmethod
    def of(cls, model: VariogramModel, d: int) -> Self:
        """Return the correlation of a model that has a sill, in d coordinates."""
        total = model.partial_sill
        return cls(
            tuple(
                Structure(part.kind.code, part.shape or 0.0, part.sill / total, part.coordinates(np.eye(d)))
                for part in (model, *model.plus)
                if part.sill
            )
        )

    def at(self, points: FloatArray) -> Sums:
        """Return the sums over points (n, d) that predictions need."""
        from truepose.numerics import kernels

        return Sums(self, len(points), tuple(kernels.pack(s.scaled(points)) for s in self.structures))

    def matrix(self, points: FloatArray) -> FloatArray:
        """Return rho between points (n, d), (n, n)."""
        return self.at(points).cross(points)

    def of_distances(self, scaled: Sequence[FloatArray]) -> FloatArray:
        """Return rho at distances in the scaled coordinates of each structure, arrays of any shape."""
        total = None
        for s, r in zip(self.structures, scaled, strict=True):
            rho = correlation(s.code, r, s.shape)
            if s.share != 1.0:
                rho *= s.share
            total = rho if total is None else np.add(total, rho, out=total)
        return np.zeros(()) if total is None else total


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums over fixed points, for any targets.

    Attributes
    ----------
    correlation : Correlation
        The correlation of the structures.
    n : int
        The points.
    samples : tuple of packed arrays
        The points as each structure sees them.
    """

    correlation: Correlation
    n: int
    samples: tuple[FloatArray, ...]

    def cross(self, x: FloatArray) -> FloatArray:
        """Return rho between targets x (m, d) and the points, (m, n), C order."""
        total = None
        for s, samples in self._structures():
            rho = cross_correlation(s.code, s.scaled(x), samples, self.n, s.shape)
            if s.share != 1.0:
                rho *= s.share
            total = rho if total is None else np.add(total, rho, out=total)
        return np.zeros((len(x), self.n)) if total is None else total

    def weighted(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """Return Σ_j rho(x_i, x_j) w_jc, (m, k), of weights (n, k) packed."""
        total = np.zeros((len(x), weights.shape[1]))
        for s, samples in self._structures():
            total += s.share * weighted_sum(s.code, s.scaled(x), samples, weights, s.shape)
        return total

    def gradient(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the derivative of `weighted` by the coordinates, (m, k, d)."""
        total = np.zeros((len(x), weights.shape[1], x.shape[1]))
        for s, samples in self._structures():
            total += s.share * weighted_gradient(s.code, s.scaled(x), samples, weights, s.shape) @ s.axes.T
        return total

    def _structures(self) -> Iterator[tuple[Structure, FloatArray]]:
        return zip(self.correlation.structures, self.samples, strict=True)


@dataclass(frozen=True, eq=False)
class Support:
    """Nodes about a target, and their weights.

    Attributes
    ----------
    nodes : (q, d) array, or (1, 1) for a point
        The nodes, as shifts from a target.
    weights : (q,) array
        The weights of the nodes; their sum is 1.
    within : float
        The mean correlation of two points of the support.
    """

    nodes: FloatArray
    weights: FloatArray
    within: float = 1.0

    @classmethod
    def box(cls, size: ArrayLike, d: int, nodes: int | None, correlation: Correlation) -> Self:
        """Return the support of a box with edges of `size`, a number or (d,); `nodes` is 6 if not given, 4 for d > 4.

        Raises
        ------
        KrigingError
            If a size is not above 0, or there are too few or too many nodes.
        """
        edges = np.asarray(size, dtype=np.float64)
        if edges.shape not in ((), (d,)) or not (np.isfinite(edges) & (edges > 0)).all():
            raise KrigingError(f"block size is {size!r}; expected a number above 0, or one for each of {d} coordinates")
        if nodes is None:
            nodes = NODES if NODES**d <= MOST_NODES else FEWER_NODES
        if not (nodes >= 1 and nodes**d <= MOST_NODES):
            raise KrigingError(
                f"{nodes} nodes along each of {d} edges; expected at least 1, and {MOST_NODES} in the box at most"
            )
        edges = np.broadcast_to(edges, (d,))
        at, weights = _nodes(nodes, edges)
        return cls(at, weights, _mean_within(edges, correlation))

    def average(self, values: Callable[[FloatArray | float], FloatArray]) -> FloatArray:
        """Return the mean of a function of the shift from the target."""
        if len(self.nodes) == 1 and not self.nodes.any():
            return values(0.0)
        total = self.weights[0] * values(self.nodes[0])
        for node, weight in zip(self.nodes[1:], self.weights[1:], strict=True):
            total += weight * values(node)
        return np.asarray(total)


POINT: Final = Support(np.zeros((1, 1)), np.ones(1))


def _nodes(count: int, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    t, w = np.polynomial.legendre.leggauss(count)
    grid = np.array(list(product(t, repeat=len(edges))))
    weights = np.prod(np.array(list(product(w / 2, repeat=len(edges)))), axis=1)
    return np.asarray(grid * edges / 2), np.asarray(weights)


def _mean_within(edges: FloatArray, correlation: Correlation) -> float:
    """Return the mean correlation of two random points of a box.

    Their difference has the density Π (1 − |t|)/edge at edge·t, so the double integral over the box is one integral
    over t in [−1, 1]^d, of which ρ(−h) = ρ(h) leaves half. A cusp of ρ at 0 lies in a corner of each part, where
    Gauss–Legendre quadrature resolves it.
    """
    d = len(edges)
    count = max(2, min(16, int(MOST_DIFFERENCES ** (1 / d) / 2)))
    t, w = np.polynomial.legendre.leggauss(count)
    t, w = (t + 1) / 2, w * (1 - t) / 2  # over [0, 1] with the density 2 (1 − t)
    sides = [(t, w)] + [(np.append(-t, t), np.append(w, w) / 2)] * (d - 1)
    grid = np.array(list(product(*(side[0] for side in sides))))
    weights = np.prod(np.array(list(product(*(side[1] for side in sides)))), axis=1)
    return float(correlation.at(np.zeros((1, d))).cross(grid * edges)[:, 0] @ weights)
