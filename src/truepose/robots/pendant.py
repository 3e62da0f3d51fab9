"""Joints as a controller shows them, and those of the model.

Both have the controller's order, signs and zero. They differ where a controller counts a joint from elsewhere than the
link before it, or where one motor moves two joints: then the robot file states a ``coupling``. FANUC's pendant and
programs show J3 relative to the plane at right angles to axis 1: J3 stays as it is where J2 alone moves. Joint 3 of a
chain is the angle between the links, which is J3 + J2 where all joints are zero with the upper arm upright and the
forearm level, J2 leans the arm forward and J3 lifts the forearm. This is the coupling of FANUC arms whose file states
none. `test_world_frame` compares a pose of a controller; the sum itself was not confirmed on one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import RobotError
from truepose.robots.chain import Chain
from truepose.robots.coupling import Coupling, coupling_matrix
from truepose.robots.inverse.axes import Axes

GROUND: Final[Coupling] = ((3, 2, 1.0),)
"""The coupling of a controller that counts J3 from the ground, as FANUC's do."""
_SQUARE: Final = 1e-6  # rad; of zero positions with as many digits as files have


@dataclass(frozen=True)
class ShownJoints:
    """The conversion between the joints that a controller shows and those of the model, q = C s.

    Parameters
    ----------
    coupling : tuple of (int, int, float)
        The rows of the coupling; see `truepose.robots.coupling`.
    dof : int
        The number of joints.

    Examples
    --------
    >>> shown = ShownJoints(((3, 2, 1.0),), 6)
    >>> shown.to_model(np.array([0.0, 20.0, 5.0, 0.0, 0.0, 0.0]))[2]
    np.float64(25.0)
    >>> shown.from_model(np.array([0.0, 20.0, 25.0, 0.0, 0.0, 0.0]))[2]
    np.float64(5.0)
    """

    coupling: Coupling
    dof: int

    def to_model(self, shown: FloatArray) -> FloatArray:
        """Return the joints of the model from those shown, (…, dof); also of changes, in any unit."""
        return _combined(shown, self._parts[0])

    def from_model(self, q: FloatArray) -> FloatArray:
        """Return the joints as shown from those of the model, (…, dof); also of changes, in any unit."""
        return _combined(q, self._parts[1])

    @cached_property
    def _parts(self) -> tuple[FloatArray, FloatArray]:
        """C and its inverse, without the diagonals: (1 + F)⁻¹ = 1 − F + F² …, which ends where no joint comes again."""
        part = coupling_matrix(self.coupling, self.dof) - np.eye(self.dof)
        inverse, power = -part, -part
        for _ in range(self.dof - 2):
            power = -part @ power
            inverse = inverse + power
        return part, inverse


def _combined(joints: FloatArray, part: FloatArray) -> FloatArray:
    """Return (1 + part) applied to joints (…, dof); joints without a coupling stay as they are to the last digit."""
    found = joints.copy()
    for i, k in np.argwhere(part).tolist():
        found[..., i] += part[i, k] * joints[..., k]
    return found


def shown_joints(robot: Chain, *, ground: bool | None = None) -> ShownJoints:
    """Return the conversion between the joints that the controller of an arm shows and those of the model.

    Parameters
    ----------
    robot : Chain
        The arm. A coupling that its file states holds; `ground` matters only where it states none.
    ground : bool, optional
        Whether the controller counts J3 from the ground; by default whether its maker is FANUC.

    Raises
    ------
    RobotError
        If J3 counts from the ground, the file states no coupling, and joint 3 of the arm is not J3 + J2.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> shown_joints(load_robot("fanuc-m20ia")).coupling, shown_joints(load_robot("kuka-kr16-2")).coupling
    (((3, 2, 1.0),), ())
    """
    if robot.coupling is not None:
        return ShownJoints(robot.coupling, robot.dof)
    if not (robot.maker.strip().lower() == "fanuc" if ground is None else ground):
        return ShownJoints((), robot.dof)
    if reason := ground_objection(robot):
        raise RobotError(
            f"{robot.name}: FANUC counts J3 from the ground, and {reason}; state coupling in [kinematics] of the robot "
            "file ([] where the joints shown are those of the model)"
        )
    return ShownJoints(GROUND, robot.dof)


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
