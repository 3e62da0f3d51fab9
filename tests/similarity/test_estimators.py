"""Estimators, directions and cross-variograms against GSTools and scikit-gstat, and against the definitions."""

from __future__ import annotations

import itertools
import tracemalloc

import gstools as gs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import pdist
from skgstat import estimators as peers
from tests.tiers import examples

from truepose.errors import DataError
from truepose.numerics.pairs import smallest_gap
from truepose.similarity import Direction, experimental_variogram, variogram_cloud

EDGES = np.array([0.0, 0.1, 0.25, 0.4, 0.8])


def differences(x, e, edges=EDGES):
    """Absolute differences of each bin."""
    h, z = pdist(x), pdist(e[:, None])
    return [z[(h > low) & (h <= high)] for low, high in itertools.pairwise(edges)]


@settings(max_examples=examples(25))
@given(seed=st.integers(0, 2**32 - 1), d=st.sampled_from([1, 2, 3, 6]), n=st.integers(20, 150))
@pytest.mark.parametrize(("estimator", "peer"), [("cressie", peers.cressie), ("dowd", peers.dowd)])
def test_robust_as_scikit_gstat(estimator, peer, seed, d, n):
    rng = np.random.default_rng(seed)
    x, e = rng.random((n, d)), rng.standard_t(2, (n, 2))
    ev = experimental_variogram(x, e, bins=EDGES, estimator=estimator)
    for c in range(2):
        expected = [peer(z) if len(z) else np.nan for z in differences(x, e[:, c])]
        np.testing.assert_allclose(ev.semivariance[:, c], expected, rtol=1e-9)
    assert ev.estimator == estimator


@settings(max_examples=examples(12))
@given(seed=st.integers(0, 2**32 - 1), d=st.sampled_from([1, 2, 3]))
@pytest.mark.parametrize("estimator", ["matheron", "cressie"])
def test_all_directions_as_gstools(estimator, seed, d):
    rng = np.random.default_rng(seed)
    x, e = rng.random((80, d)), rng.standard_normal(80)
    ev = experimental_variogram(x, e, bins=EDGES, estimator=estimator)
    _, gamma, pairs = gs.vario_estimate(x.T, e, EDGES, estimator=estimator, return_counts=True)
    assert ev.pairs.tolist() == pairs.tolist()
    np.testing.assert_allclose(ev.semivariance[ev.pairs > 0, 0], gamma[ev.pairs > 0], rtol=1e-9)


@settings(max_examples=examples(15))
@given(
    seed=st.integers(0, 2**32 - 1),
    d=st.sampled_from([2, 3]),
    tolerance=st.floats(0.1, 1.5),
    bandwidth=st.sampled_from([0.15, 0.5, np.inf]),
)
@pytest.mark.parametrize("estimator", ["matheron", "cressie"])
def test_directional_as_gstools(estimator, seed, d, tolerance, bandwidth):
    rng = np.random.default_rng(seed)
    x, e, axis = rng.random((80, d)), rng.standard_normal(80), rng.standard_normal(d)
    ev = experimental_variogram(
        x, e, bins=EDGES, estimator=estimator, direction=Direction(axis, tolerance=tolerance, bandwidth=bandwidth)
    )
    _, gamma, pairs = gs.vario_estimate(
        x.T,
        e,
        EDGES,
        direction=axis / np.linalg.norm(axis),
        angles_tol=tolerance,
        bandwidth=bandwidth if np.isfinite(bandwidth) else 1e9,
        estimator=estimator,
        return_counts=True,
    )
    assert ev.pairs.tolist() == pairs.tolist()
    np.testing.assert_allclose(ev.semivariance[ev.pairs > 0, 0], gamma[ev.pairs > 0], rtol=1e-9)


@settings(max_examples=examples(50))
@given(st.lists(st.integers(-6, 6) | st.floats(-5, 5), min_size=2, max_size=50), st.floats(0, 1))
def test_smallest_gap_is_an_order_statistic(values, where):
    z = np.sort(np.array(values, dtype=float))
    gaps = np.sort((z[None] - z[:, None])[np.triu_indices(len(z), 1)])
    k = max(1, round(where * len(gaps)))
    assert smallest_gap(z, k) == gaps[k - 1]


def test_genton_is_its_definition(rng):
    """scikit-gstat takes absolute differences and interpolates; of the same signed ones it is the next gap at most."""
    x, e = np.sort(rng.random(60))[:, None], rng.standard_normal((60, 1))
    ev = experimental_variogram(x, e, bins=EDGES, estimator="genton")
    i, j = np.triu_indices(60, 1)
    z, h = (e[j] - e[i])[:, 0], (x[j] - x[i])[:, 0]
    for b, (low, high) in enumerate(itertools.pairwise(EDGES)):
        signed = z[(h > low) & (h <= high)]
        gaps = np.sort(pdist(signed[:, None]))
        k = (len(signed) // 2 + 1) * (len(signed) // 2) // 2
        assert ev.semivariance[b, 0] == pytest.approx((2.2191 * gaps[k - 1]) ** 2 / 2, rel=1e-12)
        if len(signed) < 500 and len(signed) % 2 == 0:
            peer = peers.genton(signed) * (2.2191 / 2.219) ** 2
            assert (2.2191 * gaps[k - 1]) ** 2 / 2 <= peer * (1 + 1e-12)
            assert peer <= (2.2191 * gaps[k]) ** 2 / 2 * (1 + 1e-12)


@pytest.mark.parametrize("estimator", ["matheron", "cressie", "dowd", "genton"])
def test_consistent_for_normal_errors_and_blind_to_order(estimator, rng):
    x, e = rng.random((400, 3)), rng.normal(scale=2.0, size=(400, 1))
    ev = experimental_variogram(x, e, bins=3, estimator=estimator)
    np.testing.assert_allclose(ev.semivariance, 4.0, rtol=0.15)
    order = rng.permutation(400)
    shuffled = experimental_variogram(x[order], e[order], bins=3, estimator=estimator)
    np.testing.assert_allclose(shuffled.semivariance, ev.semivariance, rtol=1e-10)


def test_gross_errors_move_the_robust_ones_little(rng):
    x, e = rng.random((300, 3)), rng.standard_normal((300, 1))
    e[:6] += 50.0
    gamma = {
        name: experimental_variogram(x, e, bins=1, estimator=name).semivariance[0, 0]
        for name in ("matheron", "cressie", "dowd", "genton")
    }
    assert gamma["matheron"] > 20
    assert gamma["cressie"] < 3.5
    assert max(gamma["dowd"], gamma["genton"]) < 1.6


@pytest.mark.parametrize("estimator", ["matheron", "dowd"])
def test_cross_variograms(estimator, rng):
    x, e = rng.random((90, 3)), rng.standard_normal((90, 3))
    e[:, 2] = 2 * e[:, 0]
    ev = experimental_variogram(x, e, bins=EDGES, estimator=estimator, cross=True)
    np.testing.assert_array_equal(ev.cross, ev.cross.transpose(0, 2, 1))
    np.testing.assert_array_equal(np.einsum("kaa->ka", ev.cross), ev.semivariance)
    np.testing.assert_allclose(ev.cross[:, 0, 2], 2 * ev.semivariance[:, 0], rtol=1e-10)
    if estimator == "matheron":
        h = pdist(x)
        i, j = np.triu_indices(90, 1)
        product = (e[i, 0] - e[j, 0]) * (e[i, 1] - e[j, 1])
        expected = [product[(h > a) & (h <= b)].mean() / 2 for a, b in itertools.pairwise(EDGES)]
        np.testing.assert_allclose(ev.cross[:, 0, 1], expected, rtol=1e-9)


def test_edges_closer_than_a_cell(rng):
    """Several edges in one cell of the table, and one beyond its end."""
    x, e = rng.random((200, 2)), rng.standard_normal(200)
    edges = np.array([0.0, 1e-3, 1.1e-3, 1.2e-3, 0.02, 0.0200001, 0.5, 40.0])
    ev = experimental_variogram(x, e, bins=edges)
    h = pdist(x)
    assert ev.pairs.tolist() == [np.count_nonzero((h > a) & (h <= b)) for a, b in itertools.pairwise(edges)]


def test_cloud_is_refused_for_many_points(rng):
    with pytest.raises(DataError, match="6000 points have too many pairs"):
        experimental_variogram(rng.random((6000, 1)), np.zeros(6000), max_lag=0.1, estimator="genton")


@pytest.mark.parametrize("direction", [None, Direction([1.0, 2.0, 0.0], tolerance=0.6, bandwidth=0.33)])
@pytest.mark.parametrize("values", ["normal", "few", "equal"])
def test_dowd_is_the_median_of_all_differences(rng, direction, values):
    """With ties, an even and an odd number of pairs, an empty bin, and repeats of a point."""
    x = rng.random((60, 3)).round(1)
    e = {"normal": rng.standard_normal((60, 2)), "few": rng.integers(-1, 2, (60, 2)) * 1e-3, "equal": np.ones((60, 2))}
    edges = np.array([0.0, 0.31, 0.52, 0.73, 5.0, 6.0])
    ev = experimental_variogram(x, e[values], edges, estimator="dowd", direction=direction)
    cloud = variogram_cloud(x, e[values], direction=direction)
    bins = np.searchsorted(edges, cloud.distance)
    for b, gamma in enumerate([ev.repeat_semivariance, *ev.semivariance]):
        z = np.sqrt(2 * cloud.semivariance[bins == b])
        expected = 2.198 * np.median(z, axis=0) ** 2 / 2 if len(z) else [np.nan, np.nan]
        np.testing.assert_allclose(gamma, expected, rtol=1e-12)


@pytest.mark.exhaustive
def test_dowd_of_many_points_needs_little_memory(rng):
    """6,000 points have 18 million pairs: 430 MB if they were held."""
    x, e = rng.random((6000, 1)), rng.standard_normal(6000)
    tracemalloc.start()
    ev = experimental_variogram(x, e, max_lag=0.1, estimator="dowd")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20e6
    np.testing.assert_allclose(ev.semivariance, 1.0, rtol=0.1)


def test_cloud_holds_the_pairs_of_the_bins(rng):
    x, e = rng.random((50, 3)), rng.standard_normal((50, 2))
    for direction in (None, Direction([1.0, 2.0, 0.0], tolerance=0.6, bandwidth=0.3)):
        found = variogram_cloud(x, e, 0.5, direction)
        ev = experimental_variogram(x, e, bins=[0.0, 0.5], direction=direction)
        assert len(found.distance) == ev.pairs[0]
        np.testing.assert_allclose(found.semivariance.mean(axis=0), ev.semivariance[0])
        np.testing.assert_allclose(np.linalg.norm(x[found.second] - x[found.first], axis=1), found.distance)
    assert len(variogram_cloud(x, e).distance) == 50 * 49 / 2
