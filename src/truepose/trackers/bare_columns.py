"""Three bare columns from a script (layout 8): x, y, z in mm, no header, all-zero rows where a reading is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from truepose.samples import Samples
from truepose.trackers.columns import Columns, read_millimetres, split
from truepose.trackers.readings import Layout, Readings, first_line

_COLUMNS: Final = Columns(x=1, y=2, z=3)


def _matches(text: str) -> bool:
    table = split(first_line(text), "")
    fields = table.fields[0].tolist()
    if len(fields) != 3:
        return False
    try:
        return all(float(field.replace(",", ".")) is not None for field in fields)
    except ValueError:
        return False


def read(data: bytes, path: str | Path) -> Readings:
    """Read three columns between blanks, tabs, semicolons or commas; see `read_columns`."""
    return read_millimetres(data, path, _COLUMNS, LAYOUT.name)


def write(samples: Samples) -> bytes:
    """Write as ``numpy.savetxt`` does, to 19 digits."""
    return "".join(" ".join(f"{value:.18e}" for value in p) + "\n" for p in samples.p_meas).encode()


LAYOUT: Final = Layout("columns", "three bare columns x, y, z in mm", _matches, read, write)
