"""The order of a measurement: a short round trip through all poses, home to home."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray, IntArray


def shortest_tour(q: ArrayLike, home: ArrayLike) -> IntArray:
    """Return an order of joints (n, dof) [rad] whose round trip from `home` (dof,) and back is short.

    A motion takes as long as its largest joint motion. Nearest neighbour, then 2-opt until no exchange helps.

    Examples
    --------
    >>> shortest_tour([[3.0], [1.0], [2.0]], [0.0]).tolist()
    [1, 2, 0]
    """
    stops = np.concatenate([[np.asarray(home, float)], np.asarray(q, float)])
    cost = np.abs(stops[:, None] - stops).max(axis=2)
    tour = _improved(_nearest_first(cost), cost)
    return tour[1:-1] - 1


def _nearest_first(cost: FloatArray) -> IntArray:
    """Return a round trip from stop 0 that goes to the nearest open stop each time, (n + 1,)."""
    tour, open_ = [0], np.ones(len(cost), np.bool_)
    open_[0] = False
    while open_.any():
        tour.append(int(np.argmin(np.where(open_, cost[tour[-1]], np.inf))))
        open_[tour[-1]] = False
    return np.array([*tour, 0])


def _improved(tour: IntArray, cost: FloatArray) -> IntArray:
    """Turn parts of the round trip round while that shortens it (2-opt)."""
    better = True
    while better:
        better = False
        for i in range(len(tour) - 2):
            at, next_ = tour[:-1], tour[1:]
            saved = cost[at[i], next_[i]] + cost[at, next_] - cost[at[i], at] - cost[next_[i], next_]
            saved[: i + 2] = 0.0
            j = int(np.argmax(saved))
            if saved[j] > 1e-12:
                tour[i + 1 : j + 1] = tour[i + 1 : j + 1][::-1].copy()
                better = True
    return tour
