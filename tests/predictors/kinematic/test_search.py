"""The search for hyperparameters of kinematic Kriging: starts, second derivatives, bounds."""

from dataclasses import replace

import numpy as np
import pytest

import truepose as tp
from truepose.predictors import KinematicKriging, make_predictor
from truepose.predictors.kinematic import searched
from truepose.predictors.kinematic.covariance_form import Likelihood
from truepose.predictors.kinematic.design import take
from truepose.predictors.kinematic.fitting import Start, search, search_near, spread_starts
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.terms import Terms


@pytest.fixture(scope="module")
def errors():
    virtual = tp.VirtualCell("hard", seed=3)
    choice = tp.choose(["registration"], virtual.measure(virtual.design(80)), virtual.cell)
    return choice.errors


@pytest.fixture(scope="module")
def part(errors):
    """A function that returns the likelihood of some samples."""
    terms = Terms(errors.arm.robot, errors.arm.tf_flange_tool)
    design = terms.at(errors.coordinates["joint"])

    def likelihood(rows):
        kept = take(design, rows)
        return Likelihood(terms, kept, np.arange(6), errors.e[rows], errors.noise_std[rows], np.ones(len(rows)))

    return likelihood


@pytest.fixture(scope="module")
def found(part):
    return search(part(np.arange(80)), spread_starts(Hyperparameters.start(6, 6)))


def penalised(likelihood, hyper):
    """The value and the gradient of the objective, computed from its definition."""
    value, gradient = likelihood(hyper)
    centre, std = hyper.prior()
    pull = (hyper.to_vector() - centre) / std
    return value + 0.5 * pull @ pull, gradient + pull / std


def test_a_search_ends_where_the_gradient_is_zero(part, found):
    result, start = found
    likelihood = part(np.arange(80))
    value, gradient = penalised(likelihood, result.hyper)
    metric = 80 * start.curvature + np.diag(result.hyper.prior()[1] ** -2.0)
    assert gradient @ np.linalg.solve(metric, gradient) < 0.005
    pull = value - likelihood(result.hyper)[0]
    assert result.log_likelihood == pytest.approx(pull - value - likelihood.constant, abs=1e-9)


def test_similar_samples_need_a_third_of_the_evaluations_for_the_same_optimum(part, found):
    likelihood = part(np.arange(64))
    far, _ = search(likelihood, spread_starts(Hyperparameters.start(6, 6)))
    near, _ = search_near(likelihood, found[1])
    assert near.evaluations <= far.evaluations / 3
    assert penalised(likelihood, near.hyper)[0] == pytest.approx(penalised(likelihood, far.hyper)[0], abs=0.01)


def test_the_curvature_predicts_the_gradient_nearby(part, found):
    result, start = found
    likelihood, theta = part(np.arange(80)), result.hyper.to_vector()
    metric = 80 * start.curvature + np.diag(result.hyper.prior()[1] ** -2.0)
    step = np.linalg.solve(metric, np.random.default_rng(0).normal(size=len(theta)))
    step *= 0.01 / np.abs(step).max()
    change = np.subtract(
        *(penalised(likelihood, result.hyper.with_vector(at))[1] for at in (theta + step, theta - step))
    )
    np.testing.assert_allclose(change / 2, metric @ step, atol=0.3 * np.abs(metric @ step).max())


def test_a_search_stays_within_the_bounds_and_names_them(part):
    start = Hyperparameters.start(6, 6)
    low = np.array(start.bounds())[:, 0]
    at_the_bound = start.with_vector(np.where(np.arange(len(low)) == 0, low, start.to_vector()))
    result, _ = search_near(part(np.arange(80)), Start(at_the_bound, np.zeros((len(low), len(low)))))
    vector = result.hyper.to_vector()
    assert (vector >= low - 1e-12).all()
    assert (0 in result.bounds_hit) == bool(vector[0] <= low[0] + 1e-9)


def test_a_fit_that_starts_at_an_optimum_finds_what_it_finds_alone(errors, monkeypatch):
    q, rows = errors.coordinates["joint"], np.arange(80) % 5 > 0
    whole = make_predictor("kinematic-kriging", arm=errors.arm).fit(q, errors.e, errors.noise_std)
    alone = make_predictor("kinematic-kriging", arm=errors.arm).fit(q[rows], errors.e[rows], errors.noise_std[rows])
    told = make_predictor("kinematic-kriging", arm=errors.arm)
    told.start_from(whole.optimum())
    monkeypatch.setattr(searched, "search", None)  # must not be used
    told.fit(q[rows], errors.e[rows], errors.noise_std[rows])
    expected, std = alone.predict(q, return_std=True)
    got, got_std = told.predict(q, return_std=True)
    np.testing.assert_allclose(got, expected, atol=0.02 * std.min())
    np.testing.assert_allclose(got_std, std, rtol=0.02)


def test_a_start_for_other_joints_is_not_used(errors):
    q = errors.coordinates["joint"].copy()
    whole = make_predictor("kinematic-kriging", arm=errors.arm).fit(q, errors.e)
    q[:, 3] = q[0, 3]
    model = make_predictor("kinematic-kriging", arm=errors.arm)
    model.start_from(whole.optimum())
    assert 3 in model.fit(q, errors.e).unseen_


def test_folds_start_from_the_fit_of_all_samples(errors, monkeypatch):
    told = []
    monkeypatch.setattr(KinematicKriging, "start_from", lambda model, optimum: told.append(optimum))
    choice = tp.predictors.rank_predictors(["kinematic-kriging"], replace(errors), folds=2, splits=["points"])
    assert len(told) == 2
    assert all(optimum is told[0] for optimum in told)
    np.testing.assert_array_equal(told[0][1].hyper.to_vector(), choice.predictor.hyper_.to_vector())


def test_a_fit_names_the_hyperparameters_at_their_bounds():
    """An arm without errors: hyperparameters go to their bounds."""
    virtual = tp.VirtualCell("paper", seed=0)
    q = virtual.design(40, seed=1)
    samples = virtual.measure(q, seed=1)
    e = np.zeros((40, 3)) + 1e-3 * np.random.default_rng(0).normal(size=(40, 3))
    model = tp.KinematicKriging(virtual.robot, virtual.tf_flange_tool, conditions=("approach",))
    model.fit(np.hstack([samples.q, np.sign(samples.q)]), e)
    known = model.hyper_.names(
        model.joints_, ["geometry", "compliance", "backlash"], [f"joint {j}" for j in range(1, 7)]
    )
    assert model.bounds_hit_
    assert set(model.bounds_hit_) <= set(known)
