"""The column ``masked`` of the tidy table: the reason to leave a row out, see `truepose.samples.masks`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose._io.delimited import TextTable, unescaped
from truepose._io.strict import LARGEST, to_float
from truepose._typing import FloatArray, IntArray
from truepose.errors import FileError
from truepose.samples.columns import WORDS, gather, require
from truepose.samples.frames import COMMANDED, MEASURED, quantities
from truepose.samples.split import distance_quantities, split_distances

MASKED: Final = "masked"
"""The column of reasons in the tidy table."""
FACT: Final = "fact"
"""The column of what the import found about the table, one fact to a row."""
BETWEEN: Final = " || "
"""What separates facts in one field, where there are more of them than rows."""


@dataclass(frozen=True)
class SampleTable:
    """All rows of a tidy table as they stand there, to show them and to say which to leave out.

    Attributes
    ----------
    row : (n,) array of int
        The number of each row.
    name : (n,) array of str, optional
        The names of the points.
    reasons : (n,) array of str
        The reason to leave each row out; empty where it counts.
    values : dict of str to array
        The other quantities of `Samples` by name, angles of orientations in rad as ``rpy_cmd`` and ``rxyz_meas``; nan
        where a field is no number.
    source : str
        The file, for messages.
    reflector : (n,) array of str, optional
        The reflectors.
    """

    row: IntArray
    name: NDArray[np.str_] | None
    reasons: NDArray[np.str_]
    values: dict[str, FloatArray]
    source: str
    reflector: NDArray[np.str_] | None = None

    def __len__(self) -> int:
        return len(self.row)


def all_rows(table: TextTable) -> SampleTable:
    """Return all rows of a tidy table, whatever their values are.

    Raises
    ------
    FileError
        If a column is missing, misspelt or without unit, or the number of a row is invalid.
    """
    named: dict[str, Any] = gather(table, ("row", *WORDS), finite=False)
    values = _numbers(table)
    require(table, values, "x_meas")
    if "q_shown" not in values:
        require(table, values, "q1", "x_cmd")
    rows = named.get("row", np.arange(len(table.line)))
    return SampleTable(rows, named.get("name"), masked_rows(table), values, str(table.path), named.get("reflector"))


def _numbers(table: TextTable) -> dict[str, Any]:
    """Return the quantities of a table; nan where a field is no number."""
    wanted = (COMMANDED | MEASURED) - {"row", *WORDS}
    try:
        return gather(table, wanted, finite=False)
    except FileError:
        known = [[_is_value(field, table.delimiter) for field in row] for row in table.fields.tolist()]
        readable = replace(table, fields=np.where(np.array(known, bool), table.fields, "nan"))
        return gather(readable, wanted, finite=False)


def _is_value(field: str, delimiter: str) -> bool:
    """Return whether a field is a number, or nan, in a table with a delimiter."""
    try:
        value = to_float(field if delimiter == "," else field.replace(",", "."))
    except ValueError:
        return False
    return not abs(value) > LARGEST


def counted_quantities(table: TextTable, reasons: NDArray[np.str_] | None = None) -> dict[str, Any]:
    """Return the arguments of `Samples.of` from a tidy table without its masked rows, whose values may be anything.

    Without a column ``row``, rows keep their number in the table.

    Parameters
    ----------
    table : TextTable
        The table.
    reasons : (n,) array of str, optional
        The reasons to leave rows out; by default those of the table.

    Raises
    ------
    FileError
        As `truepose.samples.frames.quantities`; also where all rows are masked.
    """
    reasons = masked_rows(table) if reasons is None else reasons
    rows = np.flatnonzero(reasons == "")
    part = rows_of(table, rows)
    positions, distances, apart = split_distances(part)
    found = {"row": rows[~apart], **quantities(positions, measured=True), "line": positions.line}
    if distances is not None:
        found["distances"] = {"row": rows[apart], **distance_quantities(distances)}
    return {**found, "excluded": excluded_rows(table, reasons), "facts": facts_of_rows(table)}


def masked_rows(table: TextTable) -> NDArray[np.str_]:
    """Return the reason of each row of a tidy table, (n,); empty where it counts."""
    return _texts(table, MASKED)


def facts_of_rows(table: TextTable) -> tuple[tuple[str, str], ...]:
    """Return the facts in a tidy table, each a code with its words; a field without a code is none."""
    found = [one for field in _texts(table, FACT).tolist() for one in field.split(BETWEEN)]
    parts = [one.partition(": ") for one in found]
    return tuple([(code, words) for code, mark, words in parts if mark])


def _texts(table: TextTable, column: str) -> NDArray[np.str_]:
    """Return the texts of a column of a tidy table, (n,); empty where there is no such column."""
    place = next((k for k, name in enumerate(table.header) if name.strip().lower() == column), None)
    if place is None:
        return np.full(len(table.line), "", dtype="<U1")
    return np.array([unescaped(field) for field in table.fields[:, place].tolist()], dtype=np.str_)


def rows_of(table: TextTable, rows: IntArray) -> TextTable:
    """Return some rows of a table.

    Raises
    ------
    FileError
        If there are none.
    """
    if not len(rows):
        raise FileError(table.path, "all rows are masked; at least one must count", line=table.header_line)
    return replace(table, fields=table.fields[rows], line=table.line[rows])


def excluded_rows(table: TextTable, reasons: NDArray[np.str_]) -> tuple[dict[str, Any], ...]:
    """Return the masked rows of a tidy table as `Samples.excluded` names them; their other values may be anything."""
    masked = np.flatnonzero(reasons != "")
    if not len(masked):
        return ()
    found = gather(rows_of(table, masked), ("row", "name"), finite=False)
    rows: list[Any] = found.get("row", masked).tolist()
    names: list[Any] = found["name"].tolist() if "name" in found else [""] * len(masked)
    lines: list[Any] = table.line[masked].tolist()
    return tuple(
        {"row": row, "point": name or None, "line": line, "reason": f"masked: {reasons[i]}"}
        for i, row, name, line in zip(masked.tolist(), rows, names, lines, strict=True)
    )
