"""Name, x, y, z between semicolons, with empty fields at the end (layout 4); mm."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from truepose.samples import Samples
from truepose.trackers.columns import Columns, first_row, read_millimetres
from truepose.trackers.exporting import row_names
from truepose.trackers.readings import Layout, Readings

_NUMBER: Final = r"\s*+[+-]?[0-9]++(?:[.,][0-9]*+)?+(?:[eE][+-]?[0-9]++)?+\s*+"
_ROW: Final = re.compile(rf"[^;]*;{_NUMBER};{_NUMBER};{_NUMBER}(?:;\s*)*")
_COLUMNS: Final = Columns(name=1, x=2, y=3, z=4, delimiter=";")


def _matches(text: str) -> bool:
    return _ROW.fullmatch(first_row(text)) is not None


def read(data: bytes, path: str | Path) -> Readings:
    """Read such a file; see `read_columns`."""
    return read_millimetres(data, path, _COLUMNS, LAYOUT.name)


def write(samples: Samples) -> bytes:
    """Write to 1 µm, lines ended by CR LF."""
    name = row_names(samples)
    rows = (f"P{name[i]};{x:.3f};{y:.3f};{z:.3f};;;;\r\n" for i, (x, y, z) in enumerate(samples.p_meas))
    return "".join(rows).encode()


LAYOUT: Final = Layout("semicolons", "name;x;y;z in mm, fields after them empty", _matches, read, write)
