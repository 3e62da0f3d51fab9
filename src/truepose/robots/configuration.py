"""Arm configurations as controllers write them: KUKA's Status and Turn, ABB's confdata, FANUC's CONFIG.

They make the joints of a pose unique. UR writes none: choose among `Robot.inverse` by joints nearby, with
`nearest_branch`. The tables state how well the meaning on a controller is confirmed; that the joints follow from pose
and configuration is tested.

| KUKA | is 1 when | evidence |
|---|---|---|
| S bit 0 | the wrist centre, in the frame turned with A1, has x < 0 (overhead) | two makers' documents |
| S bit 1 | A3 >= phi, the angle at which upper arm and wrist centre are in line | the same; phi tested |
| S bit 2 | A5 < 0 | 432 of 432 points of four public code bases |
| S bit 4 | the point was taught on an absolutely accurate robot | one source; ignored here |
| T bit i | A(i+1) < 0 | one source; reported to be ignored within ±2 deg of zero, as here |

| ABB | is | evidence |
|---|---|---|
| cf1, cf4, cf6 | floor(angle / 90 deg) of joints 1, 4, 6 | one source |
| cfx | 4 · (wrist centre behind axis 1) + 2 · (behind the lower arm) + (joint 5 negative) | one source |
| behind the lower arm | in the frame turned with joint 1, also where the arm reaches over its back | unconfirmed |

| FANUC | is | evidence |
|---|---|---|
| N, F | joint 5 below zero (so the tool down in front of the arm is N), or not | unconfirmed |
| L, R | not used by six-axis arms: skipped | one source |
| U, D | elbow above or below the line from shoulder to wrist centre, in the frame turned with joint 1 | unconfirmed |
| T, B | wrist centre before or behind axis 1 | one source |
| three numbers | full turns of joints 4, 5, 6 away from -180 … 180 deg: 1 from 180 up, -1 from -180 down | one source |
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError, RobotError
from truepose.geometry.arrays import name_rows
from truepose.robots.chain import Chain
from truepose.robots.inverse.axes import half_turn
from truepose.robots.inverse.branches import find_branches, inverse
from truepose.robots.inverse.closed_form import ortho_parallel

StrArray = NDArray[np.str_]

OVERHEAD: Final = 1
ELBOW: Final = 2
WRIST: Final = 4
BRANCH: Final = OVERHEAD | ELBOW | WRIST
"""The bits of Status that select one of the eight branches."""

_TURN_IGNORED: Final = np.deg2rad(2.0)
# slots of OrthoParallel.branches, 4 · (reaching back) + 2 · (t3 + psi < 0) + (t5 < 0), by the branch bits of Status
_SLOT: Final = np.array([4 * bool(s & OVERHEAD) + 2 * (not s & ELBOW) + bool(s & WRIST) for s in range(8)])
_STATUS: Final = np.argsort(_SLOT)

_TURN: Final = 2 * np.pi
_QUARTER: Final = np.pi / 2
_ABB_JOINTS: Final = np.array([0, 3, 5])
_FANUC_JOINTS: Final = np.array([3, 4, 5])
_DOUBT: Final = np.deg2rad(1.0)  # poses with few digits may fall just outside the stated quarter or turn
# by the same slots: 4 · (reaching back) + 2 · (elbow below) + (joint 5 negative)
_FANUC_LETTERS: Final = np.array([f"{'FN'[s & 1]} {'UD'[s >> 1 & 1]} {'TB'[s >> 2]}" for s in range(8)])
_CONFIG: Final = re.compile(r"([NF])\s*([LR]?)\s*([UD])\s*([TB])\s*,\s*(-?[0-9]+)\s*,\s*(-?[0-9]+)\s*,\s*(-?[0-9]+)")


def status_turn(robot: Chain, q: ArrayLike) -> tuple[IntArray, IntArray]:
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


def select(robot: Chain, solutions: FloatArray, status: ArrayLike, turn: ArrayLike) -> FloatArray:
    """Return the branch that Status and Turn select.

    Parameters
    ----------
    robot : Robot
        A six-axis arm with parallel base pair and spherical wrist.
    solutions : (8, 6) or (n, 8, 6) array [rad]
        The branches from `robot.inverse`, in its order.
    status, turn : int, or (n,) int array
        Status and Turn; bits S 3 and up and T 6 and up are ignored.

    Returns
    -------
    (6,) or (n, 6) array [rad]
        NaN where that branch does not exist. Not checked against the limits: see `Robot.check_limits`.

    Raises
    ------
    RobotError
        If the arm is of another kind.
    DataError
        If Status or Turn are not whole numbers from 0 up, or the shapes do not match.
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
    robot: Chain, poses: ArrayLike, status: ArrayLike, turn: ArrayLike, tool: ArrayLike | None = None
) -> FloatArray:
    """Return the joints of poses with Status and Turn: `select` of `robot.inverse`.

    Parameters
    ----------
    robot : Robot
    poses : (4, 4) or (n, 4, 4) array [mm], base frame
        The poses of the flange, or of the TCP when `tool` is given.
    status, turn : int, or (n,) int array
    tool : (4, 4) array or (3,) array [mm], optional
        tf_flange_tool, or the TCP's position in the flange frame.

    Returns
    -------
    (6,) or (n, 6) array [rad]

    Raises
    ------
    RobotError
        If a pose is out of reach (the message names the rows), or the arm is of another kind.
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
        raise RobotError(f"{robot.name}: out of reach with the given Status in {rows}; check base, tool and Status")
    return q


def abb_configuration(robot: Chain, q: ArrayLike) -> IntArray:
    """Return ABB's confdata [cf1, cf4, cf6, cfx] of joint vectors.

    Parameters
    ----------
    robot : Robot
        A six-axis arm with parallel base pair and spherical wrist, or a calibrated one of this kind.
    q : (6,) or (n, 6) array [rad]

    Returns
    -------
    (4,) or (n, 4) int array

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
    >>> abb_configuration(load_robot("abb-irb120"), np.deg2rad([-10, 0, 20, 100, -30, 0]))
    array([-1,  1,  0,  1])
    """
    arm = ortho_parallel(robot)
    joints = robot.check_joints(q)
    quarters = np.floor(joints[..., _ABB_JOINTS] / _QUARTER).astype(np.int64)
    return np.concatenate([quarters, arm.slot(joints)[..., None]], axis=-1)


def joints_of_abb(
    robot: Chain, poses: ArrayLike, configuration: ArrayLike, tool: ArrayLike | None = None
) -> FloatArray:
    """Return the joints of poses with ABB's confdata.

    Joints 1, 4 and 6 take the full turn that cf1, cf4 and cf6 state, the others the one within the limits.

    Parameters
    ----------
    robot : Robot
    poses : (4, 4) or (n, 4, 4) array [mm], base frame
        The poses of the flange, or of the TCP when `tool` is given.
    configuration : (4,) or (n, 4) int array
        The confdata cf1, cf4, cf6, cfx.
    tool : (4, 4) array or (3,) array [mm], optional
        tf_flange_tool, or the TCP's position in the flange frame.

    Returns
    -------
    (6,) or (n, 6) array [rad]

    Raises
    ------
    RobotError
        If a pose is out of reach, or its joints lie in another quarter than cf1, cf4, cf6 state (the message names the
        rows), or the arm is of another kind.
    DataError
        If the confdata is invalid, or poses or tool are not rigid transforms.
    """
    word = np.asarray(configuration)
    if not np.issubdtype(word.dtype, np.integer) or word.shape[-1:] != (4,) or word.ndim > 2:
        raise DataError(f"configuration must be whole numbers cf1, cf4, cf6, cfx of each pose; got {configuration!r}")
    word = word.reshape(-1, 4)
    odd = (word[:, 3] < 0) | (word[:, 3] > 7)
    if odd.any():
        rows = np.flatnonzero(odd)
        raise DataError(f"cfx is {word[rows[0], 3]} in {name_rows(rows)}; expected 0 to 7")
    q = _on_branch(robot, poses, tool, word[:, 3], "cfx")
    return _turned(robot, q, _ABB_JOINTS, _middle(word), _QUARTER / 2, "quarter turns cf1, cf4, cf6")


def select_abb(robot: Chain, solutions: FloatArray, configuration: IntArray) -> FloatArray:
    """Return the branches (n, 6) [rad] that confdata (n, 4) select from `solutions` (n, 8, 6); NaN where there is none.

    Raises
    ------
    RobotError
        If the arm is of another kind.
    """
    ortho_parallel(robot)
    q = solutions[np.arange(len(solutions)), configuration[:, 3]]
    return _with_turns(q, _ABB_JOINTS, _middle(configuration))


def _middle(configuration: IntArray) -> FloatArray:
    """Return the middles of the quarters of joints 1, 4 and 6, (n, 3) [rad]."""
    return np.asarray((configuration[:, :3] + 0.5) * _QUARTER)


def fanuc_configuration(robot: Chain, q: ArrayLike) -> StrArray:
    """Return FANUC's CONFIG of joint vectors, such as "N U T, 0, 0, 0".

    Parameters
    ----------
    robot : Robot
        A six-axis arm with parallel base pair and spherical wrist, or a calibrated one of this kind.
    q : (6,) or (n, 6) array [rad]
        The library's joints: joint 3 relative to joint 2 (the pendant shows it relative to the ground).

    Returns
    -------
    str array of shape () or (n,)

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
    >>> str(fanuc_configuration(load_robot("fanuc-m20ia"), np.deg2rad([0, 0, 0, 0, -90, 200])))
    'N U T, 0, 0, 1'
    """
    arm = ortho_parallel(robot)
    joints = robot.check_joints(q)
    slot = arm.slot(joints)
    some = joints[..., _FANUC_JOINTS]
    turns = (np.sign(some) * np.floor((np.abs(some) + np.pi) / _TURN)).astype(np.int64).astype(np.str_)
    letters = _FANUC_LETTERS[slot]
    for i in range(3):
        letters = np.char.add(np.char.add(letters, ", "), turns[..., i])
    return np.asarray(letters)


def joints_of_fanuc(
    robot: Chain, poses: ArrayLike, configuration: str | Sequence[str] | StrArray, tool: ArrayLike | None = None
) -> FloatArray:
    """Return the joints of poses with FANUC's CONFIG.

    Joints 4, 5 and 6 take the full turn that the numbers state, the others the one within the limits (of two, the one
    in -180 … 180 deg).

    Parameters
    ----------
    robot : Robot
    poses : (4, 4) or (n, 4, 4) array [mm], base frame
        The poses of the flange, or of the TCP when `tool` is given.
    configuration : str, or n of them
        The CONFIG, such as "N U T, 0, 0, 0", with or without quotation marks; one for all poses, or one for each.
    tool : (4, 4) array or (3,) array [mm], optional
        tf_flange_tool, or the TCP's position in the flange frame.

    Returns
    -------
    (6,) or (n, 6) array [rad]

    Raises
    ------
    RobotError
        If a pose is out of reach (the message names the rows), or the arm is of another kind.
    DataError
        If a CONFIG is invalid, or poses or tool are not rigid transforms.
    """
    slots, goal = _parse_fanuc(np.atleast_1d(np.asarray(configuration)).tolist())
    q = _on_branch(robot, poses, tool, slots, "CONFIG")
    return _turned(robot, q, _FANUC_JOINTS, goal, np.pi, "turn numbers")


def select_fanuc(robot: Chain, solutions: FloatArray, configuration: Sequence[str]) -> FloatArray:
    """Return the branches (n, 6) [rad] that n CONFIG select from `solutions` (n, 8, 6); NaN where there is none.

    Raises
    ------
    RobotError
        If the arm is of another kind.
    DataError
        If a CONFIG is invalid.
    """
    ortho_parallel(robot)
    slots, goal = _parse_fanuc(configuration)
    return _with_turns(solutions[np.arange(len(solutions)), slots], _FANUC_JOINTS, goal)


def _parse_fanuc(words: Sequence[str]) -> tuple[IntArray, FloatArray]:
    """Return the slots (n,) and the full turns of joints 4, 5 and 6 (n, 3) [rad] that CONFIG state."""
    slots, turns = np.empty(len(words), np.int64), np.empty((len(words), 3))
    for row, word in enumerate(words):
        found = _CONFIG.fullmatch(str(word).strip("'\" "))
        if found is None:
            raise DataError(f'CONFIG in row {row} is {word!r}; expected, for example, "N U T, 0, 0, 0"')
        slots[row] = 4 * (found[4] == "B") + 2 * (found[3] == "D") + (found[1] == "N")
        turns[row] = [int(number) for number in found.group(5, 6, 7)]
    return slots, _TURN * turns


def _on_branch(robot: Chain, poses: ArrayLike, tool: ArrayLike | None, slots: IntArray, word: str) -> FloatArray:
    """Return the joints of poses on given branches, slots of `OrthoParallel.branches`: (6,) or (n, 6)."""
    ortho_parallel(robot)
    single = np.ndim(poses) == 2
    branches = find_branches(robot, poses, tool)
    count = len(branches.q)
    if len(slots) not in (1, count):
        raise DataError(f"got {count} poses and {len(slots)} configurations; expected equal numbers, or one for all")
    q = branches.q[np.arange(count), np.broadcast_to(slots, (count,))]
    missing = np.isnan(q).any(axis=1)
    if missing.any():
        branches.check_reach()
        raise RobotError(
            f"{robot.name}: out of reach on the branch of the given {word} in {name_rows(np.flatnonzero(missing))}, "
            f"but not on others; check base, tool and {word}"
        )
    return q[0] if single else q


def _turned(robot: Chain, q: FloatArray, joints: IntArray, middle: FloatArray, half: float, word: str) -> FloatArray:
    """Return joints (…, 6) with full turns added until some of them lie within `half` of the stated middles."""
    goal = middle if q.ndim == 2 else middle[0]
    turned = _with_turns(q, joints, goal)
    off = np.abs(turned[..., joints] - goal) > half + _DOUBT
    if off.any():
        rows = np.flatnonzero(np.atleast_2d(off).any(axis=1))
        joint = joints[int(np.argmax(np.atleast_2d(off)[rows[0]]))]
        value = np.rad2deg(np.atleast_2d(turned)[rows[0], joint])
        raise RobotError(
            f"{robot.name}: the {word} do not match the joints in {name_rows(rows)}: joint {joint + 1} is at "
            f"{value:.3f} deg in row {rows[0]}; check tool, base and configuration"
        )
    return turned


def _with_turns(q: FloatArray, joints: IntArray, goal: FloatArray) -> FloatArray:
    """Return joints (…, 6) [rad] with some of them at the full turn nearest to `goal` (…, k)."""
    turned = q.copy()
    now = q[..., joints]
    turned[..., joints] = now + _TURN * np.round((goal - now) / _TURN)
    return turned


def _bits(name: str, value: ArrayLike, count: int) -> IntArray:
    bits = np.asarray(value)
    if not np.issubdtype(bits.dtype, np.integer) or bits.shape not in ((), (count,)) or (bits < 0).any():
        raise DataError(f"expected {name} as whole numbers from 0 up, one or {count} of them; got {value!r}")
    return np.broadcast_to(bits, (count,)).astype(np.int64)
