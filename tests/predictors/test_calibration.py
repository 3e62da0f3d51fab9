"""Calibration and the network behind it, as error models."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sklearn.base import clone

from truepose.errors import DataError, IdentifiabilityError
from truepose.geometry import make_transform, register_with_tool
from truepose.predictors.calibration import KinematicCalibration
from truepose.predictors.residual_network import ResidualNetwork
from truepose.robots import load_robot
from truepose.samples import read_samples

TOOL = make_transform(translation=[110.0, -20.0, 360.0])
ROBOT = load_robot("kuka-kr210-r2700-extra")
NOISE = 0.03


def errors(q, robot=ROBOT):
    return (TRUE.forward(q, TOOL) - robot.forward(q, TOOL))[:, :3, 3]


def true_robot():
    rng = np.random.default_rng(5)
    size = {"alpha": 3e-4, "offset": 3e-4, "beta": 3e-4, "a": 0.3, "d": 0.3}
    return replace(ROBOT, **{key: getattr(ROBOT, key) + rng.normal(scale=s, size=6) for key, s in size.items()})


TRUE = true_robot()


@pytest.fixture
def samples(rng):
    q = rng.uniform(0.5 * ROBOT.limits[:, 0], 0.5 * ROBOT.limits[:, 1], (80, 6))
    return q, errors(q) + NOISE * rng.normal(size=(80, 3))


@pytest.fixture
def targets(rng):
    return rng.uniform(0.5 * ROBOT.limits[:, 0], 0.5 * ROBOT.limits[:, 1], (100, 6))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("method", ["ls", "lm", "ekf", "ukf"])
def test_predicts_to_a_part_of_the_noise(method, samples, targets):
    model = KinematicCalibration(ROBOT, TOOL, method=method).fit(*samples)
    e, std = model.predict(targets, return_std=True)
    miss = e - errors(targets)
    assert np.linalg.norm(miss, axis=1).mean() < NOISE
    assert 0.85 < (np.abs(miss) < 1.96 * std).mean() <= 1.0
    assert model.misfit_std_ == pytest.approx(NOISE, rel=0.15)
    _, wider = model.predict(targets, return_std=True, include_nugget=True)
    assert (wider > std).all()


def test_orientation_of_the_identified_arm(samples, targets):
    """A turn of the last frame is hidden by the tool's shift; the rest of the orientation error follows."""
    model = KinematicCalibration(ROBOT, TOOL).fit(*samples)
    error, std = model.predict_pose(targets, return_std=True)
    for found, expected in zip((error, std), model.predict(targets, return_std=True), strict=True):
        np.testing.assert_allclose(found[:, :3], expected, atol=1e-12)
    real, nominal = TRUE.forward(targets, TOOL), ROBOT.forward(targets, TOOL)
    true = Rotation.from_matrix(real[:, :3, :3] @ np.swapaxes(nominal[:, :3, :3], 1, 2)).as_rotvec()
    miss = Rotation.from_rotvec(true) * Rotation.from_rotvec(-error[:, 3:])
    in_flange = (Rotation.from_matrix(nominal[:, :3, :3]).inv() * miss).as_matrix() @ nominal[:, :3, :3]
    left = Rotation.from_matrix(in_flange).as_rotvec()
    assert np.linalg.norm(left - left.mean(axis=0), axis=1).mean() < 0.1 * np.linalg.norm(true, axis=1).mean()
    assert (np.abs(miss.as_rotvec()) < 1.96 * std[:, 3:]).mean() > 0.93
    np.testing.assert_array_equal(model.predict_pose(targets), error)
    away = np.array([0.0, 150.0, -100.0])
    offset = nominal[:, :3, :3] @ away
    other = TOOL.copy()
    other[:3, 3] += away
    at_other = (TRUE.forward(targets, other) - ROBOT.forward(targets, other))[:, :3, 3]
    found, wider = model.predict_pose(targets, return_std=True, offset=offset)
    assert (
        np.linalg.norm(at_other - found[:, :3], axis=1).mean() < np.linalg.norm(at_other - error[:, :3], axis=1).mean()
    )
    assert (np.abs(at_other - found[:, :3]) < 1.96 * wider[:, :3]).mean() > 0.93


@pytest.mark.sampled(1)
@pytest.mark.parametrize("options", [{}, {"prior": "subset"}, {"loss": "huber"}, {"terms": ("sin1", "cos1 q2")}])
def test_leave_one_out_is_refitting(options, samples):
    """The closed form against fits without each of some samples; repeats of a pose go together."""
    q, e = samples
    q, e = np.concatenate([q, q[:2]]), np.concatenate([e, e[:2] + 0.01])
    model = KinematicCalibration(ROBOT, TOOL, misfit_std=NOISE, **options).fit(q, e)
    residual, std = model.leave_one_out()
    for i in (0, 7, 40):
        out = (q == q[i]).all(axis=1)
        again = KinematicCalibration(ROBOT, TOOL, misfit_std=NOISE, **options).fit(q[~out], e[~out])
        mean, spread = again.predict(q[[i]], return_std=True, include_nugget=True)
        weak = options.get("prior") == "subset" or "loss" in options  # the subset and the weights may change
        np.testing.assert_allclose(residual[i], e[i] - mean[0], atol=0.02 if weak else 1e-3)
        np.testing.assert_allclose(std[i], spread[0], rtol=0.2 if weak else 1e-2)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "model",
    [
        KinematicCalibration(ROBOT, TOOL),
        KinematicCalibration(ROBOT, TOOL, method="ukf", convention="mcpc"),
        KinematicCalibration(ROBOT, TOOL, prior="subset", terms=("sin1",)),
        KinematicCalibration(ROBOT, TOOL, loss="cauchy", terms=("compliance",), payload=(200.0, 0.0, 0.0, 250.0)),
        ResidualNetwork(ROBOT, TOOL, hidden=5),
    ],
    ids=["lm", "ukf", "subset", "cauchy", "network"],
)
def test_pinned_copy_answers_the_same_bit_by_bit(model, samples, targets):
    model = clone(model).fit(*samples)
    plain = json.loads(json.dumps(model.to_dict()))
    assert "robot" not in plain
    again = type(model).from_dict({**plain, **{name: getattr(model, name) for name in model.arm_parameters}})
    for copy in (model.with_fitted_parameters(), again):
        answer = copy.fit(*samples).predict(targets, return_std=True)
        np.testing.assert_array_equal(answer, model.predict(targets, return_std=True))
        np.testing.assert_array_equal(copy.leave_one_out(), model.leave_one_out())


def test_backlash_with_approach_signs(samples, rng):
    q, e = samples
    approach = rng.choice([-1.0, 1.0], q.shape)
    slack = np.array([1e-4, 2e-4, -1e-4, 0, 0, 0])
    e = e + np.einsum("nij,nj->ni", ROBOT.joint_jacobian(q, tool=TOOL), approach * slack)
    x = np.column_stack([q, approach])
    model = KinematicCalibration(ROBOT, TOOL, terms=("backlash",)).fit(x, e)
    rows = [row for row in model.parameters_ if row["group"] == "backlash"]
    for row, true in zip(rows[:3], slack, strict=False):
        assert abs(row["change"] - true) < 4 * row["std"] < 1e-4
    with pytest.raises(DataError, match="backlash needs the approach signs"):
        KinematicCalibration(ROBOT, TOOL, terms=("backlash",)).fit(q, e)


@pytest.mark.exhaustive
def test_campaign(samples, targets):
    q, e = samples
    model = KinematicCalibration(ROBOT, TOOL, method="ekf", misfit_std=NOISE)
    spread = []
    for part in (slice(0, 20), slice(20, 50), slice(50, 80)):
        model.partial_fit(q[part], e[part])
        spread.append(model.predict(targets, return_std=True)[1].mean())
    assert spread[0] > spread[1] > spread[2]
    whole = KinematicCalibration(ROBOT, TOOL, method="ekf", misfit_std=NOISE).fit(q, e)
    np.testing.assert_allclose(model.predict(targets), whole.predict(targets), atol=1e-6)
    with pytest.raises(DataError, match=r'partial_fit needs method="ekf" or "ukf", got "lm"'):
        KinematicCalibration(ROBOT, TOOL).partial_fit(q, e)
    with pytest.raises(DataError, match="partial_fit needs noise_std, or misfit_std"):
        KinematicCalibration(ROBOT, TOOL, method="ekf").partial_fit(q, e)


def test_calibrated_robot_goes_where_the_true_one_goes(samples, targets):
    model = KinematicCalibration(ROBOT, TOOL).fit(*samples)
    found = model.calibrated_.forward(targets)[:, :3, 3] - TRUE.forward(targets, TOOL)[:, :3, 3]
    around = found - found.mean(axis=0)  # base and tool stay with the cell
    assert (
        np.linalg.norm(around, axis=1).mean()
        < 0.6 * np.linalg.norm(errors(targets) - errors(targets).mean(axis=0), axis=1).mean()
    )


def test_table(samples):
    rows = {row["parameter"]: row for row in KinematicCalibration(ROBOT, TOOL).fit(*samples).parameters_}
    assert len(rows) == 39
    assert rows["theta3"]["note"] == ""
    assert rows["theta3"]["identified"] == pytest.approx(TRUE.offset[2], abs=5 * rows["theta3"]["std"])
    assert rows["d2"]["note"].startswith("not identifiable with d3")
    assert rows["a3"]["unit"] == "mm"


def test_noise_of_the_readings_makes_the_rest_the_models(samples, targets):
    """With the readings' noise known, what the model cannot explain is its nugget, and in no field."""
    q, e = samples
    e = e + 0.1 * np.sin(40 * q[:, :3])
    model = KinematicCalibration(ROBOT, TOOL).fit(q, e, noise_std=NOISE)
    assert 0.05 < model.misfit_std_ < 0.12
    np.testing.assert_allclose(model.nugget_, model.misfit_std_**2)
    field, reading = (model.predict(targets, return_std=True, include_nugget=with_it)[1] for with_it in (False, True))
    np.testing.assert_allclose(reading**2 - field**2, model.misfit_std_**2)


def test_few_and_similar_poses(samples, rng):
    q, e = samples
    message = r"6 samples are too few: rank 18 of the 27 .* add poses .* such as q = \("
    with pytest.raises(IdentifiabilityError, match=message):
        KinematicCalibration(ROBOT, TOOL).fit(q[:6], e[:6])
    with pytest.raises(IdentifiabilityError, match="30 samples are too similar: rank 3 of the 27"):
        KinematicCalibration(ROBOT, TOOL).fit(np.tile(q[:1], (30, 1)), e[:30])
    still = q.copy()
    still[:, 3:] = q[0, 3:]
    hint = KinematicCalibration(ROBOT, TOOL).fit(still, errors(still)).hint_
    assert "of the 27 combinations" in hint
    assert "add poses that turn all joints" in hint
    assert KinematicCalibration(ROBOT, TOOL).fit(q, e).hint_ == ""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"robot": None}, "calibration needs the nominal robot"),
        ({"method": "newton"}, 'method is "newton"; expected one of ls, lm, ekf, ukf'),
        ({"prior": "none"}, 'prior is "none"; expected one of tolerance, subset'),
        ({"method": "ls", "loss": "huber"}, 'loss "huber" needs method="lm"'),
        ({"method": "ekf", "prior": "subset"}, "a Kalman filter needs tolerances"),
        ({"misfit_std": -1.0}, "misfit_std is -1.0"),
        ({"payload": (5.0,)}, r"payload is \(5.0,\); expected mass"),
        ({"identified": (1.0,)}, "identified has 1 numbers, expected 39"),
        ({"parameters": ("gamma",)}, 'no parameter "gamma"'),
    ],
)
def test_bad_options(options, message, samples):
    with pytest.raises(ValueError, match=message):
        KinematicCalibration(**{"robot": ROBOT, "tf_flange_tool": TOOL, **options}).fit(*samples)


def test_bad_samples(samples):
    q, e = samples
    with pytest.raises(DataError, match="X has 3 columns, expected the 6 joints of kuka-kr210"):
        KinematicCalibration(ROBOT).fit(q[:, :3], e)
    with pytest.raises(DataError, match="y has 1 columns, expected 3"):
        KinematicCalibration(ROBOT).fit(q, e[:, 0])
    with pytest.raises(DataError, match="X has NaN or infinity in row 2"):
        KinematicCalibration(ROBOT).fit(np.where(np.arange(80)[:, None] == 2, np.nan, q), e)


def test_seven_joints(rng):
    """Chains of any number of revolute joints are calibrated."""
    seven = replace(
        ROBOT,
        name="seven",
        **{
            key: np.append(getattr(ROBOT, key), value)
            for key, value in {
                "alpha": np.pi / 2,
                "a": 80.0,
                "d": 120.0,
                "offset": 0.0,
                "beta": 0.0,
                "sign": 1.0,
            }.items()
        },
        limits=np.vstack([ROBOT.limits, [-3.0, 3.0]]),
    )
    true = replace(seven, a=seven.a + rng.normal(scale=0.3, size=7))
    q = rng.uniform(-1, 1, (80, 7))
    model = KinematicCalibration(seven, TOOL).fit(q, (true.forward(q, TOOL) - seven.forward(q, TOOL))[:, :3, 3])
    assert model.observability_.rank == 31  # 4 for each joint and 3
    new = rng.uniform(-1, 1, (30, 7))
    miss = model.predict(new) - (true.forward(new, TOOL) - seven.forward(new, TOOL))[:, :3, 3]
    assert np.abs(miss).max() < 1e-3


@pytest.mark.exhaustive
def test_network_learns_what_calibration_leaves(rng):
    def wave(q):
        return np.einsum("nij,nj->ni", ROBOT.joint_jacobian(q, tool=TOOL), 3e-4 * np.sin(3 * q) * [1, 1, 1, 0, 0, 0])

    q = rng.uniform(-1, 1, (500, 6))
    new = rng.uniform(-1, 1, (200, 6))
    e = errors(q) + wave(q) + NOISE * rng.normal(size=q[:, :3].shape)
    plain = KinematicCalibration(ROBOT, TOOL).fit(q, e)
    model = ResidualNetwork(ROBOT, TOOL).fit(q, e)

    def miss(model):
        return np.linalg.norm(model.predict(new) - errors(new) - wave(new), axis=1).mean()

    assert model.shrink_ > 0.8
    assert miss(model) < 0.6 * miss(plain)
    residual, std = model.leave_one_out()
    assert np.sqrt((residual**2).mean()) == pytest.approx(std.mean(), rel=0.05)


def test_network_keeps_still_where_nothing_is_left(samples, targets):
    model = ResidualNetwork(ROBOT, TOOL, hidden=10).fit(*samples)
    assert model.shrink_ < 0.3
    plain = KinematicCalibration(ROBOT, TOOL).fit(*samples)
    assert np.abs(model.predict(targets) - plain.predict(targets)).max() < NOISE
    with pytest.raises(DataError, match="19 samples are too few for networks"):
        ResidualNetwork(ROBOT, TOOL).fit(samples[0][:19], samples[1][:19])


@pytest.mark.exhaustive
@pytest.mark.parametrize(("terms", "mark"), [((), 0.362), (("sin1", "cos1"), 0.318)])
def test_measured_arm(ur10, terms, mark):
    """A UR10 read by a laser tracker: mean of the other half over five random halves [mm]."""
    samples = read_samples(ur10 / "samples.csv")
    robot = load_robot("universal-robots-ur10")
    left = []
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(len(samples))
        half, other = np.split(order, 2)
        registration = register_with_tool(robot.forward(samples.q[half]), samples.p_meas[half])
        tool = make_transform(translation=registration.p_flange_tool)
        e = registration.apply(samples.p_meas) - robot.forward(samples.q, tool)[:, :3, 3]
        model = KinematicCalibration(robot, tool, terms=terms).fit(samples.q[half], e[half])
        left.append(np.linalg.norm(e[other] - model.predict(samples.q[other]), axis=1).mean())
    assert np.mean(left) < mark
