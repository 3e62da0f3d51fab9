from __future__ import annotations

import tracemalloc
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from tests.tiers import examples

from truepose.errors import IllConditionedWarning, KrigingError
from truepose.predictors import OrdinaryKriging
from truepose.similarity import VariogramModel

BOUNDED = ["spherical", "exponential", "gaussian", "matern32", "matern52"]
MODEL = VariogramModel("exponential", nugget=0.1, sill=1.0, range=0.4)


@st.composite
def problems(draw, families=(*BOUNDED, "linear")):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    d = draw(st.integers(1, 3))
    n = draw(st.integers(3, 40))
    model = VariogramModel(
        draw(st.sampled_from(families)),
        nugget=draw(st.floats(0.05, 1.0)),
        sill=draw(st.floats(0.1, 10)),
        range=draw(st.floats(0.2, 2.0)),
    )
    noise = draw(st.sampled_from([None, 0.3, rng.random(n), rng.random((n, 2))]))
    return model, rng.random((n, d)), rng.standard_normal((n, 2)), noise, rng.random((9, d))


def by_equation_7(variogram, x, e, noise, targets, filtering):
    """Equation (7) as it stands: the bordered system in semivariances, noise subtracted from the diagonal."""
    n = len(x)
    system = np.ones((n + 1, n + 1))
    system[:n, :n] = variogram.semivariance(cdist(x, x))
    system[np.diag_indices(n)] = -(noise**2)
    system[n, n] = 0
    right = np.ones((n + 1, len(targets)))
    right[:n] = variogram.semivariance(cdist(x, targets))
    if filtering:
        right[:n][cdist(x, targets) == 0] = variogram.nugget
    weights = np.linalg.solve(system, right)
    variance = np.einsum("im,im->m", weights, right)
    return weights[:n].T @ e, variance - (variogram.nugget if filtering else 0)


@settings(max_examples=examples(60))
@given(problems(), st.booleans())
def test_equation_7(problem, exact):
    variogram, x, e, noise, targets = problem
    model = OrdinaryKriging(variogram, exact=exact).fit(x, e, noise)
    targets = np.vstack([targets, x[:1]])
    mean, std = model.predict(targets, return_std=True)
    full = np.zeros_like(e) if noise is None else np.broadcast_to(np.atleast_2d(np.asarray(noise).T).T, e.shape)
    for c in range(2):
        expected, variance = by_equation_7(variogram, x, e[:, c], full[:, c], targets, filtering=not exact)
        np.testing.assert_allclose(mean[:, c], expected, atol=1e-9)
        np.testing.assert_allclose(std[:, c] ** 2, np.maximum(variance, 0), atol=1e-9)


@settings(max_examples=examples(40))
@given(problems(), st.booleans())
def test_leave_one_out_is_refitting(problem, exact):
    variogram, x, e, noise, _ = problem
    model = OrdinaryKriging(variogram, exact=exact).fit(x, e, noise)
    residual, std = model.leave_one_out()
    full = np.zeros_like(e) if noise is None else np.broadcast_to(np.atleast_2d(np.asarray(noise).T).T, e.shape)
    for i in range(0, len(x), 5):
        rest = np.arange(len(x)) != i
        refitted = OrdinaryKriging(variogram, exact=exact).fit(x[rest], e[rest], full[rest])
        mean, refitted_std = refitted.predict(x[i : i + 1], return_std=True, include_nugget=True)
        np.testing.assert_allclose(residual[i], e[i] - mean[0], atol=1e-9)
        np.testing.assert_allclose(std[i] ** 2, refitted_std[0] ** 2 + full[i] ** 2, rtol=1e-9)


@settings(max_examples=examples(40))
@given(problems(families=("gaussian", "matern32", "matern52", "exponential", "spherical")))
def test_gradient(problem):
    variogram, x, e, noise, targets = problem
    model, step = OrdinaryKriging(variogram).fit(x, e, noise), 1e-6
    gradient = model.gradient(targets)
    assert gradient.shape == (9, 2, x.shape[1])
    for a, unit in enumerate(np.eye(x.shape[1]) * step):
        difference = (model.predict(targets + unit) - model.predict(targets - unit)) / (2 * step)
        np.testing.assert_allclose(gradient[:, :, a], difference, atol=1e-6 * (1 + np.abs(difference).max()))


def test_gradient_of_one_column(rng):
    x = rng.random((20, 3))
    assert OrdinaryKriging(MODEL).fit(x, x[:, 0]).gradient(x[:4] + 0.1).shape == (4, 3)


@pytest.mark.parametrize("family", BOUNDED)
@pytest.mark.parametrize("nugget", [0.0, 0.2])
def test_exact_at_the_samples(family, nugget, rng):
    x, e = rng.random((15, 3)) * 5, rng.standard_normal((15, 3))
    model = OrdinaryKriging(VariogramModel(family, nugget=nugget, sill=1, range=1), exact=True).fit(x, e)
    mean, std = model.predict(x, return_std=True)
    np.testing.assert_array_equal(mean, e)
    np.testing.assert_array_equal(std, 0)
    near, near_std = model.predict(x + 1e-7, return_std=True)
    assert (near_std**2 >= nugget - 1e-12).all()
    if nugget == 0:
        np.testing.assert_allclose(near, e, atol=1e-4)


def test_filtering_does_not_pass_through_the_samples(rng):
    x, e = rng.random((30, 2)), rng.standard_normal((30, 2))
    model = OrdinaryKriging(MODEL).fit(x, e)
    mean, std = model.predict(x, return_std=True)
    assert np.abs(mean - e).max() > 0.05
    with_nugget = model.predict(x, return_std=True, include_nugget=True)[1]
    np.testing.assert_allclose(with_nugget**2, std**2 + MODEL.nugget)


def test_far_away_the_gls_mean(rng):
    x, e = rng.random((25, 3)), rng.standard_normal((25, 3))
    model = OrdinaryKriging(MODEL).fit(x, e)
    inverse = np.linalg.inv(MODEL.covariance(cdist(x, x)))
    mean, std = model.predict([[1e6, 0, 0]], return_std=True)
    np.testing.assert_allclose(mean[0], inverse.sum(axis=0) @ e / inverse.sum())
    np.testing.assert_allclose(std[0] ** 2, MODEL.sill + 1 / inverse.sum())
    np.testing.assert_allclose(model.mean_, mean[0])


def test_weights_sum_to_one(rng):
    weights = OrdinaryKriging(MODEL).fit(rng.random((12, 2)), np.eye(12)).predict(rng.random((50, 2)) * 3)
    np.testing.assert_allclose(weights.sum(axis=1), 1)


def test_all_nugget_gives_the_mean_everywhere(rng):
    x, e = rng.random((40, 3)), rng.standard_normal((40, 3))
    model = OrdinaryKriging(VariogramModel("spherical", nugget=2.0, sill=0.0, range=1.0)).fit(x, e)
    mean, std = model.predict(x, return_std=True)
    np.testing.assert_allclose(mean, np.broadcast_to(e.mean(axis=0), e.shape))
    np.testing.assert_allclose(std**2, 2.0 / 40)


def test_noise_std_weighs_the_samples(rng):
    """A reading whose noise is enormous counts as little as one that is left out."""
    x, e = rng.random((20, 2)), rng.standard_normal((20, 3))
    noise = np.zeros(20)
    noise[3] = 1e6
    rest, targets = np.arange(20) != 3, rng.random((10, 2))
    with pytest.warns(IllConditionedWarning):  # variances from 0 to 1e12
        with_noise = OrdinaryKriging(MODEL).fit(x, e, noise).predict(targets)
    np.testing.assert_allclose(with_noise, OrdinaryKriging(MODEL).fit(x[rest], e[rest]).predict(targets), atol=1e-8)


def test_repeats_are_the_same_as_their_average_with_less_noise(rng):
    x, e = rng.random((10, 2)), rng.standard_normal((13, 2))
    repeated = np.vstack([x, x[:3]])
    model = OrdinaryKriging(MODEL).fit(repeated, e)
    targets = rng.random((9, 2))
    mean, std = model.predict(targets, return_std=True)
    covariance = MODEL.signal_covariance(cdist(repeated, repeated)) + MODEL.nugget * np.eye(13)
    inverse = np.linalg.inv(covariance)
    gls = inverse.sum(axis=0) @ e / inverse.sum()
    cross = MODEL.signal_covariance(cdist(targets, repeated))
    np.testing.assert_allclose(mean, gls + cross @ inverse @ (e - gls))
    lack = 1 - cross @ inverse.sum(axis=0)
    variance = MODEL.sill - np.einsum("mi,ij,mj->m", cross, inverse, cross) + lack**2 / inverse.sum()
    np.testing.assert_allclose(std[:, 0] ** 2, variance)


def test_leave_one_out_leaves_all_repeats_out(rng):
    x, e = rng.random((10, 2)), rng.standard_normal((12, 2))
    repeated = np.vstack([x, x[:2]])
    residual, _ = OrdinaryKriging(MODEL).fit(repeated, e).leave_one_out()
    others = np.abs(repeated - x[0]).max(axis=1) > 0
    expected = OrdinaryKriging(MODEL).fit(repeated[others], e[others]).predict(x[:1])
    np.testing.assert_allclose(residual[[0, 10]], e[[0, 10]] - expected)


def test_scatter_of_repeats_is_the_noise(rng):
    x = np.repeat(rng.random((40, 3)), 3, axis=0)
    e = np.sin(3 * x) + rng.normal(scale=0.2, size=x.shape)
    fitted = OrdinaryKriging().fit(x, e)
    assert fitted.variogram_.nugget == pytest.approx(0.04, rel=0.3)
    silent = OrdinaryKriging(VariogramModel("matern52", sill=1.0, range=1.0)).fit(x, e)
    std, reading = (silent.predict([[0.5] * 3], return_std=True, include_nugget=flag)[1] for flag in (False, True))
    np.testing.assert_allclose(reading**2 - std**2, 0.04, rtol=0.35)


def test_exact_repeats(rng):
    x, e = rng.random((6, 2)), rng.standard_normal((6, 2))
    twice, targets = np.vstack([x, x[2:3]]), rng.random((5, 2))
    agreeing = OrdinaryKriging(MODEL, exact=True).fit(twice, np.vstack([e, e[2:3]]))
    np.testing.assert_allclose(agreeing.predict(targets), OrdinaryKriging(MODEL, exact=True).fit(x, e).predict(targets))
    with pytest.raises(KrigingError, match=r"rows 2, 6 are one point, but their errors differ by 0\.5"):
        OrdinaryKriging(MODEL, exact=True).fit(twice, np.vstack([e, e[2:3] + 0.5]))
    OrdinaryKriging(MODEL, exact=True).fit(twice, np.vstack([e, e[2:3] + 0.5]), noise_std=0.1)


def test_components_have_their_own_scale(rng):
    x = rng.random((120, 3))
    factor = np.linalg.cholesky(MODEL.covariance(cdist(x, x)))
    e = factor @ rng.standard_normal((120, 3)) * [1.0, 10.0, 0.0]
    model = OrdinaryKriging().fit(x, e)
    _, std = model.predict(rng.random((10, 3)), return_std=True)
    np.testing.assert_allclose(std[:, 1] / std[:, 0], 10, rtol=0.3)
    assert (std[:, 2] < 1e-4).all()
    assert len(model.variograms_) == 3


def test_fitted_std_is_calibrated(rng):
    x, targets = rng.random((150, 3)), rng.random((300, 3))
    true = VariogramModel("matern32", nugget=0.05, sill=1.0, range=0.3)
    points = np.vstack([x, targets])
    e = np.linalg.cholesky(true.covariance(cdist(points, points))) @ rng.standard_normal((450, 3))
    model = OrdinaryKriging().fit(x, e[:150])
    mean, std = model.predict(targets, return_std=True, include_nugget=True)
    assert ((e[150:] - mean) / std).std() == pytest.approx(1, abs=0.15)
    residual, std = model.leave_one_out()
    assert (residual / std).std() == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("variogram", ["spherical", ["exponential", "matern32"], "best"])
def test_variogram_by_name_of_family(variogram, rng):
    x = rng.random((100, 3))
    model = OrdinaryKriging(variogram).fit(x, np.sin(3 * x) + rng.normal(scale=0.1, size=x.shape))
    assert model.variogram_.family in ([variogram] if variogram == "spherical" else model.variogram_.fit.candidates)


def test_joint_space_of_six(rng):
    q = rng.uniform(-2, 2, (80, 6))
    e = np.cos(q[:, :3]) + 0.3 * q[:, 3:]
    assert OrdinaryKriging().fit(q, e).score(q + 0.01, e) > 0.8


def test_chunks_are_bounded_and_agree(rng):
    x, e, targets = rng.random((300, 3)), rng.standard_normal((300, 3)), rng.random((40_000, 3))
    model = OrdinaryKriging(MODEL).fit(x, e)
    few = model.predict(targets[-5:], return_std=True)
    tracemalloc.start()
    mean, std = model.predict(targets, return_std=True)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 150e6
    np.testing.assert_allclose((mean[-5:], std[-5:]), few, rtol=1e-12)


def test_singular_matrix_names_condition_points_and_remedy(rng):
    x = np.vstack([rng.random((40, 2)), [[0.3, 0.3], [0.3, 0.3 + 1e-9]]])
    smooth = VariogramModel("gaussian", sill=1.0, range=3.0)
    with pytest.raises(KrigingError, match=r"condition number \d\.\de\+.*rows 40, 41,.* apart\); give .* a nugget"):
        OrdinaryKriging(smooth).fit(x, x)


def test_poor_condition_is_told_with_its_remedy(rng):
    x, smooth = rng.random((25, 2)), VariogramModel("gaussian", sill=1.0, range=1.0)
    with pytest.warns(
        IllConditionedWarning, match=r"condition number \d\.\de\+1[123].*digits.*rows \d+, \d+ .*a nugget"
    ):
        model = OrdinaryKriging(smooth).fit(x, x)
    assert 1e11 < model.condition_ < 1e14
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        OrdinaryKriging(replace(smooth, nugget=1e-6)).fit(x, x)


@settings(max_examples=examples(40))
@given(problem=problems(families=BOUNDED))
def test_condition_is_that_of_the_covariance_matrix(problem):
    variogram, x, e, _, targets = problem
    matrix = variogram.signal_covariance(cdist(x, x)) + variogram.nugget * np.eye(len(x))
    model = OrdinaryKriging(variogram).fit(x, e)
    assert model.condition_ == pytest.approx(np.linalg.cond(matrix, 1), rel=1e-9)
    assert model.predict(targets) == pytest.approx(OrdinaryKriging(variogram).fit(x, e).predict(targets), rel=1e-9)


def test_a_small_noise_does_not_hide_a_poor_condition(rng):
    x, smooth = rng.random((25, 2)), VariogramModel("gaussian", sill=1.0, range=1.0)
    with pytest.warns(IllConditionedWarning, match="condition number"):
        OrdinaryKriging(smooth).fit(x, x, noise_std=1e-7)


@pytest.mark.parametrize(
    ("variogram", "n", "d", "message"),
    [
        (MODEL, 1, 3, "there is 1 sample"),
        (None, 4, 3, "4 samples are too few to fit a variogram; measure at least 5"),
        (VariogramModel("spherical", sill=1, range=1), 9, 4, "valid in up to 3 coordinates, but there are 4"),
        ((MODEL, MODEL), 9, 3, "expected one variogram for all of 3 components or one for each, got 2"),
        ((MODEL, MODEL, VariogramModel("gaussian", sill=1, range=1)), 9, 3, "differ in family or range"),
        ((MODEL, 3, MODEL), 9, 3, "GSTools CovModel, got int"),
    ],
)
def test_refusals(variogram, n, d, message, rng):
    with pytest.raises(KrigingError, match=message):
        OrdinaryKriging(variogram).fit(rng.random((n, d)), rng.random((n, 3)))


def test_all_samples_at_one_point(rng):
    with pytest.raises(KrigingError, match="7 samples, all at one"):
        OrdinaryKriging(MODEL).fit(np.ones((7, 3)), rng.random((7, 3)))
