from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from truepose.errors import DataError, KrigingError, VariogramWarning
from truepose.similarity import (
    FAMILIES,
    Direction,
    VariogramModel,
    experimental_variogram,
    fit_likelihood,
    fit_variogram,
)

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
    with pytest.warns(VariogramWarning, match="the semivariogram is flat"):
        fitted = fit_variogram(replace(bins, vector=np.full_like(bins.lag, 2.0)), "spherical")
    assert (fitted.nugget, fitted.sill) == pytest.approx((2.0, 0.0))
    assert fitted.structural_ratio == 0
    assert fitted.fit.bounds_hit == {"sill": "lower"}
    assert "flat" in fitted.fit.remarks[0]
    assert np.isnan(fitted.fit.standard_error["sill"])


def test_trend_without_sill_is_reported(bins):
    with pytest.warns(VariogramWarning, match="no sill within the samples"):
        fitted = fit_variogram(replace(bins, vector=0.01 + 1e-3 * bins.lag**1.7), "spherical")
    assert fitted.fit.bounds_hit["range"] == "upper"
    assert any("trend" in remark for remark in fitted.fit.remarks)


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
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


def test_likelihood_finds_the_model(rng):
    x = rng.random((300, 3)) * 1000
    true = VariogramModel("matern32", nugget=0.1, sill=1.0, range=150.0)
    found = fit_likelihood(x, field(true, x, 3, rng), "matern32")
    np.testing.assert_allclose([found.nugget, found.sill, found.range], [0.1, 1.0, 150.0], rtol=0.35)


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
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
    with pytest.raises(KrigingError, match="'linear' cannot be fitted in this way"):
        fit_likelihood(x, x, "linear")


@pytest.mark.parametrize(("family", "shape"), [("matern", 1.0), ("stable", 1.5), ("rational", 2.0), ("power", 1.25)])
def test_shape_is_found_or_given(bins, family, shape):
    true = VariogramModel(family, nugget=0.2, sill=1.5, range=200.0, shape=shape)
    exact = replace(bins, vector=true.semivariance(bins.lag))
    for found in (fit_variogram(exact, family), fit_variogram(exact, family, shape=shape)):
        assert found.shape == shape
        np.testing.assert_allclose(found.semivariance(bins.lag), exact.vector, rtol=1e-4)


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
def test_nugget_alone_cubic_and_hole(bins):
    flat = replace(bins, vector=np.full_like(bins.lag, 2.0))
    assert fit_variogram(flat, "nugget").nugget == pytest.approx(2.0)
    for family in ("cubic", "hole"):
        true = VariogramModel(family, nugget=0.1, sill=1.0, range=300.0)
        found = fit_variogram(replace(bins, vector=true.semivariance(bins.lag)), family)
        assert found.range == pytest.approx(300, rel=1e-3)


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
def test_a_value_set_by_hand_stands_beside_the_fit(bins):
    fitted = fit_variogram(bins, "exponential")
    assert not fitted.overridden
    by_hand = replace(fitted, range=123.0)
    assert by_hand.overridden
    assert by_hand.fit.fitted["range"] == fitted.range


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
def test_two_structures_are_recovered(bins):
    true = VariogramModel("spherical", nugget=0.1, sill=1.0, range=120.0)
    true = true + VariogramModel("gaussian", sill=2.0, range=500.0)
    fitted = fit_variogram(replace(bins, vector=true.semivariance(bins.lag)), "spherical+gaussian")
    for found, part in zip(fitted.structures, true.structures, strict=True):
        assert found.family == part.family
        np.testing.assert_allclose([found.sill, found.range], [part.sill, part.range], rtol=1e-3)
    assert fitted.nugget == pytest.approx(0.1, abs=1e-3)
    assert fitted.fit.bounds_hit == {}
    assert set(fitted.fit.standard_error) == {"nugget", "sill", "range", "sill_of_2", "range_of_2"}
    assert fitted.fit.fitted == fitted.to_dict()


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
def test_a_structure_that_is_not_needed_is_told(bins):
    true = VariogramModel("spherical", nugget=0.1, sill=1.0, range=300.0)
    fitted = fit_variogram(replace(bins, vector=true.semivariance(bins.lag)), "spherical+spherical")
    np.testing.assert_allclose(fitted.semivariance(bins.lag), true.semivariance(bins.lag), rtol=1e-4)


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.5), (0.3, -0.2, 0.6), None])
def test_ranges_along_axes_are_recovered(rng, rotation):
    """From the semivariance along 13 directions; turned axes may come in any order."""
    d = 2 if rotation == (0.0, 0.0, 0.5) else 3
    true = VariogramModel("matern32", nugget=0.2, sill=1.5, range=(300.0, 150.0, 80.0)[:d], rotation=rotation)
    x = rng.random((150, d)) * 1000
    lines = [v for v in np.ndindex(*(3,) * d) if tuple(np.subtract(v, 1)) > (0,) * d]
    evs = [
        experimental_variogram(x, x[:, :1], 8, 500.0, direction=Direction(np.subtract(v, 1), np.pi / 6)) for v in lines
    ]
    exact = [replace(ev, vector=true.semivariance(np.nan_to_num(ev.lag), ev.axis)) for ev in evs]
    fitted = fit_variogram(exact, "matern32", ranges="each" if rotation is None else "rotated")
    for ev in exact:
        used = ev.pairs > 0
        np.testing.assert_allclose(fitted.semivariance(ev.lag[used], ev.axis), ev.vector[used], rtol=1e-4)
    np.testing.assert_allclose(sorted(fitted.range, reverse=True), true.range, rtol=1e-3)
    assert all(fitted.fit.standard_error[f"range_{k + 1}"] < 1 for k in range(d))


def test_refusals_of_axes(bins):
    with pytest.raises(DataError, match="ranges='each' needs semivariograms along directions"):
        fit_variogram(bins, "spherical", ranges="each")
    with pytest.raises(DataError, match="expected a semivariogram, or several along different directions, got"):
        fit_variogram([], "spherical")
    with pytest.raises(KrigingError, match=r"family \['sphere'\] is not known"):
        fit_variogram(bins, "sphere+gaussian")
