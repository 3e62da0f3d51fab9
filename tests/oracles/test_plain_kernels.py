"""Compiled kernels and raw LAPACK calls against their plain versions, which the benchmarks time beside them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import plain
from truepose.numerics.kernels import MATERN32, cross_correlation, pack, weighted_sum
from truepose.numerics.small_systems import eliminate, pair_distances
from truepose.predictors import OrdinaryKriging
from truepose.predictors.kriging.system import System
from truepose.similarity import VariogramModel, experimental_variogram
from truepose.similarity.structure import correlation


@pytest.mark.parametrize("n", [1, 15, 16, 17, 100, 255, 256, 257, 600])
def test_correlations(rng, n):
    """Also where the samples do not fill a block, or just do."""
    u, v, w = rng.random((40, 3)) * 3, rng.random((n, 3)) * 3, rng.standard_normal((n, 2))
    out = np.empty((40, n))
    cross_correlation(MATERN32, 0.0, u, pack(v), out)
    np.testing.assert_allclose(out, plain.matern32(u, v), rtol=1e-13)
    np.testing.assert_allclose(plain.matern32_by_loops(u, v), out, rtol=1e-13)
    np.testing.assert_allclose(weighted_sum(MATERN32, 0.0, u, pack(v), pack(w)), out @ w, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("n", [2, 17, 256, 300])
def test_semivariance(rng, n):
    x, e = rng.random((n, 3)), rng.standard_normal((n, 2))
    edges = np.linspace(0.0, 1.0, 11)
    found = experimental_variogram(x, e, edges)
    pairs, semivariance = plain.semivariance(x, e, edges)
    np.testing.assert_array_equal(found.pairs, pairs)
    np.testing.assert_allclose(found.semivariance, semivariance, rtol=1e-11)


def test_small_systems(rng):
    x, targets = rng.random((300, 3)), rng.random((45, 3))
    near = np.argsort(np.linalg.norm(x[None] - targets[:, None], axis=2), axis=1)[:, :12]
    rho = correlation(MATERN32, pair_distances(x, targets, near))
    arguments = (rho, near, 0.9, rng.uniform(1.0, 1.2, 300), rng.uniform(0, 0.1, 45), rng.standard_normal((300, 4)))
    np.testing.assert_allclose(eliminate(*arguments), plain.eliminate(*arguments), rtol=1e-9, atol=1e-11)


def test_reduction_by_the_inverse_factor(rng):
    x = rng.random((80, 3))
    K = plain.matern32(x, x) + 0.1 * np.eye(80)
    cross = plain.matern32(rng.random((30, 3)), x)
    system = System.factorise(K.copy(), np.ones((80, 1)), x)
    half, _ = system.reduce(cross.copy(), np.ones((30, 1)))
    np.testing.assert_allclose(half, plain.reduce(np.linalg.cholesky(K), cross), rtol=1e-10, atol=1e-12)


def test_kriging(rng):
    x, targets = rng.random((100, 3)), rng.random((500, 3))
    e = np.sin(4 * x)
    model = OrdinaryKriging(VariogramModel("matern32", 0.05, 1.0, 0.4)).fit(x, e)
    mean, std = plain.Kriging(0.05, 0.4).fit(x, e).predict(targets)
    found, own = model.predict(targets, return_std=True)
    np.testing.assert_allclose(found, mean, atol=1e-11)
    np.testing.assert_allclose(own, np.tile(std[:, None], 3), atol=1e-11)
    np.testing.assert_allclose(model.predict(targets), found, atol=1e-12)
