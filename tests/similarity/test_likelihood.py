from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel
from tests.tiers import examples

from truepose.errors import DataError, KrigingError, VariogramWarning
from truepose.similarity import VariogramModel, fit_likelihood, likelihood
from truepose.similarity.likelihood import _Problem
from truepose.similarity.parametrisation import Parametrisation
from truepose.similarity.trend import polynomial

FAMILIES = {"spherical": None, "exponential": None, "gaussian": None, "matern32": None, "cubic": None, "hole": None}
FAMILIES |= {"matern52": None, "stable": None, "rational": None, "matern": None}
FAMILIES |= {"exponential+gaussian": None, "matern32+stable+exponential": None}


def problem(rng, family="matern52", method="reml", ranges="each", n=25, d=3, common=False, drift="linear"):
    x, e = rng.random((n, d)), rng.standard_normal((n, 2)) * [1.0, 3.0]
    F = np.empty((n, 0)) if drift == "none" else polynomial(x, drift)
    return _Problem(Parametrisation.of(family, ranges, d), method, common, x, e, F)


@settings(max_examples=examples(40))
@given(
    seed=st.integers(0, 2**32 - 1),
    d=st.sampled_from([1, 2, 3, 6]),
    family=st.sampled_from(list(FAMILIES)),
    method=st.sampled_from(["reml", "ml", "loo"]),
    ranges=st.sampled_from(["one", "each", "rotated"]),
    common=st.booleans(),
)
def test_gradient(seed, d, family, method, ranges, common):
    """Against differences of sixth order in every parameter: ranges, turns, shapes, sills, nugget ratio."""
    rng = np.random.default_rng(seed)
    if (d == 6 and family in ("spherical", "cubic", "hole")) or (d not in (2, 3) and ranges == "rotated"):
        return
    p = problem(rng, family, method, ranges, d=d, common=common, drift=str(rng.choice(["none", "constant", "linear"])))
    kinked = family in ("spherical", "cubic")  # at r = 1: all pairs are kept nearer
    theta = p.start(4.0 if kinked else 0.5, 0.2) + rng.uniform(-0.2, 0.2, len(p.bounds))
    gradient, step = p.loss(theta)[1], 3e-3
    for k, unit in enumerate(np.eye(len(theta))):
        ahead = [p.loss(theta + m * step * unit)[0] - p.loss(theta - m * step * unit)[0] for m in (1, 2, 3)]
        differences = (45 * ahead[0] - 9 * ahead[1] + ahead[2]) / (60 * step)
        assert gradient[k] == pytest.approx(differences, rel=1e-6, abs=2e-6)


def covariance(p, theta):
    model = p.parameters.model(theta[:-1], nugget=np.exp(theta[-1]), sill=1.0)
    return model.covariance_between(p.points, p.points) + model.nugget * np.eye(len(p.points))


@pytest.mark.parametrize("common", [False, True])
def test_likelihoods_are_the_densities(rng, common):
    """ML is the normal density at the GLS mean; REML that of contrasts, which do not know the drift."""
    for method in ("ml", "reml"):
        p = problem(rng, method=method, common=common)
        theta = p.start(0.5, 0.2)
        K, scale = covariance(p, theta), p.judged(theta).scale
        value = p.log_likelihood(p.judged(theta).loss)
        if method == "ml":
            beta = np.linalg.solve(p.drift.T @ np.linalg.solve(K, p.drift), p.drift.T @ np.linalg.solve(K, p.e))
            z, C = p.e - p.drift @ beta, K
        else:
            contrasts = np.linalg.svd(p.drift.T)[2][p.drift.shape[1] :]
            z, C = contrasts @ p.e, contrasts @ K @ contrasts.T
        expected = sum(multivariate_normal(cov=s * C).logpdf(z[:, c]) for c, s in enumerate(scale))
        assert value == pytest.approx(expected, rel=1e-10)


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
@pytest.mark.promise("the restricted log-likelihood depends on the space that a drift spans, not on its columns")
def test_restricted_likelihood_does_not_depend_on_the_columns_of_the_drift(rng, record_property):
    x = rng.random((40, 2))
    e = rng.standard_normal((40, 3)) + x @ [[3.0], [-2.0]]
    columns = np.column_stack([np.ones(40), x])
    turned = [columns, columns @ rng.standard_normal((3, 3)), 1e3 * columns, columns / [1.0, 1e-3, 10.0]]
    record_property("cases", len(turned))
    found = [fit_likelihood(x, e, "matern52", drift=drift).fit.log_likelihood for drift in turned]
    np.testing.assert_allclose(found, found[0], atol=1e-5)


def test_leave_one_out_is_the_product_of_predictive_densities(rng):
    p = problem(rng, method="loo", n=15, drift="constant")
    theta = p.start(0.5, 0.2)
    K, scale, total = covariance(p, theta), p.judged(theta).scale, 0.0
    for i in range(15):
        rest = np.delete(np.arange(15), i)
        system = np.block([[K[np.ix_(rest, rest)], np.ones((14, 1))], [np.ones((1, 14)), np.zeros((1, 1))]])
        right = np.append(K[rest, i], 1.0)
        weights = np.linalg.solve(system, right)
        variance = K[i, i] - weights @ right
        residual = p.e[i] - weights[:-1] @ p.e[rest]
        total += (-0.5 * np.log(2 * np.pi * scale * variance) - residual**2 / (2 * scale * variance)).sum()
    assert p.log_likelihood(p.judged(theta).loss) == pytest.approx(total, rel=1e-10)


@pytest.fixture(scope="module")
def drawn():
    rng = np.random.default_rng(3)
    x = rng.random((520, 3)) * 1000
    true = VariogramModel("matern32", nugget=0.05, sill=1.0, range=(200.0, 400.0, 900.0))
    K = true.covariance_between(x, x) + 0.05 * np.eye(520)
    return x, np.linalg.cholesky(K) @ rng.standard_normal((520, 3))


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
def test_same_optimum_as_scikit_learn(drawn):
    x, e = drawn[0][:150], drawn[1][:150]
    found = fit_likelihood(x, e, "matern32", method="ml", ranges="each", drift="none", common_scale=True)
    kernel = ConstantKernel(1.0) * Matern([300.0] * 3, (1, 1e5), nu=1.5) + WhiteKernel(0.1, (1e-8, 1e3))
    peer = GaussianProcessRegressor(kernel).fit(x, e)
    assert found.fit.log_likelihood == pytest.approx(peer.log_marginal_likelihood_value_, abs=1e-4)
    np.testing.assert_allclose(found.range, peer.kernel_.k1.k2.length_scale, rtol=2e-3)
    np.testing.assert_allclose([found.sill, found.nugget], np.exp(peer.kernel_.theta)[[0, -1]], rtol=2e-3)


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
@pytest.mark.parametrize("method", ["reml", "ml", "loo"])
def test_finds_a_range_for_each_coordinate(drawn, method):
    found = fit_likelihood(*drawn, "matern32", method=method, ranges="each", largest=None)
    np.testing.assert_allclose(found.range, [200, 400, 900], rtol=0.45 if method == "loo" else 0.25)
    assert found.nugget == pytest.approx(0.05, rel=0.3)
    assert found.fit.samples == 520
    assert found.fit.scales.shape == (3,)
    if method == "reml":
        for name, value, true in zip(["range_1", "range_2", "range_3"], found.range, [200, 400, 900], strict=True):
            assert abs(value - true) < 3 * found.fit.standard_error[name]
        assert 0 < found.fit.standard_error["nugget"] < 0.02
        assert abs(found.sill - 1) < 3 * found.fit.standard_error["sill"]
    else:
        assert np.isnan(found.fit.standard_error["sill"]) == (method == "loo")


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
def test_finds_turned_axes():
    """Two coordinates, 30 degrees off, ranges 5 to 1; the axes may come in either order."""
    rng = np.random.default_rng(5)
    x = rng.random((250, 2))
    true = VariogramModel("exponential", nugget=0.05, sill=1.0, range=(0.5, 0.1), rotation=(0, 0, np.pi / 6))
    e = np.linalg.cholesky(true.covariance_between(x, x) + 0.05 * np.eye(250)) @ rng.standard_normal((250, 3))
    found = fit_likelihood(x, e, "exponential", ranges="rotated")
    longest = found.axes()[:, np.argmax(found.range)]
    assert abs(longest @ [np.cos(np.pi / 6), np.sin(np.pi / 6)]) > np.cos(np.radians(6))
    np.testing.assert_allclose(sorted(found.range), [0.1, 0.5], rtol=0.35)
    assert 0 < found.fit.standard_error["rotation_z"] < 0.1
    straight = fit_likelihood(x, e, "exponential", ranges="each")
    assert found.fit.log_likelihood > straight.fit.log_likelihood + 10


def test_finds_two_structures(rng):
    x = rng.random((300, 1)) * 100
    true = VariogramModel("exponential", nugget=0.02, sill=0.5, range=1.0) + VariogramModel(
        "gaussian", sill=2.0, range=20.0
    )
    e = np.linalg.cholesky(true.covariance_between(x, x) + 0.02 * np.eye(300)) @ rng.standard_normal((300, 8))
    found = fit_likelihood(x, e, "exponential+gaussian")
    assert [part.family for part in found.structures] == ["exponential", "gaussian"]
    np.testing.assert_allclose([part.range for part in found.structures], [1.0, 20.0], rtol=0.35)
    for part, name, sill in zip(found.structures, ("sill", "sill_of_2"), (0.5, 2.0), strict=True):
        assert abs(part.sill - sill) < 3 * found.fit.standard_error[name] < 1.5 * sill
    one = fit_likelihood(x, e, "exponential")
    assert found.fit.log_likelihood > one.fit.log_likelihood + 10


@pytest.mark.exhaustive
def test_standard_errors_are_the_spread_of_fits():
    """Over 60 drawn data sets; the standard error is asymptotic, so within a third."""
    rng = np.random.default_rng(8)
    x = rng.random((120, 2))
    true = VariogramModel("exponential", nugget=0.1, sill=1.0, range=0.15)
    root = np.linalg.cholesky(true.covariance_between(x, x) + 0.1 * np.eye(120))
    fits = [fit_likelihood(x, root @ rng.standard_normal((120, 3)), "exponential") for _ in range(60)]
    for name in ("range", "sill"):
        values, told = [getattr(f, name) for f in fits], [f.fit.standard_error[name] for f in fits]
        assert np.nanmedian(told) == pytest.approx(np.std(values), rel=0.35)


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
def test_shape_is_fitted(drawn):
    x, e = drawn[0][:150] / [200, 400, 900], drawn[1][:150]
    found = fit_likelihood(x, e, "stable")
    assert 1.0 < found.shape < 2.0
    assert fit_likelihood(x, e, "stable", shape=1.0).shape == 1.0
    assert found.fit.log_likelihood >= fit_likelihood(x, e, "exponential").fit.log_likelihood - 1e-6


def test_bounds_hit_are_told(rng):
    x = np.linspace(0, 1, 60)[:, None]
    with pytest.warns(VariogramWarning, match="the nugget is not identifiable"):
        assert fit_likelihood(x, x + 0 * x, "matern52").fit.bounds_hit["nugget"] == "lower"
    with pytest.warns(VariogramWarning, match="the semivariogram is flat"):
        noise = fit_likelihood(rng.random((80, 3)), rng.standard_normal((80, 3)), "matern32")
    assert set(noise.fit.bounds_hit) <= {"sill", "range", "nugget"}


def test_drift_is_taken_off(drawn):
    """REML with a linear drift does not see that drift."""
    x, e = drawn[0][:120], drawn[1][:120]
    plain = fit_likelihood(x, e, "matern32", drift="linear")
    tilted = fit_likelihood(x, e + x @ np.full((3, 3), 0.05), "matern32", drift="linear")
    assert tilted.range == pytest.approx(plain.range, rel=1e-3)
    assert tilted.sill == pytest.approx(plain.sill, rel=1e-3)


def test_refusals(rng):
    x, e = rng.random((20, 3)), rng.random((20, 3))
    with pytest.raises(DataError, match="method is 'bayes'; expected one of reml, ml, loo"):
        fit_likelihood(x, e, method="bayes")
    with pytest.raises(KrigingError, match="coordinate 1 of x is the same for all points"):
        fit_likelihood(x * [1, 0, 1], e, ranges="each")
    with pytest.raises(KrigingError, match="'nugget' cannot be fitted in this way"):
        fit_likelihood(x, e, "nugget")
    with pytest.raises(KrigingError, match="valid in up to 3 coordinates, but x has 6"):
        fit_likelihood(rng.random((20, 6)), e, "spherical")
    with pytest.raises(DataError, match=r"drift has shape \(3, 1\)"):
        fit_likelihood(x, e, drift=np.ones((3, 1)))


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
@pytest.mark.parametrize("ranges", ["one", "each"])
def test_a_start_finds_the_same_optima_with_fewer_evaluations(rng, monkeypatch, ranges):
    x = rng.uniform(0, 1000, (120, 3))
    e = np.sin(x / 200) + rng.normal(scale=0.1, size=x.shape)
    whole = fit_likelihood(x, e, ranges=ranges).fit
    calls = []
    counted = likelihood.judge
    monkeypatch.setattr(likelihood, "judge", lambda *arguments: (calls.append(1), counted(*arguments))[1])
    alone = fit_likelihood(x[20:], e[20:], ranges=ranges)
    many = len(calls)
    told = fit_likelihood(x[20:], e[20:], ranges=ranges, start=whole)
    assert len(calls) - many < many / 2
    assert told.family == alone.family
    assert told.range == pytest.approx(alone.range, rel=1e-3)
    assert told.fit.candidates == pytest.approx(alone.fit.candidates, abs=1e-5)


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
def test_a_start_of_another_kind_is_not_used(rng):
    x = rng.uniform(0, 1000, (40, 2))
    e = np.sin(x / 200)
    other = fit_likelihood(x, e, ranges="each").fit
    assert fit_likelihood(x, e, start=other) == fit_likelihood(x, e)
