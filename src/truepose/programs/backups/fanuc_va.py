"""Variables of a FANUC controller in text form (.VA): arrays of positions, and comments."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from truepose._typing import FloatArray
from truepose.geometry import euler, make_transform
from truepose.programs.core.source import Source, parse_number, shown

_ARRAY = re.compile(rb"[ \t]*\[\*\w+\*\](\$?\w+)")
_ENTRY = re.compile(rb"[ \t]*\[[ \t]*(\d{1,4})[ \t]*(?:,[ \t]*(\d{1,4})[ \t]*)?\][ \t]*=(.*)", re.S)
_NAME = re.compile(rb"'([^'\r\n]*)'")
_VALUE = re.compile(rb"(?<![\w$])([XYZWPR]):[ \t]*([^\s]+)")
_JOINT = re.compile(rb"(?<![\w$])J\d[ \t]*[=:]")
_AXES: Final = "XYZWPR"
_STARS: Final = b"*"


class Entry(NamedTuple):
    """An element of an array.

    Attributes
    ----------
    indices : tuple of int
        Its indices: those of the motion group and of the number, or that of the number alone.
    line : int
        Its first line.
    name : str
        The comment of the operator.
    text : bytes
        All behind the equals sign, to the next element.
    """

    indices: tuple[int, ...]
    line: int
    name: str
    text: bytes


def entries(source: Source, array: bytes) -> Iterator[Entry]:
    """Yield the elements of an array, such as ``$MNUFRAME``; a FileError names one that is given twice."""
    seen: dict[tuple[int, ...], int] = {}
    for entry in _entries(source, array.upper()):
        if entry.indices in seen:
            where = f"{array.decode()}[{','.join(map(str, entry.indices))}]"
            raise source.error(entry.line, f"{where} is given twice, first in line {seen[entry.indices]}; keep one")
        seen[entry.indices] = entry.line
        yield entry


def _entries(source: Source, array: bytes) -> Iterator[Entry]:
    inside, current = False, list[Entry]()
    for line, start, end in source.lines():
        text = source.data[start:end]
        head, first = _ARRAY.match(text), _ENTRY.match(text) if inside else None
        ends = not text.strip() and bool(current)  # a blank line may also stand before the first element
        if head or first or ends:
            yield from current
            current = []
        if head:
            inside = head[1].upper() == array
        elif first:
            name = _NAME.search(first[3])
            indices = tuple(int(digits) for digits in first.groups()[:2] if digits)
            current = [Entry(indices, line, name[1].decode("latin-1").strip() if name else "", first[3])]
        elif ends:
            inside = False
        elif current:
            current = [current[0]._replace(text=current[0].text + b"\n" + text)]
    yield from current


def numbers(source: Source, entry: Entry) -> tuple[float, ...] | None:
    """Return X, Y, Z [mm], W, P, R [deg] of an element; None where it is not set or gives joints.

    Raises
    ------
    FileError
        If numbers are missing, given twice or broken.
    """
    text = _NAME.sub(b"", entry.text)
    if b"Uninitialized" in text or _JOINT.search(text):
        return None
    found: dict[str, float] = {}
    for m in _VALUE.finditer(text):
        key, line = m[1].decode(), entry.line + text.count(b"\n", 0, m.start())
        if m[2].startswith(_STARS):
            return None
        if key in found:
            raise source.error(line, f"{key} is given twice; correct the file")
        try:
            found[key] = parse_number(m[2])
        except ValueError as error:
            raise source.error(line, f"{key}: {error}; correct the file") from None
    if missing := [key for key in _AXES if key not in found]:
        reason = f"{shown(entry.text) or 'an element'} has no {', '.join(missing)}: the file is truncated or broken"
        raise source.error(entry.line, reason)
    return tuple(found[key] for key in _AXES)


def transform(values: tuple[float, ...]) -> FloatArray:
    """Return the transform (4, 4) [mm] of X, Y, Z [mm], W, P, R [deg]."""
    return make_transform(euler("fanuc", list(values[3:])), list(values[:3]))
