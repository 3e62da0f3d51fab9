"""KRL motions: PTP, LIN, CIRC, their spline relatives, and where each of them goes."""

from __future__ import annotations

import re
from typing import NamedTuple

from truepose.programs.core.flow import Flow, InForce
from truepose.programs.core.points import Visit
from truepose.programs.core.source import Source
from truepose.programs.core.target import Target, Verdict
from truepose.programs.krl.frames import SYSTEM, frame_value, ipo_value
from truepose.programs.krl.lexer import Lines, Statement, closing_brace, parse_point, shown, split_commas, strip
from truepose.programs.krl.names import Names, element
from truepose.programs.krl.points import Numbers, Use, Variable
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
    """What WITH sets for one motion or for a spline block."""

    tool: InForce | None = None
    base: InForce | None = None
    ipo: str | None = None


class Goal(NamedTuple):
    """Where a motion goes: numbers or a target without numbers, or a point."""

    numbers: int | None = None
    other: int | None = None
    variable: Variable | None = None
    brackets: bytes | None = None


class MotionReader:
    """Reads motion statements of one .src.

    Attributes
    ----------
    others : list of Target
        Motions whose target is in no file: left as they are, or refused.
    sections : list of int
        Those of `others`, as in `truepose.programs.core.points.Visit`.
    circles : list of list of Goal
    block : Settings
        Of the spline block that is open.
    """

    def __init__(self, source: Source, names: Names, flow: Flow, *, named: bool = False) -> None:
        self._source, self._names, self._flow = source, names, flow
        self._file = source.path.name if named else ""
        self.others: list[Target] = []
        self.sections: list[int] = []
        self.circles: list[list[Goal]] = []
        self.block = Settings()

    def other(self, word: str, line: int, verdict: Verdict, reason: str, name: str = "") -> int:
        """Note a motion that has no numbers to correct; return its place."""
        self.others.append(Target(name or f"{word}:{line}", self._source.path, line, (word,), verdict, reason))
        self.sections.append(self._flow.section)
        return len(self.others) - 1

    def visits(self, first: int) -> list[Visit]:
        """Return the motions to `others`, which begin at `first` in a list of all targets."""
        return [
            Visit(self._file, target.line, 0, section, i, target.motions[0])
            for i, (target, section) in enumerate(zip(self.others, self.sections, strict=True), first)
        ]

    def read(self, statement: Statement) -> list[str]:
        """Take one motion; return the subprograms that its expressions call."""
        word, line, _, start, end = statement
        data = self._source.data
        if word not in CIRCLES and (m := _SIMPLE.fullmatch(data, start, end)):
            use = Use(word, line, self._flow.node, *self.block, self._file, self._flow.section)
            if m[1]:
                self._literal(*m.span(1), f"{word}:{line}", use)
                return []
            if not APPROACH.fullmatch(b" " + m[2]):
                self._point(m[2], m[3], use)
                return []
        return self._general(statement)

    def first_of(self, lines: Lines) -> Numbers:
        """Return the first point of a run of alike motions."""
        m = _FIRST.match(self._source.data, lines.start)
        assert m is not None
        word = m[1].decode().upper()
        use = Use(word, lines.line, self._flow.node, *self.block, self._file, self._flow.section)
        aggregate = parse_point(self._source, *m.span(2), lines.line)
        return Numbers(f"{word}:{lines.line}", self._source, lines.line, aggregate, use=use)

    def settings(self, start: int, end: int, line: int) -> Settings:
        """Read the assignments behind WITH."""
        found = self.block
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
                value = frame_value(self._source, m.end(), b, line, SYSTEM[name], self._names.fdats)
                found = found._replace(tool=value) if SYSTEM[name] == "tool" else found._replace(base=value)
            elif m and name == "$IPO_MODE":
                found = found._replace(ipo=ipo_value(self._source.data[m.end() : b], self._names.fdats))
        return found

    def _general(self, statement: Statement) -> list[str]:
        word, line, _, start, end = statement
        data, settings = self._source.data, self.block
        if found := _WITH.search(data, start, end):
            settings = self.settings(found.end(), end, line)
            end = found.start()
        if found := APPROACH.search(data, start, end):
            end = found.start()
        try:
            spans = split_commas(data, *strip(data, start, end))
        except ValueError as error:
            raise self._source.error(line, f"{word}: {error}; correct the file") from None
        if len(spans) == 3 and word in CIRCLES and _CIRCLE_ANGLE.match(data, *spans[2]):
            spans.pop()
        expected = 2 if word in CIRCLES else 1
        if len(spans) != expected or any(a == b for a, b in spans):
            self.other(word, line, "refuse", f"a motion that is not understood: {word}{shown(data, start, end)}")
            return []
        use = Use(word, line, self._flow.node, *settings, self._file, self._flow.section)
        names = [f"{word}:{line}"] if expected == 1 else [f"{word}:{line} auxiliary", f"{word}:{line} end"]
        calls: list[str] = []
        goals = [self._goal(a, b, name, use, calls) for (a, b), name in zip(spans, names, strict=True)]
        if expected == 2:
            self.circles.append(goals)
        return calls

    def _goal(self, start: int, end: int, name: str, use: Use, calls: list[str]) -> Goal:
        data = self._source.data
        if data[start : start + 1] == b"{" and closing_brace(self._source, start, end, use.line) == end:
            return self._literal(start, end, name, use)
        if m := _NAME.fullmatch(data, start, end):
            return self._point(m[1], m[2], use)
        calls += self._names.scan(data, start, end, use.line)
        code = _OPERATOR_WORD.sub(b"+", _BRACES.sub(b"{}", data[start:end]))
        if _ADJACENT.search(code) or not re.search(rb"[A-Za-z_$]", code):
            reason = f"a motion that is not understood: {use.word} {shown(data, start, end)}"
            return Goal(other=self.other(use.word, use.line, "refuse", reason, name))
        reason = f"target computed at run time: {shown(data, start, end)}"
        return Goal(other=self.other(use.word, use.line, "skip", reason, name))

    def _literal(self, start: int, end: int, name: str, use: Use) -> Goal:
        aggregate = parse_point(self._source, start, end, use.line)
        self._names.numbers.append(Numbers(name, self._source, use.line, aggregate, use=use))
        return Goal(numbers=len(self._names.numbers) - 1)

    def _point(self, name: bytes, brackets: bytes | None, use: Use) -> Goal:
        key = name.decode().upper()
        if key.startswith("$"):
            return Goal(other=self.other(use.word, use.line, "skip", "target known at run time only", name.decode()))
        variable = self._names.find(key)
        if variable is None:
            variable = self._names.elsewhere[key] = Variable(name.decode(), "", use.line, "nowhere")
        variable.moves[element(variable, brackets)].append(use)
        return Goal(variable=variable, brackets=brackets)
