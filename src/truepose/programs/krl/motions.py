"""KRL motions: PTP, LIN, CIRC, their spline versions, and their targets."""

from __future__ import annotations

import re
from itertools import count
from typing import NamedTuple

from truepose.programs.core.arithmetic import Expression, Shifted, Variable
from truepose.programs.core.flow import Flow
from truepose.programs.core.points import RUN_TIME, FileLine, Place, Point, Problem, Use, computed, not_understood
from truepose.programs.core.source import Source, shown, strip
from truepose.programs.core.state import InForce
from truepose.programs.krl.derived import Followed, KrlDerivations, Resolver, expression
from truepose.programs.krl.frames import SYSTEM, frame_value, ipo_value
from truepose.programs.krl.lexer import BLANK, Lines, Statement, closing_brace, parse_point, split_commas
from truepose.programs.krl.names import Names, element
from truepose.programs.krl.points import Index, KrlMotion, Numbers, PointVariable
from truepose.programs.krl.words import APPROACH, CIRCLES

_SIMPLE = re.compile(
    rb"[ \t]*+(?:(\{[^{}\"]*+\})|([A-Za-z_$][\w$]*+)(?:[ \t]*+(\[[ \t]*+[\d, \t]*+\]))?+)"
    rb"(?:(?:[ \t]++|(?<=\}))C_(?:PTP|DIS|VEL|ORI|SPL)\b)*+[ \t]*+",
    re.I,
)
_FIRST = re.compile(rb"[ \t]*+(\w++)[ \t]*+(\{[^{}]*+\})")
_WITH = re.compile(rb"\bWITH\b", re.I)
_NAME = re.compile(rb"([A-Za-z_$][\w$]*+)\s*+(\[[^\[\]]*\])?")
_SETTING = re.compile(rb"(\$\w+)\s*+(?:\[[^\]]*\]|\.\s*\w+)?\s*=\s*")
_CIRCLE_ANGLE = re.compile(rb"CA\b", re.I)
_ADJACENT = re.compile(rb"[\w)\]}$][ \t]+[\w$({]")
_OPERATOR_WORD = re.compile(rb"\b(?:B_AND|B_OR|B_EXOR|B_NOT|AND|OR|EXOR|NOT)\b", re.I)
_BRACES = re.compile(rb"\{[^{}]*\}")


class Settings(NamedTuple):
    """The settings of WITH for one motion or for a spline block."""

    tool: InForce | None = None
    base: InForce | None = None
    ipo: str | None = None


class Element(NamedTuple):
    """A named point that a motion goes to, and the element if it is an array."""

    variable: PointVariable
    key: Index
    followed: Followed | None = None


Goal = Numbers | Point | Element
"""The goal of a motion: numbers, a target without numbers, or a named point."""


class KrlMotionReader:
    """Reads the motion statements of one .src.

    Attributes
    ----------
    others : list of Point
        The motions whose target is in no file.
    circles : list of list of Goal
        The goals of circles.
    block : Settings
        The settings of the open spline block.
    followed : list of Followed
        The motions to points that the program may derive from others.
    computed : dict of Followed to Point
        The targets among these that an expression in the motion gives.
    """

    def __init__(
        self, source: Source, names: Names, flow: Flow, derivations: KrlDerivations, *, named: bool = False
    ) -> None:
        self._source, self._names, self._flow = source, names, flow
        self._named, self._derivations = named, derivations
        self._numbers = count()
        self.followed: list[Followed] = []
        self.computed: dict[Followed, Point] = {}
        self.others: list[Point] = []
        self.circles: list[list[Goal]] = []
        self.block = Settings()

    def place(self, line: int) -> Place:
        """Return a line, with the file's name if the program has several."""
        return FileLine(self._source.path.name, line) if self._named else line

    def other(self, word: str, line: int, problem: Problem, name: str = "") -> Point:
        """Note a motion that has no numbers to correct."""
        use = Use(word, self.place(line), section=self._flow.motion())
        point = Point(name or f"{word}:{line}", self._source, line, problem=problem, uses=[use])
        self.others.append(point)
        return point

    def _motion(self, word: str, line: int, settings: Settings) -> KrlMotion:
        return KrlMotion(word, self.place(line), self._flow.node, *settings, self._flow.motion())

    def read(self, statement: Statement) -> None:
        """Take one motion."""
        word, line, _, start, end = statement
        data = self._source.data
        if word not in CIRCLES and (m := _SIMPLE.fullmatch(data, start, end)):
            motion = self._motion(word, line, self.block)
            if m[1]:
                self._literal(*m.span(1), f"{word}:{line}", motion)
                return
            if not APPROACH.fullmatch(b" " + m[2]):
                self._point(m[2], m[3], motion)
                return
        self._general(statement)

    def first_of(self, lines: Lines) -> Numbers:
        """Return the first point of a run of motions of one form."""
        m = _FIRST.match(self._source.data, lines.start)
        assert m is not None
        word = m[1].decode().upper()
        motion = self._motion(word, lines.line, self.block)
        aggregate = parse_point(self._source, *m.span(2), lines.line)
        return Numbers(f"{word}:{lines.line}", self._source, lines.line, aggregate, motion=motion)

    def settings(self, start: int, end: int, line: int) -> Settings:
        """Read the assignments behind WITH."""
        found = self.block
        self._names.scan(self._source.data, start, end, line, "used in the settings of a motion")
        if approach := APPROACH.search(self._source.data, start, end):
            end = approach.start()
        try:
            pieces = split_commas(self._source.data, start, end)
        except ValueError as error:
            raise self._source.error(line, f"WITH: {error}; correct the file") from None
        for a, b in pieces:
            m = _SETTING.match(self._source.data, a, b)
            name = m[1].decode().upper() if m else ""
            if m and name in SYSTEM:
                value = frame_value(
                    self._source, m.end(), b, line, SYSTEM[name], self._names.fdats, self._names.constants
                )
                found = found._replace(tool=value) if SYSTEM[name] == "tool" else found._replace(base=value)
            elif m and name == "$IPO_MODE":
                found = found._replace(ipo=ipo_value(self._source.data[m.end() : b], self._names.fdats))
        return found

    def _general(self, statement: Statement) -> None:
        word, line, _, start, end = statement
        data, settings = self._source.data, self.block
        if found := _WITH.search(data, start, end):
            settings = self.settings(found.end(), end, line)
            end = found.start()
        if found := APPROACH.search(data, start, end):
            end = found.start()
        try:
            spans = split_commas(data, *strip(data, start, end, BLANK))
        except ValueError as error:
            raise self._source.error(line, f"{word}: {error}; correct the file") from None
        if len(spans) == 3 and word in CIRCLES and _CIRCLE_ANGLE.match(data, *spans[2]):
            self._names.scan(data, *spans.pop(), line)
        expected = 2 if word in CIRCLES else 1
        if len(spans) != expected or any(a == b for a, b in spans):
            self._names.scan(data, start, end, line)
            self.other(word, line, not_understood(f"{word} {shown(data, start, end)}".rstrip()))
            return
        motion = self._motion(word, line, settings)
        names = [f"{word}:{line}"] if expected == 1 else [f"{word}:{line} auxiliary", f"{word}:{line} end"]
        goals = [self._goal(a, b, name, motion) for (a, b), name in zip(spans, names, strict=True)]
        if expected == 2:
            self.circles.append(goals)

    def _goal(self, start: int, end: int, name: str, motion: KrlMotion) -> Goal:
        data = self._source.data
        if data[start : start + 1] == b"{" and closing_brace(self._source, start, end, motion.line) == end:
            return self._literal(start, end, name, motion)
        if m := _NAME.fullmatch(data, start, end):
            return self._point(m[1], m[2], motion)
        resolver = Resolver(self._names.find, self._names.number)
        goal = expression(self._source, start, end, motion.line, resolver, self._derivations)
        if isinstance(goal, (Variable, Shifted)):
            if isinstance(goal, Variable) and (found := self._derivations.element(goal)):
                for index in goal.indices:
                    self._read(index, motion.line)
                return self._element(*found, motion, goal)
            followed = self._follow(goal, motion)
            point = self.other(motion.word, motion.line, computed(shown(data, start, end)), name)
            self.computed[followed] = point
            return point
        self._names.scan(data, start, end, motion.line)
        code = _OPERATOR_WORD.sub(b"+", _BRACES.sub(b"{}", data[start:end]))
        if _ADJACENT.search(code) or not re.search(rb"[A-Za-z_$]", code):
            problem = not_understood(f"{motion.word} {shown(data, start, end)}")
            return self.other(motion.word, motion.line, problem, name)
        return self.other(motion.word, motion.line, computed(shown(data, start, end)), name)

    def _read(self, expression: Expression, line: int) -> None:
        """Note the points that an index reads."""
        for variable, place in self._derivations.points_in(expression):
            variable.reads[place].append((line, "read by arithmetic"))
            self._names.escape(variable, place, line, "read by arithmetic")

    def _literal(self, start: int, end: int, name: str, motion: KrlMotion) -> Goal:
        aggregate = parse_point(self._source, start, end, motion.line)
        self._names.scan_parts(aggregate, motion.line)
        numbers = Numbers(name, self._source, motion.line, aggregate, motion=motion)
        self._names.numbers.append(numbers)
        return numbers

    def _point(self, name: bytes, brackets: bytes | None, motion: KrlMotion) -> Goal:
        key = name.decode().upper()
        if key.startswith("$"):
            return self.other(motion.word, motion.line, RUN_TIME, name.decode())
        variable = self._names.find(key)
        if variable is None:
            variable = self._names.elsewhere[key] = PointVariable(name.decode(), "", motion.line, "nowhere")
        index = element(variable, brackets)
        if index is None and brackets is not None:
            self._names.scan(brackets, 0, len(brackets), motion.line)
        return self._element(variable, index, motion, self._derivations.point(variable, index))

    def _element(self, variable: PointVariable, index: Index, motion: KrlMotion, goal: Expression) -> Goal:
        """Note a motion to a point, or to an element of an array; None: any."""
        followed = None
        if variable.name.upper() in self._derivations.assigned:
            followed = self._follow(goal, motion, variable, index)
        variable.moves[index].append(motion)
        return Element(variable, index, followed)

    def _follow(
        self, goal: Expression, motion: KrlMotion, variable: PointVariable | None = None, index: Index = ()
    ) -> Followed:
        """Note a motion to a variable or to an expression."""
        followed = Followed(motion, next(self._numbers), variable, index)
        self.followed.append(followed)
        self._derivations.derivations.move(followed, goal, motion.place)
        return followed
