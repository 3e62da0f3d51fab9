"""Inverse kinematics: every branch leads back to its pose, none is missing; against py-opw-kinematics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import py_opw_kinematics as opw
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.robots.arms import ARMS

from truepose.errors import DataError
from truepose.geometry import make_transform
from truepose.robots import load_robot, nearest_branch, to_mdh
from truepose.robots.inverse.closed_form import closed_form
from truepose.robots.inverse.ortho_parallel import OrthoParallel

ORTHO_PARALLEL = [name for name in ARMS if not name.startswith("universal-robots")]


def half_turn(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def joints_within_limits(name: str, rng: np.random.Generator, n: int) -> np.ndarray:
    return rng.uniform(*load_robot(name).limits.T, size=(n, 6))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.sampled(6)
def test_every_branch_leads_back_and_the_joints_are_among_them(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    q = joints_within_limits(name, rng, 5000)
    poses = robot.forward(q)
    solutions = robot.inverse(poses)
    assert solutions.shape == (5000, 8, 6)
    exists = ~np.isnan(solutions).any(axis=-1)
    assert np.isnan(solutions[~exists]).all()  # a branch is there or not
    back = robot.forward(solutions[exists])
    np.testing.assert_allclose(back, np.repeat(poses, exists.sum(axis=1), axis=0), rtol=0, atol=1e-9)
    miss = np.where(exists, np.abs(half_turn(solutions - q[:, None])).max(axis=-1), np.inf).min(axis=1)
    assert miss.max() < 1e-6
    np.testing.assert_allclose(nearest_branch(solutions, q), q, atol=1e-6)
    distinct = np.abs(half_turn(solutions[:, :, None] - solutions[:, None])).max(axis=-1) > 1e-6
    some = exists[:, :, None] & exists[:, None] & ~np.eye(8, dtype=bool)
    assert (distinct | ~some).mean() > 0.999  # the eight are different, singular poses aside


@pytest.mark.parametrize("name", ORTHO_PARALLEL)
def test_all_branches_of_an_independent_implementation(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    arm = closed_form(robot)
    assert isinstance(arm, OrthoParallel)
    peer = opw.Robot(opw.KinematicModel(arm.a1, arm.a2, arm.b, arm.c1, arm.c2, arm.c3), degrees=False)
    poses = make_transform(Rotation.random(500, rng=rng), rng.uniform(-0.6, 0.6, (500, 3)) * (arm.c2 + arm.c3))
    theirs = peer.reach(RigidTransform.from_matrix(poses)).joints
    tf_base_flange = arm.tf_base_root @ poses @ arm.tf_wrist_flange
    ours = arm.branches(tf_base_flange) * arm.sign + arm.offset
    clear = ~np.isclose(np.abs(theirs[..., 4]), 0, atol=1e-3)
    assert (np.isnan(ours).any(axis=-1).sum(axis=1) == np.isnan(theirs).any(axis=-1).sum(axis=1)).all()
    distance = np.abs(half_turn(ours[:, :, None] - theirs[:, None])).max(axis=-1)
    nearest = np.nanmin(np.where(np.isnan(distance), np.inf, distance), axis=1)
    exists = ~np.isnan(theirs).any(axis=-1) & clear
    assert exists.sum() > 500
    assert nearest[exists].max() < 1e-9


@pytest.mark.parametrize("name", ["kuka-kr150-2", "universal-robots-ur5e"])
def test_singular_and_stretched_poses_lead_back(name: str) -> None:
    robot = load_robot(name)
    q = np.deg2rad([[0, -90, 90, 0, 0, 0], [10, -60, 40, 20, 1e-7, 30], [0, 0, 0, 10, 0, 10], [30, -70, 1e-6, 0, 0, 0]])
    poses = robot.forward(q)
    solutions = robot.inverse(poses)
    exists = ~np.isnan(solutions).any(axis=-1)
    assert exists.any(axis=1).all()
    np.testing.assert_allclose(
        robot.forward(solutions[exists]), np.repeat(poses, exists.sum(axis=1), axis=0), atol=1e-6
    )


def test_tool_single_pose_and_far_pose(rng: np.random.Generator) -> None:
    robot = load_robot("abb-irb120")
    q = np.deg2rad([10, 20, 30, 40, 50, 60])
    tool = make_transform(Rotation.random(rng=rng), [100, 20, 150])
    solutions = robot.inverse(robot.forward(q, tool=tool), tool=tool)
    assert solutions.shape == (8, 6)
    np.testing.assert_allclose(nearest_branch(solutions, q), q, atol=1e-10)
    assert np.isnan(robot.inverse(make_transform(translation=[5000.0, 0, 0]))).all()


def test_joints_are_turned_into_their_limits() -> None:
    robot = load_robot("abb-irb1600-10-145")  # joint 3 from -245 to 65 deg
    q = np.deg2rad([10, 80, -220, 40, 50, 60])
    solutions = robot.inverse(robot.forward(q))
    assert np.abs(solutions - q).max(axis=-1).min() < 1e-9


@pytest.mark.parametrize("name", ARMS)
def test_other_descriptions_of_the_same_arm(name: str, rng: np.random.Generator) -> None:
    robot = to_mdh(load_robot(name))
    turned = replace(
        robot,
        tf_base_first=make_transform(Rotation.random(rng=rng), [100, 200, 300]),
        tf_last_flange=make_transform(Rotation.random(rng=rng), [10, 20, 30]),
        offset=robot.offset + rng.uniform(-1, 1, 6),
        sign=rng.choice([-1.0, 1.0], 6),
    )
    q = rng.uniform(-3, 3, (200, 6))
    np.testing.assert_allclose(nearest_branch(turned.inverse(turned.forward(q)), q), q, atol=1e-6)


def test_invalid_poses_are_refused() -> None:
    robot = load_robot("kuka-kr150-2")
    with pytest.raises(DataError, match=r"poses has shape \(6,\)"):
        robot.inverse(np.zeros(6))
    with pytest.raises(DataError, match="poses has NaN or infinite numbers in row 1"):
        robot.inverse(np.stack([np.eye(4), np.full((4, 4), np.nan)]))


def test_nearest_branch_keeps_the_turn_of_the_reference() -> None:
    solutions = np.full((2, 8, 6), np.nan)
    solutions[0, 2] = np.deg2rad([0, 0, 0, 0, 0, -10])
    reference = np.deg2rad([0, 0, 0, 0, 0, 345])
    found = nearest_branch(solutions, reference)
    np.testing.assert_allclose(np.rad2deg(found[0]), [0, 0, 0, 0, 0, 350], atol=1e-9)
    assert np.isnan(found[1]).all()
    with pytest.raises(DataError, match="2 poses and 3 reference joints"):
        nearest_branch(solutions, np.zeros((3, 6)))
    with pytest.raises(DataError, match=r"expected solutions .* got \(2, 8, 6\) and \(5,\)"):
        nearest_branch(solutions, np.zeros(5))
