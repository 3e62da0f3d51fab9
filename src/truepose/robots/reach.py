"""The reach of an arm from its dimensions and joint limits, to compare with the data sheet."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import RobotError
from truepose.robots.chain import Chain

_GRID: Final = 121
_ROUNDS: Final = 4  # each searches the neighbourhood of the last optimum, 30 times as fine


def max_reach(robot: Chain, at: str = "wrist") -> float:
    """Return the largest horizontal distance of a point of the arm from axis 1 within the joint limits [mm].

    Joints 2 and 3 move; the others are at zero, or at the limit nearest to it. The flange is taken straight ahead of
    the wrist centre: its distance from the wrist centre is added.

    Parameters
    ----------
    robot : Robot
        A six-axis arm whose first axis is vertical.
    at : {"wrist", "flange"}
        The point: the wrist centre, which is the point of axis 5 nearest to axis 4, or the flange.

    Raises
    ------
    RobotError
        If the arm does not have six joints, or `at` is unknown.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> round(max_reach(load_robot("kuka-kr210-r2700-extra")))  # stated: 2696 mm
    2696
    """
    if robot.dof != 6:
        raise RobotError(f"{robot.name}: the reach is defined for six joints, the arm has {robot.dof}")
    if at not in ("wrist", "flange"):
        raise RobotError(f'at must be "wrist" or "flange", got "{at}"')
    lower, upper = np.clip(robot.limits, -np.pi, np.pi).T
    rest = np.clip(np.zeros(6), lower, upper)
    low, high = lower[1:3], upper[1:3]
    best = 0.0
    for _ in range(_ROUNDS):
        q2, q3 = np.meshgrid(*np.linspace(low, high, _GRID).T, indexing="ij")
        q = np.tile(rest, (q2.size, 1))
        q[:, 1], q[:, 2] = q2.ravel(), q3.ravel()
        distance = _from_first_axis(robot, q)
        k = int(np.argmax(distance))
        best = float(distance[k])
        step = 2 * (high - low) / (_GRID - 1)
        low, high = np.maximum(lower[1:3], q[k, 1:3] - step), np.minimum(upper[1:3], q[k, 1:3] + step)
    return best + (_wrist_to_flange(robot) if at == "flange" else 0.0)


def _from_first_axis(robot: Chain, q: FloatArray) -> FloatArray:
    """Return the distances (n,) [mm] of the wrist centre from axis 1."""
    joints = robot.frames(q)[..., :-1, :, :] @ robot.link_before
    first, centre = joints[..., 0, :, :], _wrist_centre(joints)
    away = centre - first[..., :3, 3]
    across = away - (away * first[..., :3, 2]).sum(-1, keepdims=True) * first[..., :3, 2]
    return np.asarray(np.linalg.norm(across, axis=-1))


def _wrist_centre(joints: FloatArray) -> FloatArray:
    """Return the points (…, 3) [mm] of axes 5 nearest to axes 4."""
    z4, z5 = joints[..., 3, :3, 2], joints[..., 4, :3, 2]
    between = joints[..., 4, :3, 3] - joints[..., 3, :3, 3]
    cosine = (z4 * z5).sum(-1)
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    along = (cosine * (between * z4).sum(-1) - (between * z5).sum(-1)) / sine2
    return np.asarray(joints[..., 4, :3, 3] + along[..., None] * z5)


def _wrist_to_flange(robot: Chain) -> float:
    zero = np.zeros(6)
    joints = robot.frames(zero)[:-1] @ robot.link_before
    return float(np.linalg.norm(robot.forward(zero)[:3, 3] - _wrist_centre(joints)))
