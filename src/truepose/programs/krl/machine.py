"""KUKA's $machine.dat: where the robot stands in the world, $ROBROOT."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.geometry import euler, make_transform
from truepose.programs.core.source import Source
from truepose.programs.krl.lexer import CARTESIAN, closing_brace, parse_aggregate, statements

_KRL: Final = re.compile(rb"(?:DECL\s+)?(?:GLOBAL\s+)?(?:FRAME\s+)?\$(ROBROOT|WORLD)\s*(\.\s*\w+\s*)?=(?!=)\s*", re.I)


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
        if (m := _KRL.match(source.data, start, end)) is None:
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
