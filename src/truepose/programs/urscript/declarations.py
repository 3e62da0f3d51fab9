"""What a program assigns to variables that hold poses; one may be used above its assignment in the text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from truepose.programs.core.forms import NUMBER
from truepose.programs.core.points import Point
from truepose.programs.core.source import Source, parse_number, shown
from truepose.programs.urscript.poses import (
    POSE_FUNCTIONS,
    Join,
    Name,
    Offset,
    Pose,
    Unknown,
    parse,
    read_joints,
    read_literal,
)
from truepose.programs.urscript.routines import Routines
from truepose.programs.urscript.syntax import ASSIGN, POSE, Statement, arguments
from truepose.programs.urscript.variables import Variable, Variables

_ADJUST: Final = re.compile(
    rb"\s*([A-Za-z_]\w*)\s*\[\s*([0-2])\s*\]\s*=\s*([A-Za-z_]\w*)\s*\[\s*([0-2])\s*\]\s*([+-])\s*(" + NUMBER + rb")\s*"
)
"""A coordinate of a pose set to one of a pose plus a constant, ``above[2] = pick[2] + 0.05``."""


class Alias(NamedTuple):
    """A variable that is assigned an expression."""

    key: str
    pose: Pose
    line: int


class Declarations:
    """The assignments of a program.

    Parameters
    ----------
    source : Source
        The file.
    routines : Routines
        Its routines.
    variables : Variables
        The variables, which are filled in.

    Attributes
    ----------
    aliases : dict of int to Alias
        The assignments of expressions by the first byte of their statements.
    adjusted : set of int
        The first bytes of the statements that only shift the variable of the alias before them.
    """

    def __init__(self, source: Source, routines: Routines, variables: Variables) -> None:
        self._source, self._routines, self._table = source, routines, variables.table
        self.aliases: dict[int, Alias] = {}
        self.adjusted: set[int] = set()
        self._own_functions = [name for name in POSE_FUNCTIONS if name.decode() in routines.bodies]
        self._assigned = routines.declare_locals()
        self._table |= {key: Variable(parameter=True) for key in routines.passed()}
        for name, body in routines.bodies.items():
            routines.current = name
            for k, statement in enumerate(() if name in routines.replaced else body):
                if statement.start not in self.adjusted:
                    self._assign(statement, body[k + 1 : k + 5])
        routines.own |= {key for key, _, _ in self._assigned}
        for key, line, how in self._assigned:
            if key in self._table:
                self._table[key].writes.append((line, how))

    def _assign(self, statement: Statement, following: Sequence[Statement]) -> None:
        m = ASSIGN.match(statement.code)
        if m is None:
            return
        code, line = statement.code, statement.line
        name, start, end = m[2].decode(), m.end(), len(statement.code.rstrip())
        key = self._routines.key(name)
        self._assigned += [(other, line, "assigned") for other in self._routines.others(name)]
        if m[3]:
            self._assigned.append((key, line, "component set"))
        elif points := self._literals(name, statement, start, end):
            variable = self._table.setdefault(key, Variable())
            variable.listed = code[start : start + 1] == b"[" and points[0].joints is None
            variable.points += points
            if variable.parameter or (variable.listed and len(variable.points) > len(points)):
                self._assigned.append((key, line, "assigned"))
        else:
            pose = self.pose(name, statement, start, end)
            if isinstance(pose, Unknown) or (variable := self._table.setdefault(key, Variable())).parameter:
                self._assigned.append((key, line, "assigned"))
            else:
                pose = self._adjust(key, pose, following)
                variable.given.append(pose)
                self.aliases[statement.start] = Alias(key, pose, line)

    def _adjust(self, key: str, pose: Pose, following: Sequence[Statement]) -> Pose:
        """Return the expression of a variable with the shifts of its coordinates in the statements that follow."""
        shift, words = np.zeros(3), []
        for statement in following:
            m = _ADJUST.fullmatch(statement.code)
            if m is None or self._routines.key(m[1].decode()) != key or m[2] != m[4]:
                break
            axis, read = int(m[2]), self._routines.key(m[3].decode())
            of_other = isinstance(pose, Name) and read == pose.key
            if read != key and (not of_other or shift[axis]):
                break
            shift[axis] += 1000.0 * parse_number(m[5] + m[6].lstrip(b"+"))
            words.append(statement.code.strip().decode("latin-1"))
            self.adjusted.add(statement.start)
        return Join(True, pose, Offset((shift[0], shift[1], shift[2])), "; ".join(words)) if words else pose

    def _literals(self, name: str, statement: Statement, start: int, end: int) -> list[Point]:
        """Return the pose that fills a span of a statement, or the poses of a list; nothing if it is anything else."""
        code, line = statement.code, statement.line
        if code[start : start + 1] != b"[" or code[end - 1 : end] != b"]":
            point = read_literal(self._source, name, statement.start + start, statement.start + end, line)
            return [] if point is None else [point]
        joints = read_joints(self._source, name, statement.start + start, statement.start + end, line)
        if joints is not None:
            return [joints]
        spans = arguments(code[: end - 1] + b")", start + 1)
        if not all(POSE.match(code, a, b) for a, b in spans):
            return []
        found = [
            read_literal(self._source, f"{name}[{k}]", statement.start + a, statement.start + b, line)
            for k, (a, b) in enumerate(spans)
        ]
        return [point for point in found if point is not None] if None not in found else []

    def pose(self, name: str, statement: Statement, start: int, end: int) -> Pose:
        """Return the expression in a span of a statement; `name` is for the pose that is written in it."""

        def literal(a: int, b: int) -> Point | None:
            return read_literal(self._source, name, statement.start + a, statement.start + b, statement.line)

        if any(one in statement.code for one in self._own_functions):
            return Unknown(shown(statement.code, start, end))
        return parse(statement.code, start, end, literal, self._routines.key)
