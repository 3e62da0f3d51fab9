from __future__ import annotations

import itertools

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import pdist
from tests.tiers import examples

from truepose.errors import DataError, KrigingError
from truepose.similarity import Direction, experimental_variogram


def by_hand(x, e, edges):
    """Equation (4) with every pair in memory."""
    h = pdist(x)
    squares = np.stack([pdist(column[:, None]) ** 2 for column in e.T], axis=1)
    inside = [(h > low) & (h <= high) for low, high in itertools.pairwise(edges)]
    pairs = np.array([mask.sum() for mask in inside])
    with np.errstate(invalid="ignore"):
        lag = np.array([h[mask].sum() for mask in inside]) / pairs
        gamma = np.array([squares[mask].sum(axis=0) for mask in inside]) / (2 * pairs[:, None])
    return lag, gamma, pairs


@settings(max_examples=examples(40))
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(2, 700),
    d=st.integers(1, 6),
    c=st.integers(1, 9),
    bins=st.integers(1, 25),
)
def test_every_pair_counted_once(seed, n, d, c, bins):
    rng = np.random.default_rng(seed)
    x, e = rng.integers(0, 6, (n, d)).astype(float), rng.standard_normal((n, c))
    x[0] += 0.5  # so that not all points are the same
    ev = experimental_variogram(x, e, bins=bins)
    lag, gamma, pairs = by_hand(x, e, ev.edges)
    assert ev.pairs.tolist() == pairs.tolist()
    np.testing.assert_allclose(ev.lag, lag, rtol=1e-12)
    np.testing.assert_allclose(ev.semivariance, gamma, rtol=1e-10)
    assert ev.repeats == np.count_nonzero(pdist(x) == 0)
    np.testing.assert_allclose(ev.vector, ev.semivariance.sum(axis=1))


def test_given_edges_are_closed_on_the_right():
    x = np.arange(4.0)[:, None]
    ev = experimental_variogram(x, [0.0, 1.0, 3.0, 6.0], bins=[0.5, 1.0, 2.0])
    assert ev.pairs.tolist() == [3, 2]
    assert ev.lag.tolist() == [1.0, 2.0]
    np.testing.assert_allclose(ev.semivariance[:, 0], [(1 + 4 + 9) / 6, (9 + 25) / 4])


def test_default_reaches_half_the_largest_distance(rng):
    x = rng.random((50, 3))
    assert experimental_variogram(x, x).edges[-1] == pytest.approx(pdist(x).max() / 2, rel=1e-14)


def test_repeats_tell_the_noise(rng):
    x = np.repeat(rng.random((2000, 3)), 2, axis=0)
    ev = experimental_variogram(x, rng.normal(scale=0.3, size=(4000, 2)))
    assert ev.repeats == 2000
    np.testing.assert_allclose(ev.repeat_semivariance, 0.09, rtol=0.1)


def test_weights_stretch_joint_space(rng):
    q, e, w = rng.random((80, 6)), rng.random((80, 3)), np.array([4.0, 1, 1, 0.25, 0, 1])
    weighted, stretched = experimental_variogram(q, e, weights=w), experimental_variogram(q * np.sqrt(w), e)
    np.testing.assert_array_equal(weighted.semivariance, stretched.semivariance)


def test_direction_takes_pairs_in_cone_and_band(rng):
    x, e = rng.random((120, 3)), rng.random((120, 2))
    i, j = np.triu_indices(120, 1)
    step = x[j] - x[i]
    h = np.linalg.norm(step, axis=1)
    along = np.abs(step @ [0.6, 0.8, 0])
    taken = (along >= np.cos(0.5) * h) & (np.sqrt(h**2 - along**2) <= 0.2) & (h <= 0.6)
    ev = experimental_variogram(x, e, bins=1, max_lag=0.6, direction=Direction([3, 4, 0], tolerance=0.5, bandwidth=0.2))
    assert ev.pairs.tolist() == [np.count_nonzero(taken)]
    np.testing.assert_allclose(ev.semivariance[0], ((e[j] - e[i])[taken] ** 2).mean(axis=0) / 2)


def test_direction_of_a_ramp():
    x = np.stack(np.meshgrid(np.arange(8.0), np.arange(8.0)), axis=-1).reshape(-1, 2)
    across = experimental_variogram(x, x[:, 0], direction=[0, 1.0], bins=[0.0, 1.0])
    along = experimental_variogram(x, x[:, 0], direction=[1.0, 0], bins=[0.0, 1.0])
    assert (across.semivariance[0, 0], along.semivariance[0, 0]) == (0.0, 0.5)


def test_result_does_not_depend_on_threads(rng):
    x, e = rng.random((1500, 3)), rng.standard_normal((1500, 3))
    threads = numba.get_num_threads()
    results = []
    for count in {1, threads}:
        numba.set_num_threads(count)
        results.append(experimental_variogram(x, e).semivariance)
    numba.set_num_threads(threads)
    np.testing.assert_array_equal(results[0], results[-1])


def test_few_pairs_are_weak():
    ev = experimental_variogram(np.arange(40.0)[:, None], np.arange(40.0), bins=[0.0, 1.0, 5.0, 30.0, 39.0])
    assert ev.weak.tolist() == (ev.pairs < 30).tolist()
    empty = experimental_variogram([[0.0], [10.0]], [0.0, 1.0], bins=[0.0, 1.0, 20.0])
    assert empty.pairs.tolist() == [0, 1]
    assert np.isnan(empty.semivariance[0, 0])
    assert np.isnan(empty.lag[0])


X3 = np.eye(3)
NAN, INFINITE = np.eye(3), np.eye(3)
NAN[1, 0], INFINITE[2, 0] = np.nan, np.inf


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"x": X3[0], "e": X3}, DataError, r"x has shape \(3,\)"),
        ({"x": X3, "e": X3[:2]}, DataError, "x has 3 rows and e has 2"),
        ({"x": X3[:1], "e": X3[:1]}, DataError, "one point"),
        ({"x": np.empty((0, 3)), "e": np.empty((0, 3))}, DataError, r"x has shape \(0, 3\)"),
        ({"x": NAN, "e": X3}, DataError, "x has NaN or infinity in row 1"),
        ({"x": X3, "e": INFINITE}, DataError, "e has NaN or infinity in row 2"),
        ({"x": np.zeros((3, 3)), "e": X3}, KrigingError, "all 3 points are the same"),
        ({"x": X3, "e": X3, "bins": 0}, DataError, "bins is 0"),
        ({"x": X3, "e": X3, "bins": [1.0, 1.0]}, DataError, "increasing"),
        ({"x": X3, "e": X3, "bins": [0.0, 1.0], "max_lag": 1.0}, DataError, "leave max_lag out"),
        ({"x": X3, "e": X3, "max_lag": -1.0}, DataError, "max_lag is -1.0"),
        ({"x": X3, "e": X3, "estimator": "mean"}, DataError, "'mean' is not known; use one of matheron, cressie"),
        ({"x": X3, "e": X3, "direction": [0.0, 0, 0]}, DataError, "not zero"),
        ({"x": X3, "e": X3, "direction": Direction([1, 0, 0], tolerance=2.0)}, DataError, "tolerance 2.0 rad"),
        ({"x": X3, "e": X3, "weights": [1.0, 1.0]}, DataError, "weights"),
    ],
)
def test_refusals(arguments, error, message):
    with pytest.raises(error, match=message):
        experimental_variogram(**arguments)
