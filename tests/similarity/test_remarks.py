"""A fit says aloud where the samples do not support it."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from truepose.errors import VariogramWarning
from truepose.predictors import OrdinaryKriging
from truepose.similarity import (
    VariogramModel,
    experimental_variogram,
    fit_likelihood,
    fit_variogram,
    permutation_envelope,
    sampled,
    verdict,
)

X = np.random.default_rng(3).uniform(0.0, 1000.0, (150, 3))
SMOOTH = np.column_stack([np.sin(X[:, 0] / 900.0), np.cos(X[:, 1] / 800.0), 1e-3 * X[:, 2]])


def drawn(model: VariogramModel) -> np.ndarray:
    root = np.linalg.cholesky(model.covariance_between(X, X) + model.nugget * np.eye(len(X)))
    return np.asarray(root @ np.random.default_rng(4).standard_normal((len(X), 3)))


@pytest.mark.parametrize("family", ["spherical", "exponential", "gaussian", "matern32", "matern52", "best"])
@pytest.mark.promise("fit_variogram warns once where the range is beyond the largest lag, and repr says it")
def test_no_sill_within_the_samples(family: str):
    ev = experimental_variogram(X, SMOOTH)
    with pytest.warns(VariogramWarning, match="no sill within the samples: the practical range of .* beyond") as caught:
        fitted = fit_variogram(ev, family)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert fitted.practical_range > fitted.fit.longest == ev.lag.max()
    assert fitted.fit.no_sill
    assert "no sill within the samples" in repr(fitted)


@pytest.mark.promise("fit_variogram warns where a parameter ends at its bound, and names it")
@pytest.mark.parametrize(
    ("gamma", "remark"),
    [
        (lambda h: np.full_like(h, 2.0), "flat"),
        (lambda h: 1 - np.exp(-((h / 150.0) ** 2)), "the nugget is not identifiable"),
        (lambda h: 0.01 + 1e-3 * h**1.7, "no sill within the samples"),
    ],
)
def test_bounds(gamma: Any, remark: str):
    ev = experimental_variogram(X, SMOOTH)
    with pytest.warns(VariogramWarning, match=remark):
        fitted = fit_variogram(replace(ev, vector=gamma(ev.lag)), "gaussian")
    assert remark in repr(fitted)


@pytest.mark.promise("fit_likelihood warns as fit_variogram does")
def test_likelihood_warns():
    with pytest.warns(VariogramWarning, match="no sill within the samples") as caught:
        fitted = fit_likelihood(X, SMOOTH)
    assert len(caught) == 1
    assert "no sill within the samples" in repr(fitted)


def test_a_good_fit_says_nothing():
    true = VariogramModel("exponential", nugget=0.2, sill=1.0, range=100.0)
    ev = experimental_variogram(X, SMOOTH)
    exact = replace(ev, vector=true.semivariance(ev.lag))
    e = drawn(true)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for fitted in (fit_variogram(exact, "exponential"), fit_likelihood(X, e, "exponential")):
            assert fitted.fit.remarks == ()
            assert "remarks" not in repr(fitted)


def test_a_model_set_by_hand_has_no_remarks():
    with pytest.warns(VariogramWarning):
        fitted = fit_variogram(experimental_variogram(X, SMOOTH))
    assert "remarks" not in repr(replace(fitted, range=200.0))
    assert "remarks" not in repr(VariogramModel("spherical", sill=1.0, range=2.0))


@pytest.mark.promise("predictors fit their variograms without a warning, however often")
def test_predictors_are_quiet(recwarn: pytest.WarningsRecorder):
    model = OrdinaryKriging("spherical").fit(X, SMOOTH)
    OrdinaryKriging().fit(X[:60], SMOOTH[:60])
    assert not [one for one in recwarn if issubclass(one.category, VariogramWarning)]
    assert "no sill within the samples" in repr(model.variogram_)


@pytest.mark.promise("structure and noise are stated for the distances that were sampled, as one set of figures")
def test_sampled_figures_extrapolate_nothing():
    envelope = permutation_envelope(X, SMOOTH)
    with pytest.warns(VariogramWarning):
        fitted = fit_variogram(envelope.variogram, "gaussian")
    found = sampled(fitted, envelope.variogram)
    seen = envelope.variogram.vector[-1]
    assert found.variance == pytest.approx(seen, rel=0.1)
    assert fitted.partial_sill > 2 * seen  # which the report told before
    assert not found.sill
    text = verdict(fitted, envelope)
    assert "there is no sill within the samples" in text
    assert f"at distances up to {found.lag:.4g} mm, {found.structure_percent:.6g} % is similarity" in text


@pytest.mark.parametrize("nugget", [0.0, 0.000018, 0.005, 0.013, 0.4])
def test_noise_and_structure_add_up(nugget: float):
    ev = experimental_variogram(X, SMOOTH)
    found = sampled(VariogramModel("spherical", nugget=nugget, sill=1.0 - nugget, range=100.0), ev)
    assert found.sill
    assert found.noise_share == pytest.approx(nugget)
    assert found.structure_percent + 100 * nugget == pytest.approx(100.0, abs=0.51 if nugget >= 0.01 else 1e-5)
