"""APT / CL data (.apt, .cls): ``GOTO/x,y,z,i,j,k`` in the frame and with the orientation rule that the user states.

The rule (`ReadOptions.angles`) states whether the tool's z lies along the axis i, j, k ("z") or against it ("-z"). The
axis leaves the turn about itself open: the tool's x is taken as near to the frame's x as possible.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from truepose.programs.core.held import leave_held
from truepose.programs.core.points import (
    AS_MEASURED,
    NOT_HERE,
    RELATIVE,
    Frame,
    Point,
    Problem,
    numbers_at,
)
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Reader
from truepose.programs.core.source import NotAProgramError, Source

_STATEMENT = re.compile(rb"\s*([A-Z]\w*)[ \t]*(?:/|$|\s)", re.I)
_GOTO: Final = ("GOTO", "FROM")
_ARCS: Final = (
    *("MOVARC", "ARCMOV", "CIRCLE", "HELIX", "NURBS", "SPLINE"),
    *("GOFWD", "GOBACK", "GOLFT", "GORGT", "GOUP", "GODOWN"),
)
_CHANGES: Final = ("TRANS", "ORIGIN", "ROTABL", "ROTHED", "COPY", "TRACUT", "REFSYS", "CUTCOM", "MCS")
_KEYS: Final = ("x", "y", "z", "i", "j", "k")
_MM: Final = {"MM": 1.0, "MILLIMETER": 1.0, "MILLIMETERS": 1.0, "CM": 10.0, "INCH": 25.4, "INCHES": 25.4, "IN": 25.4}
_RULES: Final = ("z", "-z")


class _Statement(NamedTuple):
    line: int
    word: str
    pieces: list[tuple[bytes, int]]


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read APT or CL data; a FileError names the line if they are broken."""
    source = Source.read(path)
    reader = Reader(source, frames, options)
    points = reader.points
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    unit, unit_line = 1.0, 0
    changed = ""
    for line, word, pieces in _statements(source):
        words = [token.decode("latin-1").strip().upper() for token, _ in pieces]
        name = f"{word}:{line}"
        problem = None
        if word == "UNITS" and words:
            if words[0] not in _MM:
                raise source.error(line, f"UNITS/{words[0][:20]}: expected MM, CM or INCHES")
            if points and _MM[words[0]] != unit:
                raise source.error(line, f"the unit changes from line {unit_line or 1} on; split the file")
            unit, unit_line = _MM[words[0]], line
        elif word in _GOTO:
            if len(pieces) not in (3, 6):
                raise source.error(line, f"{name} has {len(pieces)} numbers, expected 3 or 6; correct the file")
            tokens, starts = zip(*pieces, strict=True)
            values, spans = numbers_at(source, line, _KEYS[: len(pieces)], tokens, starts)
            axis = values[3:] or axis
            if abs(sum(a * a for a in axis) - 1.0) > 1e-2:
                raise source.error(line, f"{name}: the tool axis does not have length 1; correct the file")
            if options.angles not in _RULES:
                problem = Problem("refuse", "state the direction of the tool axis on the tool (--angles z or -z)")
            elif changed:
                problem = Problem("refuse", f"{changed} changes the coordinates before it")
            padded = (*spans, NOT_HERE, NOT_HERE, NOT_HERE)[:6]
            point = Point(name, source, line, (*values[:3], *axis), padded, problem, uses=[reader.use(word, line)])
            points.append(point)
        elif word == "GODLTA":
            reader.other(word, line, RELATIVE)
        elif word in _ARCS:
            reader.other(word, line, Problem("refuse", f"{word} is a motion that is not supported"))
        elif word in _CHANGES and not changed and words[:1] not in (["OFF"], ["NOMORE"]):
            changed = f"{word} (line {line})"
    if not points:
        raise NotAProgramError(path, "has no GOTO: it is no APT or CL data")
    if options.orientation:
        leave_held(points)
    rule = options.angles if options.angles in _RULES else "z"
    return reader.program(f"apt {rule}", unit=unit, tool=Frame(AS_MEASURED))


def _statements(source: Source) -> Iterator[_Statement]:
    """Yield the statements; one goes on in the next line after a ``$``."""
    data = source.data
    open_: _Statement | None = None
    for line, start, end in source.lines():
        comment = data.find(b"$$", start, end)
        end = comment if comment >= 0 else end
        code = data[start:end]
        goes_on = code.rstrip().endswith(b"$")
        if goes_on:
            end = start + len(code.rstrip()) - 1
            code = data[start:end]
        if open_ is None:
            m = _STATEMENT.match(data, start, end)
            if m is None or not code.strip():
                continue
            open_ = _Statement(line, m[1].decode().upper(), [])
            slash = code.find(b"/")
            start = start + slash + 1 if slash >= 0 else end
        pieces, position = open_.pieces, start
        parts = data[start:end].split(b",")
        for k, part in enumerate(parts):
            text = part.strip()
            if text or (k < len(parts) - 1):
                pieces.append((text, position + len(part) - len(part.lstrip())))
            position += len(part) + 1
        if not goes_on:
            yield open_
            open_ = None
    if open_ is not None:
        raise source.error(open_.line, "a statement goes on after $ but the file ends: it is truncated")
