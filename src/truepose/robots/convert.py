"""Conversion of serial chains of revolute joints to modified D-H with Hayati's beta."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.geometry.transforms import invert_transform, make_transform
from truepose.robots.chain import ChainT

_NEARLY_PARALLEL = 0.05  # sine of the angle below which the common normal runs far away: Hayati and Mirmirani (1985)
_ON_AXIS = 1e-9  # mm
_SQUARE = 1e-9


def to_mdh(robot: ChainT) -> ChainT:
    """Return the same arm in the parameters of theory (1); its flange poses are equal to rounding.

    Examples
    --------
    >>> import numpy as np
    >>> from truepose.robots import load_robot
    >>> ur = load_robot("universal-robots-ur10")
    >>> np.rad2deg(to_mdh(ur).alpha).round(6) + 0.0
    array([  0.,  90.,   0.,   0.,  90., -90.])
    """
    return mdh_of_fixed(robot, robot.fixed)


def mdh_of_fixed(robot: ChainT, fixed: FloatArray) -> ChainT:
    """Return the arm fixed_0 Rz(s_1 q_1 + offset_1) fixed_1 … fixed_n in the parameters of theory (1).

    Parameters
    ----------
    robot : Robot
        The arm whose names, signs, offsets and limits are kept.
    fixed : (dof + 1, 4, 4) array [mm]
        The transforms between the rotations about z, as in `Robot.fixed`.

    Notes
    -----
    Neighbouring axes that are parallel, or nearly so, have d = 0 and a beta; all others beta = 0 and their common
    normal.
    """
    dof = robot.dof
    turn = np.tile(np.eye(4), (dof, 1, 1))
    turn[:, :3, :3] = Rotation.from_rotvec(np.outer(robot.offset, [0, 0, 1])).as_matrix()
    joints, tf = [], fixed[0]
    for i in range(dof):  # joint frames at q = 0
        joints.append(tf)
        tf = tf @ turn[i] @ fixed[i + 1]
    axis = np.array([joint[:3, 2] for joint in joints])
    point = np.array([joint[:3, 3] for joint in joints])

    alpha, a, d, offset, beta = np.zeros((5, dof))
    first = np.eye(4) if _same_line(np.eye(4), axis[0], point[0]) else joints[0]
    frame = first  # of joint i before it turns: z along its axis
    for i in range(dof - 1):
        here, z, z_next = frame[:3, 3], axis[i], axis[i + 1]
        normal = np.cross(z, z_next)
        to_next = point[i + 1] - here
        if np.linalg.norm(normal) < _NEARLY_PARALLEL:
            across = to_next - (to_next @ z_next) * z_next
            far = np.linalg.norm(across) > _ON_AXIS
            x = _square_to(z_next, across if far else frame[:3, 0])
            origin = point[i + 1] - (to_next @ z_next) * z_next
        else:
            x = normal / np.linalg.norm(normal)
            side = np.cross(z, x)  # the foot of the normal on the next axis has no component along it
            origin = point[i + 1] - (to_next @ side) / (z_next @ side) * z_next
            d[i] = (origin - here) @ z
        turned = x @ frame[:3, 0]
        if turned < -_SQUARE or (abs(turned) <= _SQUARE and x @ to_next < 0):
            x = -x  # the smaller offset, else the positive length
        a[i + 1] = (origin - here) @ x
        frame_next = make_transform(np.column_stack([x, np.cross(z_next, x), z_next]), origin)
        offset[i], beta[i], alpha[i + 1] = Rotation.from_matrix(frame[:3, :3].T @ frame_next[:3, :3]).as_euler("ZYX")
        frame = frame_next
    if _same_line(tf, axis[-1], point[-1]):
        inside = frame[:3, :3].T @ tf[:3, 0]
        offset[-1], d[-1] = np.arctan2(inside[1], inside[0]), (tf[:3, 3] - frame[:3, 3]) @ axis[-1]
        frame = frame @ make_transform(Rotation.from_rotvec([0, 0, offset[-1]]), [0, 0, d[-1]])
    return replace(
        robot,
        alpha=alpha,
        a=a,
        d=d,
        offset=offset,
        beta=beta,
        convention="mdh",
        tf_base_first=first,
        tf_last_flange=_cleaned(invert_transform(frame) @ tf),
    )


def _same_line(tf: FloatArray, axis: FloatArray, point: FloatArray) -> bool:
    """Whether an axis is the z axis of a frame, in the same direction."""
    off_line = np.linalg.norm(np.cross(axis, point - tf[:3, 3]))
    return bool(np.linalg.norm(tf[:3, 2] - axis) < 1e-12 and off_line < _ON_AXIS)


def _square_to(z: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return the unit vector square to z nearest to another; two passes remove the rounding of short vectors."""
    x = wanted / np.linalg.norm(wanted)
    for _ in range(2):
        x = x - (x @ z) * z
        x = x / np.linalg.norm(x)
    return np.asarray(x)


def _cleaned(tf: FloatArray) -> FloatArray:
    """Return exactly the identity for a transform that equals it up to rounding."""
    return np.eye(4) if np.abs(tf - np.eye(4)).max() < 1e-12 else tf
