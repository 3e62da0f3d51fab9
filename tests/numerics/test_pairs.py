"""Distances over all pairs of points, and sums by several threads."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from scipy.spatial.distance import cdist, pdist

from truepose.numerics import kernels
from truepose.numerics.pairs import ROWS, largest_distance


def _sphere(rng, n, d):
    x = rng.normal(size=(n, d))
    return x / np.linalg.norm(x, axis=1, keepdims=True)


CLOUDS = {
    "box": lambda rng: rng.uniform(0, 1000, (3 * ROWS, 3)),
    "six joints": lambda rng: rng.uniform(-3, 3, (3 * ROWS, 6)),
    "sphere": lambda rng: 500 * _sphere(rng, 3 * ROWS + 1, 3) + 1e4,
    "line": lambda rng: np.linspace(0, 7, 2 * ROWS)[:, None] * [1.0, 2.0, 0.0],
    "one far away": lambda rng: np.vstack([rng.normal(size=(ROWS, 2)), [[1e6, 0.0]]]),
    "two points": lambda rng: np.array([[0.0, 0.0], [3.0, 4.0]]),
    "equal points": lambda rng: np.ones((2 * ROWS, 3)),
    "one point": lambda rng: np.ones((1, 3)),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_largest_distance_is_that_of_all_pairs(rng, name):
    x = CLOUDS[name](rng)
    assert largest_distance(x) == pytest.approx(max(pdist(x), default=0.0), rel=1e-14)


@pytest.mark.parametrize("rows", [1, 3, 17, 100])
def test_results_do_not_depend_on_the_number_of_threads(rng, monkeypatch, rows):
    u, points = rng.normal(size=(rows, 3)), rng.normal(size=(40, 3))
    expected = np.exp(-cdist(u, points))
    found = []
    for threads in (1, 3):
        monkeypatch.setattr(numba, "get_num_threads", lambda threads=threads: threads)
        out = np.full((rows, 40), np.nan)
        kernels.cross_correlation(kernels.EXPONENTIAL, 0.0, u, kernels.pack(points), out)
        sums = kernels.weighted_sum(kernels.EXPONENTIAL, 0.0, u, kernels.pack(points), kernels.pack(np.eye(40)))
        found.append((out, sums))
        np.testing.assert_allclose(out, expected, rtol=1e-12)
        np.testing.assert_allclose(sums, expected, rtol=1e-12)
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
