"""Runs of points whose names differ in a number, such as ``P[17]{…}``, and runs of motions to them.

A point stays a row of its run as long as motions of runs are all that names it. A language's reader takes any other
row out of the run and reads it as a point of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from truepose._typing import BoolArray, IntArray
from truepose.programs.core import forms
from truepose.programs.core.forms import Lines
from truepose.programs.core.source import Source

DIGITS: Final = rb"[0-9]{1,9}+"
"""The number in a name."""
_ROOM: Final = 10**11


def code_of(digits: bytes, prefix: int = 0) -> int:
    """Return a number that stands for a name: its digits, leading zeros included, and the number of its prefix."""
    return int(b"1" + digits) + prefix * _ROOM


class Group(NamedTuple):
    """Consecutive points of one run that motions of one kind go to, one to each; or none at all.

    Attributes
    ----------
    run : int
        The number of the run.
    first, last : int
        The first point, and that behind the last, counted in the run.
    kind : int
        The kind of the motions, as the reader counts them; −1 without motions.
    lines : (n,) array of int
        The line of each motion.
    """

    run: int
    first: int
    last: int
    kind: int
    lines: NDArray[np.int32]


class NamedRuns:
    """The runs of one file.

    Parameters
    ----------
    source : Source
        The file.

    Attributes
    ----------
    taken : (n,) array of bool
        Whether each point is taken out.
    """

    def __init__(self, source: Source) -> None:
        self._data = source.data
        self._runs: list[Lines] = []
        self._codes: list[IntArray] = []
        self._moves: list[tuple[NDArray[np.int32], NDArray[np.int32], int]] = []
        self._last: tuple[int, list[int]] = (-1, [])
        self.taken: BoolArray = np.empty(0, bool)

    def declare(self, lines: Lines, prefix: int = 0) -> None:
        """Add a run of points; the first hole is the number in the name."""
        self._runs.append(lines)
        self._codes.append(self._read_codes(lines, 0, prefix))

    @property
    def end(self) -> int:
        """The byte behind the last run of points."""
        return self._runs[-1].end

    def ready(self) -> bool:
        """Prepare the search for points; False where two of them have one name."""
        self._starts = np.cumsum([0, *map(len, self._codes)])
        self._codes_in_order = codes = np.concatenate(self._codes) if self._codes else np.empty(0, np.int64)
        self._order = np.argsort(codes, kind="stable")
        self._sorted = codes[self._order]
        self.taken = np.zeros(len(codes), bool)
        return not (self._sorted[1:] == self._sorted[:-1]).any()

    def __len__(self) -> int:
        return len(self.taken)

    def rows(self, codes: IntArray) -> IntArray:
        """Return the places of points; −1 where there is none."""
        if not len(self):
            return np.full(len(codes), -1)
        at = np.minimum(np.searchsorted(self._sorted, codes), len(self) - 1)
        return np.where(self._sorted[at] == codes, self._order[at], -1)

    def take(self, row: int) -> tuple[int, int]:
        """Take a point out; return the number of its run, and where its text starts."""
        self.taken[row] = True
        run = int(np.searchsorted(self._starts, row, side="right")) - 1
        return run, self._items(run)[row - int(self._starts[run])]

    def move(self, lines: Lines, hole: int, kind: int, prefix: int = 0, source: Source | None = None) -> bool:
        """Add a run of motions to points of runs; False where they go to other points, too.

        `source` is the file of the motions; by default that of the points.
        """
        rows = self.rows(self._read_codes(lines, hole, prefix, source))
        if (rows < 0).any():
            return False
        self._moves.append((rows.astype(np.int32), lines.line + np.arange(lines.items, dtype=np.int32), kind))
        return True

    def groups(self, fits: Callable[[Group], bool]) -> Iterator[tuple[Group, Lines]]:
        """Yield the points that stay in their runs, with their lines; take all others out.

        `fits` is a function that returns whether the points of a group have one verdict and reason.
        """
        n = len(self)
        kind, line, count = np.full(n, -1, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
        for rows, lines, moved in self._moves:
            kind[rows], line[rows] = moved, lines
            np.add.at(count, rows, 1)
        self.taken |= count > 1
        for run, (start, end) in enumerate(pairwise(self._starts.tolist())):
            key = np.where(self.taken[start:end], -2, kind[start:end])
            cuts = [0, *(np.flatnonzero(np.diff(key)) + 1).tolist(), end - start]
            for first, last in pairwise(cuts):
                group = Group(run, first, last, int(key[first]), line[start + first : start + last])
                if group.kind == -2:
                    continue
                if last - first < forms.FEWEST or not fits(group):
                    self.taken[start + first : start + last] = True
                else:
                    yield group, self._runs[run].part(self._data, first, last)

    def left(self) -> Iterator[tuple[int, int, int]]:
        """Yield the motions to points that are taken out: row, line and kind, in the order of the text."""
        for rows, lines, kind in self._moves:
            for k in np.flatnonzero(self.taken[rows]).tolist():
                yield int(rows[k]), int(lines[k]), kind

    def codes(self, prefix: int) -> IntArray:
        """Return the codes of the points with a prefix, as without one."""
        found: IntArray = self._codes_in_order[self._codes_in_order // _ROOM == prefix] % _ROOM
        return found

    def name(self, row: int) -> tuple[int, str]:
        """Return the number of the prefix of a point's name, and its digits."""
        prefix, code = divmod(int(self._codes_in_order[row]), _ROOM)
        return prefix, str(code)[1:]

    def _read_codes(self, lines: Lines, hole: int, prefix: int, source: Source | None = None) -> IntArray:
        values, spans = lines.columns(source.data if source else self._data, slice(hole, hole + 1))
        digits = spans[:, 0, 1] - spans[:, 0, 0]
        codes: IntArray = 10**digits + values[:, 0].astype(np.int64) + prefix * _ROOM
        return codes

    def _items(self, run: int) -> list[int]:
        """Return where the text of each point of a run starts."""
        if self._last[0] != run:
            self._last = run, self._runs[run].starts(self._data)
        return self._last[1]
