"""Fits whose first registration is far off: long reflector arms, small joint motion, arms far from nominal."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.error_map.registration import with_tool_hint
from truepose.errors import DataError
from truepose.geometry import apply_transform, make_transform, register_with_tool
from truepose.geometry.station import kabsch
from truepose.numerics import frozen
from truepose.predictors.kinematic import terms
from truepose.predictors.kinematic.fitting import search
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.robots import error_model

ARM7 = tp.Robot(
    "seven-axes",
    alpha=np.deg2rad([0, -90, 90, 90, -90, -90, 90]),
    a=[0, 0, 0, 45, -45, 0, 70],
    d=[333, 0, 316, 0, 384, 0, 100],
    offset=[0, 0.2, 0, -0.5, 0, 0, 0.7],
    limits=np.deg2rad([[-170, 170]] * 7),
)
NOISE = 0.02  # mm
FITTED = 60


class Campaign:
    """An arm with errors of geometry, measured at joints within some degrees of a pose.

    Attributes
    ----------
    q : (n, 7) array [rad]
        The joints; the first `FITTED` are those of the samples.
    read, exact : (n, 3) arrays [mm], tracker frame
        The readings, and the true positions.
    tf_flange_tool : (4, 4) array [mm]
        The true place of the reflector.
    """

    def __init__(self, seed, degrees_off, degrees=15.0):
        rng = np.random.default_rng(seed)
        self.q = rng.uniform(-0.9, 0.9, 7) + np.deg2rad(degrees) * rng.uniform(-1, 1, (FITTED + 200, 7))
        self.tf_flange_tool = make_transform(np.eye(3), np.array([300.0, 50.0, 600.0]))
        model = error_model(ARM7, "hayati", self.tf_flange_tool)
        own = [p.group not in ("base", "tool") for p in model.parameters]
        size = [5.0 if p.unit == "mm" else np.deg2rad(degrees_off) for p in model.parameters]
        p = model.forward(self.q, model.nominal + np.array(own) * size * rng.normal(size=len(own)))[:, :3, 3]
        self.exact = apply_transform(make_transform(Rotation.random(rng=rng), np.array([2000.0, 500, 800])), p)
        self.read = self.exact + rng.normal(0, NOISE, p.shape)

    def errors(self, tf_base_tracker, tf_flange_tool):
        """Return the errors of the readings, and those without noise, after a registration."""
        p_cmd = ARM7.forward(self.q) @ tf_flange_tool[:, 3]
        return tuple(apply_transform(tf_base_tracker, p) - p_cmd[:, :3] for p in (self.read, self.exact))

    def miss(self, tf_base_tracker, tf_flange_tool, **options):
        """Return the mean length of what a fit leaves of the other poses' errors [mm], and the fit."""
        e, exact = self.errors(tf_base_tracker, tf_flange_tool)
        model = tp.KinematicKriging(ARM7, tf_flange_tool, **options).fit(self.q[:FITTED], e[:FITTED], NOISE)
        left = model.predict(self.q[FITTED:]) - exact[FITTED:]
        return np.linalg.norm(left, axis=1).mean(), model

    def registered_with(self, away):
        """Return the best station for a tool that is away from the true one [mm], and that tool."""
        tool = self.tf_flange_tool.copy()
        tool[:3, 3] += away
        p_cmd = (ARM7.forward(self.q[:FITTED]) @ tool)[:, :3, 3]
        return make_transform(*kabsch(self.read[:FITTED], p_cmd, np.ones(FITTED))), tool


@pytest.fixture(scope="module", params=[0.05, 1.0], ids=["near nominal", "one degree off"])
def campaign(request):
    return Campaign(1, request.param)


@pytest.mark.parametrize("times", [1.0, 4.0])
@pytest.mark.parametrize("solver", ["covariance", "basis"])
@pytest.mark.sampled(1)
def test_a_fit_finds_its_way_from_a_tool_that_is_140_mm_and_more_off(campaign, solver, times):
    """The accuracy does not depend on where the registration starts."""
    near, _ = campaign.miss(*campaign.registered_with(np.zeros(3)), solver=solver)
    far, model = campaign.miss(*campaign.registered_with(times * np.array([100.0, -80.0, 60.0])), solver=solver)
    assert near < 2.0 * NOISE
    assert far == pytest.approx(near, rel=0.05)
    again = tp.KinematicKriging(ARM7, model.tf_flange_tool).set_params(**model.with_fitted_parameters().get_params())
    again.fit(*model._given)
    assert np.abs(again.predict(campaign.q) - model.predict(campaign.q)).max() < 1e-6


def test_a_tool_that_the_arm_moved_is_named():
    """Fitted at the nominal arm, the tool is centimetres off; the estimated arm shows it."""
    campaign = Campaign(1, 1.0)
    found = register_with_tool(ARM7.forward(campaign.q[:FITTED]), campaign.read[:FITTED])
    tool = make_transform(np.eye(3), found.p_flange_tool)
    off = np.linalg.norm(found.p_flange_tool - campaign.tf_flange_tool[:3, 3])
    miss, model = campaign.miss(found.tf_base_tracker, tool)
    assert miss < 2.0 * NOISE
    assert off > 20.0
    hinted = with_tool_hint(found, model.parameters_)
    assert "the fitted tool is off by 40 mm ± 14 mm" in hinted.hint
    assert with_tool_hint(found, [{**row, "estimate": 0.0, "std": 0.1} for row in model.parameters_]) is found


def test_a_search_that_does_not_move_starts_elsewhere():
    """A likelihood whose gradient is wrong near the start holds a search there; it is found from other starts."""
    start, best = Hyperparameters.start(1, 0), 0.011

    class Likelihood:
        n, constant = 10, 0.0

        def __call__(self, hyper):
            theta = hyper.to_vector()
            off = theta - np.log([best, 0.1, 1.0, 1.0, 0.03])
            gradient = off if np.abs(theta - start.to_vector()).max() > 0.5 else -off
            return 100.0 * float(off @ off), 200.0 * gradient

    found, _ = search(Likelihood(), [start])
    assert found.hyper.joint_std[0] == pytest.approx(best, rel=0.1)


@pytest.fixture
def prior_times(monkeypatch):
    """A function that multiplies the prior of registration."""

    def change(times):
        usual = {"base": {"mm": 30.0, "rad": 0.03}, "tool": {"mm": 30.0}}
        wide = {group: {unit: times * std for unit, std in own.items()} for group, own in usual.items()}
        monkeypatch.setattr(terms, "_REGISTRATION", wide)

    return change


@pytest.mark.parametrize("degrees", [10.0, 15.0, 24.0])
@pytest.mark.parametrize("degrees_off", [0.05, 1.0])
@pytest.mark.sampled(1)
def test_the_prior_of_registration_does_not_matter(prior_times, degrees_off, degrees):
    """With a tool that is not stated, 670 mm off, the fit is that of the right one, whatever the prior's width."""
    campaign = Campaign(2, degrees_off, degrees)
    near, _ = campaign.miss(*campaign.registered_with(np.zeros(3)))
    for times in (1.0, 10.0, 100.0):
        prior_times(times)
        far, model = campaign.miss(*campaign.registered_with(-campaign.tf_flange_tool[:3, 3]))
        assert far == pytest.approx(near, rel=0.1)
        assert not model.bounds_hit_
        tool = [row["estimate"] for row in model.parameters_ if row["name"] in ("tool x", "tool y", "tool z")]
        std = [row["std"] for row in model.parameters_ if row["name"] in ("tool x", "tool y", "tool z")]
        assert (np.abs(tool - campaign.tf_flange_tool[:3, 3]) < 5.0 * np.array(std) + 1.0).all()


def test_a_moved_prior_of_registration_is_kept():
    """A copy with the fitted parameters, new samples and frozen constants all use the prior where it was moved."""
    campaign = Campaign(1, 0.05)
    found = campaign.registered_with(-campaign.tf_flange_tool[:3, 3])
    e, _ = campaign.errors(*found)
    model = campaign.miss(*found)[1]
    assert np.abs(model.with_fitted_parameters().registration).max() > 100.0
    again = tp.KinematicKriging(ARM7, found[1]).set_params(**model.with_fitted_parameters().get_params())
    again.fit(*model._given)
    q = campaign.q[FITTED:]
    assert np.abs(again.predict(q) - model.predict(q)).max() < 1e-6
    assert np.abs(sum(model.explain(q).values()) - model.predict(q)).max() < 1e-7
    constants, plain = model.constants(), np.empty((len(q), 3))
    frozen.predict(q, plain, constants, frozen.scratch(constants))
    assert np.abs(plain - model.predict(q)).max() < 1e-3
    model.update(q[:30], e[FITTED : FITTED + 30], NOISE)
    assert np.linalg.norm(model.predict(q[30:]) - e[FITTED + 30 :], axis=1).mean() < 3.0 * NOISE
    with pytest.raises(DataError, match="registration has 2 numbers, expected 9"):
        model.with_fitted_parameters().set_params(registration=(1.0, 2.0)).fit(*model._given)


def test_what_no_sample_determines_stays_at_the_stated_tool():
    """With one orientation of the flange, tool and base cannot be told apart: the tool keeps its prior."""
    virtual = tp.VirtualCell("paper")
    samples = virtual.measure(virtual.design(40))
    model = tp.fit_cell(virtual.cell, samples, "kinematic-kriging").predictor
    tool = [row for row in model.parameters_ if row["name"] in ("tool x", "tool y", "tool z")]
    assert all(abs(row["estimate"]) < 15.0 < row["std"] < 30.0 for row in tool)
    assert not np.any(model.with_fitted_parameters().registration)
