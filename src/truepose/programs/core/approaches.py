"""From where a program reaches its targets, where this is certain: on a straight line or by a joint motion.

The direction in which each joint comes to a target decides on which side of its backlash it stands. A circle or a
spline ends in another direction than that of its chord, so the targets of these are unknown.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

import numpy as np

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.compensation import Starts
from truepose.geometry import invert_transform
from truepose.programs.core.columns import ProgramTargets, TargetColumns
from truepose.programs.core.joint_digits import by_form
from truepose.programs.core.program import Program
from truepose.robots import Robot, shown_joints

_STRAIGHT: Final = re.compile(r"S?LIN(_REL)?|MoveL\w*|L|MOVL|movel|G0?1|GOTO", re.I)
_BY_JOINTS: Final = re.compile(r"S?PTP(_REL)?|MoveJ\w*|J|MOVJ|movej", re.I)


def starts_of(program: Program, robot: Robot, tf_flange_tool: FloatArray) -> Starts:
    """Return from where straight and joint motions reach each target; unknown where several motions differ in this.

    Parameters
    ----------
    program : Program
        The program, of n targets.
    robot : Robot
        The nominal robot.
    tf_flange_tool : (4, 4) array [mm]
        The tool of targets that name none.
    """
    targets = program.targets
    source, n = _sources(targets), len(targets)
    straight, by_joints = _kinds(targets)
    of_circles = sorted({i for circle in program.circles for i in circle})
    straight[of_circles], by_joints[of_circles] = False, False
    source[list(targets.follows)] = -1
    poses, status, turn = np.full((n, 4, 4), np.nan), np.full(n, -1), np.full(n, -1)
    if len(known := np.flatnonzero((straight | by_joints) & (source >= 0))):
        flange, tool, status_at, turn_at = _flanges(targets, robot, tf_flange_tool)
        at = source[known]
        poses[known] = flange[at] @ tool[known]  # the tool of the target is the one that moves
        status[known], turn[known] = status_at[at], turn_at[at]
    return Starts(poses, by_joints, status, turn)


def _sources(targets: ProgramTargets) -> IntArray:
    """Return the one target from which motions reach each target, (n,); negative where there is none, or several."""
    source = np.full(len(targets), -1)
    row, _, goes_on = targets.motions
    if not len(row):
        return source
    previous, now = np.where(goes_on[1:], row[:-1], -2), row[1:]
    source[now[::-1]] = previous[::-1]
    source[now[previous != source[now]]] = -2
    source[row[0]] = -2
    return source


def _kinds(targets: ProgramTargets) -> tuple[BoolArray, BoolArray]:
    """Return whether straight motions alone, and whether joint motions alone, go to each target, (n,)."""
    found = np.zeros((2, len(targets)), np.bool_)
    for start, columns in targets.chunks():
        kinds, which = columns.shared()
        for mine, form in zip(found, (_STRAIGHT, _BY_JOINTS), strict=True):
            only = [bool(kind.motions) and all(map(form.fullmatch, kind.motions)) for kind in kinds]
            if form is _STRAIGHT:  # a held part moves so that the tool goes straight along it
                only = [is_only and not kind.stands for is_only, kind in zip(only, kinds, strict=True)]
            mine[start : start + len(columns)] = np.array(only, np.bool_)[which]
    return found[0], found[1]


def _flanges(
    targets: ProgramTargets, robot: Robot, tf_flange_tool: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Return of all targets the flange in the base frame and the tool, (n, 4, 4) [mm], Status and Turn, (n,).

    A flange that is not known is NaN; Status and Turn then are −1.
    """
    n = len(targets)
    flange, tool = np.full((n, 4, 4), np.nan), np.empty((n, 4, 4))
    status, turn = np.full(n, -1), np.full(n, -1)
    for first, columns in targets.chunks():
        tool[first : first + len(columns)] = columns.tf_flange_tool(tf_flange_tool)
        known = np.isfinite(columns.values).all(axis=1) & np.isfinite(columns.tf_base_frame()).all(axis=(1, 2))
        if len(rows := np.flatnonzero(known & ~columns.commands_joints)):
            at = first + rows
            flange[at] = columns.take(rows).poses_base() @ invert_transform(tool[at])
            status[at], turn[at] = columns.status[rows], np.where(columns.on_paths, -1, columns.turn)[rows]
        for rows, q in _commanded(columns, robot):
            flange[first + rows] = robot.forward(q)
    return flange, tool, status, turn


def _commanded(columns: TargetColumns, robot: Robot) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield joint targets and their joints (k, dof) [rad], those that the arm of the map has."""
    if columns.joints is None or not columns.commands_joints.any():
        return
    for form, rows in by_form(columns):
        if form.count == robot.dof and form.arm is None:
            q = shown_joints(robot, ground=form.ground).to_model(form.joints(columns.joints[rows]))
            certain = np.isfinite(q).all(axis=1)
            yield rows[certain], q[certain]
