from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from truepose.errors import DataError, KrigingError
from truepose.similarity import (
    FAMILIES,
    VariogramModel,
    experimental_variogram,
    fit_likelihood,
    fit_variogram,
)
from truepose.similarity.likelihood import restricted_loss

BOUNDED = ["spherical", "exponential", "gaussian", "matern32", "matern52"]


def field(model, x, components, rng):
    covariance = model.covariance(cdist(x, x))
    return np.linalg.cholesky(covariance + 1e-10 * np.eye(len(x))) @ rng.standard_normal((len(x), components))


@pytest.fixture
def bins(rng):
    """A variogram with ordinary lags and counts, whose semivariance a test replaces."""
    x = rng.random((150, 3)) * 1000
    return experimental_variogram(x, rng.standard_normal((150, 1)))


@pytest.mark.parametrize("family", BOUNDED)
def test_model_is_recovered_from_its_own_semivariance(bins, family):
    true = VariogramModel(family, nugget=0.2, sill=1.5, range=400 / FAMILIES[family].practical_range())
    exact = replace(bins, vector=true.semivariance(bins.lag))
    fitted = fit_variogram(exact, family)
    np.testing.assert_allclose(
        [fitted.nugget, fitted.sill, fitted.range], [true.nugget, true.sill, true.range], rtol=1e-5
    )
    assert fitted.fit.bounds_hit == {}
    assert fitted.fit.converged
    assert fit_variogram(exact, "best").family == family


def test_weights_are_cressies(bins, rng):
    """At the optimum the weighted residuals are orthogonal to the tangent of nugget, sill and range."""
    true = VariogramModel("exponential", nugget=0.2, sill=1.5, range=150.0)
    noisy = replace(bins, vector=true.semivariance(bins.lag) * rng.uniform(0.9, 1.1, len(bins.lag)))
    fitted = fit_variogram(noisy, "exponential")
    gamma = fitted.semivariance(bins.lag)
    step = 1e-5
    tangent = [
        np.ones_like(gamma),
        1 - np.exp(-bins.lag / fitted.range),
        (replace(fitted, range=fitted.range * (1 + step)).semivariance(bins.lag) - gamma) / step,
    ]
    weighted = bins.pairs / gamma**2 * (noisy.vector - gamma)
    size = np.abs(weighted).sum()
    assert np.abs(np.array(tangent) @ weighted).max() < 1e-4 * size
    assert all(0 < fitted.fit.standard_error[name] < np.inf for name in ("nugget", "sill", "range"))


def test_linear(bins):
    fitted = fit_variogram(replace(bins, vector=0.3 + 0.002 * bins.lag), "linear")
    assert fitted.nugget == pytest.approx(0.3)
    assert fitted.sill / fitted.range == pytest.approx(0.002)


def test_all_nugget(bins):
    fitted = fit_variogram(replace(bins, vector=np.full_like(bins.lag, 2.0)), "spherical")
    assert (fitted.nugget, fitted.sill) == pytest.approx((2.0, 0.0))
    assert fitted.structural_ratio == 0
    assert fitted.fit.bounds_hit == {"sill": "lower"}
    assert "flat" in fitted.fit.remarks[0]
    assert np.isnan(fitted.fit.standard_error["sill"])


def test_trend_without_sill_is_reported(bins):
    fitted = fit_variogram(replace(bins, vector=0.01 + 1e-3 * bins.lag**1.7), "spherical")
    assert fitted.fit.bounds_hit["range"] == "upper"
    assert any("trend" in remark for remark in fitted.fit.remarks)


def test_component(rng):
    x = rng.random((200, 3))
    ev = experimental_variogram(x, rng.standard_normal((200, 3)) * [1, 2, 3])
    total = [fit_variogram(ev, component=c).covariance(0.0) for c in range(3)]
    np.testing.assert_allclose(total, [1, 4, 9], rtol=0.2)
    with pytest.raises(DataError, match="components 0 to 2"):
        fit_variogram(ev, component=3)


def test_refusals(bins):
    x = np.arange(5.0)[:, None]
    with pytest.raises(KrigingError, match="2 bins hold pairs, but a variogram model has 3 parameters"):
        fit_variogram(experimental_variogram(x, x, bins=2))
    with pytest.raises(KrigingError, match="do not vary"):
        fit_variogram(replace(bins, vector=np.zeros_like(bins.lag)))
    with pytest.raises(KrigingError, match=r"'cube'.*is not known"):
        fit_variogram(bins, "cube")


@pytest.mark.parametrize("family", BOUNDED)
def test_likelihood_gradient(family, rng):
    x, e, step = rng.random((40, 3)), rng.standard_normal((40, 3)), 1e-5
    h = cdist(x, x)

    def loss(log_range, log_ratio):
        return restricted_loss(family, np.exp(log_range), np.exp(log_ratio), h, e)

    gradient = loss(-0.9, -2.0)[1]
    by_range = (loss(-0.9 + step, -2.0)[0] - loss(-0.9 - step, -2.0)[0]) / (2 * step)
    by_ratio = (loss(-0.9, -2.0 + step)[0] - loss(-0.9, -2.0 - step)[0]) / (2 * step)
    np.testing.assert_allclose(gradient, [by_range, by_ratio], rtol=1e-6)


def test_likelihood_is_that_of_contrasts(rng):
    """The restricted likelihood is the likelihood of the errors' contrasts, which do not know the mean."""
    x, e = rng.random((12, 2)), rng.standard_normal((12, 2))
    contrasts = np.linalg.svd(np.ones((1, 12)))[2][1:]
    differences = []
    for length, ratio in ((0.3, 0.1), (0.8, 0.01)):
        value, _, scale = restricted_loss("matern32", length, ratio, cdist(x, x), e)
        model = VariogramModel("matern32", nugget=ratio, sill=1.0, range=length)
        covariance = contrasts @ model.covariance(cdist(x, x)) @ contrasts.T
        _, log_determinant = np.linalg.slogdet(covariance)
        z = contrasts @ e
        expected_scale = np.einsum("nc,nc->c", z, np.linalg.solve(covariance, z)) / 11
        np.testing.assert_allclose(scale, expected_scale)
        differences.append(value - log_determinant - 11 / 2 * np.log(expected_scale).sum())
    assert differences[0] == pytest.approx(differences[1], abs=1e-10)


def test_likelihood_finds_the_model(rng):
    x = rng.random((300, 3)) * 1000
    true = VariogramModel("matern32", nugget=0.1, sill=1.0, range=150.0)
    found = fit_likelihood(x, field(true, x, 3, rng), "matern32")
    np.testing.assert_allclose([found.nugget, found.sill, found.range], [0.1, 1.0, 150.0], rtol=0.35)


def test_likelihood_of_noise_has_no_structure(rng):
    assert fit_likelihood(rng.random((100, 3)), rng.standard_normal((100, 3))).structural_ratio < 0.2


def test_likelihood_refusals(rng):
    x = rng.random((10, 2))
    with pytest.raises(KrigingError, match="4 samples are too few"):
        fit_likelihood(x[:4], x[:4])
    with pytest.raises(KrigingError, match="do not vary"):
        fit_likelihood(x, np.ones(10))
    with pytest.raises(KrigingError, match="all 10 points are the same"):
        fit_likelihood(np.ones((10, 2)), x)
    with pytest.raises(KrigingError, match=r"linear.* has no likelihood"):
        fit_likelihood(x, x, "linear")
