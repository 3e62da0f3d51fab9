"""Calibrated arms and chains without closed form: every branch leads back, and what is lost is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.robots.arms import ARMS

from truepose.errors import DataError, RobotError
from truepose.geometry import make_transform
from truepose.robots import Robot, find_branches, load_robot, nearest_branch, to_mdh
from truepose.robots.inverse.closed_form import closed_form, nominal_of, ortho_parallel
from truepose.robots.inverse.newton import damped_newton, linearised, smallest_singular


def half_turn(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def calibrated(robot: Robot, rng: np.random.Generator) -> Robot:
    """Errors of an arm as delivered, in every parameter: 0.4 mm and 0.4 mrad."""
    changes = {key: rng.normal(scale=0.4, size=6) for key in ("a", "d")}
    changes |= {key: rng.normal(scale=4e-4, size=6) for key in ("alpha", "offset", "beta")}
    if robot.convention == "dh":
        del changes["beta"]
    return replace(robot, **{key: getattr(robot, key) + change for key, change in changes.items()})  # type: ignore[arg-type]


def nearest_to(q: np.ndarray, solutions: np.ndarray) -> np.ndarray:
    """Largest joint difference to the nearest branch: (n,)."""
    away = np.abs(half_turn(solutions - q[:, None])).max(axis=-1)
    return np.where(np.isnan(away), np.inf, away).min(axis=1)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ARMS)
def test_every_branch_of_a_calibrated_arm_leads_back(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    arm = calibrated(robot, rng)
    assert closed_form(arm) is None
    q = rng.uniform(*robot.limits.T, size=(1000, 6))
    poses = arm.forward(q)
    found = find_branches(arm, poses)
    exists = found.exists
    np.testing.assert_array_equal(arm.inverse(poses), found.q)
    back = arm.forward(found.q[exists])
    np.testing.assert_allclose(back, np.repeat(poses, exists.sum(axis=1), axis=0), rtol=0, atol=1e-9)
    missed = nearest_to(q, found.q) > 1e-6
    assert missed.mean() < 0.01
    assert (smallest_singular(arm, q[missed]) < 0.01).all()  # where more than eight branches may lie
    # away from singularities the calibrated arm has the branches of its nominal one, in the same slots
    nominal = find_branches(robot, poses)
    plain = nominal.exists & (nominal.sigma_min > 0.02)
    assert exists[plain].all()
    assert np.abs(half_turn(found.q - nominal.q))[plain].max() < 0.3
    assert not found.beyond_mm[exists.any(axis=1)].any()


def test_three_newton_steps_reach_3e_6_mm_away_from_singularities(rng: np.random.Generator) -> None:
    robot = load_robot("kuka-kr210-r2700-extra")
    arm = calibrated(robot, rng)
    q = rng.uniform(*robot.limits.T, size=(5000, 6))
    q = q[smallest_singular(robot, q) > 0.1]
    assert len(q) > 2000
    start = nearest_branch(robot.inverse(arm.forward(q)), q)
    q, start = q[~np.isnan(start).any(axis=1)], start[~np.isnan(start).any(axis=1)]
    assert damped_newton(arm, arm.forward(q), start, steps=3).miss_mm.max() < 3e-6


def test_jacobian_of_the_iteration_is_the_difference_of_forward(rng: np.random.Generator) -> None:
    arm = replace(calibrated(load_robot("fanuc-m20ia"), rng), tf_base_first=make_transform(Rotation.random(rng=rng)))
    q = rng.uniform(-3, 3, (20, 6))
    pose = arm.forward(q)
    missing, J = linearised(arm, pose, q)
    assert np.abs(missing).max() < 1e-12
    for j in range(6):
        step = 1e-5 * np.eye(6)[j]
        there, _ = linearised(arm, arm.forward(q + step), q)
        back, _ = linearised(arm, arm.forward(q - step), q)
        np.testing.assert_allclose(J[:, :, j], (there - back) / 2e-5, atol=1e-8)


@pytest.mark.parametrize("t5_deg", [1.0, 0.1, 0.03, 0.0])
def test_no_jump_where_the_wrist_is_nearly_straight(t5_deg: float, rng: np.random.Generator) -> None:
    robot = load_robot("kuka-kr210-r2700-extra")
    arm = calibrated(robot, rng)
    q = np.tile(np.deg2rad([10.0, -80, 95, 20, t5_deg, 40]), (200, 1))
    q[:, :4] += rng.normal(scale=0.2, size=(200, 4))
    # poses of the nominal arm: the calibrated one may not reach them all
    found = find_branches(arm, robot.forward(q), nominal=robot)
    start = find_branches(robot, robot.forward(q))
    slot = np.nanargmin(np.abs(half_turn(start.q - q[:, None])).max(axis=-1), axis=1)
    there = found.q[np.arange(200), slot]
    kept = ~np.isnan(there[:, 0])
    # told: the singularity, and how far the wrist had to turn; the arm itself, its first three joints, stays
    assert found.singular[np.arange(200), slot][kept].mean() > 0.5
    arm_moves = np.abs(half_turn(there - q))[kept, :3]
    assert arm_moves.max() < 0.01
    moved = np.abs(half_turn(found.q - start.q)).max(axis=-1)
    both = found.exists & start.exists
    np.testing.assert_allclose(found.moved[both], moved[both], atol=1e-12)


def test_the_nominal_arm_is_made_or_given(rng: np.random.Generator) -> None:
    robot = load_robot("kuka-kr150-2")
    assert nominal_of(robot) is robot
    arm = calibrated(robot, rng)
    made = nominal_of(arm)
    assert made is not None
    assert closed_form(made) is not None
    q = rng.uniform(*robot.limits.T, size=(300, 6))
    poses = arm.forward(q, tool=[0, 0, 200])
    ours, theirs = arm.inverse(poses, tool=[0, 0, 200]), arm.inverse(poses, tool=[0, 0, 200], nominal=robot)
    both = ~np.isnan(ours).any(axis=-1) & ~np.isnan(theirs).any(axis=-1)
    assert both.mean() > 0.5
    assert np.median(np.abs(half_turn(ours - theirs))[both].max(axis=-1)) < 1e-9
    assert ortho_parallel(arm).c2 == pytest.approx(ortho_parallel(robot).c2, abs=2.0)
    with pytest.raises(RobotError, match="kuka-kr150-2: the nominal arm has no closed-form inverse; pass another"):
        arm.inverse(poses, nominal=arm)


def test_a_calibrated_arm_in_other_conventions(rng: np.random.Generator) -> None:
    arm = to_mdh(calibrated(load_robot("universal-robots-ur10e"), rng))
    q = rng.uniform(-3, 3, size=(300, 6))
    assert np.mean(nearest_to(q, arm.inverse(arm.forward(q))) < 1e-6) > 0.99


def test_how_far_out_of_reach(rng: np.random.Generator) -> None:
    robot = load_robot("kuka-kr150-2")
    letters = ortho_parallel(robot)
    rotation = Rotation.random(200, rng=rng).as_matrix()
    wrist = rng.normal(size=(200, 3)) * 3000
    poses = make_transform(rotation, wrist + 230.0 * rotation[:, :, 2])
    found = find_branches(robot, poses)
    # by hand: the wrist centre, from the nearer of the two shoulder points, beyond upper arm and forearm, or inside
    side = np.array([[1.0], [-1.0]]) * np.hypot(wrist[:, 0], wrist[:, 1]) - letters.a1
    distance = np.hypot(side, wrist[:, 2] - letters.c1)
    most, least = letters.c2 + letters.reach, abs(letters.c2 - letters.reach)
    beyond = np.maximum(np.maximum(distance - most, least - distance), 0.0).min(axis=0)
    assert 20 < (beyond == 0).sum() < 180
    np.testing.assert_allclose(found.beyond_mm, beyond, atol=1e-6)
    arm = calibrated(robot, rng)
    far = beyond > 10
    np.testing.assert_allclose(find_branches(arm, poses).beyond_mm[far], beyond[far], atol=5.0)


def test_messages_state_reach_and_limits() -> None:
    robot = load_robot("kuka-kr150-2")
    q = np.deg2rad([[0, -90, 90, 0, 45, 0], [0, -40, 0, 0, 30, 0], [20, -90, 90, 0, 45, 0]])
    poses = robot.forward(q)
    find_branches(robot, poses).check()
    poses[[0, 2], 0, 3] += [5000, 7000]
    with pytest.raises(RobotError, match=r"out of reach: row 0 by 3\d\d\d mm; row 2 by 5\d\d\d mm; check base, tool"):
        find_branches(robot, poses).check()
    low = np.deg2rad([0, 20, 60, 0, 30, 0])  # joint 2 beyond its 0 deg on the only branch that reaches there in front
    narrow = replace(robot, limits=np.deg2rad([[-90, 90], [-146, 0], [-119, 155], [-10, 10], [-125, 125], [-10, 10]]))
    with pytest.raises(
        RobotError,
        match=r"no branch lies within the joint limits for row 0; in row 0 the nearest has joint \d at .* deg, limits",
    ):
        find_branches(narrow, narrow.forward(low)).check()


def test_a_chain_without_any_closed_form(rng: np.random.Generator) -> None:
    robot = replace(
        load_robot("fanuc-m20ia"), name="offset-wrist", a=[0, 150, 790, 250, 60, 40], d=[525, 0, 0, 835, 90, 100]
    )
    assert nominal_of(robot) is None
    q = rng.uniform(-3, 3, size=(60, 6))
    poses = robot.forward(q)
    found = find_branches(robot, poses)
    assert found.q.shape == (60, 16, 6)
    back = robot.forward(found.q[found.exists])
    np.testing.assert_allclose(back, np.repeat(poses, found.exists.sum(axis=1), axis=0), rtol=0, atol=1e-9)
    assert found.exists.any(axis=1).all()
    assert np.mean(nearest_to(q, found.q) < 1e-6) > 0.9
    assert np.isnan(found.moved).all()
    distinct = np.abs(half_turn(found.q[:, :, None] - found.q[:, None])).max(axis=-1) > 1e-6
    assert (distinct | ~(found.exists[:, :, None] & found.exists[:, None]) | np.eye(16, dtype=bool)).all()
    poses[0, 0, 3] += 9000
    with pytest.raises(RobotError, match="offset-wrist: out of reach: row 0 by"):
        find_branches(robot, poses[:2]).check_reach()


def test_fewer_joints_are_solved_and_seven_refused(rng: np.random.Generator) -> None:
    three = Robot("three", alpha=[0, 1.5, 0], a=[0, 100, 300], d=[400, 0, 20], offset=[0, 0, 0])
    q = rng.uniform(-3, 3, (20, 3))
    assert nearest_to(q, three.inverse(three.forward(q))).max() < 1e-6
    seven = Robot("seven-axis", alpha=np.ones(7), a=np.zeros(7), d=np.ones(7), offset=np.zeros(7))
    with pytest.raises(RobotError, match="seven-axis: 7 joints reach a pose in infinitely many ways"):
        seven.inverse(np.eye(4))


def test_invalid_poses_are_refused(rng: np.random.Generator) -> None:
    arm = calibrated(load_robot("kuka-kr150-2"), rng)
    with pytest.raises(DataError, match="poses has NaN or infinite numbers in row 1"):
        find_branches(arm, np.stack([np.eye(4), np.full((4, 4), np.nan)]))
    with pytest.raises(DataError, match=r"poses has shape \(6,\)"):
        arm.inverse(np.zeros(6))
