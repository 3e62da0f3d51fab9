"""Joints as FANUC's controllers count them: J3 from the ground.

FANUC's pendant and programs show J3 relative to the plane at right angles to axis 1: J3 stays as it is where J2 alone
moves. Joint 3 of a chain is the angle between the links, which is J3 + J2 where all joints are zero with the upper arm
upright and the forearm level, J2 leans the arm forward and J3 lifts the forearm. `test_world_frame` compares a pose of
a controller; the sum itself was not confirmed on one.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.robots.chain import Chain
from truepose.robots.inverse.axes import Axes

_SQUARE: Final = 1e-6  # rad; of zero positions with as many digits as files have


def from_ground(shown: FloatArray) -> FloatArray:
    """Return the joints of an arm from those that FANUC shows, (…, dof); also of changes, in any unit.

    Examples
    --------
    >>> from_ground(np.array([0.0, 20.0, 5.0, 0.0, 0.0, 0.0]))[2]
    np.float64(25.0)
    """
    joints = shown.copy()
    joints[..., 2] += shown[..., 1]
    return joints


def to_ground(joints: FloatArray) -> FloatArray:
    """Return the joints that FANUC shows from those of an arm, (…, dof); also of changes, in any unit."""
    shown = joints.copy()
    shown[..., 2] -= joints[..., 1]
    return shown


def ground_objection(robot: Chain) -> str:
    """Return why FANUC's J3 + J2 is not joint 3 of an arm; empty where it is.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> ground_objection(load_robot("fanuc-m20ia"))
    ''
    """
    if robot.dof != 6:
        return f"{robot.name} has {robot.dof} joints"
    axes = Axes.of(robot)
    up = axes.direction[0] if axes.direction[0] @ (axes.point[2] - axes.point[1]) >= 0.0 else -axes.direction[0]
    leans, lifts, forearm = axes.direction[1], axes.direction[2], axes.direction[3]
    if np.linalg.norm(leans + lifts) > _SQUARE or abs(leans @ up) > _SQUARE:
        return f"joints 2 and 3 of {robot.name} do not turn against each other about level axes"
    ahead = np.cross(leans, up)
    upper = axes.point[2] - axes.point[1]
    if abs(upper @ ahead) > _SQUARE * np.linalg.norm(upper):
        return f"the upper arm of {robot.name} is not upright where joint 2 is zero"
    if abs(forearm @ up) > _SQUARE or (axes.point[4] - axes.point[2]) @ ahead <= 0.0:
        return f"the forearm of {robot.name} is not level and ahead where joint 3 is zero"
    return ""
