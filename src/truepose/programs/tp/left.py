"""The shifts of motions that called programs leave in force: those of programs beside the one that calls them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from truepose.errors import FileError
from truepose.programs.core import shifts
from truepose.programs.core.source import Source, shown
from truepose.programs.tp.registers import CALL
from truepose.programs.tp.sections import NUMBERED, REMARK

_CONCERNS: Final = re.compile(rb"[^\r\n]*\b(?:CALL|RUN|Track|Offset|SOFTFLOAT|FORCE|LINE|LNSCH)\b[^\r\n]*", re.I)
_TEXT: Final = re.compile(rb"'[^']*'|\"[^\"]*\"")


class LeftShifts:
    """Tells which shifts are in force behind calls.

    Parameters
    ----------
    path : Path
        The program that calls others.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._found: dict[str, dict[int, str]] = {}

    def by(self, name: str) -> list[str]:
        """Return the shifts that a program leaves, as its text has them, each with its place."""
        return sorted(self._by(name.upper()).values())

    def _by(self, name: str) -> dict[int, str]:
        if name not in self._found:
            self._found[name] = {}  # also of one that calls itself
            if (source := self._source(name)) is not None:
                self._found[name] = self._in(source)
        return self._found[name]

    def _source(self, name: str) -> Source | None:
        for path in (self._path.with_name(stem + self._path.suffix) for stem in (name, name.lower())):
            try:
                return Source.read(path)
            except FileError:
                continue  # it is elsewhere, or reading it will give the reason
        return None

    def _in(self, source: Source) -> dict[int, str]:
        """Return the shifts in force at the end of a program, by their kinds."""
        found: dict[int, str] = {}
        start, end = source.data.find(b"/MN"), source.data.find(b"/POS")
        for line in _CONCERNS.finditer(source.data, max(start, 0), end if end >= 0 else len(source.data)):
            m = NUMBERED.match(line[0])
            code = _TEXT.sub(b"", line[0][m.end() :] if m else line[0])
            if REMARK.match(code):
                continue
            for called in CALL.findall(code):
                found |= self._by(called.decode("latin-1").upper())
            for k, kind in enumerate(shifts.FANUC):
                if kind.ends is not None and kind.ends.search(code):
                    found.pop(k, None)
                elif begun := kind.begins.search(code):
                    place = f"line {source.line(line.start())} of {source.path.name}"
                    found[k] = f"{shown(begun[0].rstrip())} ({place})"
        return found
