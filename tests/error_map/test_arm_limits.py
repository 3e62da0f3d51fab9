"""The check of arm and tool at each of its limits and 1 % to both sides of it."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.error_map.arm_check import _Implied, check_arm, check_point
from truepose.errors import DataError
from truepose.geometry import apply_transform, make_transform
from truepose.robots import load_robot
from truepose.samples import Poses

ROBOT = load_robot("kuka-kr150-2")
TOOL = make_transform(Rotation.identity(), [110.0, 0.0, 360.0])
ASIDE = np.array([0.6, 0.0, 0.8])


def shown(n: int = 12, off: float = 0.2, **more: Any) -> Poses:
    """Positions of the tool, half of them `off` to one side along an axis of the tool, half to the other [mm]."""
    q = np.deg2rad([0.0, -70.0, 90.0, 0.0, 40.0, 0.0]) + np.random.default_rng(1).uniform(-0.7, 0.7, (n, 6))
    sides = off * np.where(np.arange(n) % 2, 1.0, -1.0)[:, None] * [0.0, 1.0, 0.0]
    tf = ROBOT.forward(q, tool=TOOL)
    return Poses(q=q, p_cmd=tf[:, :3, 3] + np.einsum("nij,nj->ni", tf[:, :3, :3], sides), **more)


def turned(poses: Poses, degrees: Any) -> Poses:
    """The poses with commanded orientations that are turned about an axis of the tool."""
    rotation = Rotation.from_matrix(ROBOT.forward(poses.q, tool=TOOL)[:, :3, :3])
    turn = Rotation.from_rotvec(np.deg2rad(np.broadcast_to(np.reshape(degrees, (-1, 1)), (len(poses), 1))) * ASIDE)
    return Poses(q=poses.q, p_cmd=poses.p_cmd, rotation_cmd=rotation * turn)


def stated(away: float) -> np.ndarray:
    return make_transform(Rotation.identity(), TOOL[:3, 3] + away * ASIDE)


LIMIT = 0.1 + 4.0 * 0.2 * np.sqrt(3.0 / 12.0)
"""0.1 mm and four standard deviations of the tool that 12 positions with residuals of 0.2 mm imply: 0.5 mm."""


def test_a_stated_tool_may_be_off_by_a_tenth_and_four_standard_deviations() -> None:
    assert check_arm(ROBOT, shown(), stated(0.99 * LIMIT)).words.endswith(
        " The controller's tool agrees with [tool] within 0.495 mm."
    )
    with pytest.raises(DataError, match=r"states \(110\.30, 0\.00, 360\.40\) mm, 0\.50 mm apart"):
        check_arm(ROBOT, shown(), stated(1.01 * LIMIT))
    check_arm(ROBOT, shown(off=0.0), stated(0.099))
    with pytest.raises(DataError, match="mm apart"):
        check_arm(ROBOT, shown(off=0.0), stated(0.101))


def test_a_fitted_point_may_be_a_millimetre_farther_away_without_a_note() -> None:
    near, far = (check_arm(ROBOT, shown(), stated(share * (LIMIT + 1.0)), fit="position") for share in (0.99, 1.01))
    assert near.checked
    assert near.words == "The arm's model agrees with the commanded positions of 12 poses within 0.200 mm (median)."
    assert "They are of another point than the measured one, 1.51 mm from it" in far.words
    assert far.p_flange_tool_mm == pytest.approx((110.0, 0.0, 360.0), abs=1e-4)


@pytest.mark.parametrize(("off", "checked"), [(0.297, True), (0.303, False)])
def test_positions_within_the_rounding_imply_a_tool_alone(off: float, checked: bool) -> None:
    """Others imply a tool and a frame, for which six poses are too few."""
    found = check_arm(ROBOT, shown(6, off), TOOL)
    assert (found.checked, "too few poses" in found.words) == (checked, not checked)
    assert found.residual_mm == (pytest.approx(off) if checked else None)


@pytest.mark.parametrize(("n", "checked"), [(7, False), (8, True)])
def test_a_frame_takes_eight_poses(n: int, checked: bool) -> None:
    poses = shown(n, 0.01)
    lifted = Poses(
        q=poses.q, p_cmd=apply_transform(make_transform(Rotation.identity(), [0.0, 0.0, 500.0]), poses.p_cmd)
    )
    found = check_arm(ROBOT, lifted, TOOL)
    assert found.checked == checked
    assert (
        bool(re.search(r"the model's base lies at \(-?0\.\d\d, -?0\.\d\d, (500\.0|499\.9)\d\) mm", found.words))
        == checked
    )


@pytest.mark.parametrize(("off", "checked"), [(0.99e-5, False), (1.01e-5, True)])
def test_positions_of_the_model_to_the_last_digit_prove_nothing(off: float, checked: bool) -> None:
    found = check_arm(ROBOT, shown(off=off), TOOL)
    assert (found.checked, "the model's own to the last digit" in found.words) == (checked, not checked)


@pytest.mark.parametrize("fit", ["none", "position"])
def test_an_orientation_may_be_off_by_a_fifth_of_a_degree(fit: Any) -> None:
    assert "Its orientation agrees as well." in check_arm(ROBOT, turned(shown(), 0.198), TOOL, fit=fit).words
    if fit == "none":
        with pytest.raises(DataError, match=r"0\.20° apart; state the controller's tool"):
            check_arm(ROBOT, turned(shown(), 0.202), TOOL)
    else:
        words = check_arm(ROBOT, turned(shown(), 0.202), TOOL, fit=fit).words
        assert "0.20° apart: state the angles in [tool]." in words
        tilted = make_transform(Rotation.from_euler("z", 1.0, degrees=True), TOOL[:3, 3])
        with pytest.raises(DataError, match=r"1\.00° apart; state the controller's tool"):
            check_arm(ROBOT, turned(shown(), 0.0), tilted, fit=fit)


@pytest.mark.parametrize(("degrees", "follow"), [(0.198, True), (0.202, False)])
def test_orientations_that_do_not_follow_the_joints_are_not_used(degrees: float, follow: bool) -> None:
    """Half of them turned to one side, half to the other."""
    found = check_arm(ROBOT, turned(shown(), degrees * np.where(np.arange(12) % 2, 1.0, -1.0)), TOOL)
    assert ("Its orientation agrees" in found.words, "do not follow the joints" in found.words) == (follow, not follow)


def test_a_fitted_orientation_is_not_compared() -> None:
    assert "rientation" not in check_arm(ROBOT, turned(shown(), 30.0), TOOL, fit="pose").words


def test_directions_of_the_tool_that_poses_leave_open_are_not_compared() -> None:
    """Those with a standard deviation of a millimetre and more."""
    variance = np.diag([0.99**2, 1.01**2, 0.25])
    implied = _Implied(np.zeros(3), variance, np.eye(4), 0.1)
    away, limit = implied.from_tool(np.array([3.0, 50.0, 4.0]))
    assert (away, limit) == pytest.approx((5.0, 0.1 + 4.0 * np.sqrt(0.99**2 + 0.25)))


def test_a_table_without_joints_or_positions_is_not_checked() -> None:
    poses = shown()
    assert "the samples have no joints" in check_arm(ROBOT, Poses(p_cmd=poses.p_cmd), TOOL).words
    assert "the joints have no commanded positions" in check_arm(ROBOT, Poses(q=poses.q), TOOL).words


@pytest.fixture(scope="module")
def cell() -> tp.Cell:
    return tp.VirtualCell("paper").cell


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_taught_point_may_be_off_by_the_rounding(cell: tp.Cell, share: float) -> None:
    q = np.deg2rad([10.0, -60.0, 80.0, 5.0, 40.0, 0.0])
    tf = cell.load_robot().forward(q[None], tool=cell.tf_flange_tool)[0]
    rotation = Rotation.from_matrix(tf[:3, :3])
    near, turn = tf[:3, 3] + 0.3 * share * ASIDE, rotation * Rotation.from_rotvec(np.deg2rad(0.2) * share * ASIDE)
    if share < 1.0:
        found = check_point(cell, q, near, turn)
        assert (found.checked, found.n, found.residual_mm) == (True, 1, pytest.approx(0.297))
    else:
        with pytest.raises(DataError, match=r"0\.30 mm apart; if the arm is right, the controller's tool is"):
            check_point(cell, q, near, rotation)
        with pytest.raises(DataError, match=r"an orientation 0\.20° from that of"):
            check_point(cell, q, tf[:3, 3], turn)


@pytest.mark.parametrize("position", [[0.0, 0.0], [0.0, np.nan, 0.0]])
def test_a_taught_point_has_three_finite_numbers(cell: tp.Cell, position: list[float]) -> None:
    with pytest.raises(DataError, match=r"expected a position of shape \(3,\) and finite"):
        check_point(cell, np.zeros(6), position)
