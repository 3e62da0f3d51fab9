"""Harmonics of the gears in kinematic Kriging, and the gear ratios of a robot file."""

from dataclasses import replace

import numpy as np
import pytest

from truepose import VirtualCell
from truepose.error_map.frozen_parts import from_arrays, to_arrays
from truepose.errors import FileError
from truepose.numerics.frozen import predict, scratch
from truepose.numerics.frozen_deviation import deviations
from truepose.planning.prior import Prior
from truepose.predictors.kinematic import KinematicKriging
from truepose.predictors.kinematic.gears import amplitudes
from truepose.predictors.kinematic.hyperparameters import Hyperparameters, HyperPrior, Weak
from truepose.robots import joint_terms, load_robot
from truepose.robots.io.toml import parse_robot, to_toml

RATIO = np.array([141.0, 153.5, 120.0, 101.0, 80.0, 51.0])
ROBOT = replace(load_robot("kuka-kr210-r2700-extra"), gear_ratio=RATIO)
TOOL = np.array([[1.0, 0, 0, 110], [0, 1, 0, 20], [0, 0, 1, 360], [0, 0, 0, 1]])
HOME = np.deg2rad([0, -75, 95, 10, 50, 20])
RIPPLE = np.array([4e-5, -5e-5, 4e-5, 3e-5, 5e-5, 0.0])  # rad


def simulate(n, seed, noise=0.01, grid=None):
    """Configurations, and errors of one link and of ripple [mm]."""
    rng = np.random.default_rng(seed)
    q = HOME + rng.uniform(-1, 1, size=(n, 6)) * np.deg2rad([40, 25, 25, 60, 40, 90])
    q = q if grid is None else np.round(q / grid) * grid
    link = 0.3 * ROBOT.error_jacobian(q, tool=TOOL, parameters=["a3"])[:, :, 0]
    moved = q + RIPPLE * np.sin(RATIO * q + 0.4)
    reached, nominal = (ROBOT.forward(joints, tool=TOOL)[:, :3, 3] for joints in (moved, q))
    return q, link + reached - nominal + rng.normal(scale=noise, size=link.shape)


@pytest.fixture(scope="module", params=["covariance", "basis"])
def fitted(request):
    return KinematicKriging(ROBOT, TOOL, solver=request.param).fit(*simulate(120, 0))


@pytest.mark.sampled(1)
def test_the_amplitude_of_each_gear_is_found(fitted):
    rows = {row["name"]: row for row in fitted.parameters_ if row["group"] == "gear"}
    assert len(rows) == 24
    for joint, ripple in enumerate(RIPPLE[:5], 1):
        for wave, part in (("sin", np.cos(0.4)), ("cos", np.sin(0.4))):
            first, second = rows[f"gear {wave} 1 q{joint}"], rows[f"gear {wave} 2 q{joint}"]
            assert abs(first["estimate"] - ripple * part) < 4.5 * first["std"]
            assert abs(second["estimate"]) < 4.5 * second["std"]
    assert max(rows[f"gear sin 1 q{joint}"]["std"] for joint in (1, 2, 3)) < 5e-6


def test_amplitudes_have_intervals(fitted):
    found = amplitudes([row for row in fitted.parameters_ if row["group"] == "gear"])
    assert [row["name"] for row in found[:3]] == ["gear 1 q1", "gear 2 q1", "gear 1 q2"]
    for row, ripple in zip(found[:10:2], RIPPLE[:5], strict=True):
        assert abs(row["estimate"] - abs(ripple)) < 4.5 * row["std"]


@pytest.mark.exhaustive
def test_with_the_term_new_poses_are_predicted_better(fitted):
    q, e = simulate(150, 1, noise=0.0)
    without = KinematicKriging(ROBOT, TOOL, gear_harmonics=False).fit(*simulate(120, 0))
    assert not any(row["group"] == "gear" for row in without.parameters_)
    left, before = (np.linalg.norm(model.predict(q) - e, axis=1).mean() for model in (fitted, without))
    assert left < 0.5 * before


def test_contributions_sum_to_the_prediction(fitted):
    q = simulate(10, 2)[0]
    parts = fitted.explain(q)
    assert np.abs(parts["gear"]).max() > 0.05
    np.testing.assert_allclose(sum(parts.values()), fitted.predict(q), atol=1e-7)


def test_a_frozen_map_knows_the_gears(fitted):
    q = simulate(60, 3)[0]
    constants = fitted.constants()
    out = np.empty((len(q), 3))
    predict(q, out, constants, scratch(constants))
    mean, std = fitted.predict(q, return_std=True)
    np.testing.assert_allclose(out, mean, atol=2e-4)
    found = deviations(q, constants, fitted.deviation(constants, q, np.zeros(3)))
    assert (found > std * 0.999).all()
    np.testing.assert_allclose(found, std, rtol=0.03)


def test_files_of_frozen_maps_from_before_the_term_still_load(fitted):
    q = simulate(20, 3)[0]
    model = KinematicKriging(replace(ROBOT, gear_ratio=[]), TOOL, joint_errors=False, residual="none", robust=False)
    constants = model.fit(*simulate(20, 7)).constants()
    deviation = model.deviation(constants, q, np.zeros(3))
    old = to_arrays(constants, deviation)
    assert old.pop("deviation.waves").size == 0
    again = from_arrays(old)
    np.testing.assert_array_equal(deviations(q, *again), deviations(q, constants, deviation))
    damaged = to_arrays(fitted.constants(), fitted.deviation(fitted.constants(), q, np.zeros(3)))
    damaged.pop("deviation.waves")
    with pytest.raises(ValueError, match="waves has shape"):
        from_arrays(damaged)


def test_a_plan_after_a_map_with_gears_expects_what_the_map_does(fitted):
    q = simulate(60, 8)[0]
    covariance = Prior.after(fitted, simulate(120, 0)[0], q).covariance(q)
    std = np.sqrt(np.einsum("naa->na", covariance))
    expected = fitted.predict(q, return_std=True)[1] / np.sqrt(fitted.inflation_)
    assert 0.7 < std.mean() / expected.mean() < 1.3


@pytest.mark.parametrize("grid", [None, 2 * np.pi / 120])
def test_the_term_is_left_out_where_the_samples_do_not_show_it(grid):
    """Without ripple; and with gears of which each sampled angle is a whole number of motor turns."""
    robot = ROBOT if grid is None else replace(ROBOT, gear_ratio=np.full(6, 120.0))
    q, e = simulate(80, 4, grid=grid)
    e = e if grid is not None else 0.3 * robot.error_jacobian(q, tool=TOOL, parameters=["a3"])[:, :, 0]
    e = e + np.random.default_rng(5).normal(scale=0.01, size=e.shape)
    model = KinematicKriging(robot, TOOL, residual="none").fit(q, e)
    assert model.hyper_.tolerance[-1] == pytest.approx(model.hyper_.least_tolerance[-1])
    assert not any(row["told"] for row in model.parameters_ if row["group"] == "gear")


def test_a_robot_file_states_gear_ratios():
    np.testing.assert_array_equal(parse_robot(to_toml(ROBOT)).gear_ratio, RATIO)
    assert "gear_ratio" not in to_toml(replace(ROBOT, gear_ratio=np.empty(0)))


def test_calibration_takes_the_gear_ratios_of_the_robot():
    q = simulate(5, 6)[0]
    stated, own = (joint_terms(ROBOT, ["gearsin1"], gear_ratio=ratio).basis(q) for ratio in (RATIO, None))
    np.testing.assert_array_equal(own, stated)


def test_a_virtual_robot_has_the_ripple_of_its_file(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(to_toml(ROBOT), "utf-8")
    cell = VirtualCell("ripple", robot=path, seed=1)
    np.testing.assert_array_equal(cell.truth.ripple.order[:, 0], RATIO)
    size = np.hypot(cell.truth.ripple.sine, cell.truth.ripple.cosine)
    assert ((size >= 20e-6) & (size <= 50e-6)).all()
    np.testing.assert_array_equal(cell.cell.load_robot().gear_ratio, RATIO)


@pytest.mark.parametrize(
    ("ratio", "why"),
    [
        ("[141.0, 0.0, 120.0, 101.0, 80.0, 51.0]", "my-arm.toml: .*joint 2: gear_ratio is 0"),
        ("[141.0, 153.5, -120.0, 101.0, 80.0, 51.0]", "my-arm.toml: .*joint 3: gear_ratio is -120"),
        ("[141.0, 153.5]", r"kinematics.gear_ratio must be a list of 6 numbers"),
        ('"100"', r"kinematics.gear_ratio must be a list of 6 numbers"),
        ("[]", r"kinematics.gear_ratio must be a list of 6 numbers"),
    ],
)
def test_wrong_gear_ratios_name_file_and_joint(ratio, why):
    lines = ["gear_ratio = " + ratio if line.startswith("gear_ratio") else line for line in to_toml(ROBOT).splitlines()]
    with pytest.raises(FileError, match=why):
        parse_robot("\n".join(lines), path="my-arm.toml")


def test_the_shortest_length_follows_the_spacing_of_the_angles():
    q = np.column_stack([np.arange(200) * 0.008, np.arange(200) % 40 * 0.1, np.arange(200) % 2, np.arange(200) * 1e-4])
    np.testing.assert_allclose(HyperPrior().for_angles(q).shortest, [0.008, 0.02, 0.02, 0.003], rtol=0.01)


def test_repeated_angles_and_whole_turns_count_once():
    angle = np.arange(100) * 0.01
    q = np.concatenate([angle, angle, angle + 2 * np.pi])[:, None]
    np.testing.assert_allclose(HyperPrior().for_angles(q).shortest, [0.01], rtol=0.01)


def test_priors_may_differ_from_joint_to_joint():
    weak = HyperPrior(joint_length=Weak(np.array([0.05, 0.3]), np.array([0.5, 1.0])), shortest=np.array([0.004, 0.02]))
    hyper = Hyperparameters.start(2, 0, weak=weak)
    centre, std = hyper.prior()
    np.testing.assert_allclose(hyper.joint_length, [0.05, 0.3])
    np.testing.assert_allclose(np.exp(centre[2:4]), [0.05, 0.3])
    np.testing.assert_allclose(std[2:4], [0.5, 1.0])
    np.testing.assert_allclose(np.exp([low for low, _ in hyper.bounds()[2:4]]), [0.004, 0.02])
    assert hyper.with_vector(hyper.to_vector()).weak is weak
    again = Hyperparameters.from_dict(hyper.to_dict())
    np.testing.assert_allclose(again.to_vector(), hyper.to_vector())
