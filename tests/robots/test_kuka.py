"""Status and Turn: S 0-2 counts the branches one to one, and pose with S and T gives the joints back."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.errors import DataError, RobotError
from truepose.robots import joints_of_pose, load_robot, select, status_turn

KUKAS = ["kuka-kr150-2", "kuka-kr210-r2700-extra", "kuka-kr10-r1100-sixx"]


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


def test_bad_input_is_told() -> None:
    robot = load_robot("kuka-kr150-2")
    pose = robot.forward(np.deg2rad([0, -90, 90, 0, 30, 0]))
    with pytest.raises(RobotError, match=r"out of reach: row 1 by 7\d\d\d mm; check base, tool"):
        joints_of_pose(robot, np.stack([pose, pose + far()]), 2, 2)
    stretched = robot.forward(np.deg2rad([0, -40, 0, 0, 30, 0]))  # reached by two branches, not over the back
    with pytest.raises(RobotError, match="out of reach with its Status in row 0; check base, tool and Status"):
        joints_of_pose(robot, stretched, 1, 2)
    with pytest.raises(DataError, match="Status must be whole numbers of bits, one or 2 of them"):
        joints_of_pose(robot, np.stack([pose, pose]), [2, 2, 2], 2)
    with pytest.raises(DataError, match="Turn must be whole numbers of bits"):
        joints_of_pose(robot, pose, 2, 2.5)
    with pytest.raises(DataError, match=r"solutions have shape \(6,\)"):
        select(robot, np.zeros(6), 2, 2)
    with pytest.raises(RobotError, match="universal-robots-ur5: words of configuration need a parallel base pair"):
        status_turn(load_robot("universal-robots-ur5"), np.zeros(6))


def far() -> np.ndarray:
    """A step of 9 m along x, added to a pose."""
    step = np.zeros((4, 4))
    step[0, 3] = 9000.0
    return step
