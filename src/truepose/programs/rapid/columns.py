"""Robtargets whose names differ in a number, ``CONST robtarget p17:=…``, and runs of motions to them.

An offline system writes a path of a thousand targets as a thousand such declarations and as many motions. They stay
columns (`truepose.programs.core.named`) until anything else names one of them, which is then declared on its own.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from truepose._typing import IntArray
from truepose.programs.core.forms import Lines, is_run
from truepose.programs.core.named import Group, NamedRuns, code_of
from truepose.programs.core.points import Point, Use
from truepose.programs.core.source import Source
from truepose.programs.rapid.runs import OF_NAMED

_NAME: Final = re.compile(r"(.*[^0-9])([0-9]{1,9})", re.S)


class FoundGroup(NamedTuple):
    """Robtargets of one run that motions of one kind go to, one to each; or none at all.

    Attributes
    ----------
    point : Point
        The first of them, with its use.
    lines : Lines
        The lines of their declarations.
    group : Group
        The lines of the motions, among others.
    prefix : str
        The text in front of the number in their names.
    """

    point: Point
    lines: Lines
    group: Group
    prefix: str


class NamedTargets:
    """The runs of robtargets that one module declares.

    Parameters
    ----------
    source : Source
        The file.
    declare : callable
        A function of the first byte of a declaration that reads it on its own.
    local : bool
        Whether they are LOCAL.
    """

    def __init__(self, source: Source, declare: Callable[[int], None], *, local: bool) -> None:
        self._source, self._declare, self.local = source, declare, local
        self._runs = NamedRuns(source)
        self._prefixes: dict[str, int] = {}
        self._of_run: list[tuple[str, Callable[[int], Point]]] = []

    @property
    def declared(self) -> bool:
        """Whether there are any."""
        return bool(self._of_run)

    def declare(self, lines: Lines, first: Point, read: Callable[[int], Point]) -> bool:
        """Add a run; False if it is not read as the general reader read its first point.

        `read` is a function of the first byte of a declaration that returns its point.
        """
        m = _NAME.fullmatch(first.name)
        if m is None or not is_run(lines, "abb", first, OF_NAMED):
            return False
        if blank_in_name(lines, self._source):
            return False
        prefix = m[1].upper()
        self._runs.declare(lines, self._prefixes.setdefault(prefix, len(self._prefixes)))
        self._of_run.append((m[1], read))
        return True

    def ready(self) -> bool:
        """Prepare the search; False where two robtargets have one name."""
        return self._runs.ready()

    def numbers(self, prefix: str) -> IntArray:
        """Return the numbers of the names with a prefix, as one code for each."""
        return self._runs.codes(self._prefixes[prefix])

    @property
    def prefixes(self) -> Mapping[str, int]:
        """The texts in front of the numbers, in upper case."""
        return self._prefixes

    def row(self, name: str) -> int:
        """Return the place of a robtarget by its name in upper case; −1 where there is none or it is taken out."""
        m = _NAME.fullmatch(name)
        prefix = self._prefixes.get(m[1]) if m else None
        if m is None or prefix is None:
            return -1
        row = int(self._runs.rows(np.array([code_of(m[2].encode(), prefix)]))[0])
        return -1 if row < 0 or self._runs.taken[row] else row

    def take(self, row: int) -> None:
        """Take a robtarget out of its run, and declare it on its own."""
        self._declare(self._runs.take(row)[1])

    def take_all(self) -> None:
        """Take all robtargets out."""
        for row in np.flatnonzero(~self._runs.taken).tolist():
            self.take(row)

    def move(self, lines: Lines, prefix: str, kind: int, source: Source) -> bool:
        """Add a run of motions; False where they go to other robtargets, too. `prefix` is in upper case."""
        number = self._prefixes.get(prefix)
        return number is not None and self._runs.move(lines, 0, kind, number, source)

    def settle(self, uses: Sequence[Use]) -> Iterator[FoundGroup]:
        """Yield the robtargets that stay in their runs; take all others out.

        `uses` are the motions by their kinds, each with the line of any of them.
        """
        before = self._runs.taken.copy()
        for group, lines in self._runs.groups(lambda _: True):
            prefix, read = self._of_run[group.run]
            point = read(lines.start)
            if group.kind >= 0:
                point.uses = [at_line(uses[group.kind], int(group.lines[0]))]
            yield FoundGroup(point, lines, group, prefix)
        for row in np.flatnonzero(self._runs.taken & ~before).tolist():
            self._declare(self._runs.take(row)[1])

    def left(self) -> Iterator[tuple[str, int, int]]:
        """Yield the motions to robtargets that are taken out: name in upper case, line and kind."""
        names = {number: prefix for prefix, number in self._prefixes.items()}
        for row, line, kind in self._runs.left():
            number, digits = self._runs.name(row)
            yield names[number] + digits, line, kind


def at_line(use: Use, line: int) -> Use:
    """Return a motion in another line of its file."""
    return use._replace(line=line if isinstance(use.line, int) else use.line._replace(line=line))


def blank_in_name(lines: Lines, source: Source) -> bool:
    """Return whether a blank is in front of a number in a name, which is none then."""
    without, whole = (lines.columns(source.data, slice(0, 1), blanks=blanks)[1] for blanks in (False, True))
    return bool((without != whole).any())


def prefix_of(name: str) -> str:
    """Return the text in front of the number of a name; empty where it has none."""
    m = _NAME.fullmatch(name)
    return m[1] if m else ""
