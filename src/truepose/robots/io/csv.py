"""Robots from a CSV table of D-H parameters: one line for each joint, the columns of a robot file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from truepose._io.delimited import TextTable, parse
from truepose.errors import FileError
from truepose.robots.io.toml import KEYS, parse_table, unknown_key
from truepose.robots.robot import Robot

_UNITS: Final = {"_rad": ("_deg", 180 / np.pi), "_m": ("_mm", 1000.0)}
_COMMENT: Final = re.compile(r"#\s*(name|maker|model|source|convention)\s*[:=]\s*(.*)")
_COLUMNS: Final = {key: section for section in ("kinematics", "limits") for key in KEYS[section]}


def parse_robot_csv(text: str, *, path: str | Path = "robot.csv") -> Robot:
    """Return the robot that a CSV table describes; error messages name `path`.

    The header names the columns: alpha_deg, a_mm, d_mm, offset_deg and, optionally, sign, beta_deg, lower_deg and
    upper_deg; _rad and _m are converted, a column "joint" is ignored. A table does not show which D-H convention it
    follows, so a comment line above it must: ``# convention = dh`` (standard) or ``# convention = mdh`` (Craig's
    modified). Comments with name, maker, model and source are read too; the name is that of the file if none is stated.

    Parameters
    ----------
    text : str
        The text of the file.
    path : str or Path
        The file's name in error messages.

    Raises
    ------
    FileError
        If the convention is not stated, a column is missing or unknown, or a value is not a number.

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
            stated[found[1]] = found[2].strip().strip('"')
    if "convention" not in stated:
        raise FileError(
            path,
            'state the convention in a line above the table: "# convention = dh" (standard D-H) or '
            '"# convention = mdh" (Craig\'s modified D-H)',
        )
    table: dict[str, Any] = {"name": Path(path).stem, "kinematics": {"convention": stated.pop("convention")}} | stated
    for key, values in _columns(parse(text, path), path).items():
        table.setdefault(_COLUMNS[key], {})[key] = values
    return parse_table(table, path)


def _columns(table: TextTable, path: str | Path) -> dict[str, list[float]]:
    """Return the columns by the keys of a robot file, in mm and deg."""
    found = {}
    for k, name in enumerate(table.header):
        if name.strip().lower() in ("joint", "i", "j"):
            continue
        unit = next((unit for unit in _UNITS if name.endswith(unit)), "")
        ending, factor = _UNITS.get(unit, ("", 1.0))
        key = name.removesuffix(unit) + ending
        if key not in _COLUMNS:
            raise unknown_key(path, name, [*_COLUMNS], "the header")
        if key in found:
            raise FileError(path, f'has two columns for "{key}"; remove one')
        found[key] = (factor * table.numbers([k])[:, 0]).tolist()
    return found
