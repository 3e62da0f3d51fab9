"""Which layout a measurement file has; where none fits, what it looks like."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from truepose._io.files import read_bytes, write_atomic
from truepose.errors import DataError, FileError
from truepose.samples import Samples
from truepose.trackers.columns import Columns, read_columns
from truepose.trackers.formats import (
    bare_columns,
    epoch,
    leica,
    motion,
    portable_cmm,
    pose_log,
    semicolons,
    spatial_analyzer,
    spreadsheet,
    tidy,
)
from truepose.trackers.readings import Layout, Readings, decode

LAYOUTS: Final[tuple[Layout, ...]] = (
    spatial_analyzer.WITH_HEADER,
    tidy.LAYOUT,
    leica.LAYOUT,
    portable_cmm.LAYOUT,
    pose_log.LAYOUT,
    spreadsheet.LAYOUT,
    motion.LAYOUT,
    epoch.LAYOUT,
    semicolons.LAYOUT,
    bare_columns.LAYOUT,
    spatial_analyzer.BARE,
)
"""The layouts, in the order in which they are tried."""

_REMEDY: Final = "Say where x, y and z stand, such as --columns 'x=4, y=5, z=6, unit=mm'"
_DELIMITERS: Final = {",": "commas", ";": "semicolons", "\t": "tabs"}


def read_readings(path: str | Path, columns: Columns | None = None) -> Readings:
    """Read a measurement file of any known layout, or of one that is told.

    Parameters
    ----------
    path : str or Path
    columns : Columns, optional
        Where the quantities stand; the layout is recognised when this is not given.

    Returns
    -------
    Readings
        Positions [mm] in the tracker frame.

    Raises
    ------
    FileError
        If the layout is not known (what was seen and what is known is said), or a line cannot be read.

    Examples
    --------
    >>> read_readings("tracker.txt").p  # doctest: +SKIP
    """
    data = read_bytes(path)
    return recognise(data, path).read(data, path) if columns is None else read_columns(data, path, columns)


def write_readings(path: str | Path, samples: Samples, layout: str) -> None:
    """Write samples as a measurement file, a row for each in their order: what a vendor's software would export.

    Parameters
    ----------
    path : str or Path
    samples : Samples
        Readings of zero are missing ones; rows may be left out, repeated or swapped by indexing.
    layout : str
        Key of one of the `LAYOUTS`.

    Raises
    ------
    DataError
        If there is no such layout, or it holds what the samples do not have.
    """
    keys = {known.key: known for known in LAYOUTS}
    if layout not in keys:
        raise DataError(f"no layout {layout!r}; there is: {', '.join(keys)}")
    write_atomic(path, keys[layout].write(samples))


def recognise(data: bytes, path: str | Path) -> Layout:
    """Return the layout of a file's content; see `read_readings`."""
    text = decode(data, path)
    for layout in LAYOUTS:
        if layout.matches(text):
            return layout
    known = "; ".join(layout.name for layout in LAYOUTS)
    raise FileError(
        path, f"unknown layout: {_describe(text)}. {_REMEDY}. Known are: {known}", line=_first_data_line(text)[0]
    )


def _describe(text: str) -> str:
    """Say what a text looks like: its delimiter, the number of columns, its first line with numbers."""
    _, line = _first_data_line(text)
    delimiter = max(_DELIMITERS, key=line.count)
    if line.count(delimiter):
        return f"{line.count(delimiter) + 1} columns between {_DELIMITERS[delimiter]}, as in {line[:60]!r}"
    return f"{len(line.split())} columns between blanks, as in {line[:60]!r}"


def _first_data_line(text: str) -> tuple[int, str]:
    """Return the first line with three numbers, else the first that is not blank; with its number from 1."""
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    with_numbers = (item for item in lines if len(re.findall(r"(?<![\w.])[+-]?[0-9]*\.?[0-9]+", item[1])) >= 3)
    return next(with_numbers, lines[0] if lines else (1, ""))
