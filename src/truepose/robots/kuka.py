"""KUKA's Status and Turn: the bits that make the joints of a pose unique.

| bit | is 1 when | evidence |
|---|---|---|
| S bit 0 | the wrist centre, in the frame turned with A1, has x < 0 (overhead) | two makers' documents |
| S bit 1 | A3 >= phi, the angle at which upper arm and wrist centre are in line | the same; phi tested |
| S bit 2 | A5 < 0 | 432 of 432 points of four public code bases |
| S bit 4 | taught on an absolutely accurate robot | one source; kept, means nothing here |
| T bit i | A(i+1) < 0 | one source; reported to be ignored within ±2 deg of zero, so we do |
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError, RobotError
from truepose.geometry.arrays import name_rows
from truepose.robots.axes import half_turn
from truepose.robots.chain import Robot
from truepose.robots.inverse.branches import find_branches
from truepose.robots.inverse.solve import inverse
from truepose.robots.nominal import ortho_parallel

OVERHEAD: Final = 1
ELBOW: Final = 2
WRIST: Final = 4
BRANCH: Final = OVERHEAD | ELBOW | WRIST
"""The bits of Status that choose among the eight branches."""

_TURN_IGNORED: Final = np.deg2rad(2.0)
# slot 4 · (reaching back) + 2 · (t3 + psi < 0) + (t5 < 0) of OrthoParallel.branches, by the branch bits of Status
_SLOT: Final = np.array([4 * bool(s & OVERHEAD) + 2 * (not s & ELBOW) + bool(s & WRIST) for s in range(8)])
_STATUS: Final = np.argsort(_SLOT)


def status_turn(robot: Robot, q: ArrayLike) -> tuple[IntArray, IntArray]:
    """Return Status (bits 0 to 2) and Turn (bits 0 to 5) of joint vectors.

    Parameters
    ----------
    robot : Robot
        A six-axis arm with parallel base pair and spherical wrist.
    q : (6,) or (n, 6) array [rad]

    Returns
    -------
    status, turn : int arrays of shape () or (n,)

    Raises
    ------
    RobotError
        If the arm is of another kind.
    DataError
        As `Robot.forward`.

    Examples
    --------
    >>> import numpy as np
    >>> from truepose.robots import load_robot
    >>> s, t = status_turn(load_robot("kuka-kr150-2"), np.deg2rad([0, -90, 90, 0, -30, 0]))
    >>> int(s), int(t)
    (6, 18)
    """
    arm = ortho_parallel(robot)
    joints = robot.check_joints(q)
    status = _STATUS[arm.slot(joints)]
    turn = ((joints < 0) << np.arange(6)).sum(axis=-1)
    return status.astype(np.int64), turn.astype(np.int64)


def select(robot: Robot, solutions: FloatArray, status: ArrayLike, turn: ArrayLike) -> FloatArray:
    """Return of all branches the one that Status and Turn name.

    Parameters
    ----------
    robot : Robot
    solutions : (8, 6) or (n, 8, 6) array [rad]
        From `robot.inverse`, in its slots.
    status, turn : int, or (n,) int array
        Bits beyond the branch (S 3 and up) and beyond six joints (T 6 and up) are ignored.

    Returns
    -------
    (6,) or (n, 6) array [rad]
        NaN where that branch does not exist. Not checked against the limits: see `Robot.check_limits`.

    Raises
    ------
    RobotError
        If the arm is no six-axis arm with parallel base pair and spherical wrist.
    DataError
        If Status or Turn are no numbers of bits, or shapes do not fit.
    """
    ortho_parallel(robot)
    if solutions.shape[-2:] != (8, 6) or solutions.ndim not in (2, 3):
        raise DataError(f"solutions have shape {solutions.shape}, expected (8, 6) or (n, 8, 6)")
    count = len(solutions) if solutions.ndim == 3 else 1
    s, t = (_bits(name, value, count) for name, value in (("Status", status), ("Turn", turn)))
    q = solutions.reshape(-1, 8, 6)[np.arange(count), _SLOT[s & BRANCH]]
    near = half_turn(q)
    negative = (t[:, None] >> np.arange(6)) & 1
    turned = np.where(np.abs(near) < _TURN_IGNORED, near, np.mod(q, 2 * np.pi) - 2 * np.pi * negative)
    return np.asarray(turned.reshape((*solutions.shape[:-2], 6)))


def joints_of_pose(
    robot: Robot, poses: ArrayLike, status: ArrayLike, turn: ArrayLike, tool: ArrayLike | None = None
) -> FloatArray:
    """Return the joints of poses with Status and Turn: `select` of `robot.inverse`.

    Parameters
    ----------
    robot : Robot
    poses : (4, 4) or (n, 4, 4) array [mm], base frame
        Of the flange, or of the TCP when `tool` is given.
    status, turn : int, or (n,) int array
    tool : (4, 4) array or (3,) array [mm], optional

    Returns
    -------
    (6,) or (n, 6) array [rad]

    Raises
    ------
    RobotError
        If a pose is out of reach (the rows are named), or the arm is of another kind.
    DataError
        As `select` and `robot.inverse`.
    """
    solutions = inverse(robot, poses, tool)
    q = select(robot, solutions, status, turn)
    missing = np.isnan(q.reshape(-1, 6)).any(axis=1)
    if missing.any():
        if np.isnan(solutions.reshape(-1, 8, 6)[..., 0]).all(axis=1).any():
            find_branches(robot, poses, tool).check_reach()
        rows = name_rows(np.flatnonzero(missing))
        raise RobotError(f"{robot.name}: out of reach with its Status in {rows}; check base, tool and Status")
    return q


def _bits(name: str, value: ArrayLike, count: int) -> IntArray:
    bits = np.asarray(value)
    if not np.issubdtype(bits.dtype, np.integer) or bits.shape not in ((), (count,)) or (bits < 0).any():
        raise DataError(f"{name} must be whole numbers of bits, one or {count} of them; got {value!r}")
    return np.broadcast_to(bits, (count,)).astype(np.int64)
