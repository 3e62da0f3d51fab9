"""KUKA's Status and Turn, ABB's confdata, FANUC's CONFIG: with them a pose gives its joints back; bits by hand."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.errors import DataError, RobotError
from truepose.robots import (
    abb_configuration,
    fanuc_configuration,
    joints_of_abb,
    joints_of_fanuc,
    joints_of_pose,
    list_robots,
    load_robot,
    select,
    status_turn,
)

KUKAS = ["kuka-kr150-2", "kuka-kr210-r2700-extra", "kuka-kr10-r1100-sixx"]
ABBS = [name for name in list_robots() if name.startswith("abb")]
FANUCS = [name for name in list_robots() if name.startswith("fanuc")]
TOOL = [0.0, 50.0, 300.0]


@pytest.mark.parametrize("name", ABBS)
@pytest.mark.sampled(2)
def test_pose_with_confdata_gives_the_joints(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    q = rng.uniform(*robot.limits.T, size=(5000, 6))
    word = abb_configuration(robot, q)
    assert set(word[:, 3]) == set(range(8))
    np.testing.assert_allclose(joints_of_abb(robot, robot.forward(q, TOOL), word, TOOL), q, atol=1e-6)


@pytest.mark.parametrize("name", FANUCS)
@pytest.mark.sampled(2)
def test_pose_with_config_gives_the_joints(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    lower, upper = robot.limits.T
    once = [0, 2]  # no number tells the turns of joints 1 and 3
    lower, upper = lower.copy(), upper.copy()
    lower[once], upper[once] = np.maximum(lower[once], -np.pi), np.minimum(upper[once], np.pi)
    q = rng.uniform(lower, upper, size=(5000, 6))
    word = fanuc_configuration(robot, q)
    assert {w[:5] for w in word} == {f"{n} {u} {t}" for n in "NF" for u in "UD" for t in "TB"}
    np.testing.assert_allclose(joints_of_fanuc(robot, robot.forward(q, TOOL), word, TOOL), q, atol=1e-6)


@pytest.mark.parametrize(
    ("q_deg", "word"),
    [  # by hand on the IRB 120: all joints at zero is the upper arm upright, the forearm level
        ([10, 0, 0, 20, 30, 40], [0, 0, 0, 0]),
        ([-10, 0, 0, -20, -30, -40], [-1, -1, -1, 1]),
        ([100, 0, 0, -100, 30, 290], [1, -2, 3, 0]),
        ([10, 60, -80, 20, 30, 40], [0, 0, 0, 2]),  # behind the lower arm from -atan2(302, 70) = -77 deg down
        ([10, 60, -74, 20, 30, 40], [0, 0, 0, 0]),
        ([10, 0, -105, 20, 30, 40], [0, 0, 0, 6]),
        ([10, -100, 0, 20, 30, 40], [0, 0, 0, 4]),
        ([10, 60, -108, 20, -30, 40], [0, 0, 0, 3]),
    ],
)
def test_confdata_by_hand(q_deg: list[float], word: list[int]) -> None:
    robot = load_robot("abb-irb120")
    np.testing.assert_array_equal(abb_configuration(robot, np.deg2rad(q_deg)), word)
    found = joints_of_abb(robot, robot.forward(np.deg2rad(q_deg)), word)
    np.testing.assert_allclose(np.rad2deg(found), q_deg, atol=1e-6)


@pytest.mark.parametrize(
    ("q_deg", "word"),
    [
        ([0, 0, 0, 0, -90, 0], "N U T, 0, 0, 0"),
        ([0, 0, 0, 0, 90, 0], "F U T, 0, 0, 0"),
        ([0, 0, 0, 190, -90, -185], "N U T, 1, 0, -1"),
        ([0, 0, 0, -179, 30, 179], "F U T, 0, 0, 0"),
        ([0, -90, 0, 0, -90, 0], "N U B, 0, 0, 0"),
    ],
)
def test_config_by_hand(q_deg: list[float], word: str) -> None:
    robot = load_robot("fanuc-m20ia")
    assert str(fanuc_configuration(robot, np.deg2rad(q_deg))) == word
    found = joints_of_fanuc(robot, robot.forward(np.deg2rad(q_deg)), word)
    np.testing.assert_allclose(np.rad2deg(found), q_deg, atol=1e-6)


def test_config_as_controllers_write_it() -> None:
    robot = load_robot("fanuc-m20ia")
    q = np.deg2rad([[10, 20, 30, 40, -50, 60], [10, 20, 30, 40, 50, 60]])
    words = ["'N U T, 0, 0, 0'", "F R U T,0,0,0"]
    np.testing.assert_allclose(joints_of_fanuc(robot, robot.forward(q), words), q, atol=1e-9)
    np.testing.assert_allclose(joints_of_fanuc(robot, robot.forward(q[0]), words[0]), q[0], atol=1e-9)


def test_a_calibrated_arm_reads_the_words_of_its_nominal_one(rng: np.random.Generator) -> None:
    from dataclasses import replace

    robot = load_robot("abb-irb6640-185-280")
    arm = replace(robot, a=robot.a + rng.normal(scale=0.3, size=6), alpha=robot.alpha + rng.normal(scale=3e-4, size=6))
    q = np.deg2rad([[10, 20, 30, 40, 50, 60], [-10, 20, -30, 140, -50, -260]])
    word = abb_configuration(arm, q)
    np.testing.assert_array_equal(word, abb_configuration(robot, q))
    np.testing.assert_allclose(joints_of_abb(arm, arm.forward(q), word), q, atol=1e-6)


def test_invalid_configurations_are_refused() -> None:
    robot, fanuc = load_robot("abb-irb120"), load_robot("fanuc-m20ia")
    q = np.deg2rad([10, 20, 30, 40, 50, 60])
    poses = np.stack([robot.forward(q)] * 2)
    with pytest.raises(DataError, match="configuration must be whole numbers cf1, cf4, cf6, cfx of each pose; got"):
        joints_of_abb(robot, poses, [0.5, 0, 0, 0])
    with pytest.raises(DataError, match="cfx is 8 in row 1; expected 0 to 7"):
        joints_of_abb(robot, poses, [[0, 0, 0, 0], [0, 0, 0, 8]])
    with pytest.raises(DataError, match="2 poses and 3 configurations"):
        joints_of_abb(robot, poses, [[0, 0, 0, 0]] * 3)
    with pytest.raises(RobotError, match=r"cf6 do not match the joints in row 1: joint 4 is at 400\.000 deg in row 1"):
        joints_of_abb(robot, poses, [[0, 0, 0, 0], [0, 2, 0, 0]])
    with pytest.raises(DataError, match=r'CONFIG in row 1 is .*X U T.*; expected, for example, "N U T, 0, 0, 0"'):
        joints_of_fanuc(fanuc, np.stack([fanuc.forward(q)] * 2), ["F U T, 0, 0, 0", "X U T, 0, 0, 0"])
    far = poses.copy()
    far[1, 0, 3] += 3000
    with pytest.raises(RobotError, match=r"abb-irb120: out of reach: row 1 by 2\d\d\d mm"):
        joints_of_abb(robot, far, [0, 0, 0, 0])
    robot = load_robot("abb-irb6640-185-280")
    stretched = robot.forward(np.deg2rad([0, 70, -70, 0, 30, 0]))
    with pytest.raises(RobotError, match="out of reach on the branch of the given cfx in row 0, but not on others"):
        joints_of_abb(robot, stretched, [0, 0, 0, 4])
    with pytest.raises(RobotError, match="universal-robots-ur5: arm configurations need a parallel base pair"):
        abb_configuration(load_robot("universal-robots-ur5"), q)


@pytest.mark.parametrize("name", KUKAS)
def test_status_counts_the_branches_one_to_one(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    q = rng.uniform(*robot.limits.T, size=(5000, 6))
    solutions = robot.inverse(robot.forward(q))
    exists = ~np.isnan(solutions).any(axis=-1)
    status = np.full(exists.shape, -1)
    status[exists] = status_turn(robot, solutions[exists])[0]
    slots = [set(status[exists[:, slot], slot]) for slot in range(8)]
    assert all(len(values) == 1 for values in slots)  # a slot is always the same status
    assert set.union(*slots) == set(range(8))  # and all eight occur


@pytest.mark.parametrize("name", KUKAS)
def test_pose_with_status_and_turn_gives_the_joints(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    q = rng.uniform(*robot.limits.T, size=(5000, 6))
    status, turn = status_turn(robot, q)
    found = joints_of_pose(robot, robot.forward(q, tool=[0, 50, 300]), status, turn, tool=[0, 50, 300])
    np.testing.assert_allclose(found, q, atol=1e-6)


@pytest.mark.parametrize(
    ("q_deg", "status", "turn"),
    [  # by hand: axis 5 down is A5 > 0; KR 150-2: phi = atan2(-55, 1100) = -2.86 deg
        ([0, -90, 90, 0, 30, 0], 2, 0b000010),
        ([0, -90, 90, 0, -30, 0], 6, 0b010010),
        ([-10, -90, 90, -20, -30, -40], 6, 0b111011),
        ([0, -90, -2.8, 0, 30, 0], 2, 0b000110),
        ([0, -90, -2.9, 0, 30, 0], 0, 0b000110),
        ([0, -140, -100, 0, 30, 0], 1, 0b000110),
        ([0, -90, 90, 0, 30, 350], 2, 0b000010),
        ([0, -90, 90, 0, 30, -350], 2, 0b100010),
    ],
)
def test_bits_by_hand(q_deg: list[float], status: int, turn: int) -> None:
    found = status_turn(load_robot("kuka-kr150-2"), np.deg2rad(q_deg))
    assert tuple(int(value) for value in found) == (status, turn)


def test_overhead_is_where_the_wrist_centre_lies(rng: np.random.Generator) -> None:
    robot = load_robot("kuka-kr210-r2700-extra")
    q = rng.uniform(*robot.limits.T, size=(2000, 6))
    flange = robot.forward(q)
    wrist = flange[:, :3, 3] - 215.0 * flange[:, :3, 2]
    x = np.cos(-q[:, 0]) * wrist[:, 0] + np.sin(-q[:, 0]) * wrist[:, 1]  # A1 turns about -z
    np.testing.assert_array_equal(status_turn(robot, q)[0] & 1, x < 0)


def test_turn_is_ignored_near_zero() -> None:
    robot = load_robot("kuka-kr150-2")
    q = np.deg2rad([0.5, -90, 90, -1.0, 30, 0])
    solutions = robot.inverse(robot.forward(q))
    np.testing.assert_allclose(select(robot, solutions, 2, 0b000011), q, atol=1e-9)
    np.testing.assert_allclose(select(robot, solutions, 18, 0b001010), q, atol=1e-9)  # S bit 4 means nothing here


def test_turn_chooses_the_turn() -> None:
    robot = load_robot("kuka-kr150-2")
    q = np.deg2rad([10, -90, 90, 300, 30, -200])
    found = joints_of_pose(robot, robot.forward(q), *status_turn(robot, q))
    np.testing.assert_allclose(found, q, atol=1e-9)


def test_invalid_status_and_turn_are_refused() -> None:
    robot = load_robot("kuka-kr150-2")
    pose = robot.forward(np.deg2rad([0, -90, 90, 0, 30, 0]))
    with pytest.raises(RobotError, match=r"out of reach: row 1 by 7\d\d\d mm; check base, tool"):
        joints_of_pose(robot, np.stack([pose, pose + far()]), 2, 2)
    stretched = robot.forward(np.deg2rad([0, -40, 0, 0, 30, 0]))  # reached by two branches, not over the back
    with pytest.raises(RobotError, match="out of reach with the given Status in row 0; check base, tool and Status"):
        joints_of_pose(robot, stretched, 1, 2)
    with pytest.raises(DataError, match="expected Status as whole numbers from 0 up, one or 2 of them"):
        joints_of_pose(robot, np.stack([pose, pose]), [2, 2, 2], 2)
    with pytest.raises(DataError, match="expected Turn as whole numbers from 0 up"):
        joints_of_pose(robot, pose, 2, 2.5)
    with pytest.raises(DataError, match=r"solutions have shape \(6,\)"):
        select(robot, np.zeros(6), 2, 2)
    with pytest.raises(RobotError, match="universal-robots-ur5: arm configurations need a parallel base pair"):
        status_turn(load_robot("universal-robots-ur5"), np.zeros(6))


def far() -> np.ndarray:
    """A step of 9 m along x, added to a pose."""
    step = np.zeros((4, 4))
    step[0, 3] = 9000.0
    return step
