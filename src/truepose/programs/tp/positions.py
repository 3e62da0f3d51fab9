"""The positions of a FANUC program, under /POS, with their own frame numbers.

Positions of one form that follow each other stay columns (`truepose.programs.core.named`) until something other than a
plain motion names one of them.
"""

from __future__ import annotations

import re
from typing import Final, Literal, NamedTuple

import numpy as np

from truepose.errors import FileError
from truepose.programs.core.forms import RunFinder, is_run
from truepose.programs.core.joint_targets import FANUC, JointNumbers
from truepose.programs.core.named import NamedRuns, code_of
from truepose.programs.core.points import JOINTS, Frame, Point, Problem, numbers_at
from truepose.programs.core.program import ReadOptions
from truepose.programs.core.source import Source, parse_number, shown
from truepose.programs.tp.words import check_language

_HEAD = re.compile(rb"(?<![\w$])P[ \t]*\[[ \t]*(\d{1,9})[ \t]*(?::[ \t]*(?:\"[^\"\r\n]*\"|[^\]\r\n]*))?\]\s*\{", re.I)
_GROUP = re.compile(rb"\bGP(\d{1,9})\s*:", re.I)
_FRAMES = re.compile(rb"\b(UF|UT)\s*:\s*([^\s,]*)", re.I)
_CONFIG = re.compile(rb"\bCONFIG\s*:\s*'([^'\r\n]*)'", re.I)
_VALUE = re.compile(rb"(?<![\w'])([XYZWPR]|R[XYZ]|J\d|E\d)[ \t]*=([ \t]*[^\s,;}]*)[ \t]*(mm|deg)?", re.I)
_ARM: Final = ("J1", "J2", "J3", "J4", "J5", "J6")
_AXES: Final = ("X", "Y", "Z", "W", "P", "R")
_UNIT: Final = dict(zip(_AXES, (b"mm", b"mm", b"mm", b"deg", b"deg", b"deg"), strict=True))
_NUMBER: Final = rb"[-+]?+(?:[0-9]{1,6}+(?:\.[0-9]{0,15}+)?+|\.[0-9]{1,15}+)"
"""A number as controllers write it: without a zero in front of the point."""
_CAM_POSITION: Final = re.compile(
    rb"P\[([1-9][0-9]{0,8}+)\][ \t]*+\{[^{}=]{0,200}?"
    + b"".join(
        rb"\b%s[ \t]*+=[ \t]*+(" % key.encode() + _NUMBER + rb")[ \t]++" + _UNIT[key] + rb"\b[,\s]*+" for key in _AXES
    )
    + rb"(?:GP\d:[^{}=]{0,200}?"
    + b"".join(
        (rb"(?:" if k > 1 else b"")
        + rb"\bJ%d[ \t]*+=[ \t]*+(" % k
        + _NUMBER
        + rb")[ \t]++(?:mm|deg)\b[,\s]*+"
        + (rb")?" if k > 1 else b"")
        for k in (1, 2, 3)
    )
    + rb")?\}[ \t]*+;?[ \t]*+\r?+\n",
    re.I,
)
"""A position as CAM systems write it, also with axes of a positioner; the general reader reads the first of many."""
VALUES: Final = slice(1, 7)
"""The holes of its numbers, behind that of its name."""
NAME: Final = rb"[1-9][0-9]{0,8}+"
NOT_TAUGHT: Final = Problem("skip", "not taught: it is not under /POS")
REMOTE: Final = Problem("refuse", "remote TCP: tool and frame change roles")
IN_FORCE: Final = Frame("F")
"""Frame of a position that is taught in whichever is in force."""


class Taught(NamedTuple):
    """The data of a position beside its numbers.

    Attributes
    ----------
    tool, base : Frame, optional
        The tool and frame in which it was taught; None where the text does not say it.
    others : frozenset of int
        The other motion groups of the position.
    """

    tool: Frame | None = None
    base: Frame | None = None
    others: frozenset[int] = frozenset()


class Positions:
    """The positions of one program.

    Parameters
    ----------
    source : Source
        The file.
    options : ReadOptions
        The options of reading.
    start, end : int
        The bytes between which they stand.
    group : int
        The motion group of the robot.

    Attributes
    ----------
    named : NamedRuns
        The positions that are rows of a run.
    first : list of Point
        The first position of each run.

    Raises
    ------
    FileError
        If a position is broken or given twice.
    """

    def __init__(self, source: Source, options: ReadOptions, start: int, end: int, group: int) -> None:
        self._source, self._options, self._group = source, options, group
        self._taught: dict[str, Taught] = {}
        if not self._read_in_runs(start, end):
            self._read(start, end, None)
            self.named.ready()

    def _read_in_runs(self, start: int, end: int) -> bool:
        """Read the positions in runs; False where the general reader must name what is broken or given twice."""
        try:
            self._read(
                start, end, RunFinder(self._source, _CAM_POSITION, {1: NAME, **dict.fromkeys(range(2, 11), _NUMBER)})
            )
        except FileError:
            return False
        numbers = np.array([code_of(b"%d" % number) for number in self._points], np.int64)
        return self.named.ready() and bool((self.named.rows(numbers) < 0).all())

    def ordered(self) -> list[Point]:
        """Return the positions outside of runs in the order of the file, and then those that are not taught."""
        points = self._points.values()
        taught = [point for point in points if point.problem != NOT_TAUGHT]
        return [*sorted(taught, key=lambda point: point.line), *(p for p in points if p.problem == NOT_TAUGHT)]

    def taught(self, point: Point) -> Taught:
        """Return the frames and motion groups of a position."""
        return self._taught.get(point.name, Taught())

    def moved_to(self, number: int, line: int) -> Point:
        """Return the position that a motion goes to, also if it is not taught."""
        point = self.get(number)
        if point is None:
            point = self._points[number] = Point(f"P[{number}]", self._source, line, problem=NOT_TAUGHT)
        return point

    def get(self, number: int) -> Point | None:
        """Return a position, taken out of its run."""
        if number not in self._points and (row := int(self.named.rows(np.array([code_of(b"%d" % number)]))[0])) >= 0:
            self.take_out(row)
        return self._points.get(number)

    def of_joints(self) -> list[Point]:
        """Return the positions in joint representation."""
        return [point for point in self._points.values() if point.joints is not None]

    def is_constant(self, number: int) -> bool:
        """Return whether a position has numbers, which the program never changes."""
        point = self.get(number)
        return point is not None and bool(point.values) and not point.writes

    def take_out(self, row: int) -> Point:
        """Take a position out of its run."""
        number, point = self.read_at(self.named.take(row)[1])
        return self._points.setdefault(number, point)

    def read_at(self, start: int) -> tuple[int, Point]:
        """Return the number of a position whose text starts at a byte, and the position."""
        m = _HEAD.match(self._source.data, start)
        assert m is not None  # it is one of a run
        number, close = int(m[1]), self._source.data.find(b"}", m.end())
        return number, self._position(number, self._source.line(start), m.end(), close)

    def all(self) -> list[Point]:
        """Return all positions, taken out of their runs."""
        for row in np.flatnonzero(~self.named.taken).tolist():
            self.take_out(row)
        return list(self._points.values())

    def _read(self, start: int, end: int, finder: RunFinder | None) -> None:
        data, source = self._source.data, self._source
        self._points: dict[int, Point] = {}
        self.named, self.first = NamedRuns(source), list[Point]()
        position = start
        while m := _HEAD.search(data, position, end):
            line = source.line(m.start(1))
            if data[position : m.start()].strip():
                raise source.error(
                    source.line(position + 1), "a position under /POS that is not understood; correct it"
                )
            number, close = int(m[1]), data.find(b"}", m.end(), end)
            if close < 0 or data.find(b"{", m.end(), close) >= 0:
                raise source.error(line, f"the brace of P[{number}] is not closed: the file is truncated or broken")
            if finder is not None and self._run(finder, number, line, m, close, end):
                position = self.named.end
                continue
            if number in self._points:
                raise source.error(line, f"P[{number}] is given twice, first in line {self._points[number].line}")
            self._points[number] = self._position(number, line, m.end(), close)
            position = close + 1
            while data[position : position + 1] in (b" ", b";", b"\t"):
                position += 1
        if data[position:end].strip():
            line = source.line(position + len(data[position:end]) - len(data[position:end].lstrip()))
            raise source.error(line, "a position under /POS that is not understood; correct it")

    def _run(self, finder: RunFinder, number: int, line: int, head: re.Match[bytes], close: int, end: int) -> bool:
        """Take a run of positions; return whether there is one."""
        if (lines := finder.find(head.start())) is None or lines.end > end:
            return False
        first = self._position(number, line, head.end(), close)
        if not is_run(lines, "fanuc", first, VALUES, blanks=True):
            return False
        self.named.declare(lines)
        self.first.append(first)
        return True

    def _position(self, number: int, line: int, start: int, end: int) -> Point:
        source, data = self._source, self._source.data
        point = Point(f"P[{number}]", source, line)
        groups = list(_GROUP.finditer(data, start, end))
        numbers = [int(m[1]) for m in groups] or [1]
        if self._group not in numbers:
            point.problem = Problem("skip", f"no position of group {self._group}, the robot")
            return point
        if groups:
            ours = numbers.index(self._group)
            start = groups[ours].end()
            end = groups[ours + 1].start() if ours + 1 < len(groups) else end
        frames: dict[bytes, bytes] = {m[1].upper(): m[2] for m in _FRAMES.finditer(data, start, end)}
        config = _CONFIG.search(data, start, end)
        if config is None:
            check_language(source, line, data[start:end])
        point.configuration = config[1].decode("latin-1") if config else ""
        point.problem = _problem_of(frames)
        self._taught[point.name] = Taught(
            frame_of(frames.get(b"UT", b""), "tool", self._group),
            frame_of(frames.get(b"UF", b""), "base", self._group),
            frozenset(numbers) - {self._group},
        )
        found: dict[str, re.Match[bytes]] = {}
        for m in _VALUE.finditer(data, start, end):
            key = m[1].decode().upper()
            if key in found:
                raise source.error(source.line(m.start()), f"P[{number}] gives {key} twice; keep one")
            found[key] = m
        if any(key.startswith("J") for key in found):
            self._take_joints(point, found, frames)
            return point
        if any(len(key) == 2 and key.startswith("R") for key in found):
            point.problem = REMOTE
            return point
        missing = [key for key in _AXES if key not in found]
        if missing:
            raise source.error(line, f"P[{number}] has no {', '.join(missing)}; correct the file")
        if any(found[key][2].strip().startswith(b"*") for key in _AXES):
            point.problem = Problem("skip", "not taught: its numbers are ****")
            return point
        for key in _AXES:
            if (found[key][3] or b"").lower() != _UNIT[key]:
                at = source.line(found[key].start())
                raise source.error(
                    at, f"P[{number}] {key}: expected a number in {_UNIT[key].decode()}; correct the file"
                )
        tokens = [found[key][2].strip() for key in _AXES]
        values, _ = numbers_at(source, source.line(found["X"].start()), _AXES, tokens, [0] * 6)
        point.values, point.spans = values, tuple([found[key].span(2) for key in _AXES])
        point.problem = point.problem or self._external([key for key in found if key.startswith("E")])
        return point

    def _external(self, keys: list[str]) -> Problem | None:
        if not keys or self._options.external_axes:
            return None
        reason = f"external axis {keys[0]} in group 1 has no model; allow external_axes if it does not move it"
        return Problem("refuse", reason)

    def _take_joints(self, point: Point, found: dict[str, re.Match[bytes]], frames: dict[bytes, bytes]) -> None:
        """Take a position in joint representation."""
        texts = {key: found[key][2].strip() for key in _ARM if key in found}
        in_degrees = all((found[key][3] or b"").lower() == b"deg" for key in texts)
        try:
            values = tuple([parse_number(text) for text in texts.values()])
        except ValueError:  # **** where it is not taught
            values = ()
        if len(values) < len(_ARM) or not in_degrees:
            point.problem = JOINTS
            return
        point.joints = JointNumbers(values, tuple([found[key].span(2) for key in _ARM]), FANUC)
        point.problem = _problem_of(frames, (b"UT",)) or self._external([key for key in found if key not in _ARM])


def _problem_of(frames: dict[bytes, bytes], needed: tuple[bytes, ...] = (b"UF", b"UT")) -> Problem | None:
    for key in needed:
        value = frames.get(key, b"")
        if value.upper() != b"F" and (not value.isdigit() or len(value) > 4):
            return Problem("refuse", f"{key.decode()} : {shown(value) or 'missing'}: teach it in a frame with a number")
    return None


def frame_of(digits: bytes, which: Literal["tool", "base"], group: int) -> Frame | None:
    """Return the tool or frame of a number; `IN_FORCE` for ``F``, None for anything else.

    The key of a frame is its number for group 1 and, for example, ``gp2-3`` for number 3 of group 2. Number 0 is the
    flange or the world of each group.
    """
    if digits.upper() == b"F":
        return IN_FORCE
    if not digits.isdigit() or len(digits) > 4:
        return None
    number, text = int(digits), {"tool": "UTOOL", "base": "UFRAME"}[which]
    if group == 1 or number == 0:
        return Frame(f"{text}[{number}]", number)
    return Frame(f"{text}[GP{group}:{number}]", f"gp{group}-{number}")
