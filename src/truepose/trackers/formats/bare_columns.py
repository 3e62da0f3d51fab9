"""Three bare columns from a script (layout 8): x, y, z in mm, no header, all-zero rows where a reading is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from truepose._io.strict import to_float
from truepose.samples import Samples
from truepose.trackers.columns import Columns, find_delimiter, first_row, read_millimetres
from truepose.trackers.readings import Layout, Readings

_COLUMNS: Final = Columns(x=1, y=2, z=3)


def _matches(text: str) -> bool:
    row = first_row(text)
    delimiter = find_delimiter(row)
    try:
        return len([to_float(field.replace(",", ".")) for field in row.split(delimiter.strip(" ") or None)]) == 3
    except ValueError:
        return False


def read(data: bytes, path: str | Path) -> Readings:
    """Read three columns between blanks, tabs, semicolons or commas; see `read_columns`."""
    return read_millimetres(data, path, _COLUMNS, LAYOUT.name)


def write(samples: Samples) -> bytes:
    """Write as ``numpy.savetxt`` does, to 19 digits."""
    return "".join(" ".join(f"{value:.18e}" for value in p) + "\n" for p in samples.p_meas).encode()


LAYOUT: Final = Layout("columns", "three bare columns x, y, z in mm", _matches, read, write)
