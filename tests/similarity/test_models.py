from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from scipy.special import gamma, kv
from tests.tiers import examples

from truepose.errors import DataError, KrigingError
from truepose.numerics.kernels import pack
from truepose.similarity import FAMILIES, VariogramModel
from truepose.similarity.structure import correlation, slope_over_distance, weighted_gradient, weighted_sum


def matern(r, nu):
    t = np.sqrt(2 * nu) * r
    return 2 ** (1 - nu) / gamma(nu) * t**nu * kv(nu, t)


FORMULAS = {
    ("spherical", None): lambda r: np.where(r < 1, 1 - 1.5 * r + 0.5 * r**3, 0),
    ("exponential", None): lambda r: np.exp(-r),
    ("gaussian", None): lambda r: np.exp(-(r**2)),
    ("matern32", None): lambda r: matern(r, 1.5),
    ("matern52", None): lambda r: matern(r, 2.5),
    ("cubic", None): lambda r: np.where(r < 1, 1 - 7 * r**2 + 8.75 * r**3 - 3.5 * r**5 + 0.75 * r**7, 0),
    ("matern", 0.3): lambda r: matern(r, 0.3),
    ("matern", 0.5): lambda r: matern(r, 0.5),
    ("matern", 1.0): lambda r: matern(r, 1.0),
    ("matern", 2.2): lambda r: matern(r, 2.2),
    ("matern", 4.5): lambda r: matern(r, 4.5),
    ("stable", 0.7): lambda r: np.exp(-(r**0.7)),
    ("stable", 2.0): lambda r: np.exp(-(r**2)),
    ("rational", 0.4): lambda r: (1 + r**2 / 0.8) ** -0.4,
    ("hole", None): lambda r: np.sin(r) / r,
}
SHAPES = {"matern": 2.2, "stable": 1.3, "rational": 1.7, "power": 1.4}
BOUNDED = [name for name, kind in FAMILIES.items() if kind.bounded and name != "nugget"]


def model_of(family, sill=1.0, range=1.0, **others):  # noqa: A002
    return VariogramModel(family, sill=sill, range=range, shape=SHAPES.get(family), **others)


@pytest.mark.parametrize(("family", "shape"), FORMULAS)
def test_correlation_is_the_formula(family, shape):
    h = np.linspace(1e-3, 20, 3001)
    model = VariogramModel(family, sill=1.0, range=2.0, shape=shape)
    np.testing.assert_allclose(model.signal_covariance(h), FORMULAS[family, shape](h / 2), rtol=1e-11, atol=1e-14)


def test_every_family_has_a_formula_here():
    assert {name for name, _ in FORMULAS} == set(BOUNDED)


def test_exponential_to_the_last_bits():
    h = np.linspace(0, 700, 100_001)
    model = VariogramModel("exponential", sill=1.0, range=1.0)
    np.testing.assert_allclose(model.signal_covariance(h), np.exp(-h), rtol=5e-16)
    assert model.signal_covariance(1e6) < 1e-300


@pytest.mark.parametrize("nu", [0.3, 0.9999, 1.0, 1.0001, 3.3, 30.0])
def test_matern_near_zero(nu):
    """Where the Bessel function overflows, the correlation is 1 less a power of the distance."""
    r = np.concatenate([[0.0], np.geomspace(1e-300, 1e-3, 400)])
    rho = correlation(FAMILIES["matern"].code, r, nu)
    assert rho[0] == 1
    assert np.isfinite(rho).all()
    assert (np.diff(rho) <= 1e-13).all()


@pytest.mark.parametrize("family", BOUNDED)
def test_equation_5_and_limits(family):
    model = model_of(family, nugget=0.5, sill=2.0, range=3.0)
    h = np.array([0.0, 0.1, 1.0, 5.0])
    np.testing.assert_allclose(model.semivariance(h), model.covariance(0.0) - model.covariance(h), atol=1e-15)
    assert model.semivariance(0.0) == 0
    assert model.semivariance(1e-12) == pytest.approx(0.5)
    assert model.covariance(0.0) == 2.5
    assert model.signal_covariance(0.0) == 2.0
    assert model.structural_ratio == 0.8
    assert model.semivariance(model.practical_range) == pytest.approx(0.5 + 0.95 * 2.0, rel=1e-12)


@pytest.mark.parametrize("family", [name for name in FAMILIES if name != "nugget"])
def test_slope_by_distance(family):
    """Against differences of sixth order; all models but the Bessel ones are exact to the last digits."""
    model, h, step = model_of(family, nugget=0.3, range=2.0), np.array([0.1, 0.6, 1.4, 1.9, 2.8]), 1e-3
    np.testing.assert_allclose(model.slope(h), sixth_order(model.semivariance, h, step), rtol=1e-8, atol=1e-10)


def sixth_order(function, at, step):
    ahead = [function(at + k * step) - function(at - k * step) for k in (1, 2, 3)]
    return (45 * ahead[0] - 9 * ahead[1] + ahead[2]) / (60 * step)


ANISOTROPIC = {"range": (2.0, 5.0, 0.7), "rotation": (0.4, -0.3, 1.1)}


@pytest.mark.parametrize("family", [name for name in FAMILIES if name != "nugget"])
@pytest.mark.parametrize("extra", [{}, ANISOTROPIC])
def test_derivatives_by_parameters(family, extra):
    nested = VariogramModel("exponential", nugget=0.2, sill=0.4, range=1.5) if not extra else None
    start = model_of(family, nugget=0.3, sill=1.7, **{"range": 2.0, **extra})
    h, axis = np.array([0.0, 0.3, 0.9, 2.6]), [1.0, 2.0, -0.5]

    def rebuilt(name, delta):
        values = start.to_dict()
        stem, _, index = name.partition("_")
        if stem == "rotation":
            values[stem]["xyz".index(index)] += delta
        elif index:
            values[stem][int(index) - 1] += delta
        else:
            values[stem] += delta
        model = VariogramModel.from_dict(values)
        return model + nested if nested else model

    found = rebuilt("sill", 0.0).derivatives(h, axis)
    for name, values in found.items():
        if name.endswith("_of_2"):
            continue
        differences = sixth_order(lambda d, name=name: rebuilt(name, d).semivariance(h, axis), 0.0, 1e-3)
        np.testing.assert_allclose(values, differences, rtol=1e-6, atol=1e-9, err_msg=name)
    if nested:
        np.testing.assert_allclose(found["sill_of_2"], 1 - np.exp(-h / 1.5))


@settings(max_examples=examples(60))
@given(
    seed=st.integers(0, 2**32 - 1),
    d=st.sampled_from([1, 2, 3, 6]),
    family=st.sampled_from(BOUNDED),
    ranges=st.booleans(),
)
def test_covariance_is_positive_definite(seed, d, family, ranges):
    """In as many coordinates as the table allows, whatever the ranges."""
    rng = np.random.default_rng(seed)
    a = tuple(rng.uniform(0.1, 2.0, d)) if ranges else float(rng.uniform(0.1, 2.0))
    model = model_of(family, range=a)
    if d > FAMILIES[family].dimensions:
        with pytest.raises(KrigingError, match="valid in up to 3 coordinates"):
            model.check_dimensions(d)
        return
    x = rng.random((60, d))
    matrix = model.covariance_between(x, x)
    assert np.linalg.eigvalsh(matrix)[0] > -1e-12 * 60
    stretched = cdist(x / np.array(a), x / np.array(a))
    np.testing.assert_allclose(matrix, model_of(family).signal_covariance(stretched), atol=1e-12)


@settings(max_examples=examples(30))
@given(seed=st.integers(0, 2**32 - 1), d=st.sampled_from([1, 2, 3, 6]), alpha=st.floats(0.05, 1.95))
def test_pseudo_sill_makes_it_positive_definite(seed, d, alpha):
    rng = np.random.default_rng(seed)
    x = rng.random((40, d)) * rng.uniform(0.1, 10)
    model = VariogramModel("power", nugget=0.1, sill=2.0, range=3.0, shape=alpha)
    model += VariogramModel("exponential", sill=0.5, range=1.0)
    standing = model.with_pseudo_sill(x)
    h = cdist(x, x)
    np.testing.assert_allclose(standing.semivariance(h), model.semivariance(h), rtol=1e-9, atol=1e-12)
    covariance = standing.partial_sill - (standing.semivariance(h) - np.where(h == 0, 0.0, standing.nugget))
    assert np.linalg.eigvalsh(covariance)[0] > -1e-9 * standing.partial_sill


def test_rotated_ranges():
    turn = Rotation.from_euler("zyx", [30, -20, 50], degrees=True)
    model = VariogramModel("gaussian", sill=1.0, range=(3.0, 2.0, 1.0), rotation=turn)
    assert model.practical_range == max(model.practical_ranges) == pytest.approx(3 * np.sqrt(np.log(20)))
    for k, a in enumerate((3.0, 2.0, 1.0)):
        along = turn.as_matrix()[:, k]
        np.testing.assert_allclose(
            model.signal_covariance([0.5, 2.0], along), np.exp(-(np.array([0.5, 2.0]) ** 2) / a**2)
        )
    flat = VariogramModel("gaussian", sill=1.0, range=(3.0, 1.0), rotation=(0, 0, np.pi / 2))
    np.testing.assert_allclose(flat.signal_covariance(1.0, [0, 1.0]), np.exp(-1 / 9))


def test_nested_sum(rng):
    first = VariogramModel("spherical", nugget=0.1, sill=1.0, range=5.0)
    second = VariogramModel("matern", nugget=0.2, sill=2.0, range=(9.0, 4.0, 3.0), shape=1.5)
    both = first + second + VariogramModel("nugget", nugget=0.3)
    h, axis = np.array([0.0, 0.5, 4.0]), [1.0, 1.0, 0]
    np.testing.assert_allclose(
        both.semivariance(h, axis), first.semivariance(h) + second.semivariance(h, axis) + (h > 0) * 0.3
    )
    assert (both.nugget, both.partial_sill) == pytest.approx((0.6, 3.0))
    assert [part.family for part in both.structures] == ["spherical", "matern"]
    for axis, reach in zip(np.eye(3), both.practical_ranges, strict=True):
        assert both.semivariance(reach, axis) == pytest.approx(0.6 + 0.95 * 3)
    assert both.scaled(4.0).covariance(0.0, axis) == pytest.approx(14.4)


def test_plain_values_and_back():
    simple = VariogramModel("matern52", nugget=0.1, sill=1.0, range=7.0)
    assert set(simple.to_dict()) == {"family", "nugget", "sill", "range"}
    rich = VariogramModel("stable", sill=1.0, range=(1.0, 2.0, 3.0), shape=1.5, rotation=(0.1, 0, 0), plus=[simple])
    for model in (simple, rich):
        assert VariogramModel.from_dict(json.loads(json.dumps(model.to_dict()))) == model
    assert simple.scaled(4.0).covariance(0.0) == pytest.approx(4.4)


@pytest.mark.parametrize("family", BOUNDED)
def test_sums_over_samples(family, rng):
    """The compiled sums, and those with scipy's Bessel function, are the sums of the formula and its slope."""
    model, u, v, w = model_of(family), rng.random((7, 3)), rng.random((300, 3)) * 2, rng.standard_normal((300, 2))
    code, shape = FAMILIES[family].code, model.shape or 0.0
    np.testing.assert_allclose(
        weighted_sum(code, u, pack(v), pack(w), shape), model.covariance_between(u, v) @ w, rtol=1e-11, atol=1e-11
    )
    gap = u[:, None] - v
    slope = slope_over_distance(code, np.linalg.norm(gap, axis=2), shape)
    expected = np.einsum("mn,nc,mnd->mcd", slope, w, gap)
    np.testing.assert_allclose(weighted_gradient(code, u, pack(v), pack(w), shape), expected, rtol=1e-9, atol=1e-9)


def test_linear_has_no_sill():
    model = VariogramModel("linear", nugget=0.1, sill=0.006, range=1.0)
    assert model.semivariance(50.0) == pytest.approx(0.4)
    assert model.practical_range == np.inf
    with pytest.raises(KrigingError, match="no sill"):
        model.covariance(1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"family": "cubistic", "sill": 1, "range": 1}, "'cubistic' is not known; use one of spherical"),
        ({"family": "spherical", "sill": -1, "range": 1}, "sill is -1; expected a finite number of 0 or more"),
        ({"family": "spherical", "sill": 1, "range": 0}, "range is 0; expected a finite number above 0"),
        ({"family": "spherical", "sill": 1, "range": np.nan}, "range is nan"),
        ({"family": "spherical", "sill": 1, "range": (1.0, 0.0)}, r"range is \(1.0, 0.0\)"),
        ({"family": "spherical", "sill": 0, "range": 1}, "both 0"),
        ({"family": "nugget", "sill": 1, "range": 1}, "a nugget has no sill"),
        ({"family": "stable", "sill": 1, "range": 1}, "needs its shape α; give shape=, a number above 0 and up to 2"),
        ({"family": "stable", "sill": 1, "range": 1, "shape": 2.1}, "shape α of stable is 2.1"),
        ({"family": "power", "sill": 1, "range": 1, "shape": 2.0}, "above 0 and below 2"),
        ({"family": "gaussian", "sill": 1, "range": 1, "shape": 2.0}, "has no shape parameter"),
        ({"family": "gaussian", "sill": 1, "range": 1, "rotation": (0, 0, 1)}, "needs several ranges"),
        ({"family": "gaussian", "sill": 1, "range": (1, 1), "rotation": (0, 1)}, "rotation vector"),
        ({"family": "gaussian", "sill": 1, "range": 1, "plus": ["nugget"]}, "something else than VariogramModel"),
    ],
)
def test_refusals(arguments, message):
    with pytest.raises(KrigingError, match=message):
        VariogramModel(**arguments)


def test_refusals_of_use():
    anisotropic = VariogramModel("spherical", sill=1, range=(1.0, 2.0))
    with pytest.raises(KrigingError, match="0 or more"):
        VariogramModel("spherical", sill=1, range=1).semivariance([-1.0])
    with pytest.raises(KrigingError, match="pass the direction of the distances"):
        anisotropic.semivariance(1.0)
    with pytest.raises(DataError, match="vector of 2 numbers"):
        anisotropic.semivariance(1.0, [0.0, 0.0])
    with pytest.raises(KrigingError, match="has 2 ranges, but there are 3 coordinates"):
        anisotropic.check_dimensions(3)
    with pytest.raises(KrigingError, match="must be about z"):
        VariogramModel("gaussian", sill=1.0, range=(3.0, 1.0), rotation=(1, 0, 0)).check_dimensions(2)


def test_positional_arguments_and_repr():
    model = VariogramModel("spherical", 0.01, 1.0, 500)
    assert model == VariogramModel("spherical", nugget=0.01, sill=1.0, range=500)
    assert repr(model) == "VariogramModel('spherical', nugget=0.01, sill=1.0, range=500.0)"
    rich = VariogramModel("stable", 0.0, 1 / 3, (1.0, 2.0), shape=1.5, rotation=(0, 0, 0.1)) + model
    assert repr(rich).startswith("VariogramModel('stable', nugget=0.01, sill=0.333333, range=(1.0, 2.0), shape=1.5")
    assert eval(repr(rich), {"VariogramModel": VariogramModel}).plus == rich.plus
