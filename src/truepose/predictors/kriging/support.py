"""What a prediction is the mean over: a point, or a box by Gauss and Legendre's nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.predictors.kriging.correlation import Correlation

MOST_NODES: Final = 4096


@dataclass(frozen=True, eq=False)
class Support:
    """Nodes about a target, and their weights.

    Attributes
    ----------
    nodes : (q, d) array, or (1, 1) for a point
    weights : (q,) array
        With the sum 1.
    within : float
        Mean correlation of two points of the support.
    """

    nodes: FloatArray
    weights: FloatArray
    within: float = 1.0

    @classmethod
    def box(cls, size: ArrayLike, d: int, nodes: int, correlation: Correlation) -> Self:
        """Return the support of a box with edges of `size`, a number or (d,).

        Raises
        ------
        KrigingError
            If a size is not above 0, or there are too few or too many nodes.
        """
        edges = np.asarray(size, dtype=np.float64)
        if edges.shape not in ((), (d,)) or not (np.isfinite(edges) & (edges > 0)).all():
            raise KrigingError(f"block size is {size!r}; expected a number above 0, or one for each of {d} coordinates")
        if not (nodes >= 1 and nodes**d <= MOST_NODES):
            raise KrigingError(
                f"{nodes} nodes along each of {d} edges; expected at least 1, and {MOST_NODES} in the box at most"
            )
        edges = np.broadcast_to(edges, (d,))
        at, weights = _nodes(nodes, edges)
        others, their = _nodes(nodes + 1, edges)  # no node is its own pair: a cusp at 0 would bias the mean
        within = float(weights @ correlation.at(others).cross(at) @ their)
        return cls(at, weights, within)

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
