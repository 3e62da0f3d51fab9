"""The positions of an INFORM job, under //POS, whose kind, tool and frame are modal.

Positions of one form that follow each other stay columns (`truepose.programs.core.named`) until something other than a
plain motion names one of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from truepose.errors import FileError
from truepose.programs.core.forms import BLANKS, NUMBER, RunFinder, is_run
from truepose.programs.core.joint_targets import STATE, JointNumbers, in_pulses
from truepose.programs.core.named import NamedRuns, code_of
from truepose.programs.core.points import JOINTS, Frame, Point, Problem, numbers_at
from truepose.programs.core.source import Source, Span, shown
from truepose.programs.inform.controller import Controller, Pose

_POSITION = re.compile(rb"[ \t]*(B?E?[CP]|EX)(\d{3,6})[ \t]*=[ \t]*")
_MODAL = re.compile(rb"[ \t]*///(\w+)[ \t]*([^\r\n]*)")
_CAM_POSITION: Final = re.compile(
    rb"[ \t]*+C([0-9]{3,6}+)[ \t]*+=" + rb",".join([BLANKS + rb"(" + NUMBER + rb")" + BLANKS] * 6) + rb"\r?+\n"
)
"""A position as CAM systems write it; the general reader reads the first of many."""
VALUES: Final = slice(1, 7)
"""The holes of its numbers, behind that of its name."""
NAME: Final = rb"[0-9]{3,6}+"
_KEYS: Final = ("X", "Y", "Z", "Rx", "Ry", "Rz")
_BASES: Final = ("BASE", "ROBOT")
_WIDTHS: Final = range(3, 7)
"""Numbers of digits in the name of a position."""


class Frames(NamedTuple):
    """The tool and the frame in which a position was taught."""

    tool: Frame | None = None
    frame: Frame | None = None


class Positions:
    """The positions of one job.

    Parameters
    ----------
    source : Source
        The file.
    spans : iterable of Span
        The bytes between which they stand.
    controller : Controller
        The knowledge of all jobs.

    Attributes
    ----------
    named : NamedRuns
        The positions that are rows of a run.
    first : list of Point
        The first position of each run.
    axes_in_use : set of (str, int)
        The positions of base axes and stations away from zero, such as ("BC", 7).

    Raises
    ------
    FileError
        If a position is broken or given twice.
    """

    def __init__(self, source: Source, spans: Iterable[Span], controller: Controller, *, own_arm: bool = False) -> None:
        self._source, self._spans = source, list(spans)
        why = controller.no_pulses
        if controller.pulses and controller.own_lengths and not own_arm:
            why = f"the controller has lengths of its own, {controller.own_lengths}; {STATE}"
        known = controller.pulses and not (controller.own_lengths and not own_arm)
        self._no_pulses = Problem("skip", f"{JOINTS.reason} (pulses): {why}")
        self._form = in_pulses(controller.pulses, controller.lengths if own_arm else None) if known else None
        if not self._read_in_runs():
            self._read(None)
            self.named.ready()

    def _read_in_runs(self) -> bool:
        """Read the positions in runs; False where the general reader must name what is broken or given twice."""
        try:
            self._read(RunFinder(self._source, _CAM_POSITION, {1: NAME}))
        except FileError:
            return False
        codes = np.array([code_of(b"%0*d" % (w, n)) for k, n in self._points if k == "C" for w in _WIDTHS], np.int64)
        return self.named.ready() and self._one_width() and bool((self.named.rows(codes) < 0).all())

    def _one_width(self) -> bool:
        """Return whether no two positions of runs differ in leading zeros only."""
        return len({len(point.name) for point in self.first}) < 2

    def ordered(self) -> list[Point]:
        """Return the positions outside of runs in the order of the file."""
        return sorted(self._points.values(), key=lambda point: point.line)

    def get(self, kind: str, number: int) -> Point | None:
        """Return a position, taken out of its run; `kind` is "C" or "P"."""
        if (kind, number) not in self._points and kind == "C" and len(self.named):
            rows = self.named.rows(np.array([code_of(b"%0*d" % (w, number)) for w in _WIDTHS], np.int64))
            for row in rows[rows >= 0].tolist():
                self.take_out(row)
        return self._points.get((kind, number))

    def take_out(self, row: int) -> Point:
        """Take a position out of its run."""
        run, start = self.named.take(row)
        point = self.read_at(start, self.first[run])
        return self._points.setdefault(("C", int(point.name[1:])), point)

    def read_at(self, start: int, first: Point) -> Point:
        """Return the position whose line starts at a byte, in a run whose first position is given."""
        m = _POSITION.match(self._source.data, start)
        assert m is not None  # it is one of a run
        line = self._source.line(start)
        point = self._numbers(m, line, self._source.data.find(b"\n", m.end()))
        point.problem, point.configuration = first.problem, first.configuration
        self._frames_of[id(point)] = self.frames_of(first)
        self._kept.append(point)
        return point

    def frames_of(self, point: Point) -> Frames:
        """Return the tool and frame in which a position was taught."""
        return self._frames_of.get(id(point), Frames())

    def variables(self) -> list[tuple[int, Point, Pose | None]]:
        """Return the copies of P variables: number, point, and the position unless it is in pulses."""
        found = []
        for (kind, number), point in self._points.items():
            if kind == "P":
                frame = self.frames_of(point).frame
                pose = Pose(point.values, frame.text if frame else "") if point.values else None
                found.append((number, point, pose))
        return found

    def _read(self, finder: RunFinder | None) -> None:
        self._points: dict[tuple[str, int], Point] = {}
        self._frames_of: dict[int, Frames] = {}
        self._kept: list[Point] = []  # `_frames_of` tells points by their ids
        self._modal: dict[str, str] = {}
        self.named, self.first = NamedRuns(self._source), list[Point]()
        self.axes_in_use: set[tuple[str, int]] = set()
        for position, end in self._spans:
            while position < end:
                for line, a, b in self._source.lines(position, end):
                    if finder is not None and self._run(finder, line, a, b, end):
                        position = self.named.end
                        break
                    self._line(line, a, b)
                else:
                    break

    def _run(self, finder: RunFinder, line: int, start: int, stop: int, end: int) -> bool:
        """Take a run of positions; return whether there is one."""
        lines, m = finder.find(start), _POSITION.match(self._source.data, start)
        if lines is None or lines.end > end or m is None:
            return False
        first = self._position(m, line, stop)
        if not first.values or not is_run(lines, "yaskawa", first, VALUES):
            return False
        self.named.declare(lines)
        self.first.append(first)
        return True

    def _line(self, line: int, start: int, end: int) -> None:
        data, source = self._source.data, self._source
        if modal := _MODAL.match(data, start, end):
            self._modal[modal[1].decode("latin-1").upper()] = modal[2].decode("latin-1").strip()
            return
        m = _POSITION.match(data, start, end)
        if m is None:
            if data[start:end].strip():
                raise source.error(line, f"a line under //POS that is not understood: {shown(data[start:end])}")
            return
        kind, number = m[1].decode(), int(m[2])
        if kind not in ("C", "P"):
            if any(token.strip(b" \t+-0.") for token in data[m.end() : end].split(b",")):
                self.axes_in_use.add((kind, number))
            return
        if (kind, number) in self._points:
            name, before = data[m.start(1) : m.end(2)].decode("latin-1"), self._points[kind, number]
            raise source.error(line, f"{name} is given twice, first in line {before.line}")
        self._points[kind, number] = self._position(m, line, end)

    def _position(self, m: re.Match[bytes], line: int, end: int) -> Point:
        """Return a position with the tool and frame of the modal lines above it."""
        postype, tool, user = (self._modal.get(key, "") for key in ("POSTYPE", "TOOL", "USER"))
        postype = postype.upper()
        point = self._pulses(m, line, end) if postype == "PULSE" else self._numbers(m, line, end)
        point.configuration = self._modal.get("RCONF", "")
        tool_frame = Frame(f"TOOL {int(tool)}", int(tool)) if _small(tool) else None
        frame = None
        if postype in _BASES:
            frame = Frame(postype, 0)
        elif postype == "USER" and _small(user):
            frame = Frame(f"USER {int(user)}", int(user))
        elif point.problem is None and point.joints is None:
            said = f"///POSTYPE {postype or 'missing'}" + (" without ///USER" if postype == "USER" else "")
            point.problem = Problem("refuse", f"{said}: the frame of its numbers is not known")
        if tool and tool_frame is None and point.problem is None:
            point.problem = Problem("refuse", f"///TOOL {tool}: its tool is not known")
        self._frames_of[id(point)] = Frames(tool_frame, frame)
        self._kept.append(point)
        return point

    def _pulses(self, m: re.Match[bytes], line: int, end: int) -> Point:
        """Return a position in pulses."""
        point = Point(m[1].decode() + m[2].decode(), self._source, line)
        tokens, starts = self._tokens(m, end)
        if self._form is None:
            point.problem = self._no_pulses
        elif len(tokens) != self._form.count or not all(re.fullmatch(rb"-?[0-9]{1,9}", token) for token in tokens):
            point.problem = Problem("skip", f"{JOINTS.reason} ({len(tokens)} pulses): expected six whole numbers")
        else:
            spans = [(start, start + len(token)) for start, token in zip(starts, tokens, strict=True)]
            point.joints = JointNumbers(tuple(map(float, tokens)), tuple(spans), self._form)
        return point

    def _tokens(self, m: re.Match[bytes], end: int) -> tuple[list[bytes], list[int]]:
        """Return the numbers of a position as they are written, and where each starts."""
        tokens, starts, position = [], [], m.end()
        for piece in self._source.data[m.end() : end].split(b","):
            tokens.append(piece.strip())
            starts.append(position + len(piece) - len(piece.lstrip()))
            position += len(piece) + 1
        return tokens, starts

    def _numbers(self, m: re.Match[bytes], line: int, end: int) -> Point:
        """Return a position with its numbers."""
        point = Point(m[1].decode() + m[2].decode(), self._source, line)
        tokens, starts = self._tokens(m, end)
        if len(tokens) < 6:
            raise self._source.error(line, f"{point.name} has {len(tokens)} numbers, expected 6; correct the file")
        point.values, point.spans = numbers_at(self._source, line, _KEYS, tokens[:6], starts[:6])
        if len(tokens) > 6:
            reason = f"{len(tokens)} numbers: a seventh axis, which has no model, or a number that a comma splits"
            point.problem = Problem("refuse", reason)
        return point


def _small(text: str) -> bool:
    return text.isdecimal() and text.isascii() and len(text) < 5
