"""What a header line says: which column holds what, and in which unit. For vendor tables and spreadsheets."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

from truepose._io.units import MM_PER
from truepose.errors import FileError
from truepose.trackers.columns import Columns, find_delimiter
from truepose.trackers.readings import first_line

_ANGLE_UNITS: Final = ("deg", "rad", "mrad", "°")
_BRACKETS: Final = re.compile(r"^(?P<stem>.*?)\s*\[\s*(?P<unit>[^\]]*?)\s*\]$")
_PARENTHESES: Final = re.compile(rf"^(?P<stem>.*?)\s*\(\s*(?P<unit>{'|'.join((*MM_PER, *_ANGLE_UNITS))})\s*\)$")
_SUFFIX: Final = re.compile(rf"^(?P<stem>.+)_(?P<unit>{'|'.join((*MM_PER, *_ANGLE_UNITS))})$")
_STEMS: Final = {
    **{
        name: axis
        for axis in "xyz"
        for name in (axis, f"m{axis} coord", f"{axis} coord", f"actual {axis}", f"{axis} actual", f"meas {axis}")
    },
    **dict.fromkeys(("name", "element name", "point", "point name", "id", "point id", "nr", "no"), "name"),
    **dict.fromkeys(("time", "date", "date/time", "datetime", "timestamp", "time stamp"), "time"),
    **dict.fromkeys(("u(95)", "u95"), "u95"),
    **{f"q{k}": f"q{k}" for k in range(4)},
    **{f"r{axis}": f"r{axis}" for axis in "xyz"},
}
"""What a column is, by its name in lower case, without unit and without a dot at the end."""


def names_xyz(text: str) -> bool:
    """Return whether the first line names x, y and z, and between blanks as many columns as the next line has."""
    line = first_line(text)
    names = _names(line)
    if not {"x", "y", "z"} <= {_STEMS.get(_stem_and_unit(name)[0]) for name in names}:
        return False
    rows = [row for row in text.splitlines() if row.strip()]
    return find_delimiter(line) != " " or len(rows) < 2 or len(rows[1].split()) == len(names)


def header_columns(text: str, path: str | Path) -> Columns:
    """Return what the first line says about the columns.

    Raises
    ------
    FileError
        If x, y or z is not named or comes twice, they have different units, or angles a unit that is not known.
    """
    number, line = next(((n, ln) for n, ln in enumerate(text.splitlines(), start=1) if ln.strip()), (1, ""))
    found: dict[str, tuple[int, str]] = {}
    for column, name in enumerate(_names(line), start=1):
        stem, unit = _stem_and_unit(name)
        if (what := _STEMS.get(stem)) is None:
            continue
        if what in found and what in "xyz":
            message = f"columns {found[what][0]} and {column} are both {what}; say which with --columns"
            raise FileError(path, message, line=number)
        found.setdefault(what, (column, unit))
    if missing := [axis for axis in "xyz" if axis not in found]:
        raise FileError(path, f"has no column {missing[0]}; say which with --columns", line=number)
    units = {found[axis][1] for axis in "xyz"}
    if len(units) > 1:
        raise FileError(path, f"x, y and z have different units: {', '.join(sorted(units))}", line=number)
    values: dict[str, Any] = {what: found[what][0] for what in ("x", "y", "z", "name", "time") if what in found}
    if "u95" in found:
        values |= {"std": (found["u95"][0],), "std_factor": 0.5}
    values |= _rotation(found)
    return Columns(**values, unit=units.pop() or "mm", delimiter=find_delimiter(line), skip=number)


def states_unit(text: str) -> bool:
    """Return whether the header gives x a unit."""
    named = (_stem_and_unit(name) for name in _names(first_line(text)))
    return any(_STEMS.get(stem) == "x" and unit for stem, unit in named)


def _names(line: str) -> list[str]:
    """Return the names of a header line; between blanks a unit in brackets belongs to the name before it."""
    bare = line.lstrip("#% ")
    delimiter = find_delimiter(bare)
    return re.sub(r"(?<!\s)\s++(?=[\[(])", "", bare).split() if delimiter == " " else bare.split(delimiter)


def _rotation(found: dict[str, tuple[int, str]]) -> dict[str, Any]:
    for names in (("q0", "q1", "q2", "q3"), ("rx", "ry", "rz")):
        if set(names) <= found.keys():
            unit = found[names[0]][1].replace("°", "deg")
            return {"rotation": tuple(found[name][0] for name in names), **({"angle_unit": unit} if unit else {})}
    return {}


def _stem_and_unit(name: str) -> tuple[str, str]:
    plain = " ".join(name.strip().strip('"').split())
    for pattern in (_BRACKETS, _PARENTHESES, _SUFFIX):
        if found := pattern.match(plain):
            return found["stem"].lower().rstrip("."), found["unit"]
    return plain.lower().rstrip("."), ""
