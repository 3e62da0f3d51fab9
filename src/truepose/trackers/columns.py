"""Readings in columns: a description of the columns, which can be saved, and the reader of all such layouts."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._io.delimited import TITLES, TextTable, find_delimiter, first_row, is_number, parse
from truepose._io.files import LARGEST_CONFIG, read_text, write_atomic
from truepose._io.strict import is_whole, parse_toml, to_float
from truepose._io.units import RAD_PER, millimetres_per
from truepose._typing import BoolArray, FloatArray
from truepose.errors import DataError, FileError
from truepose.trackers.readings import Readings
from truepose.trackers.times import column_seconds

Column = int | str
_DELIMITERS: Final = (";", ",", "\t", " ")


@dataclass(frozen=True, kw_only=True)
class Columns:
    """The columns of the quantities in a table, by number from 1 or by the name in the header.

    Attributes
    ----------
    x, y, z : int or str
        The columns of the position.
    name : int or str, optional
        The column of the point name.
    time : int or str, optional
        The column of the time.
    rotation : tuple, optional
        The three columns of angles, or the four of a quaternion w, x, y, z.
    std : tuple, optional
        The column of a standard deviation for all axes, or three columns.
    unit, angle_unit : str
        The units of lengths (mm, m, cm, in) and of angles (deg, rad, mrad).
    angles : str
        The order of the angles as in scipy's ``Rotation.from_euler``: ``"xyz"`` about fixed axes, ``"ZYX"`` for KUKA.
    std_factor : float
        The standard deviation per unit of the std columns: 0.5 for an expanded uncertainty U(95).
    delimiter : str
        The delimiter ``";"``, ``","``, a tab or a blank (any number of blanks); found automatically if empty.
    skip : int
        The number of lines before the data, including the header; by default the header is the first line with all
        names, if there are names.

    Examples
    --------
    >>> Columns.parse("x=4, y=5, z=6, unit=m").z
    6
    """

    x: Column
    y: Column
    z: Column
    name: Column | None = None
    time: Column | None = None
    rotation: tuple[Column, ...] = ()
    std: tuple[Column, ...] = ()
    unit: str = "mm"
    angle_unit: str = "deg"
    angles: str = "xyz"
    std_factor: float = 1.0
    delimiter: str = ""
    skip: int = 0

    def __post_init__(self) -> None:
        if len(self.rotation) not in (0, 3, 4):
            raise DataError(f"rotation names {len(self.rotation)} columns; expected 3 angles or a quaternion's 4")
        if len(self.std) not in (0, 1, 3):
            raise DataError(f"std names {len(self.std)} columns; expected 1 for all axes or 3")
        if self.angle_unit not in RAD_PER:
            raise DataError(f"the unit of angles {self.angle_unit!r} is not known; known are {', '.join(RAD_PER)}")
        if self.delimiter not in ("", *_DELIMITERS):
            raise DataError(f"delimiter {self.delimiter!r}; expected a semicolon, comma, tab or blank")
        if not re.fullmatch("[xyz]{3}|[XYZ]{3}", self.angles):
            raise DataError(
                f'angles {self.angles!r}; expected an order of axes such as "xyz" (fixed) or "ZYX" (moving)'
            )

    @classmethod
    def parse(cls, text: str) -> Columns:
        """Return the columns from a text: ``x=4, y=5, z=6, unit=m``; several columns as ``rotation=7:8:9``.

        Raises
        ------
        DataError
            If a key is unknown, or x, y or z is missing.
        """
        pairs = [pair.partition("=") for pair in text.split(",") if pair.strip()]
        return cls.from_dict({key.strip(): _value(key.strip(), value.strip()) for key, _, value in pairs})

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Columns:
        """Return the columns from a dict; see `parse` for the errors."""
        known = [f.name for f in fields(cls)]
        if unknown := [key for key in values if key not in known]:
            raise DataError(f"columns: {unknown[0]!r} is not known; known are {', '.join(known)}")
        only = "; for the unit alone, pass --unit" if set(values) == {"unit"} else ""
        if missing := [key for key in "xyz" if key not in values]:
            raise DataError(f"columns: {missing[0]} is not given; write x=4, y=5, z=6 (numbers from 1, or names){only}")
        listed: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in values.items()}
        return cls(**listed)

    @classmethod
    def load(cls, path: str | Path) -> Columns:
        """Read columns from a file of `save`.

        Raises
        ------
        FileError
            If the file cannot be read or is invalid.
        """
        try:
            return cls.from_dict(parse_toml(read_text(path, LARGEST_CONFIG), path))
        except FileError:
            raise
        except (DataError, TypeError) as error:
            raise FileError(path, str(error)) from None

    def places(self) -> list[tuple[str, Column]]:
        """Return the quantities and their columns; of several columns, the quantity of each."""
        single = [(what, getattr(self, what)) for what in ("x", "y", "z", "name", "time")]
        several = [(what, column) for what in ("rotation", "std") for column in getattr(self, what)]
        return [(what, column) for what, column in (*single, *several) if column is not None]

    def save(self, path: str | Path) -> None:
        """Write the columns as .toml."""
        kept = {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) not in (None, (), "")}
        write_atomic(path, "".join(f"{key} = {json.dumps(value)}\n" for key, value in kept.items()))


def _value(key: str, text: str) -> Any:
    if key in ("rotation", "std"):
        return tuple(_column(part) for part in text.split(":"))
    if key == "std_factor":
        return to_float(text)
    return _column(text)


def _column(text: str) -> Column:
    return int(text) if is_whole(text.strip()) else text.strip()


def read_columns(text: str, path: str | Path, columns: Columns) -> Readings:
    """Read a table with known columns.

    Rows whose three coordinates are empty, nan, or all zero count as missing (`Readings.missing`).

    Raises
    ------
    FileError
        If a column is missing, or a field is not a number or a date; with the line.
    """
    table = parse(
        text, path, skip=columns.skip or _header_line(text, columns), delimiter=columns.delimiter, lenient=True
    )
    place = [_place(table, column) for column in (columns.x, columns.y, columns.z)]
    numbers = _blank_as_nan(table, place).numbers(place)
    factor = millimetres_per(columns.unit, path, table.header_line)
    optional: dict[str, Any] = {}
    notes: tuple[str, ...] = ()
    if columns.name is not None:
        optional["name"] = table.fields[:, _place(table, columns.name)]
    texts = [] if columns.time is None else table.fields[:, _place(table, columns.time)].tolist()
    if any(texts):
        optional["time"] = column_seconds(texts, table.line, path)
        if optional["time"] is None:
            notes = (f"The time stamps were rounded by a spreadsheet (such as {texts[0]}) and are left out.",)
    if columns.rotation:
        optional["rotation"] = _rotation(
            table, columns, np.asarray(np.isnan(numbers).any(axis=1) | (numbers == 0.0).all(axis=1))
        )
    if columns.std:
        std = _filled(table, columns.std) * columns.std_factor * factor
        optional["p_std"] = np.broadcast_to(std, numbers.shape).copy()
    return Readings(
        p=factor * numbers,
        line=table.line,
        source=str(path),
        unit=columns.unit,
        notes=notes,
        columns=tuple((what, _place(table, column) + 1) for what, column in columns.places()),
        **optional,
    )


def _header_line(text: str, columns: Columns) -> int:
    """Return the number of the first line that has all names of columns.

    If no line has, it is 1, for a message with the names that are there; 0 if that line holds numbers, or no column is
    named.
    """
    stated = (columns.x, columns.y, columns.z, columns.name, columns.time, *columns.rotation, *columns.std)
    names = {_plain(column) for column in stated if isinstance(column, str)}
    for number, line in enumerate(text.splitlines()[:TITLES] if names else [], start=1):
        fields = line.split(columns.delimiter or find_delimiter(line))
        if names <= {_plain(field.strip().strip('"')) for field in fields}:
            return number
    first = first_row(text)
    return int(bool(names) and not all(map(is_number, first.split(find_delimiter(first)))))


def _plain(name: str) -> str:
    return " ".join(name.lower().split())


def _place(table: TextTable, column: Column) -> int:
    if isinstance(column, int):
        if not 1 <= column <= len(table.header):
            message = f"has no column {column}; there are {len(table.header)}"
            raise FileError(table.path, message, line=table.header_line)
        return column - 1
    for k, name in enumerate(table.header):
        if _plain(name) == _plain(column):
            return k
    message = f"has no column {column!r}; there are {', '.join(table.header)}"
    raise FileError(table.path, message, line=table.header_line)


def _blank_as_nan(table: TextTable, place: list[int]) -> TextTable:
    """Return the table with nan in rows where all columns of `place` are empty."""
    empty = (table.fields[:, place] == "").all(axis=1)
    if not empty.any():
        return table
    filled = table.fields.astype(f"<U{max(3, table.fields.dtype.itemsize // 4)}")
    filled[np.ix_(empty, place)] = "nan"
    return replace(table, fields=filled)


def _filled(table: TextTable, columns: tuple[Column, ...]) -> FloatArray:
    place = [_place(table, column) for column in columns]
    return _blank_as_nan(table, place).numbers(place)


def _rotation(table: TextTable, columns: Columns, missing: BoolArray) -> Rotation:
    """Return the orientations; the identity for rows without a reading."""
    values = _filled(table, columns.rotation)
    quaternion = len(columns.rotation) == 4
    absent = np.isnan(values).any(axis=1) | (quaternion & (values == 0.0).all(axis=1))
    lost = np.flatnonzero(absent & ~missing)
    if len(lost):
        raise FileError(table.path, "has a position but no orientation", line=int(table.line[lost[0]]))
    if not quaternion:
        angles = np.where(absent[:, None], 0.0, values) * RAD_PER[columns.angle_unit]
        return Rotation.from_euler(columns.angles, angles)
    length = np.linalg.norm(values, axis=1)
    wrong = np.flatnonzero(~absent & (np.abs(length - 1.0) > 0.01))
    if len(wrong):
        message = f"the quaternion has length {length[wrong[0]]:.4g}, expected 1; are these its columns?"
        raise FileError(table.path, message, line=int(table.line[wrong[0]]))
    return Rotation.from_quat(np.where(absent[:, None], [1.0, 0.0, 0.0, 0.0], values), scalar_first=True)
