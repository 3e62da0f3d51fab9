"""The tidy table (layout 11 of the tracker files): one row per reading, with the unit in the name of each column.

==========================================  =========================================================================
columns                                     meaning
==========================================  =========================================================================
name (or point), row                        name of the point, for messages; number of the row in JSON, from 0
reflector                                   name of the reflector in the cell file: one row for each reflector of a pose
q1_deg …                                    joints, in the robot's own order and sign
q1_shown_deg …                              joints as the controller shows them, where these differ (FANUC's J3)
x_cmd_mm …, roll/pitch/yaw_cmd_deg          commanded pose, base frame; R = Rz(yaw) Ry(pitch) Rx(roll)
x_meas_mm …, rx/ry/rz_meas_deg              measured pose, tracker frame; R = Rx(rx) Ry(ry) Rz(rz)
x_std_mm …, rx_std_deg …                    standard deviations of the reading
approach1 …                                 sign of the last motion of each joint: -1, 0, +1
distance_mm, distance_std_mm                distance of the tool point from a fixed point, in rows without x_meas_mm …
origin, x_origin_mm …                       that point: its name in the cell file, or its position in the tracker frame
time_s, temp_C, load_kg                     time of the reading, air temperature, payload
x_load_mm …                                 centre of mass of the payload, flange frame
masked                                      the reason to leave this row out; empty where it counts
fact                                        what the import found about the table (code: words), one fact to a row
==========================================  =========================================================================

Lengths may also be _m, _cm, _um, _in, angles _rad, _mrad; the delimiter is a comma, semicolon, tab or blanks.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose._io.delimited import (
    TextTable,
    csv_cell,
    escaped,
    find_delimiter,
    first_row,
    is_number,
    parse,
    read_tabular,
)
from truepose._io.files import write_atomic
from truepose._io.workbook import in_format, is_workbook
from truepose._typing import FloatArray
from truepose.errors import DataError, FileError
from truepose.samples.checks import check
from truepose.samples.columns import header_of, names_columns
from truepose.samples.distances import check_distances
from truepose.samples.frames import quantities
from truepose.samples.masked import BETWEEN, FACT, MASKED, SampleTable, all_rows, counted_quantities
from truepose.samples.split import distance_quantities
from truepose.samples.table import Distances, Poses, Samples


def read_samples(path: str | Path) -> Samples:
    """Read a tidy table of commanded configurations and their measurements, and check it.

    Parameters
    ----------
    path : str or Path
        A CSV file or a workbook (``file.xlsx``, ``file.xlsx#Sheet``) with
        x_meas_mm … and q1_deg … or x_cmd_mm … (or both).

    Returns
    -------
    Samples
        The samples in the order of the file, without masked rows; these are named in `Samples.excluded`.

    Raises
    ------
    FileError
        If the file is not a tidy table; with the line.
    DataError
        If values are implausible (`check`); with the rows.

    Examples
    --------
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> samples = Samples(np.array([[2100.0, 5.0, 800.0], [2050.0, 360.0, 800.0]]), q=np.radians([[10.0], [20.0]]))
    >>> with TemporaryDirectory() as folder:
    ...     write_samples(f"{folder}/samples.csv", samples)
    ...     read_samples(f"{folder}/samples.csv").p_meas
    array([[2100.,    5.,  800.],
           [2050.,  360.,  800.]])
    """
    table = _table(path)
    samples = Samples.of(counted_quantities(table), str(table.path))
    check(samples)
    return samples


def read_all_samples(path: str | Path) -> SampleTable:
    """Read a tidy table with its masked rows, to show it; fields that are no number are nan.

    Raises
    ------
    FileError
        If the file is not a tidy table.
    """
    return all_rows(_table(path))


def read_samples_but(path: str | Path, reasons: NDArray[np.str_]) -> Samples:
    """Read the samples without a reason (n,) to leave them out; the column ``masked`` does not matter.

    Raises
    ------
    FileError
        If the file is not a tidy table, or a value of a row that counts is invalid; with the line.
    """
    table = _table(path)
    return Samples.of(counted_quantities(table, reasons), str(table.path))


def read_poses(path: str | Path) -> Poses:
    """Read commanded configurations without measurements: poses for a prediction, or a plan (``plan.csv``).

    Parameters
    ----------
    path : str or Path
        A CSV file or a workbook (``file.xlsx``, ``file.xlsx#Sheet``) with
        q1_deg … or x_cmd_mm … (or both); columns of measurements are ignored.

    Returns
    -------
    Poses
        The poses in the order of the file.

    Raises
    ------
    FileError, DataError
        For the reasons of `read_samples`.

    Examples
    --------
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     write_samples(f"{folder}/poses.csv", Poses(p_cmd=np.array([[1200.0, 0.0, 900.0], [1350.0, 200.0, 900.0]])))
    ...     read_poses(f"{folder}/poses.csv").p_cmd
    array([[1200.,    0.,  900.],
           [1350.,  200.,  900.]])
    """
    table = _table(path)
    poses = Poses(**quantities(table, measured=False), line=table.line, source=str(table.path))
    check(poses)
    return poses


def read_distances(path: str | Path) -> Distances:
    """Read distances from fixed points: a tidy table with q1_deg … and distance_mm.

    Parameters
    ----------
    path : str or Path
        A CSV file or a workbook (``file.xlsx``, ``file.xlsx#Sheet``).

    Returns
    -------
    Distances
        The distances in the order of the file.

    Raises
    ------
    FileError, DataError
        If the file is no such table, or its values are implausible; with the line or the rows.
    """
    table = _table(path)
    found = distance_quantities(table)
    if "distance" not in found:
        raise FileError(table.path, "needs the column distance_mm, beside q1_deg …", line=table.header_line)
    distances = Distances(**found, source=str(table.path))
    check_distances(distances)
    check(distances)
    return distances


def write_samples(path: str | Path, samples: Poses, reasons: NDArray[np.str_] | None = None) -> None:
    """Write a tidy table of samples or of a plan, in mm and degrees with 12 significant digits.

    Parameters
    ----------
    path : str or Path
        The file to write; a workbook if its name ends in ``.xlsx``, else CSV.
    samples : Poses
        The samples or poses.
    reasons : (n,) array of str, optional
        The reasons to leave rows out, for the column ``masked``; empty where a row counts.

    Raises
    ------
    FileError
        If the file cannot be written; nothing is changed then.
    """
    write_atomic(path, in_format(path, samples_text(samples, path, reasons)))


def samples_text(samples: Poses, path: str | Path = "samples", reasons: NDArray[np.str_] | None = None) -> str:
    """Return the text of a tidy table; see `write_samples`."""
    columns = {name: _text(path, values) for name, values in samples.table_columns().items()}
    if reasons is not None and (reasons != "").any():
        masked = [csv_cell(reason) for reason in reasons.tolist()]
        columns[MASKED] = masked + [""] * (len(columns["row"]) - len(masked))
    if found := [f"{code}: {words}" for code, words in getattr(samples, "facts", ())]:
        n = len(columns["row"])
        columns[FACT] = [csv_cell(escaped(BETWEEN.join(found[k::n]))) for k in range(n)]
    rows = [",".join(row) for row in zip(*columns.values(), strict=True)]
    return "\n".join([",".join(columns), *rows]) + "\n"


def append_columns(
    path: str | Path, out: str | Path, columns: Mapping[str, FloatArray] | Mapping[str, NDArray[np.str_]]
) -> None:
    """Copy a table with further columns at its end; columns of the same name are replaced, others stay unchanged.

    Parameters
    ----------
    path : str or Path
        The table to read.
    out : str or Path
        The file to write.
    columns : mapping of str to (n,) array of float or str
        The new columns by their full names, in the units of the names.

    Raises
    ------
    FileError
        If the table cannot be read or the file cannot be written.
    DataError
        If a column has another number of rows than the table.
    """
    table = _table(path)
    for name, values in columns.items():
        if len(values) != len(table.fields):
            raise DataError(f"{path}: has {len(table.fields)} rows, but the column {name} has {len(values)}")
    kept = [index for index, name in enumerate(table.header) if name.strip().lower() not in columns]
    added = [_fields(values) for values in columns.values()]
    text = StringIO()
    delimiter = "," if is_workbook(out) else table.delimiter
    writer = csv.writer(text, delimiter=delimiter, lineterminator="\n")
    writer.writerow([*(_cell(table.header[index]) for index in kept), *columns])
    rows = ([_cell(field) for field in row] for row in table.fields[:, kept].tolist())
    writer.writerows([*row, *new] for row, *new in zip(rows, *added, strict=True))
    write_atomic(out, in_format(out, text.getvalue()))


def _table(path: str | Path) -> TextTable:
    """Read a table whose header may have titles above it."""
    text, source = read_tabular(path)
    skip = header_of(text, joints=True)
    if skip is None:
        try:
            return parse(text, source)
        except FileError as error:
            if error.line is None or names_columns(first_row(text)):
                raise
            reason = str(error).removeprefix(f"{source}:{error.line}: ")
            remedy = (
                "no line names columns as q1_deg or x_meas_mm do; readings of a tracker need 'truepose import' first"
            )
            raise FileError(source, f"{reason}; {remedy}", line=error.line) from None
    return parse(text, source, skip=skip, delimiter=find_delimiter(text.splitlines()[skip - 1]))


def _fields(values: NDArray[Any]) -> list[str]:
    """Return the values of a new column as fields of a table."""
    if values.dtype.kind == "U":
        return [escaped(str(value)) for value in values]
    return [f"{value:.12g}" for value in values]


def _cell(field: str) -> str:
    """Return a field unchanged, or escaped if it is not a number and a spreadsheet would read it as a formula."""
    return field if field.startswith("'") or is_number(field) else escaped(field)


def _text(path: str | Path, values: NDArray[Any]) -> list[str]:
    if values.dtype.kind == "U":
        bad = [name for name in values if any(letter in name for letter in ',;"\t\n\r')]
        if bad:
            raise FileError(path, f"the pose name {bad[0]!r} contains a delimiter or quotation mark; rename the pose")
        return [escaped(str(name)) for name in values]
    if values.dtype.kind == "i":
        return [str(value) for value in values]
    return ["" if np.isnan(value) else f"{value:.12g}" for value in values]
