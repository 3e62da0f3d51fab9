from __future__ import annotations

import numpy as np
import pytest
from scipy.special import gamma, kv

from truepose.errors import KrigingError
from truepose.similarity import FAMILIES, VariogramModel
from truepose.similarity.covariance import slope_over_distance

BOUNDED = [name for name, kind in FAMILIES.items() if kind.bounded]


def matern(r, nu):
    t = np.sqrt(2 * nu) * r
    return 2 ** (1 - nu) / gamma(nu) * t**nu * kv(nu, t)


FORMULAS = {
    "spherical": lambda r: np.where(r < 1, 1 - 1.5 * r + 0.5 * r**3, 0),
    "exponential": lambda r: np.exp(-r),
    "gaussian": lambda r: np.exp(-(r**2)),
    "matern32": lambda r: matern(r, 1.5),
    "matern52": lambda r: matern(r, 2.5),
}


@pytest.mark.parametrize("family", BOUNDED)
def test_correlation_is_the_formula(family):
    h = np.linspace(1e-3, 30, 3001)
    model = VariogramModel(family, sill=1.0, range=2.0)
    np.testing.assert_allclose(model.signal_covariance(h), FORMULAS[family](h / 2), rtol=1e-11, atol=1e-14)


def test_exponential_to_the_last_bits():
    h = np.linspace(0, 700, 100_001)
    model = VariogramModel("exponential", sill=1.0, range=1.0)
    np.testing.assert_allclose(model.signal_covariance(h), np.exp(-h), rtol=5e-16)
    assert model.signal_covariance(1e6) < 1e-300


@pytest.mark.parametrize("family", BOUNDED)
def test_equation_5_and_limits(family):
    model = VariogramModel(family, nugget=0.5, sill=2.0, range=3.0)
    h = np.array([0.0, 0.1, 1.0, 5.0])
    np.testing.assert_allclose(model.semivariance(h), model.covariance(0.0) - model.covariance(h), atol=1e-15)
    assert model.semivariance(0.0) == 0
    assert model.semivariance(1e-9) == pytest.approx(0.5)
    assert model.covariance(0.0) == 2.5
    assert model.signal_covariance(0.0) == 2.0
    assert model.structural_ratio == 0.8
    assert model.semivariance(model.practical_range) == pytest.approx(0.5 + 0.95 * 2.0, rel=1e-12)


@pytest.mark.parametrize("family", list(FAMILIES))
def test_slope_against_differences(family):
    code, r, step = FAMILIES[family].code, np.array([0.05, 0.3, 0.7, 0.95, 1.4]), 1e-5
    model = VariogramModel(family, sill=1.0, range=1.0)
    differences = (model.semivariance(r - step) - model.semivariance(r + step)) / (2 * step)
    np.testing.assert_allclose(slope_over_distance(code, r) * r, differences, rtol=1e-8, atol=1e-9)


def test_linear_has_no_sill():
    model = VariogramModel("linear", nugget=0.1, sill=0.006, range=1.0)
    assert model.semivariance(50.0) == pytest.approx(0.4)
    assert model.practical_range == np.inf
    with pytest.raises(KrigingError, match="no sill"):
        model.covariance(1.0)


def test_plain_values_and_back():
    model = VariogramModel("matern52", nugget=0.1, sill=1.0, range=7.0)
    assert VariogramModel.from_dict(model.to_dict()) == model
    assert model.scaled(4.0).covariance(0.0) == pytest.approx(4.4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"family": "cubistic", "sill": 1, "range": 1}, "'cubistic' is not known; use one of spherical"),
        ({"family": "spherical", "sill": -1, "range": 1}, "sill is -1; expected a finite number of 0 or more"),
        ({"family": "spherical", "sill": 1, "range": 0}, "range is 0; expected a finite number above 0"),
        ({"family": "spherical", "sill": 1, "range": np.nan}, "range is nan"),
        ({"family": "spherical", "sill": 0, "range": 1}, "both 0"),
    ],
)
def test_refusals(arguments, message):
    with pytest.raises(KrigingError, match=message):
        VariogramModel(**arguments)


def test_negative_distance():
    with pytest.raises(KrigingError, match="0 or more"):
        VariogramModel("spherical", sill=1, range=1).semivariance([-1.0])
