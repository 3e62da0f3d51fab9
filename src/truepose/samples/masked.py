"""The column ``masked`` of the tidy table: the reason to leave a row out, see `truepose.samples.masks`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose._io.delimited import TextTable, unescaped
from truepose._typing import IntArray
from truepose.errors import FileError
from truepose.samples.columns import gather
from truepose.samples.frames import quantities

MASKED: Final = "masked"
"""The column of reasons in the tidy table."""


def counted_quantities(table: TextTable) -> dict[str, Any]:
    """Return the arguments of `Samples` from a tidy table without its masked rows.

    Without a column ``row``, rows keep their number in the table.

    Raises
    ------
    FileError
        As `truepose.samples.frames.quantities`; also where all rows are masked.
    """
    reasons = masked_rows(table)
    rows = np.flatnonzero(reasons == "")
    part = rows_of(table, rows)
    found = {"row": rows, **quantities(part, measured=True), "line": part.line}
    return {**found, "excluded": excluded_rows(table, reasons)}


def masked_rows(table: TextTable) -> NDArray[np.str_]:
    """Return the reason of each row of a tidy table, (n,); empty where it counts."""
    column = next((k for k, name in enumerate(table.header) if name.strip().lower() == MASKED), None)
    if column is None:
        return np.full(len(table.line), "", dtype="<U1")
    return np.array([unescaped(field) for field in table.fields[:, column].tolist()], dtype=np.str_)


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
