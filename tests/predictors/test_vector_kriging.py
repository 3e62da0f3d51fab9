"""Vector Kriging (9): the Kronecker structure against the whole system, and the whole system against plain algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from tests.tiers import examples

from truepose.errors import DataError, KrigingError
from truepose.predictors import OrdinaryKriging, VectorKriging
from truepose.similarity import VariogramModel

MODEL = VariogramModel("matern32", nugget=0.05, sill=1.0, range=0.4)
LONG = VariogramModel("exponential", nugget=0.02, sill=1.0, range=1.5)


def matrix(rng, k=3):
    a = rng.standard_normal((k, k))
    return a @ a.T / k + 0.1 * np.eye(k)


def plain(models, matrices, x, e, targets, noise):
    """Ordinary cokriging as it stands, one nk × nk system, filtering the nugget."""
    n, k = e.shape
    kron = sum(np.kron(m.signal_covariance(cdist(x, x)), b) for m, b in zip(models, matrices, strict=True))
    nugget = sum(m.nugget * b for m, b in zip(models, matrices, strict=True))
    for i in range(n):
        kron[i * k : i * k + k, i * k : i * k + k] += nugget + noise[i]
    inverse, drift = np.linalg.inv(kron), np.kron(np.ones((n, 1)), np.eye(k))
    spread = np.linalg.inv(drift.T @ inverse @ drift)
    beta = spread @ drift.T @ inverse @ e.reshape(-1)
    mean, covariance = [], []
    for target in targets:
        distance = cdist(target[None], x)[0]
        cross = sum(np.kron(m.signal_covariance(distance), b) for m, b in zip(models, matrices, strict=True))
        lack = np.eye(k) - cross @ inverse @ drift
        prior = sum(m.sill * b for m, b in zip(models, matrices, strict=True))
        mean.append(beta + cross @ inverse @ (e.reshape(-1) - drift @ beta))
        covariance.append(prior - cross @ inverse @ cross.T + lack @ spread @ lack.T)
    return np.array(mean), np.array(covariance)


@settings(max_examples=examples(20))
@given(
    st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 3, 6]), st.booleans(), st.sampled_from(["none", "turns", "each"])
)
def test_equation_9(seed, d, several, kind):
    rng = np.random.default_rng(seed)
    x, e, targets = rng.random((15, d)), rng.standard_normal((15, 3)), rng.random((4, d))
    models = (MODEL, LONG) if several else (MODEL,)
    matrices = np.array([matrix(rng) for _ in models])
    noise = {
        "none": np.zeros((15, 3, 3)),
        "turns": np.broadcast_to(matrix(rng), (15, 3, 3)),
        "each": np.array([matrix(rng) for _ in range(15)]),
    }[kind]
    model = VectorKriging(models if several else MODEL, matrices)
    model.fit(x, e, noise_cov=noise if kind != "none" else None)
    assert model.kronecker_ == (not several and kind != "each")
    mean, covariance = plain(models, matrices, x, e, targets, noise)
    np.testing.assert_allclose(model.predict(targets), mean, atol=1e-9)
    np.testing.assert_allclose(model.predict_covariance(targets), covariance, atol=1e-9)
    std = model.predict(targets, return_std=True)[1]
    np.testing.assert_allclose(std**2, np.einsum("maa->ma", covariance), atol=1e-9)
    step = 1e-5
    for a, unit in enumerate(np.eye(d) * step):
        slope = (model.predict(targets + unit) - model.predict(targets - unit)) / (2 * step)
        np.testing.assert_allclose(model.gradient(targets)[:, :, a], slope, atol=1e-5 * (1 + np.abs(slope).max()))


@pytest.mark.parametrize("several", [True, False])
@pytest.mark.parametrize("exact", [True, False])
def test_leave_out_is_refitting(several, exact, rng):
    x, e = rng.random((15, 3)), rng.standard_normal((15, 3))
    models, matrices = ((MODEL, LONG), [matrix(rng), matrix(rng)]) if several else (MODEL, matrix(rng))
    noise = np.array([matrix(rng) for _ in range(15)]) if several else np.broadcast_to(0.1 * np.eye(3), (15, 3, 3))
    model = VectorKriging(models, matrices, exact).fit(x, e, noise_cov=noise)
    blocks = np.arange(15) // 4
    for left, labels in ((model.leave_one_out(), np.arange(15)), (model.leave_blocks_out(blocks), blocks)):
        out = labels == labels[5]
        refitted = VectorKriging(models, matrices, exact).fit(x[~out], e[~out], noise_cov=noise[~out])
        mean, std = refitted.predict(x[out], return_std=True, include_nugget=True)
        np.testing.assert_allclose(left.residual[out], e[out] - mean, atol=1e-9)
        np.testing.assert_allclose(left.std[out] ** 2, std**2 + np.einsum("naa->na", noise[out]), rtol=1e-9)


def test_intrinsic_without_noise_is_ordinary_kriging(rng):
    x, e, targets = rng.random((30, 3)), rng.standard_normal((30, 3)), rng.random((9, 3))
    model = VectorKriging(MODEL, matrix(rng)).fit(x, e)
    np.testing.assert_allclose(model.predict(targets), OrdinaryKriging(MODEL).fit(x, e).predict(targets), atol=1e-10)


def test_components_teach_each_other(rng):
    """Where x was not measured, y that varies with it tells it."""
    x = rng.random((80, 2))
    factor = np.linalg.cholesky(np.kron(MODEL.covariance(cdist(x, x)), [[1.0, 0.95], [0.95, 1.0]]))
    e = (factor @ rng.standard_normal(160)).reshape(80, 2)
    noise = np.zeros((80, 2, 2))
    noise[40:, 0, 0] = np.inf
    hidden = e.copy()
    hidden[40:, 0] = 99.0
    model = VectorKriging(MODEL, [[1.0, 0.95], [0.95, 1.0]]).fit(x, hidden, noise_cov=noise)
    together = model.predict(x[40:])[:, 0] - e[40:, 0]
    alone = OrdinaryKriging(MODEL).fit(x[:40], e[:40, 0]).predict(x[40:]) - e[40:, 0]
    assert together.std() < 0.7 * alone.std()
    assert np.isnan(model.leave_one_out().residual[40:, 0]).all()


def test_fields_have_the_covariance_of_the_prediction(rng):
    x, e, targets = rng.random((20, 3)), rng.standard_normal((20, 3)), rng.random((2, 3))
    for model in (VectorKriging(MODEL, matrix(rng)), VectorKriging((MODEL, LONG), [matrix(rng), matrix(rng)])):
        fields = model.fit(x, e).simulate(targets, 6000)
        expected = model.predict_covariance(targets)
        np.testing.assert_allclose(np.cov(fields[:, 0].T), expected[0], atol=0.08 * np.abs(expected[0]).max())
        np.testing.assert_allclose(fields.mean(axis=0), model.predict(targets), atol=0.08)


def test_coregionalisation_is_found(rng):
    x = rng.random((400, 3))
    short, long = (
        VariogramModel("exponential", sill=1.0, range=0.05),
        VariogramModel("exponential", sill=1.0, range=0.5),
    )
    b = np.array([[[1.0, 0.8], [0.8, 1.0]], [[1.0, -0.5], [-0.5, 0.5]]])
    kron = sum(np.kron(m.covariance(cdist(x, x)), c) for m, c in zip((short, long), b, strict=True))
    e = (np.linalg.cholesky(kron) @ rng.standard_normal(800)).reshape(400, 2)
    found = VectorKriging((short, long)).fit(x, e).coregionalisation_
    assert (np.linalg.eigvalsh(found) > -1e-12).all()
    np.testing.assert_allclose(found[0], b[0], atol=0.35)
    one = VectorKriging(long).fit(x, e)
    np.testing.assert_allclose(one.coregionalisation_[0], one.coregionalisation_[0].T)
    assert one.kronecker_


@pytest.mark.parametrize(
    ("arguments", "fit", "error", "message"),
    [
        ({"coregionalisation": np.eye(2)}, {}, KrigingError, "without variogram models"),
        (
            {"variogram": MODEL, "coregionalisation": np.eye(2)},
            {},
            KrigingError,
            r"shape \(2, 2\); expected \(1, 3, 3\)",
        ),
        ({"variogram": MODEL, "coregionalisation": -np.eye(3)}, {}, KrigingError, "matrix 0 is not symmetric and"),
        ({"variogram": MODEL}, {"noise_cov": np.eye(2)}, DataError, r"noise_cov has shape \(2, 2\)"),
        ({"variogram": MODEL}, {"noise_cov": -np.eye(3)}, DataError, "noise_cov of row 0 is not symmetric"),
        ({"variogram": MODEL}, {"noise_cov": np.eye(3), "noise_std": 1.0}, DataError, "cannot be combined"),
        ({"variogram": MODEL}, {"noise_cov": np.diag([np.inf, 1, 1])}, DataError, "component 0 was measured nowhere"),
    ],
)
def test_refusals(arguments, fit, error, message, rng):
    x = rng.random((20, 3))
    with pytest.raises(error, match=message):
        VectorKriging(**arguments).fit(x, x, **fit)
