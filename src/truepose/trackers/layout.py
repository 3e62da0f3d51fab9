"""A layout of measurement files: how to recognise, read and write it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from truepose._io.delimited import escaped, first_row
from truepose._typing import FloatArray
from truepose.samples import Samples
from truepose.trackers.columns import Columns, read_columns
from truepose.trackers.readings import Readings

NUMBER: Final = r"(?:[+-]?(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[eE][+-]?[0-9]++)?+|[+-]?[nN][aA][nN])"
"""Pattern of a number with a decimal point, or of nan."""
_SECONDS_PER_ROW: Final = 15.0


@dataclass(frozen=True)
class Layout:
    """A layout of measurement files.

    Attributes
    ----------
    key : str
        The short name, for `write_readings`.
    name : str
        The name in messages.
    matches : callable
        ``matches(text) -> bool``: whether a text has this layout.
    read : callable
        ``read(text, path) -> Readings``; raises `FileError` with the line.
    write : callable
        ``write(samples) -> bytes``: one row per sample, in their order.
    """

    key: str
    name: str
    matches: Callable[[str], bool]
    read: Callable[[str, str | Path], Readings]
    write: Callable[[Samples], bytes]


def in_columns(
    columns: Columns | Callable[[str, str | Path], Columns], *, unit_stated: bool = False
) -> Callable[[str, str | Path], Readings]:
    """Return the reader of a layout with one reading per row.

    Parameters
    ----------
    columns : Columns or callable
        The columns of the quantities, or a function ``columns(text, path)`` that finds them.
    unit_stated : bool
        Whether files state their unit; if not, the user may, and readings that seem to be metres are refused.
    """

    def read(text: str, path: str | Path) -> Readings:
        readings = read_columns(text, path, columns if isinstance(columns, Columns) else columns(text, path))
        return replace(readings, unit_stated=unit_stated)

    return read


def first_row_matches(pattern: str) -> Callable[[str], bool]:
    """Return a test whether the first row of a text that is no comment is like a regular expression, in any case."""
    compiled = re.compile(pattern, re.IGNORECASE)
    return lambda text: compiled.fullmatch(first_row(text)) is not None


def row_names(samples: Samples) -> list[str]:
    """Return a name per row, safe for spreadsheets: its own, else the number of its pose from 1."""
    assert samples.row is not None
    if samples.name is None:
        return [str(row + 1) for row in samples.row.tolist()]
    return [escaped(name) for name in samples.name.tolist()]


def row_times(samples: Samples) -> list[float]:
    """Return the time of each row [s]; 15 s between rows if times are not known."""
    time: FloatArray | None = samples.time
    return [_SECONDS_PER_ROW * i for i in range(len(samples))] if time is None else time.tolist()
