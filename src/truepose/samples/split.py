"""Rows of the tidy table without a measured position: distances from fixed points, as of a ball bar or a draw wire."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from truepose._io.delimited import TextTable
from truepose._io.units import split_unit
from truepose._typing import BoolArray
from truepose.errors import FileError
from truepose.samples.columns import gather
from truepose.samples.frames import COMMANDED, commanded_rotation

_MEASURED: Final = ("x_meas", "y_meas", "z_meas")
_NOTHING: Final = ("", "nan")
_OWN: Final = {"distance", "distance_std", "origin", "p_origin", "time"}


def split_distances(table: TextTable) -> tuple[TextTable, TextTable | None, BoolArray]:
    """Return the rows of positions, those of distances, and which are the latter (n,).

    Rows of distances have no measured position; columns that are empty in all of them are left out there. In rows with
    a position a distance does not matter.

    Raises
    ------
    FileError
        If all rows are distances: the station is found from positions.
    """
    stems = [_stem(name) for name in table.header]
    if "distance" not in stems:
        return table, None, np.zeros(len(table.line), np.bool_)
    there = {stem: _there(table, column) for column, stem in enumerate(stems)}
    none = np.zeros(len(table.line), np.bool_)
    positions = np.any([there.get(stem, none) for stem in _MEASURED], axis=0)
    apart = np.asarray(there["distance"] & ~positions)
    if not apart.any():
        return table, None, apart
    if apart.all():
        raise FileError(
            table.path,
            "all rows are distances (distance_mm) without a position; the station and the tool are found from rows "
            "with x_meas_mm …: add some",
            line=table.header_line,
        )
    return _without_empty(table, ~apart), _without_empty(table, apart), apart


def distance_quantities(table: TextTable) -> dict[str, Any]:
    """Return the arguments of `Distances` from rows of distances, as `split_distances` returns them.

    Raises
    ------
    FileError
        If a column is missing or a field is invalid.
    """
    return {**commanded_rotation(gather(table, COMMANDED | _OWN)), "line": table.line}


def _stem(name: str) -> str:
    return split_unit(name.strip().lower())[0]


def _there(table: TextTable, column: int) -> BoolArray:
    return np.asarray(~np.isin(np.char.lower(np.char.strip(table.fields[:, column])), _NOTHING))


def _without_empty(table: TextTable, rows: BoolArray) -> TextTable:
    """Return some rows of a table without the columns that are empty in all of them."""
    part = replace(table, fields=table.fields[rows], line=table.line[rows])
    kept = [column for column in range(len(table.header)) if _there(part, column).any()]
    return replace(part, header=[table.header[column] for column in kept], fields=part.fields[:, kept])
