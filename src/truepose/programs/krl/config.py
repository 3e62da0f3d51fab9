"""KUKA ``$config.dat``: the controller's numbered tools and bases."""

from __future__ import annotations

import re
from pathlib import Path

from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.geometry import euler, make_transform
from truepose.programs.core.source import Source
from truepose.programs.core.targets import Key
from truepose.programs.krl.lexer import CARTESIAN, closing_brace, parse_aggregate, statements, strip

_ENTRY = re.compile(rb"\s*\[\s*(\d{1,4})\s*\]\s*=\s*(?=\{)")


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
        if close != strip(source.data, entry.end(), end)[1]:
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
