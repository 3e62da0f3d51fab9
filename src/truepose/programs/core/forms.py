"""Runs of lines of one form: the same text over and over, with other numbers.

The general reader of a language reads the first line of a run. `Form` is then the text of that line with holes in place
of its numbers, and the lines behind it that have exactly this text mean the same with other numbers. Nothing but the
place of such lines is kept; their numbers are found again when they are needed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.geometry import euler
from truepose.programs.core.columns import CHUNK, TargetColumns
from truepose.programs.core.digits import values_at, without_blanks
from truepose.programs.core.judge import Judge
from truepose.programs.core.order import Sweep
from truepose.programs.core.points import Point
from truepose.programs.core.source import Source
from truepose.programs.core.target import Target

FEWEST: Final = 16
"""Number of items of a run; fewer are read one by one."""
NUMBER: Final = rb"[-+]?+[0-9]{1,6}+(?:\.[0-9]{0,15}+)?+(?:[eE]-[0-9]{1,2}+)?+"
"""A number that is small enough for any limit on values and lengths."""
BLANKS: Final = rb"[ \t]*+"
_MOST_FORMS: Final = 64
"""Number of forms of a file; lines of further forms are read one by one."""
_IN_HOLES: Final = b"0123456789+-.eE \t"
_SEPARATES: Final = np.ones(256, bool)
_SEPARATES[list(_IN_HOLES)] = False


class Form:
    """The text of one item, whole lines, with holes.

    Parameters
    ----------
    texts : sequence of bytes
        The text before, between and behind the holes.
    patterns : sequence of bytes
        The pattern of each hole: characters of numbers and blanks only.

    Raises
    ------
    ValueError
        If nothing but characters of numbers separates two holes.
    """

    def __init__(self, texts: Sequence[bytes], patterns: Sequence[bytes]) -> None:
        one = b"".join(re.escape(text) + pattern for text, pattern in zip(texts, [*patterns, b""], strict=True))
        self._many = re.compile(rb"(?:" + one + rb"){0,%d}+" % CHUNK)
        self.lines = b"".join(texts).count(b"\n")
        before, after = [], []
        seen = 0  # of the characters that separate; the last of the item before is the first
        for k, text in enumerate(texts):
            marks = [i for i, c in enumerate(text) if c not in _IN_HOLES]
            if k and not marks:
                raise ValueError("holes that nothing separates")
            if k:
                after.append((seen + 1, marks[0]))
            seen += len(marks)
            if k < len(patterns):
                before.append((seen, len(text) - (marks[-1] if marks else -1)))
        self._separators = seen
        self._before, self._behind = np.array(before), np.array(after)

    def follow(self, data: bytes, position: int) -> tuple[int, int]:
        """Return the end of the items that start at a position, and their number; at most `CHUNK`."""
        m = self._many.match(data, position)
        assert m is not None  # no item at all matches, too
        return m.end(), data.count(b"\n", position, m.end()) // self.lines

    def spans(self, data: bytes, start: int, end: int) -> IntArray:
        """Return the holes of the items of a run, (items, holes, 2), blanks in front included."""
        text = np.frombuffer(data, np.uint8, end - start, start)
        marks = np.flatnonzero(_SEPARATES[text]).reshape(-1, self._separators) + start
        marks = np.column_stack([np.append(start - 1, marks[:-1, -1]), marks])
        first = marks[:, self._before[:, 0]] + self._before[:, 1]
        last = marks[:, self._behind[:, 0]] - self._behind[:, 1]
        return np.stack([first, last], axis=2)


class Lines(NamedTuple):
    """A run: its first line, its first byte and that behind the last, the number of its items, and their form."""

    line: int
    start: int
    end: int
    items: int
    form: Form

    def columns(self, data: bytes, holes: slice = slice(None), *, blanks: bool = False) -> tuple[FloatArray, IntArray]:
        """Return the values (items, holes) and the spans (items, holes, 2) of some holes.

        `blanks`: the spans include the blanks in front.
        """
        whole = self.form.spans(data, self.start, self.end)[:, holes]
        spans = without_blanks(data, whole)
        values = values_at(data, spans.reshape(-1, 2)).reshape(spans.shape[:2])
        return values, whole if blanks else spans

    @property
    def last_line(self) -> int:
        """The line of the last item."""
        return self.line + (self.items - 1) * self.form.lines

    def part(self, data: bytes, first: int, last: int) -> Lines:
        """Return the items from `first` to the one before `last`."""
        if last - first == self.items:
            return self
        borders = [*self.starts(data), self.end]
        return Lines(self.line + first * self.form.lines, borders[first], borders[last], last - first, self.form)

    def starts(self, data: bytes) -> list[int]:
        """Return the first byte of each item."""
        text = np.frombuffer(data, np.uint8, self.end - self.start, self.start)
        ends = np.flatnonzero(text == ord("\n"))[self.form.lines - 1 :: self.form.lines] + (self.start + 1)
        return [self.start, *ends[:-1].tolist()]


@dataclass(eq=False)
class RunFinder:
    """Finds the runs of a file.

    Parameters
    ----------
    source : Source
        The file.
    first : compiled pattern
        One line with its line end, as runs may have it. Its groups are the holes.
    patterns : mapping of int to bytes
        The patterns of groups that are not `NUMBER`.
    """

    source: Source
    first: re.Pattern[bytes]
    patterns: Mapping[int, bytes] = field(default_factory=dict)
    _forms: dict[tuple[bytes, ...], Form | None] = field(default_factory=dict)
    _looked: int = 0

    def find(self, position: int) -> Lines | None:
        """Return the run that starts at a line's start."""
        data = self.source.data
        if position < self._looked or not (m := self.first.match(data, position)):
            return None
        holes = [k for k in range(1, self.first.groups + 1) if m.start(k) >= 0]
        texts = self._texts(m, holes)
        if texts not in self._forms:
            count, ahead = 1, m
            while count < FEWEST:
                following = self.first.match(data, ahead.end())
                if following is None or self._texts(following, holes) != texts:
                    self._looked = ahead.end()
                    return None
                ahead, count = following, count + 1
            if len(self._forms) >= _MOST_FORMS:
                return None
            try:
                patterns = [BLANKS + self.patterns.get(k, NUMBER) for k in holes]
                self._forms[texts] = Form(texts, patterns)
            except ValueError:
                self._forms[texts] = None
        if (form := self._forms[texts]) is None:
            return None
        end, count = form.follow(data, position)
        if count < FEWEST:
            self._looked = end
            return None
        return Lines(self.source.line(position), position, end, count, form)

    def _texts(self, m: re.Match[bytes], holes: Sequence[int]) -> tuple[bytes, ...]:
        """Return the text of a line around its holes; blanks in front of a hole belong to it."""
        data, done, texts = self.source.data, m.start(), []
        for k in holes:
            start, end = m.span(k)
            texts.append(data[done:start].rstrip(b" \t"))
            done = end
        return (*texts, data[done : m.end()])


@dataclass(frozen=True, eq=False)
class Run:
    """Targets of one form.

    Attributes
    ----------
    source : Source
        The file.
    lines : Lines
        The lines.
    likes : tuple of Target
        The first target, judged; and once more for each other configuration.
    holes : slice
        The holes of a target's numbers.
    which : (n,) array of int, optional
        The place of each target in `likes`; None where there is one.
    name : tuple of str
        The text before and behind the first hole in the name of each target; empty where the motion names it.
    blanks : bool
        Whether the spans of numbers include the blanks in front.
    """

    source: Source
    lines: Lines
    likes: tuple[Target, ...]
    holes: slice
    which: NDArray[np.int16] | None = None
    name: tuple[str, str] | tuple[()] = ()
    blanks: bool = False

    def __len__(self) -> int:
        return self.lines.items

    @property
    def like(self) -> Target:
        """The first target."""
        return self.likes[0]

    def columns(self, alike: Sequence[Target], kinds: Sequence[int]) -> TargetColumns:
        """Return the targets, read from the file's bytes."""
        n = len(self)
        data = self.source.data
        values, spans = self.lines.columns(data, self.holes, blanks=self.blanks)
        values[:, :3] *= self.like.unit
        kind = np.full(n, kinds[0]) if self.which is None else np.array(kinds)[self.which]
        nothing, line = np.full(n, -1), self.lines.line + self.lines.form.lines * np.arange(n)
        names: list[str | None] = [None] * n
        if self.name:
            before, behind = self.name
            numbers = self.lines.columns(data, slice(0, 1))[1][:, 0].tolist()
            names = [before + data[a:b].decode() + behind for a, b in numbers]
        return TargetColumns(alike, kind, line, nothing, nothing, values, spans, names)


class FoundRun(NamedTuple):
    """A run as a reader finds it.

    Attributes
    ----------
    lines : Lines
        The lines.
    point : Point
        The first point, with its use if motions go to it.
    holes : slice
        The holes of a point's numbers.
    moved_in : (n,) array of int, optional
        The line of the motion to each point; without it the points are in the motions themselves.
    name, blanks
        As `Run` has them.
    """

    lines: Lines
    point: Point
    holes: slice
    moved_in: NDArray[np.int32] | None = None
    name: tuple[str, str] | tuple[()] = ()
    blanks: bool = False

    def judged(self, judge: Judge) -> tuple[Sweep | None, Run]:
        """Return the targets, and the motions to them."""
        point = self.point
        run = Run(point.source, self.lines, (judge.target(point),), self.holes, name=self.name, blanks=self.blanks)
        sweep = Sweep.of(point.uses[0].visit(0), len(run)) if point.uses else None
        return (sweep if sweep is None or self.moved_in is None else sweep._replace(line=self.moved_in)), run


def is_run(lines: Lines, controller: str, point: Point, holes: slice, *, blanks: bool = False) -> bool:
    """Return whether a run is read as the general reader read its first point, and every orientation is one."""
    values, spans = point.values, point.spans
    if not values:
        return False
    found, where = lines.columns(point.source.data, holes, blanks=blanks)
    if found[0].tolist() != list(values) or where[0].tolist() != [list(span) for span in spans]:
        return False
    try:
        euler(controller, found[:, 3:])
    except DataError:
        return False
    return True


def configured(like: Target, texts: Sequence[str]) -> tuple[Target, ...]:
    """Return a target once for each configuration."""
    return tuple([replace(like, configuration=text) for text in texts])
