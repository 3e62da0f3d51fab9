"""Local Kriging and Vecchia's approximation: exact with all samples, and how near they come with few."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from truepose.errors import KrigingError
from truepose.predictors import LocalKriging, OrdinaryKriging, UniversalKriging, VecchiaKriging
from truepose.predictors.kriging.vecchia import predecessors
from truepose.similarity import VariogramModel, fit_likelihood

MODEL = VariogramModel("matern32", nugget=0.05, sill=1.0, range=0.4)
BOTH = [LocalKriging, VecchiaKriging]


@pytest.fixture(scope="module")
def field():
    """A drawn field: 2,000 samples, 500 targets, of a known variogram."""
    rng = np.random.default_rng(7)
    x = rng.random((2500, 3))
    e = np.linalg.cholesky(MODEL.signal_covariance(cdist(x, x)) + 1e-9 * np.eye(2500)) @ rng.standard_normal((2500, 3))
    return x[:2000], e[:2000] + rng.normal(scale=0.05**0.5, size=(2000, 3)), x[2000:], e[2000:]


@pytest.mark.parametrize("kriging", BOTH)
@pytest.mark.parametrize("drift", ["constant", "linear"])
@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("noise", [None, 0.2, "each"])
def test_with_all_samples_it_is_universal_kriging(kriging, drift, exact, noise, rng):
    x, e = rng.random((40, 3)), rng.standard_normal((40, 2))
    targets = np.vstack([rng.random((20, 3)), x[:3]])
    std = rng.random((40, 2)) if noise == "each" else noise
    mine = kriging(99, MODEL, exact, drift).fit(x, e, std)
    other = UniversalKriging(drift, MODEL, exact).fit(x, e, std)
    for got, expected in zip(mine.predict(targets, True), other.predict(targets, True), strict=True):
        np.testing.assert_allclose(got, expected, atol=1e-9)
    np.testing.assert_allclose(mine.gradient(targets[:20]), other.gradient(targets[:20]), atol=1e-9)
    if kriging is LocalKriging:
        for got, expected in zip(mine.leave_one_out(), other.leave_one_out(), strict=True):
            np.testing.assert_allclose(got, expected, atol=1e-9)
    else:
        np.testing.assert_allclose(mine.beta_, other.beta_, atol=1e-9)


def test_local_is_kriging_of_the_nearest(rng):
    x, e, target = rng.random((300, 3)), rng.standard_normal((300, 3)), rng.random((1, 3))
    near = np.argsort(cdist(target, x)[0])[:20]
    for got, expected in zip(
        LocalKriging(20, MODEL).fit(x, e).predict(target, True),
        OrdinaryKriging(MODEL).fit(x[near], e[near]).predict(target, True),
        strict=True,
    ):
        np.testing.assert_allclose(got, expected, atol=1e-10)


def test_near_is_meant_in_units_of_the_ranges(rng):
    flat = VariogramModel("exponential", nugget=0.1, sill=1.0, range=(1.0, 1.0, 0.01))
    x, e = rng.random((300, 3)), rng.standard_normal((300, 1))
    near = np.argsort(cdist([[50.0, 50.0, 0.5]], x * [1, 1, 100] + [49.5, 49.5, -49.5])[0])[:20]
    got = LocalKriging(20, flat).fit(x, e).predict([[0.5, 0.5, 0.5]])
    wanted = np.argsort(cdist([[0.5, 0.5, 50.0]], x * [1, 1, 100])[0])[:20]
    assert set(near) != set(np.argsort(cdist([[0.5] * 3], x)[0])[:20])
    expected = OrdinaryKriging(flat).fit(x[wanted], e[wanted]).predict([[0.5, 0.5, 0.5]])
    np.testing.assert_allclose(got, expected, atol=1e-10)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("neighbours", "mean", "std", "error", "likelihood"), [(16, 0.5, 0.35, 1.11, 70), (32, 0.4, 0.2, 1.06, 35)]
)
def test_vecchia_beside_the_exact_answer(field, neighbours, mean, std, error, likelihood):
    """n = 2,000: root mean square difference in units of the exact std; std and error against the truth by ratio."""
    x, e, targets, truth = field
    exact, vecchia = OrdinaryKriging(MODEL).fit(x, e), VecchiaKriging(neighbours, MODEL).fit(x, e)
    (exact_mean, exact_std), (near_mean, near_std) = exact.predict(targets, True), vecchia.predict(targets, True)
    assert np.sqrt(np.mean((near_mean - exact_mean) ** 2)) < mean * exact_std.mean()
    assert np.abs(near_std / exact_std - 1).max() < std
    assert np.sqrt(np.mean((near_mean - truth) ** 2) / np.mean((exact_mean - truth) ** 2)) < error
    assert np.std((near_mean - truth) / near_std) == pytest.approx(1, abs=0.08)
    covariance = np.linalg.cholesky(MODEL.covariance(cdist(x, x)))
    white = np.linalg.solve(covariance, e - vecchia.beta_)
    log_likelihood = -0.5 * (2000 * np.log(2 * np.pi) + (white**2).sum(axis=0)) - np.log(covariance.diagonal()).sum()
    assert np.abs(vecchia.log_likelihood_ - log_likelihood).max() < likelihood  # of 2,000 samples


def test_local_beside_the_exact_answer(field):
    x, e, targets, truth = field
    mean, std = LocalKriging(32, MODEL).fit(x, e).predict(targets, True)
    exact_mean, exact_std = OrdinaryKriging(MODEL).fit(x, e).predict(targets, True)
    assert (std > exact_std * (1 - 1e-9)).all()  # fewer samples tell less
    assert np.abs(std / exact_std - 1).max() < 0.25
    assert np.sqrt(np.mean((mean - truth) ** 2) / np.mean((exact_mean - truth) ** 2)) < 1.08


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kriging", BOTH)
def test_fitted_std_is_calibrated(kriging, field):
    x, e, targets, truth = field
    model = kriging().fit(x, e)
    mean, std = model.predict(targets, return_std=True)
    assert np.std((truth - mean) / std) == pytest.approx(1, abs=0.25)
    residual, std = model.leave_one_out()
    assert np.std(residual / std) == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("growing", [True, False])
def test_predecessors_are_the_nearest_of_those_before(growing, rng):
    u = np.sort(rng.random((900, 1)), axis=0) if growing else rng.random((900, 2))
    for rows, near in predecessors(u, 7, 200):
        for row, found in zip(rows[::37], near[::37], strict=True):
            distance = np.linalg.norm(u[:row] - u[row], axis=1)
            np.testing.assert_allclose(distance[found], np.sort(distance)[:7])


@pytest.mark.exhaustive
def test_a_hundred_thousand_samples(rng):
    x = rng.random((100_000, 3))
    e = np.sin(6 * x) + rng.normal(scale=0.05, size=x.shape)
    model = VecchiaKriging(16, VariogramModel("matern52", nugget=0.0025, sill=1.0, range=0.5)).fit(x, e)
    targets = rng.random((500, 3))
    assert np.abs(model.predict(targets) - np.sin(6 * targets)).max() < 0.1


@pytest.mark.parametrize("kriging", BOTH)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"neighbours": 0}, "neighbours is 0; expected a whole number of 1 or more"),
        ({"neighbours": 2.5}, "neighbours is 2.5"),
        ({"neighbours": 3, "drift": "linear"}, "3 neighbours do not determine a drift of 4 columns"),
        ({"variogram": VariogramModel("linear", sill=1.0, range=1.0)}, "needs a sill, and linear has none"),
        ({"variogram": VariogramModel("gaussian", sill=1.0, range=50.0)}, "singular to 64 bits"),
    ],
)
def test_refusals(kriging, arguments, message, rng):
    x = rng.random((60, 3))
    with pytest.raises(KrigingError, match=message):
        kriging(**{"variogram": MODEL} | arguments).fit(x, x).predict(x + 0.01)


def test_refined_variogram_is_the_most_likely(field):
    """With all neighbours it is maximum likelihood."""
    x, e = field[0][:150], field[1][:150]
    refined = VecchiaKriging(150, "matern32", refine=True).fit(x, e).variogram_
    exact = fit_likelihood(x, e, "matern32", method="ml", largest=None)
    assert refined.range == pytest.approx(exact.range, rel=1e-2)
    assert refined.nugget / refined.sill == pytest.approx(exact.nugget / exact.sill, rel=2e-2)
    x, e = field[0][:400], field[1][:400]
    likely = [VecchiaKriging(16, "matern32", refine=refine).fit(x, e).log_likelihood_.sum() for refine in (False, True)]
    assert likely[1] > likely[0]


@pytest.mark.parametrize("noise", [0.1, None])
def test_refined_with_the_noise_of_readings(field, noise):
    x, e = field[0][:200], field[1][:200]
    plain, refined = (VecchiaKriging(20, "matern32", refine=refine).fit(x, e, noise) for refine in (False, True))
    assert refined.log_likelihood_.sum() > plain.log_likelihood_.sum() - 1e-6
    assert refined.variogram_.sill == pytest.approx(1.0, rel=0.6)
