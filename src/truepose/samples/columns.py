"""Column names of the tidy table: a quantity and its unit, such as ``q1_deg``, ``x_meas_mm``, ``temp_C``.

A name that is nearly one of these is an error that shows the nearest one; other columns are ignored.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose._io.delimited import COMMENTS, TITLES, TextTable, find_delimiter, unescaped
from truepose._io.units import MM_PER, RAD_PER, split_unit
from truepose._typing import FloatArray, IntArray
from truepose.errors import FileError

_UNITS: Final[dict[str, dict[str, float]]] = {
    "length": {**MM_PER, "um": 1e-3},
    "angle": RAD_PER,
    "time": {"s": 1.0},
    "temperature": {"c": 1.0},
    "load": {"kg": 1.0},
}
_DEFAULT_UNIT: Final = {"length": "mm", "angle": "deg", "time": "s", "temperature": "C", "load": "kg", "": ""}
_MOST_JOINTS: Final = 16
_NEAR: Final = 0.8
_JOINT_COLUMN: Final = re.compile(r"(?P<prefix>j|q|a|theta|θ|joint|axis|achse|gelenk)[ _]?(?P<number>[0-9]{1,3})")
POINT_NAMES: Final = (
    "name",
    "point",
    "point name",
    "element name",
    "id",
    "point id",
    "nr",
    "no",
    "punkt",
    "punktname",
)
"""Columns that hold the names of points, in lower case; the first of these that a table has counts."""
OF_JOINTS: Final = ("q", "q_shown", "approach")
"""The arrays with one column for each joint."""
WORDS: Final = ("name", "reflector", "origin")
"""The quantities that are words, not numbers."""

_QUATERNION: Final = ("q0", "q1", "q2", "q3")
_OURS: Final = {
    *(f"{axis}_pred{std}_mm" for axis in "xyz" for std in ("", "_std")),
    "std_mm",
}  # added by `truepose predict`


@dataclass(frozen=True)
class Quantity:
    """The quantity of a column: the array it belongs to, its index there, and the kind of its unit."""

    array: str
    index: int
    kind: str


def _triple(array: str, stems: tuple[str, str, str], kind: str) -> dict[str, Quantity]:
    return {stem: Quantity(array, index, kind) for index, stem in enumerate(stems)}


QUANTITIES: Final[dict[str, Quantity]] = {
    "row": Quantity("row", 0, ""),
    "name": Quantity("name", 0, ""),
    "reflector": Quantity("reflector", 0, ""),
    **{f"q{i + 1}": Quantity("q", i, "angle") for i in range(_MOST_JOINTS)},
    **{f"q{i + 1}_shown": Quantity("q_shown", i, "angle") for i in range(_MOST_JOINTS)},
    **_triple("p_cmd", ("x_cmd", "y_cmd", "z_cmd"), "length"),
    **_triple("rpy_cmd", ("roll_cmd", "pitch_cmd", "yaw_cmd"), "angle"),
    **_triple("p_meas", ("x_meas", "y_meas", "z_meas"), "length"),
    **_triple("rxyz_meas", ("rx_meas", "ry_meas", "rz_meas"), "angle"),
    **_triple("p_std", ("x_std", "y_std", "z_std"), "length"),
    **_triple("rotation_std", ("rx_std", "ry_std", "rz_std"), "angle"),
    **{f"approach{i + 1}": Quantity("approach", i, "") for i in range(_MOST_JOINTS)},
    "time": Quantity("time", 0, "time"),
    "distance": Quantity("distance", 0, "length"),
    "distance_std": Quantity("distance_std", 0, "length"),
    "origin": Quantity("origin", 0, ""),
    **_triple("p_origin", ("x_origin", "y_origin", "z_origin"), "length"),
    "temp": Quantity("temperature", 0, "temperature"),
    "load": Quantity("load", 0, "load"),
    **_triple("p_load", ("x_load", "y_load", "z_load"), "length"),
}
"""All quantities of the tidy table by their column name without unit, in the order of writing."""


def full_name(stem: str) -> str:
    """Return the column name with the unit for writing, such as ``q1_deg``."""
    unit = _DEFAULT_UNIT[QUANTITIES[stem].kind]
    return f"{stem}_{unit}" if unit else stem


def gather(table: TextTable, wanted: Collection[str], *, finite: bool = True) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of a table by name, in mm and rad: (n, k), or (n,) for single columns and ``name``.

    Parameters
    ----------
    table : TextTable
        The table.
    wanted : collection of str
        The arrays to read (``Quantity.array``); other columns are ignored.
    finite : bool
        Whether a value that is not finite is an error.

    Raises
    ------
    FileError
        If a column name is misspelt, duplicated, without unit or without its neighbours, or a field is invalid.
    """
    found: dict[str, dict[int, tuple[int, float]]] = {}
    for column, name in enumerate(_known_names(table)):
        known = _recognise(name, table)
        if known is not None and known[0].array in wanted:
            quantity, factor = known
            places = found.setdefault(quantity.array, {})
            if quantity.index in places:
                other = table.header[places[quantity.index][0]]
                raise FileError(
                    table.path,
                    f"columns {other} and {name} are the same quantity; keep only one",
                    line=table.header_line,
                )
            places[quantity.index] = (column, factor)
    return {array: _values(table, array, places, finite) for array, places in found.items()}


def _known_names(table: TextTable) -> list[str]:
    """Return the names of columns as those of the tidy table.

    A table's ``point`` or ``id`` is its ``name``; ``x_cmd [mm]`` is ``x_cmd_mm``; joints may be ``A1 [°]``,
    ``theta1_rad`` or ``Achse1_deg``; a quaternion ``q0 … q3`` without unit is no joint.
    """
    lower = [name.lower() for name in table.header]
    joints = {} if any(map(_is_joint, lower)) else {column: k for k, column in enumerate(joint_columns(table), start=1)}
    return [_known_name(name, lower, joints.get(column)) for column, name in enumerate(table.header)]


def _is_joint(name: str) -> bool:
    """Return whether a column is ``q1_deg`` or the like."""
    stem, _, unit = name.rpartition("_")
    return (known := QUANTITIES.get(stem)) is not None and known.array in ("q", "q_shown") and unit in RAD_PER


def _known_name(name: str, header: list[str], joint: int | None) -> str:
    lower, (stem, unit) = name.lower(), split_unit(name)
    if lower == next((word for word in POINT_NAMES if word in header), None):
        return "name"
    if lower in _QUATERNION and "q0" in header:
        return ""
    if joint is not None and (unit or "x_cmd" not in "".join(header)):
        return f"q{joint}_{unit}" if unit else name
    known = QUANTITIES.get(stem)
    return f"{stem}_{unit}" if known is not None and unit.lower() in _UNITS.get(known.kind, {}) else name


def joint_columns(table: TextTable) -> list[int]:
    """Return the columns of joints, first to last, by names such as ``j1``, ``A1 [°]``, ``Achse1``, ``Joint 1``.

    Of ``q1 … q4`` or ``q0 … q3`` beside other joints, the numbers are those of a quaternion. The list is empty if there
    are no joints.

    Raises
    ------
    FileError
        If there are several sets of joints.
    """
    sets: dict[str, dict[int, int]] = {}
    for column, name in enumerate(table.header):
        if match := _JOINT_COLUMN.fullmatch(split_unit(name)[0]):
            sets.setdefault(match["prefix"], {}).setdefault(int(match["number"]), column)
    whole = {prefix: found for prefix, found in sets.items() if set(found) == set(range(1, len(found) + 1))}
    if len(whole) > 1 and len(whole.get("q", {})) in (3, 4):
        del whole["q"]
    if len(whole) > 1:
        names = " and ".join(f"{table.header[found[1]]} …" for found in whole.values())
        raise FileError(table.path, f"has several sets of joints ({names}); keep one", line=table.header_line)
    return [found[k] for found in whole.values() for k in sorted(found)]


def header_of(text: str, *, joints: bool = False) -> int | None:
    """Return the number of lines up to the header of a tidy table, if titles stand before it; else None.

    With `joints`, names such as ``Achse1`` make a header, too.
    """
    rows = ((number, row) for number, row in enumerate(text.splitlines(), start=1) if row.strip())
    lines = [(number, row) for number, row in rows if not row.lstrip().startswith(COMMENTS)]
    for k, (number, row) in enumerate(lines[:TITLES]):
        if names_columns(row, joints=joints):
            return number if k else None
    return None


def names_columns(row: str, *, joints: bool = False) -> bool:
    """Return whether a line names a column of a tidy table, or with `joints` a joint such as ``Achse1``."""
    delimiter = find_delimiter(row)
    names = [name.strip().lower() for name in (row.split() if delimiter == " " else row.split(delimiter))]
    return any(map(_is_column, names)) or (joints and any(_JOINT_COLUMN.fullmatch(split_unit(n)[0]) for n in names))


def _is_column(name: str) -> bool:
    stem, unit = split_unit(name)
    known = QUANTITIES.get(stem)
    return known is not None and unit.lower() in _UNITS.get(known.kind, {})


def require(table: TextTable, arrays: Collection[str], *stems: str) -> None:
    """Raise a FileError that names the required columns, unless one of their arrays was found."""
    if not {QUANTITIES[stem].array for stem in stems} & set(arrays):
        needed = " or ".join(f"{full_name(stem)} …" for stem in stems)
        has = ", ".join(table.header[:8]) + (" …" if len(table.header) > 8 else "")
        remedy = "rename yours, with their unit, or read them with `truepose import --columns`"
        raise FileError(table.path, f"needs columns {needed}; it has {has}; {remedy}", line=table.header_line)


def _recognise(name: str, table: TextTable) -> tuple[Quantity, float] | None:
    lower = name.lower()
    stem, _, unit = lower.rpartition("_")
    if (quantity := QUANTITIES.get(lower)) is not None:
        if quantity.kind:
            units = " or ".join(f"{lower}_{unit}" for unit in _shown_units(quantity.kind))
            raise FileError(table.path, f"column {name} has no unit; name it {units}", line=table.header_line)
        return quantity, 1.0
    if (quantity := QUANTITIES.get(stem)) is not None and quantity.kind:
        factor = _UNITS[quantity.kind].get(unit)
        if factor is None:
            units = ", ".join(_shown_units(quantity.kind))
            raise FileError(
                table.path, f"column {name} has the unknown unit {unit!r}; known are {units}", line=table.header_line
            )
        return quantity, factor
    if lower in _OURS:
        return None
    near = difflib.get_close_matches(lower, map(full_name, QUANTITIES), n=1, cutoff=_NEAR)
    if re.match(r"r[xyz]_cmd", lower):
        message = f"unknown column {name}; commanded orientations are roll_cmd_deg, pitch_cmd_deg, yaw_cmd_deg"
        raise FileError(table.path, f"{message}: Rz(yaw) Ry(pitch) Rx(roll)", line=table.header_line)
    if near:
        raise FileError(table.path, f"unknown column {name}; did you mean {near[0]}?", line=table.header_line)
    if re.search(r"_(cmd|meas|std)(_[a-z]+)?$", lower):
        known = "x_cmd_mm …, roll_cmd_deg …, x_meas_mm …, rx_meas_deg …, x_std_mm …, rx_std_deg …"
        raise FileError(table.path, f"unknown column {name}; known are {known}", line=table.header_line)
    return None


def _shown_units(kind: str) -> list[str]:
    return ["C"] if kind == "temperature" else list(_UNITS[kind])


def _values(table: TextTable, array: str, places: dict[int, tuple[int, float]], finite: bool) -> NDArray[np.generic]:
    stems = [stem for stem, quantity in QUANTITIES.items() if quantity.array == array]
    size = len(stems) if array not in OF_JOINTS else max(places) + 1
    missing = [full_name(stems[index]) for index in range(size) if index not in places]
    if missing:
        there = ", ".join(table.header[column] for column, _ in places.values())
        raise FileError(table.path, f"has {there} but not {', '.join(missing)}", line=table.header_line)
    columns = [places[index][0] for index in range(size)]
    if array in WORDS:
        return np.array([unescaped(name) for name in table.fields[:, columns[0]].tolist()], dtype=np.str_)
    values = table.numbers(columns)
    if finite and not np.isfinite(values).all():
        row, index = np.argwhere(~np.isfinite(values))[0]
        name, field = table.column_name(columns[index]), table.fields[row, columns[index]]
        what = f"{name} is {field}; measure again or remove the row"
        raise FileError(table.path, what, line=int(table.line[row]))
    if array == "row":
        return _whole(table, values[:, 0], columns[0])
    scaled: FloatArray = values * np.array([places[index][1] for index in range(size)])
    return scaled[:, 0] if size == 1 and array not in OF_JOINTS else scaled


def _whole(table: TextTable, values: FloatArray, column: int) -> IntArray:
    bad = np.flatnonzero(values != np.round(values))
    if len(bad):
        field = table.fields[bad[0], column]
        raise FileError(table.path, f"row is {field}, which is not a whole number", line=int(table.line[bad[0]]))
    return values.astype(np.int64)  # below LARGEST, see TextTable.numbers
