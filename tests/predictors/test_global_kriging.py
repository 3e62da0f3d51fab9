"""What all Kriging from one factorisation can: drifts, known means, boxes, blocks left out, fields, nested models."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from tests.tiers import examples

from truepose.errors import DataError, IllConditionedWarning, KrigingError
from truepose.predictors import (
    LocalKriging,
    OrdinaryKriging,
    SimpleKriging,
    UniversalKriging,
    VecchiaKriging,
    block_folds,
)
from truepose.predictors.kriging.correlation import Correlation, Support
from truepose.similarity import VariogramModel, experimental_variogram
from truepose.similarity.trend import DriftBasis

MODEL = VariogramModel("matern32", nugget=0.1, sill=1.0, range=0.4)
NESTED = MODEL + VariogramModel("spherical", sill=0.5, range=(0.3, 0.9, 2.0), rotation=(0.1, 0.2, 0.3))


def dense(variogram, x, e, targets, drift, f0):
    """Equation (8) as it stands: generalised least squares and the bordered variance, by explicit inverses."""
    inverse = np.linalg.inv(variogram.covariance_between(x, x) + variogram.nugget * np.eye(len(x)))
    cross = variogram.covariance_between(targets, x)
    spread = np.linalg.inv(drift.T @ inverse @ drift)
    beta = spread @ drift.T @ inverse @ e
    mean = f0 @ beta + cross @ inverse @ (e - drift @ beta)
    lack = f0 - cross @ inverse @ drift
    prior = np.diag(variogram.covariance_between(targets, targets))
    return mean, prior - np.einsum("mi,ij,mj->m", cross, inverse, cross) + np.einsum("mp,pq,mq->m", lack, spread, lack)


@settings(max_examples=examples(25))
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 3, 6]), st.sampled_from(["constant", "linear", "quadratic"]))
def test_equation_8(seed, d, drift):
    rng = np.random.default_rng(seed)
    x, e, targets = rng.random((60, d)), rng.standard_normal((60, 2)), rng.random((7, d))
    mean, std = UniversalKriging(drift, MODEL).fit(x, e).predict(targets, return_std=True)
    basis = DriftBasis.of(drift, x)
    expected, variance = dense(MODEL, x, e, targets, basis(x), basis(targets))
    np.testing.assert_allclose(mean, expected, atol=1e-9)
    np.testing.assert_allclose(std[:, 0] ** 2, variance, atol=1e-9)


@pytest.mark.parametrize("drift", ["linear", "quadratic", "cubic", 1])
def test_a_polynomial_is_reproduced_far_away(drift, rng):
    x = rng.random((60, 3))
    e = 3 - 2 * x + (x[:, :1] * x[:, 1:2] if drift in ("quadratic", "cubic") else 0)
    far = rng.random((5, 3)) * 10
    expected = 3 - 2 * far + (far[:, :1] * far[:, 1:2] if drift in ("quadratic", "cubic") else 0)
    np.testing.assert_allclose(UniversalKriging(drift, MODEL).fit(x, e).predict(far), expected, atol=1e-7)


def test_columns_and_functions_are_drifts_alike(rng):
    x, e, targets = rng.random((40, 3)), rng.standard_normal((40, 2)), rng.random((9, 3))

    def wave(x):
        return np.sin(5 * x[:, :1])

    column = UniversalKriging([3], MODEL).fit(np.hstack([x, wave(x)]), e)
    function = UniversalKriging(wave, MODEL).fit(x, e)
    for mine, other in zip(
        column.predict(np.hstack([targets, wave(targets)]), return_std=True),
        function.predict(targets, return_std=True),
        strict=True,
    ):
        np.testing.assert_allclose(mine, other, atol=1e-10)
    assert column.to_dict()["drift"] == [3]
    assert column.gradient(np.hstack([targets, wave(targets)])).shape == (9, 2, 4)
    with pytest.raises(KrigingError, match="not known inside a box"):
        column.predict_block(np.hstack([targets, wave(targets)]), 0.1)


@pytest.mark.parametrize(
    ("drift", "message"),
    [
        ("linaer", "drift is 'linaer'; expected constant, linear"),
        (4, "a degree from 0 to 3"),
        ([3], "expected columns of X below 3"),
        ([0, 1, 2], "but not all of them"),
        (lambda x: x[:3], r"returned shape \(3, 3\) for 30 points"),
        (lambda x: np.ones((len(x), 1)), "the 2 columns of the drift are not independent at 30 points"),
    ],
)
def test_drifts_that_cannot_be(drift, message, rng):
    with pytest.raises(KrigingError, match=message):
        UniversalKriging(drift, MODEL).fit(rng.random((30, 3)), rng.random((30, 3)))


def test_drift_of_a_plane_of_points(rng):
    flat = np.hstack([rng.random((30, 2)), np.full((30, 1), 0.5)])
    with pytest.raises(KrigingError, match="4 columns of the drift are not independent"):
        UniversalKriging("linear", MODEL).fit(flat, flat)


def test_simple_kriging(rng):
    x, e, targets = rng.random((30, 3)), rng.standard_normal((30, 2)), rng.random((9, 3))
    model = SimpleKriging(MODEL, mean=(0.5, -1.0)).fit(x, e)
    inverse = np.linalg.inv(MODEL.covariance(cdist(x, x)))
    cross = MODEL.signal_covariance(cdist(targets, x))
    mean, std = model.predict(targets, return_std=True)
    np.testing.assert_allclose(mean, [0.5, -1.0] + cross @ inverse @ (e - [0.5, -1.0]))
    np.testing.assert_allclose(std[:, 0] ** 2, 1 - np.einsum("mi,ij,mj->m", cross, inverse, cross))
    np.testing.assert_allclose(model.predict([[1e6, 0, 0]]), [[0.5, -1.0]])
    with pytest.raises(KrigingError, match="simple Kriging needs a sill, and linear has none"):
        SimpleKriging(VariogramModel("linear", sill=1.0, range=1.0)).fit(x, e)
    with pytest.raises(KrigingError, match=r"mean is \(1, 2, 3\); expected a finite number, or one for each of 2"):
        SimpleKriging(MODEL, mean=(1, 2, 3)).fit(x, e)


def test_nested_anisotropic_model_in_every_engine(rng):
    x, e, targets = rng.random((40, 3)), rng.standard_normal((40, 2)), rng.random((9, 3))
    expected, variance = dense(NESTED, x, e, targets, np.ones((40, 1)), np.ones((9, 1)))
    for model in (OrdinaryKriging(NESTED), LocalKriging(40, NESTED), VecchiaKriging(40, NESTED)):
        mean, std = model.fit(x, e).predict(targets, return_std=True)
        np.testing.assert_allclose(mean, expected, atol=1e-9)
        np.testing.assert_allclose(std[:, 0] ** 2, variance, atol=1e-9)


@pytest.mark.parametrize("model", [OrdinaryKriging, UniversalKriging, SimpleKriging, LocalKriging, VecchiaKriging])
def test_gradient_by_differences_of_high_order(model, rng):
    x, e, targets, h = rng.random((40, 3)), rng.standard_normal((40, 2)), rng.random((9, 3)), 1e-3
    drift = {"drift": "quadratic"} if model in (UniversalKriging, LocalKriging, VecchiaKriging) else {}
    near = {"neighbours": 40} if model in (LocalKriging, VecchiaKriging) else {}
    smooth = VariogramModel("matern", shape=4.5, nugget=0.1, sill=1.0, range=(0.5, 0.7, 0.9))
    fitted = model(variogram=smooth, **drift, **near).fit(x, e)
    slope = fitted.gradient(targets)
    for a, unit in enumerate(np.eye(3) * h):
        at = {k: fitted.predict(targets + k * unit) for k in (-3, -2, -1, 1, 2, 3)}
        high = (45 * (at[1] - at[-1]) - 9 * (at[2] - at[-2]) + (at[3] - at[-3])) / (60 * h)
        np.testing.assert_allclose(slope[:, :, a], high, atol=1e-6 * np.abs(high).max())


def test_block_average_is_the_mean_of_points_and_its_variance_that_of_fields(rng):
    x, e = rng.random((25, 2)), rng.standard_normal((25, 2))
    model = UniversalKriging("linear", VariogramModel("gaussian", nugget=0.1, sill=1.0, range=0.5)).fit(x, e)
    centre, size = np.array([[0.4, 0.6]]), np.array([0.5, 0.3])
    inside = centre + (rng.random((400, 2)) - 0.5) * size
    mean, std = model.predict_block(centre, size, return_std=True)
    grid = np.stack(np.meshgrid(*[(np.arange(20) + 0.5) / 20 - 0.5] * 2), -1).reshape(-1, 2) * size + centre
    np.testing.assert_allclose(mean[0], model.predict(grid).mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(std[0, 0] ** 2, model.covariance(grid)[0].mean(), rtol=1e-2)
    assert model.predict_block(centre, size).shape == (1, 2)
    fields = model.simulate(inside, 50).mean(axis=1)
    assert np.abs(fields.mean(axis=0) - mean[0]).max() < 1.0  # of the size of the errors at least


@pytest.mark.parametrize("samples", ["centre", "corners"])
def test_block_variance_of_a_square_in_closed_form(samples):
    """Linear semivariogram: 2 γ̄(samples, square) − γ̄(square, square) − γ̄(samples, samples), weights equal by symmetry.

    Mean distances in the unit square: of two points (2 + √2 + 5 ln(1 + √2))/15, from a corner (√2 + ln(1 + √2))/3,
    from the centre half of that (B. Ghosh, Bulletin of the Calcutta Mathematical Society 43, 1951).
    """
    root, log = np.sqrt(2), np.log(1 + np.sqrt(2))
    two, corner = (2 + root + 5 * log) / 15, (root + log) / 3
    if samples == "centre":  # a second sample, so far away that its weight is small, has no effect beyond its distance
        x, expected = np.array([[0.5, 0.5], [1e6, 0.5]]), corner - two
    else:
        x, expected = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]), 2 * corner - two - (2 + root) / 4
    model = OrdinaryKriging(VariogramModel("linear", sill=1.0, range=1.0)).fit(x, np.arange(len(x), dtype=float))
    std = model.predict_block([[0.5, 0.5]], 1.0, return_std=True)[1]
    assert std[0] ** 2 == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("d", "mean"), [(1, 0.55), (2, 0.3378438), (3, 0.2117428)])
def test_mean_correlation_within_a_box(d, mean):
    """Spherical, range 1, unit box: closed form 11/20 in one dimension; else two independent quadratures."""
    correlation = Correlation.of(VariogramModel("spherical", sill=1.0, range=1.0), d)
    assert Support.box(1.0, d, None, correlation).within == pytest.approx(mean, abs=3e-4)


def test_mean_distance_in_a_cube():
    """Robbins' constant: D. P. Robbins, American Mathematical Monthly 85 (1978)."""
    gaps = VariogramModel("exponential", sill=1.0, range=1e6)
    within = Support.box(1.0, 3, None, Correlation.of(gaps, 3)).within
    assert 1e6 * (1 - within) == pytest.approx(0.6617071822, rel=1e-5)


def test_a_small_block_is_a_point(rng):
    x, e, targets = rng.random((25, 3)), rng.standard_normal((25, 3)), rng.random((5, 3))
    model = OrdinaryKriging(MODEL).fit(x, e)
    for block, point in zip(model.predict_block(targets, 1e-5, True), model.predict(targets, True), strict=True):
        np.testing.assert_allclose(block, point, atol=1e-5)
    exact = OrdinaryKriging(MODEL, exact=True).fit(x, e)  # a nugget averages out
    std = exact.predict_block(targets, 1e-5, True)[1]
    np.testing.assert_allclose(std**2, exact.predict(targets, True)[1] ** 2 - MODEL.nugget, atol=1e-4)
    with pytest.raises(KrigingError, match=r"block size is 0; expected a number above 0"):
        model.predict_block(targets, 0)
    with pytest.raises(KrigingError, match="100 nodes along each of 3 edges"):
        model.predict_block(targets, 1, nodes=100)


@settings(max_examples=examples(20))
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([None, 0.3, "each"]))
def test_leave_blocks_out_is_refitting(seed, exact, noise):
    rng = np.random.default_rng(seed)
    x, e = rng.random((30, 2)), rng.standard_normal((30, 2))
    x[7] = x[3] if noise else x[7]  # a repeat
    std = np.broadcast_to(rng.random((30, 2)) + 0.1 if noise == "each" else noise or 0.0, (30, 2))
    model = UniversalKriging("linear", MODEL, exact).fit(x, e, std if noise else None)
    blocks = np.arange(30) % 5
    blocks[7] = blocks[3]
    residual, left_std = model.leave_blocks_out(blocks)
    for block in range(5):
        out = blocks == block
        # its drift is centred anew, and spans the same space
        refitted = UniversalKriging("linear", MODEL, exact).fit(x[~out], e[~out], std[~out] if noise else None)
        mean, refitted_std = refitted.predict(x[out], return_std=True, include_nugget=True)
        np.testing.assert_allclose(residual[out], e[out] - mean, atol=1e-9)
        np.testing.assert_allclose(left_std[out] ** 2, refitted_std**2 + std[out] ** 2, rtol=1e-9)


def test_leave_blocks_out_of_folds(rng):
    x = rng.random((60, 3))
    model = OrdinaryKriging(MODEL).fit(x, x[:, 0])
    assert model.leave_blocks_out(block_folds(x, 4)).residual.shape == (60,)
    one = model.leave_blocks_out(np.arange(60))
    np.testing.assert_allclose(one.residual, model.leave_one_out().residual, atol=1e-12)
    with pytest.raises(KrigingError, match="the others do not determine the drift"):
        model.leave_blocks_out(np.zeros(60))
    with pytest.raises(DataError, match=r"blocks have shape \(3,\); expected \(60,\)"):
        model.leave_blocks_out([0, 1, 2])


@pytest.mark.parametrize("exact", [True, False])
def test_fields_honour_the_samples(exact, rng):
    silent = MODEL if exact else VariogramModel("matern32", sill=1.0, range=0.4)
    x, e = rng.random((20, 3)), rng.standard_normal((20, 2))
    model = OrdinaryKriging(silent, exact).fit(x, e)
    targets = np.vstack([x[:5], rng.random((30, 3))])
    fields = model.simulate(targets, 3000, rng=1)
    np.testing.assert_allclose(fields[:, :5], np.broadcast_to(e[:5], (3000, 5, 2)), atol=1e-9)
    mean, std = model.predict(targets, return_std=True)
    np.testing.assert_allclose(fields.mean(axis=0), mean, atol=5 * std.max() / np.sqrt(3000))
    np.testing.assert_allclose(fields.std(axis=0)[5:], std[5:], rtol=0.1)
    np.testing.assert_array_equal(fields, model.simulate(targets, 3000, rng=1))
    with pytest.raises(KrigingError, match="size is 0; expected 1 field"):
        model.simulate(targets, 0)


def test_fields_reproduce_the_variogram(rng):
    true = VariogramModel("exponential", sill=1.0, range=0.15)
    x = rng.random((300, 2))
    e = np.linalg.cholesky(true.covariance(cdist(x, x)) + 1e-12 * np.eye(300)) @ rng.standard_normal((300, 1))
    model = OrdinaryKriging(true, exact=True).fit(x, e)
    targets = rng.random((400, 2))
    fields = model.simulate(targets, 20, rng=2)[:, :, 0]
    ev = experimental_variogram(targets, fields.T, bins=12, max_lag=0.4)
    simulated, kriged = (
        ev.semivariance.mean(axis=1),
        experimental_variogram(targets, model.predict(targets), bins=12, max_lag=0.4).semivariance[:, 0],
    )
    of_samples = experimental_variogram(x, e, bins=12, max_lag=0.4).semivariance[:, 0]
    np.testing.assert_allclose(simulated[:6], true.semivariance(ev.lag)[:6], rtol=0.3)
    np.testing.assert_allclose(simulated, of_samples, rtol=0.25)
    assert kriged[0] < 0.6 * simulated[0]  # a prediction is too smooth, a field is not


def test_covariance_has_the_variance_on_its_diagonal(rng):
    x, e, targets = rng.random((20, 3)), rng.standard_normal((20, 2)), rng.random((9, 3))
    for exact in (True, False):
        model = OrdinaryKriging(MODEL, exact).fit(x, e)
        std = model.predict(targets, return_std=True, include_nugget=True)[1]
        covariance = model.covariance(targets, include_nugget=True)
        np.testing.assert_allclose(np.einsum("kmm->mk", covariance), std**2)


def test_near_points_that_differ_in_the_last_digits_are_one(rng):
    x, e = rng.random((20, 3)) * 1000, rng.standard_normal((20, 3))
    twice, again = np.vstack([x, x[4:5] + 1e-10]), np.vstack([e, e[4:5] + 0.1])
    model = OrdinaryKriging(MODEL).fit(twice, again)
    exactly = OrdinaryKriging(MODEL).fit(np.vstack([x, x[4:5]]), again)
    np.testing.assert_allclose(model.predict(x), exactly.predict(x), atol=1e-9)
    with pytest.raises(KrigingError, match="rows 4, 20 are one point"):
        OrdinaryKriging(MODEL, exact=True).fit(twice, again)


def test_near_points_that_contradict_each_other(rng):
    smooth = VariogramModel("matern52", sill=1.0, range=0.5)
    x, e = rng.random((20, 3)), rng.standard_normal((20, 3))
    twice, again = np.vstack([x, x[4:5] + 1e-6]), np.vstack([e, e[4:5] + 0.1])
    with pytest.raises(KrigingError, match=r"rows 4, 20 are 1\.73e-06 apart, but .* differ by 0\.1, .*noise_std"):
        OrdinaryKriging(smooth, exact=True).fit(twice, again)
    OrdinaryKriging(smooth, exact=True).fit(twice, again, noise_std=0.05)
    with pytest.warns(IllConditionedWarning, match=r"rows 4, 20 of the points, are 1\.73e-06 apart"):
        OrdinaryKriging(smooth, exact=True).fit(twice, np.vstack([e, e[4:5]]))


def test_gstools_model_is_a_variogram(rng):
    gstools = pytest.importorskip("gstools")
    x, e = rng.random((20, 3)), rng.standard_normal((20, 3))
    covmodel = gstools.Exponential(dim=3, var=1.0, len_scale=0.4, nugget=0.1)
    mine = OrdinaryKriging(VariogramModel("exponential", nugget=0.1, sill=1.0, range=0.4)).fit(x, e).predict(x)
    np.testing.assert_allclose(OrdinaryKriging(covmodel).fit(x, e).predict(x), mine)


@pytest.mark.parametrize("nugget", [1e-6, 1e-3, 0.1])
@pytest.mark.parametrize("drift", ["constant", "linear"])
def test_variance_in_single_precision_is_as_near_as_it_states(rng, nugget, drift):
    x, targets = rng.random((300, 3)), rng.random((200, 3))
    model = VariogramModel("matern32", nugget, 1.0, 0.8)
    double, single = (
        UniversalKriging(drift, model, single_variance=narrow).fit(x, np.sin(4 * x)) for narrow in (False, True)
    )
    e, std = double.predict(targets, return_std=True)
    e_single, std_single = single.predict(targets, return_std=True)
    np.testing.assert_array_equal(e_single, e)
    difference = np.abs(std_single**2 - std**2).max()
    assert 0 < difference < 1e-7 * np.sqrt(double.condition_)
