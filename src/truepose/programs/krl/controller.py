"""KUKA's own files: ``$config.dat`` with the tools and bases, ``$machine.dat`` with the place of the robot."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.geometry import euler, make_transform
from truepose.programs.core.program import Key
from truepose.programs.core.source import Source, strip
from truepose.programs.krl.lexer import BLANK, CARTESIAN, closing_brace, parse_aggregate, statements

_ENTRY: Final = re.compile(rb"\s*\[\s*(\d{1,4})\s*\]\s*=\s*(?=\{)")
_PLACE: Final = re.compile(rb"(?:DECL\s+)?(?:GLOBAL\s+)?(?:FRAME\s+)?\$(ROBROOT|WORLD)\s*(\.\s*\w+\s*)?=(?!=)\s*", re.I)


def read_config_dat(path: str | Path) -> tuple[dict[Key, FloatArray], dict[Key, FloatArray]]:
    """Return the tools and bases of a ``$config.dat``, by number.

    Everything but ``TOOL_DATA[n]={X …}`` and ``BASE_DATA[n]={X …}`` is passed over; an entry with components missing is
    not a known frame.

    Returns
    -------
    tools : dict of int to (4, 4) array [mm]
        Flange to tool.
    bases : dict of int to (4, 4) array [mm]
        The controller's world to frame; the world is the robot's base where $ROBROOT is the null frame.

    Raises
    ------
    FileError
        If the file cannot be read, has no such entry, gives one twice, or has a broken one; with its line.
    """
    source = Source.read(path)
    tables: dict[str, dict[Key, FloatArray]] = {"TOOL_DATA": {}, "BASE_DATA": {}}
    lines: dict[tuple[str, int], int] = {}
    for word, line, _, rest, end in statements(source):
        entry = _ENTRY.match(source.data, rest, end) if word in tables else None
        if entry is None:
            continue
        close = closing_brace(source, entry.end(), end, line)
        if close != strip(source.data, entry.end(), end, BLANK)[1]:
            raise source.error(line, f"{word}[{int(entry[1])}] is followed by more than its value; correct the file")
        aggregate = parse_aggregate(source, entry.end(), close, line)
        number = int(entry[1])
        if (word, number) in lines:
            raise source.error(line, f"{word}[{number}] was given in line {lines[word, number]} already; keep one")
        lines[word, number] = line
        if all(key in aggregate.values for key in CARTESIAN):
            pose = [aggregate.values[key] for key in CARTESIAN]
            tables[word][number] = make_transform(euler("kuka", pose[3:]), pose[:3])
    if not lines:
        raise FileError(path, "has no TOOL_DATA[n]={…} or BASE_DATA[n]={…}; name the controller's $config.dat")
    return tables["TOOL_DATA"], tables["BASE_DATA"]


def is_null(source: Source, start: int, end: int, line: int) -> bool:
    """Return whether the expression between two places of a KRL file is certainly the null frame."""
    code = source.data[start:end].strip()
    if code.upper() in (b"$NULLFRAME", b"$WORLD"):
        return True
    if not code.startswith(b"{"):
        return False
    begin = start + len(source.data[start:end]) - len(source.data[start:end].lstrip())
    close = closing_brace(source, begin, end, line)
    found = parse_aggregate(source, begin, close, line)
    return not source.data[close:end].strip() and not found.loose and not any(found.values.values())


def robot_root(path: Path) -> FloatArray | None:
    """Return $ROBROOT of a $machine.dat, (4, 4) [mm]; None where it is not given."""
    source, found = Source.read(path), None
    for _, line, start, _, end in statements(source):
        if (m := _PLACE.match(source.data, start, end)) is None:
            continue
        if is_null(source, m.end(), end, line):
            found = np.eye(4) if m[1].upper() == b"ROBROOT" else found
            continue
        values = {}
        if source.data[m.end() : m.end() + 1] == b"{" and not m[2]:
            values = parse_aggregate(source, m.end(), closing_brace(source, m.end(), end, line), line).values
        if m[1].upper() != b"ROBROOT" or set(values) != set(CARTESIAN):
            name = f"${m[1].decode().upper()}"
            raise source.error(line, f"{name} is not the null frame, nor a frame that can be used; correct the file")
        pose = [values[key] for key in CARTESIAN]
        found = make_transform(euler("kuka", pose[3:]), pose[:3])
    return found
