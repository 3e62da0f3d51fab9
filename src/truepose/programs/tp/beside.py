"""What the programs in the folder of one do to it: the shifts that calls leave in force, and the frames they change."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

from truepose.errors import FileError
from truepose.programs.core import shifts
from truepose.programs.core.points import FileLine
from truepose.programs.core.source import Source, shown
from truepose.programs.tp.registers import CALL, effects_of
from truepose.programs.tp.sections import NUMBERED, REMARK

_CONCERNS: Final = re.compile(rb"\b(?:CALL|RUN|Track|Offset|SOFTFLOAT|FORCE|LINE|LNSCH)\b", re.I)
_LOOPS: Final = re.compile(rb"\bFOR[ \t]+R\b|\bLBL[ \t]*\[", re.I)
_TEXT: Final = re.compile(rb"'[^']*'|\"[^\"]*\"")


class _Version(NamedTuple):
    """A file as it is now: its path, the time of its last change, and its size."""

    path: Path
    changed: int
    size: int


class _Told(NamedTuple):
    """What a program tells: its calls and shifts in the order of the text, and the frames that it changes.

    A step is the name of a called program, or the number of a kind of shifts with the text of one that begins; empty
    where all of that kind end. `loops`: whether control may go back in the text.
    """

    steps: tuple[str | tuple[int, str], ...]
    loops: bool
    changes: tuple[tuple[FileLine, bytes, tuple[float, ...]], ...]


class Beside:
    """The knowledge of the programs of a folder, by their names in upper case.

    Parameters
    ----------
    told : mapping of str to _Told
        What each program tells.

    Attributes
    ----------
    left, entered : dict of str to set of str
        The shifts that may be in force when a program ends, and when it is called.
    """

    def __init__(self, told: dict[str, _Told] | None = None) -> None:
        self._told = told or {}
        self.left: dict[str, set[str]] = {name: set() for name in self._told}
        self.entered: dict[str, set[str]] = {name: set() for name in self._told}
        size = -1
        while size != (size := self._size()):
            for name in self._told:
                self._follow(name)

    def changes(self, name: str) -> list[tuple[FileLine, bytes, tuple[float, ...]]]:
        """Return the instructions of all programs but one that change a frame or a tool, with the constants set."""
        return [one for other, told in self._told.items() if other != name for one in told.changes]

    def _size(self) -> int:
        return sum(map(len, self.left.values())) + sum(map(len, self.entered.values()))

    def _follow(self, name: str) -> None:
        told, on = self._told[name], set[tuple[int, str]]()
        for step in told.steps * (2 if told.loops else 1):
            if isinstance(step, tuple):
                on = {one for one in on if one[0] != step[0]} if not step[1] else on | {step}
            elif step in self.entered:
                self.entered[step] |= {text for _, text in on} | self.entered[name]
                on |= {(-1, text) for text in self.left[step]}  # what a program leaves, its caller may not end
        self.left[name] |= {text for _, text in on}


def read_beside(path: Path) -> Beside:
    """Return the knowledge of the programs in the folder of one."""
    if not path.parent.is_dir():  # in a .zip, which holds a backup
        return Beside()
    files = [file for file in path.parent.iterdir() if file.suffix.lower() == path.suffix.lower() and file.is_file()]
    if len(files) == 1 and b"CALL" not in Source.read(path).data:  # a large one of a CAM system
        return Beside()
    return _read(tuple([_Version(file, (now := file.stat()).st_mtime_ns, now.st_size) for file in sorted(files)]))


@lru_cache(maxsize=2)
def _read(files: Sequence[_Version]) -> Beside:
    return Beside({file.path.stem.upper(): _tell(file.path) for file in files})


def _tell(path: Path) -> _Told:
    try:
        source = Source.read(path)
    except FileError:
        return _Told((), False, ())  # reading it will give the reason
    data, steps = source.data, list[str | tuple[int, str]]()
    start, end = max(data.find(b"/MN"), 0), data.find(b"/POS")
    done = start
    while m := _CONCERNS.search(data, done, end if end >= 0 else len(data)):
        first = max(data.rfind(b"\n", 0, m.start()), data.rfind(b"\r", 0, m.start())) + 1
        done = min((k for k in (data.find(b"\n", m.end()), data.find(b"\r", m.end())) if k >= 0), default=len(data))
        numbered = NUMBERED.match(data, first)
        code = _TEXT.sub(b"", data[numbered.end() if numbered else first : done])
        if REMARK.match(code):
            continue
        for k, kind in enumerate(shifts.FANUC):
            if kind.ends is not None and kind.ends.search(code):
                steps.append((k, ""))
            elif begun := kind.begins.search(code):
                steps.append((k, f"{shown(begun[0].rstrip())} (line {source.line(m.start())} of {path.name})"))
        steps += [called.decode("latin-1").upper() for called in CALL.findall(code)]
    effects = effects_of(data)
    return _Told(
        tuple(steps),
        _LOOPS.search(data) is not None,
        tuple([(FileLine(path.name, line), code, effects.constant_in(line)) for line, code in effects.changes]),
    )
