"""The direction in which each joint reaches a target, for maps that know the backlash of joints, or miss it."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.robots import Robot
from truepose.robots.jacobian import columns, joint_twists

_LAST: Final = 20.0, 0.1  # mm and rad of the line: its last part, short enough to be linear in the joints
_LEAST: Final = 1e-3  # rad; a joint that turns less there may not have taken up its lost motion


def approach_on_lines(robot: Robot, q: FloatArray, poses: FloatArray, before: FloatArray) -> FloatArray:
    """Return the sign of each joint's motion over the last part of a straight line to each target, (n, dof).

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    q : (n, dof) array [rad]
        The joints of the targets.
    poses, before : (n, 4, 4) arrays [mm], base frame
        The poses of the tool at the targets, and from where the lines start; NaN where that is not known.

    Returns
    -------
    (n, dof) array of -1, 0, +1
        0 where the start is not known, or the joint turns by less than 1 mrad.
    """
    signs = np.zeros_like(q)
    known = np.flatnonzero(np.isfinite(before).all(axis=(1, 2)))
    if not len(known):
        return signs
    start, end = before[known], poses[known]
    shift = end[:, :3, 3] - start[:, :3, 3]
    turn = Rotation.from_matrix(end[:, :3, :3] @ np.swapaxes(start[:, :3, :3], 1, 2)).as_rotvec()
    size = np.stack([np.linalg.norm(shift, axis=1), np.linalg.norm(turn, axis=1)], axis=1)
    share = np.minimum(1.0, np.min(_LAST / np.maximum(size, 1e-9), axis=1))[:, None]
    flange = robot.forward(q[known])
    r = end[:, :3, 3] - flange[:, :3, 3]
    wanted = share * np.concatenate([shift - np.cross(turn, r), turn], axis=1)  # of the flange
    jacobian = columns(robot.sign * q[known], robot.links(np.eye(4)), joint_twists(robot.sign), "pose")
    scale = np.repeat([1e-3, 1.0], 3)  # metres and radians weigh alike
    moved = np.einsum("njr,nr->nj", np.linalg.pinv(jacobian * scale[:, None], rcond=1e-3), wanted * scale)
    signs[known] = _signs(moved)
    return signs


def approach_by_joints(q: FloatArray, before: FloatArray) -> FloatArray:
    """Return the sign of each joint's motion to joints q from joints before, of joint motions, (n, dof).

    Each joint of a joint motion turns one way from its start to its end.

    Parameters
    ----------
    q, before : (n, dof) arrays [rad]
        The joints of the targets, and from where the motions start; NaN where that is not known.

    Returns
    -------
    (n, dof) array of -1, 0, +1
        0 where the start is not known, or the joint turns by less than 1 mrad.

    Examples
    --------
    >>> approach_by_joints(np.array([[0.2, 0.1, 0.3]]), np.array([[0.1, 0.1, 0.9]]))
    array([[ 1.,  0., -1.]])
    """
    return _signs(np.nan_to_num(q - before))


def _signs(moved: FloatArray) -> FloatArray:
    return np.where(np.abs(moved) > _LEAST, np.sign(moved), 0.0)
