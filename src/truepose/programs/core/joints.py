"""Joints of targets that a program reaches along paths.

KUKA's controller takes Status and Turn of a target into account for PTP motions only. Along straight, circular and
spline motions the arm keeps its branch, and every joint moves on from where it is. So the full turns of such targets
follow from the last PTP motion before them, and the Turn in the text may be stale. A PTP motion to joints (AXIS) states
the turns by itself.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import RobotError
from truepose.geometry import invert_transform
from truepose.programs.core.columns import Motions, ProgramTargets
from truepose.programs.core.joint_targets import KUKA
from truepose.programs.core.points import ALLOWED_JOINTS
from truepose.robots import Robot, select, shown_joints, status_turn
from truepose.robots.inverse.axes import half_turn
from truepose.robots.inverse.branches import inverse

_FARTHEST: Final = 3.0 * np.pi
"""Where a joint is taken to be that no arm turns so far: a path that winds on is not that of this arm."""


def joints_along_paths(robot: Robot, targets: ProgramTargets, tf_flange_tool: FloatArray) -> FloatArray | None:
    """Return the joints of KRL targets that straight, circular and spline motions reach from a PTP motion.

    The branch is that of the target's Status, or without one that of the motion before. Every joint is at the full turn
    nearest to the joint before the motion. Where several motions lead to a target, the first one counts.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    targets : ProgramTargets
        The n targets of a program.
    tf_flange_tool : (4, 4) array [mm]
        The tool of targets that name none.

    Returns
    -------
    (n, 6) array of float32 [rad], or None
        NaN where the joints do not follow from a PTP motion with Status and Turn; None where this holds for all.
    """
    row, on_path, _ = targets.motions
    status, turn, on_paths = _configurations(targets)
    commanded, stated = _commanded(robot, targets)
    if not len(row) or not on_paths.any() or not (len(commanded) or ((turn >= 0) & ~on_paths).any()):
        return None
    try:
        if len(commanded):
            status[commanded] = status_turn(robot, stated)[0]
        status = _first_visits(row, _carried(status[row], on_path), status)
        q = _joints(robot, targets, tf_flange_tool, status, turn)
    except RobotError:
        return None  # an arm of another kind
    anchors = ~on_paths & (turn >= 0) & np.isfinite(q[:, 0])
    q[commanded], anchors[commanded] = stated, True
    along, known = _followed(targets.motions, q, anchors)
    near = np.full_like(q, np.nan)
    known &= on_paths[row]
    near[row[known][::-1]] = along[known][::-1]
    limited = np.isfinite(robot.limits).all(axis=1)
    near[:, limited] = np.clip(near[:, limited], -_FARTHEST, _FARTHEST)
    return near


def _configurations(targets: ProgramTargets) -> tuple[IntArray, IntArray, BoolArray]:
    """Return Status and Turn of KRL targets, −1 where there is none, and whether only paths lead to each: (n,)."""
    n = len(targets)
    status, turn, on_paths = np.full(n, -1), np.full(n, -1), np.zeros(n, np.bool_)
    for first, columns in targets.chunks():
        here = slice(first, first + len(columns))
        if columns.controller == "kuka":
            status[here], turn[here], on_paths[here] = columns.status, columns.turn, columns.on_paths
    return status, turn, on_paths


def _commanded(robot: Robot, targets: ProgramTargets) -> tuple[IntArray, FloatArray]:
    """Return the KRL joint targets whose joints are certain, (k,), and their joints, (k, 6) [rad]."""
    rows, joints = [np.empty(0, np.int64)], [np.empty((0, 6))]
    for first, columns in targets.chunks() if targets.names_joints else ():
        if columns.joints is None or columns.controller != "kuka" or robot.dof != KUKA.count:
            continue
        kinds, which = columns.shared()
        certain = [
            kind.joint_form == KUKA and (kind.verdict == "correct" or kind.reason == ALLOWED_JOINTS.reason)
            for kind in kinds
        ]
        here = np.flatnonzero(np.array(certain)[which] & ~columns.on_paths)
        rows.append(first + here)
        joints.append(shown_joints(robot, ground=KUKA.ground).to_model(KUKA.joints(columns.joints[here])))
    return np.concatenate(rows), np.concatenate(joints)


def _carried(status: IntArray, on_path: BoolArray) -> IntArray:
    """Return the Status of motions (m,); a motion on a path takes that of the motion before if it names none."""
    places = np.where(on_path & (status < 0), 0, np.arange(len(status)))
    return np.asarray(status[np.maximum.accumulate(places)])


def _first_visits(row: IntArray, of_motions: IntArray, default: IntArray) -> IntArray:
    """Return of each target the value of the first motion to it (n,)."""
    values = default.copy()
    values[row[::-1]] = of_motions[::-1]
    return values


def _joints(
    robot: Robot, targets: ProgramTargets, tf_flange_tool: FloatArray, status: IntArray, turn: IntArray
) -> FloatArray:
    """Return the joints of the targets with a Status and a known pose, (n, 6) of float32 [rad]; else NaN."""
    q: FloatArray = np.full((len(targets), 6), np.nan, np.float32)
    for first, columns in targets.chunks():
        rows = np.flatnonzero(status[first : first + len(columns)] >= 0)
        if not len(rows) or columns.controller != "kuka":
            continue
        some = columns.take(rows)
        rows = rows[np.isfinite(some.values).all(axis=1) & np.isfinite(some.tf_base_frame()).all(axis=(1, 2))]
        if not len(rows):
            continue
        some = columns.take(rows)
        flange = some.poses_base() @ invert_transform(some.tf_flange_tool(tf_flange_tool))
        at = first + rows
        q[at] = select(robot, inverse(robot, flange), status[at], np.maximum(turn[at], 0))
    return q


def _followed(motions: Motions, q: FloatArray, anchors: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the joints after each motion, (m, dof) [rad], and whether they follow from an anchor.

    Joints of targets `q` (n, dof) are known up to full turns, those of the targets in `anchors` completely.
    """
    row, on_path, _ = motions
    known, anchor = np.isfinite(q[row, 0]), anchors[row]
    joined = on_path & known & ~anchor
    joined[1:] &= known[:-1]
    joined[:1] = False
    start = np.maximum.accumulate(np.where(joined, 0, np.arange(len(row))))
    along: FloatArray = np.empty((len(row), q.shape[1]), np.float32)
    for joint in range(q.shape[1]):  # one at a time: a program may have a million motions
        at = q[row, joint].astype(float)
        step = np.where(joined, half_turn(np.diff(at, prepend=at[:1])), 0.0)
        moved = np.cumsum(step)
        along[:, joint] = at[start] + moved - moved[start]
    return along, np.asarray(anchor[start])
