"""The lost motion of joints that all samples reached from one side: its effect on poses that come from the other.

Such samples cannot separate the lost motion of a joint from its offset. A pose that its joints reach from the same side
has the same lost motion, which is a part of the map; from the other side it is off by all of it. How much that is, a
prior says: see `lost_motion_std`.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import RobotError
from truepose.predictors.orientation import at_offset
from truepose.robots import Robot, max_reach

REVERSALS: Final = 3
"""The fewest samples from each side that tell the lost motion of a joint."""
_LARGE_MM: Final = 1500.0  # of the wrist centre
_LOST: Final = {"large": (1e-4, 1e-3), "small": (0.0, 5e-4)}  # rad


def lost_motion_std(robot: Robot) -> float:
    """Return the root mean square of the lost motion of a joint that nobody measured, by the type of the arm [rad].

    Makers state a lost motion of up to 1 arcmin (0.3 mrad) for new cycloidal and planetary gears, which large arms
    have, and wear and the bevel gears of their wrists multiply it: 0.1 to 1 mrad, evenly, which is 0.61 mrad. Strain
    wave gears of small arms (reach below 1.5 m) have no backlash, but turn by up to 1 to 2 arcmin under friction: up
    to 0.5 mrad, which is 0.29 mrad.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> [round(1e3 * lost_motion_std(load_robot(name)), 2) for name in ("kuka-kr210-r2700-extra", "kuka-kr6-r900-sixx")]
    [0.61, 0.29]
    """
    low, high = _LOST["large" if _reach(robot) >= _LARGE_MM else "small"]
    return float(np.sqrt((low**2 + low * high + high**2) / 3.0))


def _reach(robot: Robot) -> float:
    """Return the reach of an arm by its dimensions [mm]; a stored map has no data sheet."""
    try:
        return max_reach(robot)
    except RobotError:  # not six joints
        return float(np.linalg.norm(robot.forward(np.clip(np.zeros(robot.dof), *robot.limits.T))[:3, 3]))


def sampled_sides(approach: FloatArray | None, dof: int) -> FloatArray:
    """Return the side from which samples reached each joint, (dof,) of -1, +1; 0 for both sides, or not known.

    Parameters
    ----------
    approach : (n, dof) array of -1, 0, +1, optional
        The sign of each joint's last motion at the samples; 0 where it is not known.
    """
    if approach is None:
        return np.zeros(dof)
    up, down = (approach > 0.0).sum(axis=0), (approach < 0.0).sum(axis=0)
    one = np.minimum(up, down) < REVERSALS
    return np.where(one, np.sign(up - down), 0.0).astype(np.float64)


def from_other_sides(
    robot: Robot, lost: FloatArray, q: FloatArray, approach: FloatArray, p_flange: FloatArray
) -> FloatArray:
    """Return the variance of poses whose joints come from sides that no sample had, (m, 6) [mm², rad²], base frame.

    A joint from the other side adds the square of its lost motion; one whose side is not known adds half of it, since
    it comes from either.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    lost : (dof,) array [rad]
        The lost motion of each joint, with the sign of the side from which samples reached it; 0 where it is measured.
    q : (m, dof) array [rad]
        The joints of the poses.
    approach : (m, dof) array of -1, 0, +1
        The sign of each joint's last motion; 0 or NaN where it is not known.
    p_flange : (3,) or (m, 3) array [mm], flange frame
        The points of the poses.
    """
    known = np.nan_to_num(approach)
    share = np.where(known == 0.0, 0.5, known == -np.sign(lost))
    offset = np.einsum("mij,mj->mi", robot.forward(q)[:, :3, :3], np.broadcast_to(p_flange, (len(q), 3)))
    lever = at_offset(robot.joint_jacobian(q, "pose"), offset)
    return np.asarray(np.einsum("mrj,mj->mr", lever**2, share * lost**2))
