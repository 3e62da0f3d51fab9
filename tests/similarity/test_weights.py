"""Weights of the bins and held parameters, as gstat and GSTools have them."""

from __future__ import annotations

from dataclasses import replace

import gstools
import numpy as np
import pytest
from scipy.optimize import curve_fit

from truepose.errors import DataError
from truepose.similarity import Direction, ExperimentalVariogram, VariogramModel, experimental_variogram, fit_variogram
from truepose.similarity.least_squares import WEIGHTS


@pytest.fixture(scope="module")
def bins() -> ExperimentalVariogram:
    """A noisy exponential semivariogram."""
    rng = np.random.default_rng(5)
    ev = experimental_variogram(rng.uniform(0, 1000, (150, 3)), rng.normal(size=150), bins=15, max_lag=800.0)
    gamma = VariogramModel("exponential", nugget=0.2, sill=1.0, range=120.0).semivariance(ev.lag)
    return replace(ev, vector=gamma * (1 + 0.08 * rng.normal(size=len(gamma))))


def exponential(h: np.ndarray, nugget: float, sill: float, reach: float) -> np.ndarray:
    return np.asarray(nugget + sill * (1 - np.exp(-h / reach)))


@pytest.mark.parametrize("weights", ["pairs", "pairs/h2", "equal"])
@pytest.mark.parametrize("held", [{}, {"nugget": 0.1}, {"sill": 0.9}, {"nugget": 0.1, "sill": 0.9}, {"range": 150.0}])
def test_agrees_with_scipy(bins: ExperimentalVariogram, weights: str, held: dict[str, float]) -> None:
    free = [name for name in ("nugget", "sill", "range") if name not in held]
    sigma = {"pairs": 1 / np.sqrt(bins.pairs), "pairs/h2": bins.lag / np.sqrt(bins.pairs), "equal": None}[weights]
    start = {"nugget": 0.3, "sill": 0.8, "range": 100.0}

    def curve(h: np.ndarray, *values: float) -> np.ndarray:
        known = held | dict(zip(free, values, strict=True))
        return exponential(h, known["nugget"], known["sill"], known["range"])

    expected = curve_fit(
        curve, bins.lag, bins.vector, [start[k] for k in free], sigma=sigma, bounds=(0, np.inf), ftol=1e-14, xtol=1e-14
    )[0]
    found = fit_variogram(bins, "exponential", weights=weights, fixed=held)
    np.testing.assert_allclose([getattr(found, name) for name in free], expected, rtol=2e-4)
    assert {name: getattr(found, name) for name in held} == held
    assert found.fit is not None
    assert {name for name, value in found.fit.standard_error.items() if np.isnan(value)} == set(held)


def test_agrees_with_gstools(bins: ExperimentalVariogram) -> None:
    other = gstools.Exponential(dim=3, nugget=0.1)
    other.fit_variogram(bins.lag, bins.vector, nugget=False)
    found = fit_variogram(bins, "exponential", weights="equal", fixed={"nugget": 0.1})
    np.testing.assert_allclose([found.sill, found.range], [other.var, other.len_scale], rtol=1e-3)


@pytest.mark.parametrize("weights", WEIGHTS)
def test_exact_semivariogram_is_found_with_any_weights(bins: ExperimentalVariogram, weights: str) -> None:
    true = VariogramModel("exponential", nugget=0.2, sill=1.0, range=120.0)
    exact = replace(bins, vector=true.semivariance(bins.lag))
    found = fit_variogram(exact, "best", weights=weights, fixed={"nugget": 0.2})
    assert found.family == "exponential"
    np.testing.assert_allclose([found.sill, found.range], [1.0, 120.0], rtol=1e-4)
    assert found.fit is not None
    assert found.fit.objective < 1e-8
    assert (found.fit.weights, found.fit.held) == (weights, {"nugget": 0.2})


def test_several_structures(bins: ExperimentalVariogram) -> None:
    true = VariogramModel("spherical", 0.1, 0.5, 200.0) + VariogramModel("exponential", 0.0, 1.0, 220.0)
    exact = replace(bins, vector=true.semivariance(bins.lag))
    held = {"range": 200.0, "range_of_2": 220.0, "nugget": 0.1}
    found = fit_variogram(exact, "spherical+exponential", fixed=held)
    assert found.nugget == 0.1
    np.testing.assert_allclose([found.range, found.plus[0].range], [200.0, 220.0], rtol=1e-12)
    np.testing.assert_allclose([found.sill, found.plus[0].sill], [0.5, 1.0], rtol=1e-6)
    one = fit_variogram(exact, "spherical+exponential", weights="pairs", fixed={"range_of_2": 220.0, "sill": 0.5})
    assert one.sill == 0.5
    np.testing.assert_allclose([one.nugget, one.range, one.plus[0].sill], [0.1, 200.0, 1.0], rtol=1e-3)


def test_range_of_an_axis(rng: np.random.Generator) -> None:
    x = rng.uniform(0, 1000, (150, 2))
    true = VariogramModel("exponential", 0.1, 1.0, (80.0, 180.0))
    along = [experimental_variogram(x, x[:, 0], 10, 600.0, direction=Direction(axis)) for axis in np.eye(2)]
    exact = [replace(ev, vector=true.semivariance(ev.lag, ev.axis)) for ev in along]
    found = fit_variogram(exact, "exponential", ranges="each", fixed={"range_2": 180.0})
    np.testing.assert_allclose(found.range, (80.0, 180.0), rtol=1e-3)


@pytest.mark.parametrize(
    ("fixed", "family", "message"),
    [
        ({"psill": 1.0}, "spherical", "fixed: a spherical variogram has no parameter 'psill'; expected nugget, sill"),
        ({"range": 1.0}, "nugget", "a nugget variogram has no parameter 'range'; expected nugget"),
        ({"range": 0.0}, "spherical", "fixed: range is 0.0; expected a finite number above 0"),
        ({"nugget": -1.0}, "spherical", "fixed: nugget is -1.0; expected a finite number of 0 or more"),
        ({"range_3": 5.0}, "spherical+gaussian", "has no parameter 'range_3'"),
    ],
)
def test_fixed_is_checked(bins: ExperimentalVariogram, fixed: dict[str, float], family: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        fit_variogram(bins, family, fixed=fixed)


def test_weights_are_checked(bins: ExperimentalVariogram) -> None:
    with pytest.raises(DataError, match="weights is 'n/h2'; expected one of cressie, pairs, pairs/h2, equal"):
        fit_variogram(bins, weights="n/h2")
    assert fit_variogram(bins, "nugget", fixed={"nugget": 0.5}).nugget == 0.5
