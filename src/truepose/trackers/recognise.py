"""Recognise the layout of a measurement file, or describe a file of unknown layout."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from truepose._io.delimited import read_tabular
from truepose._io.files import write_atomic
from truepose.errors import DataError, FileError
from truepose.samples import Samples
from truepose.trackers.columns import Columns, read_columns
from truepose.trackers.formats import headed, leica, plain_rows, portable_cmm, pose_log, spatial_analyzer, tidy
from truepose.trackers.layout import Layout
from truepose.trackers.readings import Readings, in_unit

LAYOUTS: Final[tuple[Layout, ...]] = (
    spatial_analyzer.WITH_HEADER,
    tidy.LAYOUT,
    leica.LAYOUT,
    portable_cmm.LAYOUT,
    pose_log.LAYOUT,
    headed.SPREADSHEET,
    plain_rows.MOTION,
    plain_rows.EPOCH_METRES,
    plain_rows.SEMICOLONS,
    plain_rows.COLUMNS,
    spatial_analyzer.BARE,
)
"""The known layouts, in the order in which they are tried."""

_REMEDY: Final = "State the columns, such as --columns 'x=4, y=5, z=6, unit=mm'"
_DELIMITERS: Final = {",": "commas", ";": "semicolons", "\t": "tabs"}


def read_readings(
    path: str | Path,
    columns: Columns | None = None,
    *,
    unit: str | None = None,
    layouts: Sequence[Layout] = LAYOUTS,
) -> Readings:
    """Read a measurement file of a known layout, or a table with stated columns.

    Parameters
    ----------
    path : str or Path
        The measurement file: text, or a workbook (``file.xlsx``, ``file.xlsx#Sheet``).
    columns : Columns, optional
        The columns of the quantities; by default the layout is recognised.
    unit : str, optional
        The unit of lengths (mm, m, cm, in) in a file that states none; by default mm.
    layouts : sequence of Layout
        The layouts that are tried, in this order.

    Returns
    -------
    Readings
        The positions [mm] in the tracker frame.

    Raises
    ------
    FileError
        If the layout is not known (the message describes the file and lists the known layouts), or a line cannot be
        read.

    Examples
    --------
    >>> read_readings("tracker.txt").p  # doctest: +SKIP
    """
    text, path = read_tabular(path)
    if columns is not None:
        stated = columns if unit is None else replace(columns, unit=unit)
        return replace(read_columns(text, path, stated), layout="stated columns")
    layout = recognise(text, path, layouts)
    return in_unit(replace(layout.read(text, path), layout=layout.name), unit)


def write_readings(path: str | Path, samples: Samples, layout: str) -> None:
    """Write samples as a measurement file, one row per sample, as a vendor's software would export them.

    Parameters
    ----------
    path : str or Path
        The file to write.
    samples : Samples
        The samples; a reading of zero is a missing one.
    layout : str
        The key of one of the `LAYOUTS`.

    Raises
    ------
    DataError
        If the layout is not known, or needs a quantity that the samples do not have.
    """
    keys = {known.key: known for known in LAYOUTS}
    if layout not in keys:
        raise DataError(f"expected a layout of {', '.join(keys)}; got {layout!r}")
    write_atomic(path, keys[layout].write(samples))


def recognise(text: str, path: str | Path, layouts: Sequence[Layout] = LAYOUTS) -> Layout:
    """Return the layout of a text; see `read_readings`."""
    for layout in layouts:
        if layout.matches(text):
            return layout
    known = "; ".join(layout.name for layout in layouts)
    raise FileError(
        path, f"unknown layout: {_describe(text)}. {_REMEDY}. Known are: {known}", line=_first_data_line(text)[0]
    )


def _describe(text: str) -> str:
    """Describe a text of unknown layout: the delimiter, the number of columns, the first line with numbers."""
    _, line = _first_data_line(text)
    delimiter = max(_DELIMITERS, key=line.count)
    if line.count(delimiter):
        return f"{line.count(delimiter) + 1} columns between {_DELIMITERS[delimiter]}, as in {line[:60]!r}"
    return f"{len(line.split())} columns between blanks, as in {line[:60]!r}"


def _first_data_line(text: str) -> tuple[int, str]:
    """Return the first line with three numbers, else the first that is not blank, with its number from 1."""
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    with_numbers = (item for item in lines if len(re.findall(r"(?<![\w.])[+-]?[0-9]*\.?[0-9]+", item[1])) >= 3)
    return next(with_numbers, lines[0] if lines else (1, ""))
