"""A logger's rows (layout 10): epoch seconds, counters, then x, y, z in metres, between blanks."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from truepose.errors import FileError
from truepose.samples import Samples, looks_like_metres
from truepose.trackers.columns import Columns, first_row, read_columns
from truepose.trackers.exporting import row_times
from truepose.trackers.readings import Layout, Readings, decode
from truepose.trackers.times import EPOCH

_NUMBER: Final = r"[+-]?[0-9]++(?:\.[0-9]*+)?+(?:[eE][+-]?[0-9]++)?+|nan"
_ROW: Final = re.compile(
    rf"1[0-9]{{9}}(?:\.[0-9]+)?(?P<counters>(?:\s+[0-9]+)*)(?:\s+(?:{_NUMBER})){{3}}", re.IGNORECASE
)


def _matches(text: str) -> bool:
    return _ROW.fullmatch(first_row(text)) is not None


def read(data: bytes, path: str | Path) -> Readings:
    """Read the time from the first column and metres from the last three.

    Raises
    ------
    FileError
        If the positions cannot be metres, or a field is no number; with the line.
    """
    count = len(first_row(decode(data, path)).split())
    columns = Columns(time=1, x=count - 2, y=count - 1, z=count, unit="m", delimiter=" ")
    readings = read_columns(data, path, columns, LAYOUT.name)
    p = readings.p[~readings.missing] / 1000.0
    if len(p) > 1 and not looks_like_metres(p):
        spread = np.linalg.norm(np.ptp(p, axis=0))
        message = (
            f"the last three columns spread over {spread:.4g} units, too much for metres; say which with --columns"
        )
        raise FileError(path, message, line=int(readings.line[0]))
    return readings


def write(samples: Samples) -> bytes:
    """Write metres to 1 µm, times to 10 ms."""
    time = row_times(samples)
    rows = (
        f"{EPOCH + time[i]:.2f} {i} 0 " + " ".join(f"{1e-3 * value:.6f}" for value in p) + "\n"
        for i, p in enumerate(samples.p_meas)
    )
    return "".join(rows).encode()


LAYOUT: Final = Layout("epoch", "epoch seconds, counters, x, y, z in metres", _matches, read, write)
