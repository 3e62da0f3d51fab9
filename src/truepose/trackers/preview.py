"""A first look at a measurement file: its rows as they stand there, and what is understood of them."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from truepose._io.delimited import TITLES, find_delimiter, is_number, read_tabular
from truepose.errors import TrueposeError
from truepose.trackers.columns import Columns
from truepose.trackers.importing import read_measurement
from truepose.trackers.readings import Readings

_SHOWN: Final = 12
_MOST_FIELDS: Final = 60


@dataclass(frozen=True, eq=False)
class FilePreview:
    """What is understood of a measurement file; made by `preview`.

    Attributes
    ----------
    rows : list of (int, list of str)
        The first rows of the file: the line, and its fields.
    skip : int
        The number of lines before the first row with numbers, for `Columns`.
    readings : Readings, optional
        The readings; None if the file cannot be read.
    problem : TrueposeError, optional
        The error of a file that cannot be read as it is, with the remedy.
    """

    rows: list[tuple[int, list[str]]]
    skip: int
    readings: Readings | None
    problem: TrueposeError | None

    @property
    def columns(self) -> dict[str, list[int]]:
        """The columns of the quantities, from 1; of a layout without columns none."""
        found: dict[str, list[int]] = {}
        for what, column in () if self.readings is None else self.readings.columns:
            found.setdefault(what, []).append(column)
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return the preview as plain values."""
        known, readings = self.readings, {}
        if known is not None:
            there = known.p[~known.missing]
            readings = {
                "layout": known.layout,
                "unit": known.unit,
                "unit_stated": known.unit_stated,
                "frame": known.frame,
                "notes": list(known.notes),
                "count": len(known),
                "missing": int(known.missing.sum()),
                "extent_mm": np.ptp(there, axis=0).tolist() if len(there) else [0.0, 0.0, 0.0],
                "named": known.name is not None,
                "timed": known.time is not None,
                "oriented": known.rotation is not None,
            }
        return {
            "rows": [{"line": line, "fields": fields} for line, fields in self.rows],
            "skip": self.skip,
            "columns": self.columns,
            "readings": readings or None,
            "problem": None if self.problem is None else str(self.problem),
        }


def preview(
    path: str | Path,
    *,
    columns: Columns | None = None,
    unit: str | None = None,
    reflectors: ArrayLike | int | None = None,
    keep: int | None = None,
) -> FilePreview:
    r"""Return a first look at a measurement file, also if it cannot be read as it is.

    Parameters
    ----------
    path, columns, unit, reflectors, keep
        As for `truepose.trackers.read_measurement`.

    Returns
    -------
    FilePreview

    Raises
    ------
    FileError
        If the file is neither text nor a workbook.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "points.csv")
    ...     _ = file.write_text("Name;X [m];Y [m];Z [m]\nP1;1,5;0,25;0,75\nP2;1,75;0,25;0,5\n", "utf-8")
    ...     found = preview(file)
    >>> found.columns, found.readings.unit, found.rows[1]
    ({'x': [2], 'y': [3], 'z': [4], 'name': [1]}, 'm', (2, ['P1', '1,5', '0,25', '0,75']))
    """
    text, _ = read_tabular(path)
    rows, skip = _first_rows(text, "" if columns is None else columns.delimiter)
    try:
        readings = read_measurement(path, columns=columns, unit=unit, reflectors=reflectors, keep=keep)
    except TrueposeError as error:
        return FilePreview(rows, skip, None, error)
    return FilePreview(rows, skip, readings, None)


def _first_rows(text: str, delimiter: str) -> tuple[list[tuple[int, list[str]]], int]:
    """Return the first rows that are not blank, split as the first row with numbers is, and the lines before that."""
    lines = [(number, line) for number, line in enumerate(text.splitlines()[: 4 * TITLES], start=1) if line.strip()]
    first = next(
        ((number, line) for number, line in lines if sum(map(is_number, _split(line, find_delimiter(line)))) >= 3),
        lines[0] if lines else (1, ""),
    )
    delimiter = delimiter or find_delimiter(first[1])
    return [(number, _split(line, delimiter)[:_MOST_FIELDS]) for number, line in lines[:_SHOWN]], first[0] - 1


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    return [field.strip() for field in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
