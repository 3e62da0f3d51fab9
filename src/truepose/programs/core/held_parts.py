"""How a program of KUKA counts the positions of parts that the robot holds to a fixed tool (``$IPO_MODE=#TCP``).

TOOL_DATA is then the part on the flange, and BASE_DATA the tool in the world. A position may be the place of the part
at the tool, or that of the tool on the part, and documents that state which were not found. Programs show it
themselves: Status and Turn of joint motions were taught, and fit joints within their limits in one way of counting
only. A program in which both ways fit, or none, is not corrected there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.errors import RobotError
from truepose.geometry import invert_transform, make_transform
from truepose.programs.core.points import FIXED_TOOL
from truepose.programs.core.program import Program
from truepose.programs.core.target import Target
from truepose.robots import Robot, select
from truepose.robots.inverse.branches import inverse

_WHAT: Final = "the robot holds the part to a fixed tool"
_NONE: Final = f"{_WHAT}, and no PTP motion with Status and Turn shows how the program counts positions there"
_NEITHER: Final = f"{_WHAT}, and the joints do not fit Status and Turn: check TOOL_DATA, BASE_DATA and the robot"
_BOTH: Final = f"{_WHAT}, and Status and Turn fit whether positions are those of the part or of the tool"


def with_held_parts(program: Program, robot: Robot | None) -> Program:
    """Return a program whose targets on held parts are read in the way that its Status and Turn show, or refused."""
    if not any(map(_is_open, program.targets.kinds)):
        return program
    change = _change(program, robot)
    again = None if program.again is None else partial(_again, program.again, robot)
    return replace(program, targets=program.targets.with_kinds(change), again=again)


def _again(again: Callable[[], Program], robot: Robot | None) -> Program:
    return with_held_parts(again(), robot)


def _change(program: Program, robot: Robot | None) -> Callable[[Target], Target]:
    if robot is None:
        return partial(_refused, _NONE)
    of_part, of_tool, found = True, True, 0
    try:
        for at_tool, part, stands, status, turn in _taught(program):
            of_part &= _fit(robot, stands @ at_tool @ invert_transform(part), status, turn)
            of_tool &= _fit(robot, stands @ invert_transform(part @ at_tool), status, turn)
            found += len(status)
    except RobotError:
        return partial(_refused, _NONE)  # an arm of another kind
    if found and of_part != of_tool:
        return _of_part if of_part else _of_tool
    return partial(_refused, _NONE if not found else _BOTH if of_part else _NEITHER)


def _taught(program: Program) -> Iterator[tuple[FloatArray, FloatArray, FloatArray, IntArray, IntArray]]:
    """Yield joint motions to held parts: positions (k, 4, 4) [mm], part and tool (4, 4) [mm], Status and Turn (k,)."""
    for _, columns in program.targets.chunks():
        certain = ~columns.on_paths & (columns.status >= 0) & (columns.turn >= 0)
        for kind in np.unique(columns.kind).tolist():
            like = columns.alike[kind]
            rows = np.flatnonzero(certain & (columns.kind == kind))
            if not _is_open(like) or like.tf_flange_tool is None or like.tf_base_frame is None or not len(rows):
                continue
            some = columns.take(rows)
            own = make_transform(some.rotation(), some.values[:, :3])
            yield own, like.tf_flange_tool, like.tf_base_frame, some.status, some.turn


def _fit(robot: Robot, flange: FloatArray, status: IntArray, turn: IntArray) -> bool:
    """Return whether joints of all flanges (k, 4, 4) [mm] with a Status and Turn are within their limits."""
    q = select(robot, inverse(robot, flange), status, turn)
    return bool(np.isfinite(q).all() and robot.within_limits(q).all())


def _is_open(target: Target) -> bool:
    return target.stands == "base" and target.reason == FIXED_TOOL.reason


def _of_part(target: Target) -> Target:
    return replace(target, verdict="correct", reason="") if _is_open(target) else target


def _of_tool(target: Target) -> Target:
    if not _is_open(target):
        return target
    frame, tool = target.tf_flange_tool, target.tf_base_frame
    return replace(_of_part(target), stands="tool", tf_base_frame=frame, tf_flange_tool=tool)


def _refused(why: str, target: Target) -> Target:
    return replace(target, reason=why) if _is_open(target) else target
