"""Distances over all pairs of points, and sums by several threads."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from scipy.spatial.distance import cdist, pdist

from truepose.numerics import kernels
from truepose.numerics.pairs import ROWS, by_place, largest_distance, pair_sums


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


@pytest.mark.parametrize("size", [1, 7, 256])
@pytest.mark.parametrize("name", CLOUDS)
def test_an_order_by_place_holds_every_row_once(rng, name, size):
    x = CLOUDS[name](rng)
    assert np.sort(by_place(x, size)).tolist() == list(range(len(x)))


def test_rows_that_follow_one_another_by_place_are_near(rng):
    """Blocks of 256 points of 4,096 in a cube are about as wide as the 16th part of it."""
    x = rng.random((4096, 3))
    wide = np.array([np.ptp(part, axis=0).max() for part in np.split(x[by_place(x, 256)], 16)])
    assert wide.max() < 0.75


@pytest.mark.parametrize("share", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("d", [1, 3, 6])
def test_pairs_within_the_largest_lag_are_all_found(rng, d, share):
    """Blocks of points that are farther away are passed over; no pair may be lost by it."""
    x, e = rng.random((1500, d)), rng.standard_normal((1500, 1))
    h, squares = pdist(x), pdist(e, "sqeuclidean")
    edges = np.linspace(0, share * h.max(), 5)
    pairs, distance, sums = pair_sums(x, e, edges, np.empty(0), 0.0, 0.0)
    bins = np.searchsorted(edges, h)
    assert pairs.tolist() == np.bincount(bins, minlength=6)[:5].tolist()
    np.testing.assert_allclose(distance, np.bincount(bins, h, minlength=6)[:5], rtol=1e-12)
    np.testing.assert_allclose(sums[:, 0], np.bincount(bins, squares, minlength=6)[:5], rtol=1e-12)
