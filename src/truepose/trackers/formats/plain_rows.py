"""Rows without a header, recognised by their first row: layouts 4, 6, 8 and 10."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._io.delimited import find_delimiter, first_row, is_number
from truepose._typing import FloatArray
from truepose.errors import DataError, FileError
from truepose.samples import Samples, looks_like_metres
from truepose.trackers.columns import Columns, read_columns
from truepose.trackers.layout import NUMBER, Layout, first_row_matches, in_columns, row_names, row_times
from truepose.trackers.readings import Readings
from truepose.trackers.times import EPOCH

_DECIMAL: Final = NUMBER.replace(r"\.", "[.,]")  # a decimal comma, too


def _is_three_columns(text: str) -> bool:
    row = first_row(text)
    fields = row.split(find_delimiter(row).strip(" ") or None)
    return len(fields) == 3 and all(map(is_number, fields))


def _write_columns(samples: Samples) -> bytes:
    """Write positions as ``numpy.savetxt`` does, to 19 digits."""
    return "".join(" ".join(f"{value:.18e}" for value in p) + "\n" for p in samples.p_meas).encode()


def _write_semicolons(samples: Samples) -> bytes:
    """Write names and positions to 1 µm; lines end with CR LF."""
    rows = zip(row_names(samples), samples.p_meas, strict=True)
    return "".join(f"P{name};{x:.3f};{y:.3f};{z:.3f};;;;\r\n" for name, (x, y, z) in rows).encode()


def _write_motion(samples: Samples) -> bytes:
    """Write commanded and measured poses to 0.1 µm and 0.0001°; the angles are 0 without orientations."""
    if samples.p_cmd is None:
        raise DataError(f"{samples.source}: has no commanded positions (x_cmd_mm …), which this layout needs")
    values = np.hstack(
        [samples.p_cmd, _angles(samples.rotation_cmd, samples), samples.p_meas, _angles(samples.rotation_meas, samples)]
    )
    rows = zip(row_names(samples), values, strict=True)
    return "".join(f"Motion{name} {' '.join(f'{value:.4f}' for value in row)}\n" for name, row in rows).encode()


def _angles(rotation: Rotation | None, samples: Samples) -> FloatArray:
    return np.zeros((len(samples), 3)) if rotation is None else np.asarray(rotation.as_euler("xyz", degrees=True))


def _read_epoch(text: str, path: str | Path) -> Readings:
    """Read times from the first column and metres from the last three."""
    count = len(first_row(text).split())
    columns = Columns(time=1, x=count - 2, y=count - 1, z=count, unit="m", delimiter=" ")
    readings = read_columns(text, path, columns)
    p = readings.p[~readings.missing] / 1000.0
    if len(p) > 1 and not looks_like_metres(p):
        spread = np.linalg.norm(np.ptp(p, axis=0))
        message = f"the last three columns spread over {spread:.4g} units, too much for metres"
        raise FileError(path, f"{message}; say which with --columns", line=int(readings.line[0]))
    return readings


def _write_epoch(samples: Samples) -> bytes:
    """Write times to 10 ms and positions in metres to 1 µm."""
    rows = enumerate(zip(row_times(samples), 1e-3 * samples.p_meas, strict=True))
    return "".join(f"{EPOCH + t:.2f} {i} 0 {x:.6f} {y:.6f} {z:.6f}\n" for i, (t, (x, y, z)) in rows).encode()


SEMICOLONS: Final = Layout(
    "semicolons",
    "name;x;y;z, fields after them empty",
    first_row_matches(rf"[^;]*(?:;\s*+{_DECIMAL}\s*+){{3}}(?:;\s*)*"),
    in_columns(Columns(name=1, x=2, y=3, z=4, delimiter=";")),
    _write_semicolons,
)
MOTION: Final = Layout(  # angles about fixed axes x, y, z: not confirmed by the maker
    "motion",
    "name, six nominal and six measured values",
    first_row_matches(rf"\S+(?:\s+{NUMBER}){{12}}"),
    in_columns(Columns(name=1, x=8, y=9, z=10, rotation=(11, 12, 13), delimiter=" ")),
    _write_motion,
)
COLUMNS: Final = Layout(
    "columns",
    "three bare columns x, y, z",
    _is_three_columns,
    in_columns(Columns(x=1, y=2, z=3)),
    _write_columns,
)
EPOCH_METRES: Final = Layout(
    "epoch",
    "epoch seconds, counters, x, y, z in metres",
    first_row_matches(rf"1[0-9]{{9}}(?:\.[0-9]+)?(?:\s+[0-9]+)*(?:\s+{NUMBER}){{3}}"),
    _read_epoch,
    _write_epoch,
)
