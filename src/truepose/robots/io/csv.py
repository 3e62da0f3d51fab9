"""Robots from a CSV table of D-H parameters: one line for each joint, the columns of a robot file."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from truepose._io.delimited import TextTable, parse
from truepose._io.units import MM_PER, RAD_PER, split_unit
from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.robots.io.toml import KEYS, parse_table, unknown_key
from truepose.robots.robot import Robot

_UNITS: Final = {
    **{unit: ("_mm", factor) for unit, factor in MM_PER.items()},
    **{unit: ("_deg", float(np.rad2deg(factor))) for unit, factor in RAD_PER.items()},
}
_COMMENT: Final = re.compile(r"#\s*(name|maker|model|source|convention)\s*[:=]\s*(.*)", re.IGNORECASE)
_JOINT: Final = ("joint", "i", "j", "link", "axis", "name", "no", "nr")
_PI: Final = re.compile(r"([+-]?)\s*([0-9.]*)\s*\*?\s*(?:pi|π)\s*(?:/\s*([0-9]+))?", re.IGNORECASE)
_COLUMNS: Final = {key: section for section in ("kinematics", "limits") for key in KEYS[section]}


def parse_robot_csv(text: str, *, path: str | Path = "robot.csv") -> Robot:
    """Return the robot that a CSV table describes; error messages name `path`.

    The header names the columns: alpha_deg, a_mm, d_mm, offset_deg and, optionally, sign, beta_deg, lower_deg and
    upper_deg. Other units are converted (``alpha [rad]``, ``d_m``), radians may be fractions such as -pi/2, and the
    numbers in a column "joint" must follow each other. A table does not show which D-H convention it follows, so a
    comment line above it must: ``# convention = dh`` (standard) or ``# convention = mdh`` (Craig's modified). Comments
    with name, maker, model and source are read too; the name is that of the file if none is stated.

    Parameters
    ----------
    text : str
        The text of the file.
    path : str or Path
        The file's name in error messages.

    Raises
    ------
    FileError
        If the convention is not stated, a column is missing or unknown, a row is missing, or a value is not a number.

    Examples
    --------
    >>> import os
    >>> lines = ["# convention = mdh", "alpha_deg,a_mm,d_mm,offset_deg", "0,0,400,0", "-90,25,0,0"]
    >>> parse_robot_csv(os.linesep.join(lines), path="two.csv")
    <Robot two, 2 joints, mdh>
    """
    stated = {}
    for line in text.splitlines():
        if found := _COMMENT.fullmatch(line.strip().rstrip(",;")):
            stated[found[1].lower()] = found[2].strip().strip('"')
    if "convention" not in stated:
        raise FileError(
            path,
            'state the convention in a line above the table: "# convention = dh" (standard D-H) or '
            '"# convention = mdh" (Craig\'s modified D-H)',
        )
    kinematics = {"convention": stated.pop("convention").lower()}
    table: dict[str, Any] = {"name": Path(path).stem, "kinematics": kinematics} | stated
    for key, values in _columns(parse(text, path), path).items():
        table.setdefault(_COLUMNS[key], {})[key] = values
    return parse_table(table, path)


def _columns(table: TextTable, path: str | Path) -> dict[str, list[float]]:
    """Return the columns by the keys of a robot file, in mm and deg."""
    found = {}
    for k, name in enumerate(table.header):
        stem, unit = split_unit(name)
        if stem in _JOINT:
            _check_joints(table, k)
            continue
        ending, factor = _UNITS.get(unit, (f"_{unit}" * bool(unit), 1.0))
        key = stem + ending
        if key not in _COLUMNS:
            raise unknown_key(path, name, [*_COLUMNS], "the header")
        if key in found:
            raise FileError(path, f'has two columns for "{key}"; remove one')
        found[key] = (factor * _numbers(table, k, unit)).tolist()
    return found


def _numbers(table: TextTable, column: int, unit: str) -> FloatArray:
    """Return a column (n,); in radians, -pi/2 and the like are numbers."""
    if unit != "rad":
        return table.numbers([column])[:, 0]
    fields = table.fields.astype(f"<U{max(32, table.fields.dtype.itemsize // 4)}")
    fields[:, column] = [_in_radians(field) for field in fields[:, column].tolist()]
    return replace(table, fields=fields).numbers([column])[:, 0]


def _in_radians(field: str) -> str:
    if not (found := _PI.fullmatch(field)):
        return field
    sign, times, parts = found.groups()
    try:
        return f"{sign}{float(times or 1) * np.pi / float(parts or 1)!r}"
    except (ValueError, ZeroDivisionError):
        return field


def _check_joints(table: TextTable, column: int) -> None:
    """Refuse a table whose rows are not those of successive joints, where the column has their numbers."""
    found = [re.search("[0-9]{1,3}", field) for field in table.fields[:, column].tolist()]
    numbers = np.array([int(digits[0]) for digits in found if digits])
    if len(numbers) < len(found):
        return
    expected = min(numbers[0], 1) + np.arange(len(numbers))
    for row in np.flatnonzero(numbers != expected)[:1]:
        message = f"is the row of joint {numbers[row]}; expected joint {expected[row]}"
        raise FileError(table.path, f"{message}: is a row missing, or misplaced?", line=int(table.line[row]))
