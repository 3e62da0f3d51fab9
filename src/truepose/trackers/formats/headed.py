"""Tables whose header line names the columns and their units; the spreadsheet layout (layout 7).

Spreadsheets have semicolons and decimal commas, or commas and points. Time stamps that a spreadsheet rounded to
``2,02E+13`` are left out, and the summary says so. Lengths without a unit are mm; values that seem to be metres are
refused.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from truepose._io.delimited import TITLES, find_delimiter
from truepose._io.units import is_length, split_unit
from truepose.errors import FileError
from truepose.samples import Samples
from truepose.samples.columns import POINT_NAMES
from truepose.trackers.columns import Columns, read_columns
from truepose.trackers.layout import Layout, row_names
from truepose.trackers.readings import Readings, first_line

STEMS: Final = {
    **{
        name: axis
        for axis in "xyz"
        for name in (axis, f"m{axis} coord", f"{axis} coord", f"actual {axis}", f"{axis} actual", f"meas {axis}")
    },
    **dict.fromkeys(POINT_NAMES, "name"),
    **dict.fromkeys(("time", "date", "date/time", "datetime", "timestamp", "time stamp"), "time"),
    **dict.fromkeys(("u(95)", "u95"), "u95"),
    **{f"q{k}": f"q{k}" for k in range(4)},
    **{f"r{axis}": f"r{axis}" for axis in "xyz"},
}
"""The quantity of a column, by its name in lower case without unit and final dot."""


def _names_xyz(text: str) -> bool:
    """Return whether a header names x, y and z and, between blanks, as many columns as the next line has."""
    return bool(_header(text).names)


@dataclass(frozen=True)
class _Header:
    """The line that names the columns, its number, and the names; without names there is no such line."""

    number: int = 1
    line: str = ""
    names: tuple[str, ...] = ()


def _header(text: str) -> _Header:
    """Return the header of a table: its first line, or the first of the next ones that names x, y and z.

    An empty name (a merged cell) is that of the line above; a unit in the line above holds for the columns below it.
    """
    rows = [(number, row) for number, row in enumerate(text.splitlines(), start=1) if row.strip()]
    for k, (number, line) in enumerate(rows[:TITLES]):
        names = _names(line)
        if {"x", "y", "z"} <= {STEMS.get(split_unit(name)[0]) for name in names}:
            whole = find_delimiter(line) != " " or k + 1 == len(rows) or len(rows[k + 1][1].split()) == len(names)
            above = _names(rows[k - 1][1]) if k else []
            return _Header(number, line, tuple(_completed(names, above))) if whole else _Header()
    return _Header()


def _completed(names: list[str], above: list[str]) -> list[str]:
    if len(above) != len(names):
        return names
    found, over = [], ""
    for name, upper in zip(names, above, strict=True):
        over = upper.strip() or over
        unit = split_unit(over)[1]
        add = STEMS.get(split_unit(name)[0], "") in ("x", "y", "z") and not split_unit(name)[1] and is_length(unit)
        found.append(f"{name.strip()} [{unit}]" if add else name if name.strip() else upper)
    return found


def header_columns(text: str, path: str | Path) -> Columns:
    """Return the columns that the header names.

    Raises
    ------
    FileError
        If x, y or z is missing or named twice, or they have different units.
    """
    header = _header(text)
    number, line, names = header.number, header.line or first_line(text), header.names or _names(first_line(text))
    found: dict[str, tuple[int, str]] = {}
    for column, name in enumerate(names, start=1):
        stem, unit = split_unit(name)
        if (what := STEMS.get(stem)) is None:
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


def _states_unit(text: str) -> bool:
    """Return whether the header states the unit of x."""
    named = (split_unit(name) for name in _header(text).names)
    return any(STEMS.get(stem) == "x" and unit for stem, unit in named)


def _names(line: str) -> list[str]:
    """Return the names of a header line; between blanks, a unit in brackets belongs to the name before it."""
    bare = line.lstrip("#% ")
    delimiter = find_delimiter(bare)
    return re.sub(r"(?<!\s)\s++(?=[\[(])", "", bare).split() if delimiter == " " else bare.split(delimiter)


def _rotation(found: dict[str, tuple[int, str]]) -> dict[str, Any]:
    for names in (("q0", "q1", "q2", "q3"), ("rx", "ry", "rz")):
        if set(names) <= found.keys():
            unit = found[names[0]][1]
            return {"rotation": tuple(found[name][0] for name in names), **({"angle_unit": unit} if unit else {})}
    return {}


def _read(text: str, path: str | Path) -> Readings:
    """Read the columns that the header names x, y, z, name, time, rx, ry, rz or q0 … q3."""
    readings = read_columns(text, path, header_columns(text, path))
    return replace(readings, unit_stated=_states_unit(text))


def _write(samples: Samples) -> bytes:
    """Write joints [rad] and positions [m] with decimal commas, to 0.1 µrad and 0.1 µm, time stamps rounded."""
    joints = np.zeros((len(samples), 6)) if samples.q is None else samples.q
    names = [f"j{k + 1} [rad]" for k in range(joints.shape[1])]
    header = ";".join(["Time", "Point", *names, "X [m]", "Y [m]", "Z [m]"])
    numbers = np.hstack([joints, 1e-3 * samples.p_meas]).tolist()
    rows = (
        ";".join(["2.02E+13", name, *(f"{value:.7f}" for value in row)]).replace(".", ",")
        for name, row in zip(row_names(samples), numbers, strict=True)
    )
    return ("\r\n".join([header, *rows]) + "\r\n").encode()


SPREADSHEET: Final = Layout("spreadsheet", "table with a header that names x, y and z", _names_xyz, _read, _write)
