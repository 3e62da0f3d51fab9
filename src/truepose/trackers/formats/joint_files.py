"""Plans as joint targets: RAPID jointtarget, KRL E6AXIS, UR lists in radians, spreadsheets."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose._io.delimited import TextTable, first_row, parse, read_tabular
from truepose._io.units import split_unit
from truepose.errors import FileError
from truepose.samples import Poses, check, read_poses
from truepose.samples.columns import header_of, joint_columns
from truepose.trackers.formats.headed import STEMS
from truepose.trackers.layout import NUMBER

_N: Final = rf"\s*+({NUMBER})\s*+"
_RAPID: Final = re.compile(rf"jointtarget\s+(?P<name>\w+)\s*:=\s*\[\s*\[{','.join([_N] * 6)}\]", re.IGNORECASE)
_KRL: Final = re.compile(
    rf"(?:\b(?P<name>\w++)\s*+=\s*+)?\{{\s*(?:E6AXIS\s*:)?\s*{','.join(rf'{chr(92)}s*A{k}{_N}' for k in range(1, 7))}",
    re.IGNORECASE,
)
_UR: Final = re.compile(rf"(?:\b(?P<name>\w++)\s*+=\s*+)?(?<!p)\[{','.join([_N] * 6)}\]")
_PATTERNS: Final = ((_RAPID, np.pi / 180.0), (_KRL, np.pi / 180.0), (_UR, 1.0))
_TIDY: Final = re.compile(r"\b(?:q1|x_cmd)_", re.IGNORECASE)
_SURELY_DEGREES: Final = 4.0 * np.pi


def read_plan(path: str | Path) -> Poses:
    """Read a plan: plan.csv (the tidy table), or joint targets of a controller or a spreadsheet.

    Raises
    ------
    FileError
        If the file is not a plan; with the line.
    DataError
        If the joints are implausible; see `truepose.samples.check`.
    """
    text, source = read_tabular(path)
    if _TIDY.search(first_row(text)) or header_of(text) is not None:
        return read_poses(path)
    for pattern, factor in _PATTERNS:
        if found := list(pattern.finditer(text)):
            q = factor * np.array([match.groups()[-6:] for match in found], dtype=np.float64)
            names = [match["name"] for match in found]
            ends = np.array([end.start() for end in re.finditer("\n", text)])
            lines = 1 + np.searchsorted(ends, [match.start() for match in found])
            poses = Poses(q=q, name=np.array(names) if all(names) else None, line=lines, source=str(path))
            check(poses)
            return poses
    return _read_table(text, source)


def _names(table: TextTable) -> NDArray[np.str_] | None:
    """Return the names of the points, if a column holds them."""
    column = next((k for k, name in enumerate(table.header) if STEMS.get(split_unit(name)[0]) == "name"), None)
    return None if column is None else table.fields[:, column]


def _read_table(text: str, path: str | Path) -> Poses:
    """Read columns j1_deg … or j1_rad …."""
    table = parse(text, path, skip=header_of(text, joints=True), lenient=True)
    found = joint_columns(table)
    if not found:
        known = (
            "plan.csv (q1_deg … or x_cmd_mm …), RAPID jointtarget, KRL E6AXIS, UR lists [j1, …, j6], columns j1_deg …"
        )
        raise FileError(path, f"is not a plan; expected {known}", line=table.header_line)
    q = table.numbers(found)
    units = {split_unit(table.header[column])[1] for column in found}
    if units == {""} and np.abs(q).max() > _SURELY_DEGREES:
        units = {"deg"}
    if units not in ({"deg"}, {"rad"}):
        raise FileError(path, "has no unit of the joints; write j1_deg … or j1_rad …", line=table.header_line)
    poses = Poses(q=np.deg2rad(q) if units == {"deg"} else q, name=_names(table), line=table.line, source=str(path))
    check(poses)
    return poses
