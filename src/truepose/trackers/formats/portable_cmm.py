"""Points of a portable measuring arm (layout 5): several probings of one element, to be averaged; mm."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Final

from truepose.samples import Samples
from truepose.trackers.columns import Columns, read_millimetres
from truepose.trackers.exporting import row_names
from truepose.trackers.readings import Layout, Readings, first_line

_HEADER: Final = "Element Name,Number,Deviation,MX Coord.,MY Coord.,MZ Coord."
_COLUMNS: Final = Columns(name="Element Name", x="MX Coord.", y="MY Coord.", z="MZ Coord.", delimiter=",", skip=1)


def _matches(text: str) -> bool:
    return "MX Coord" in first_line(text)


def read(data: bytes, path: str | Path) -> Readings:
    """Read all probings; those of one point are averaged when they are matched with the plan.

    Raises
    ------
    FileError
        See `read_columns`.
    """
    return read_millimetres(data, path, _COLUMNS, LAYOUT.name)


def write(samples: Samples) -> bytes:
    """Write to 0.1 µm; the number counts the probings of an element."""
    probed: Counter[str] = Counter()
    rows = []
    for name, (x, y, z) in zip(row_names(samples), samples.p_meas, strict=True):
        probed[name] += 1
        rows.append(f"{name},{probed[name]},0.0000,{x:.4f},{y:.4f},{z:.4f}\n")
    return "".join([_HEADER + "\n", *rows]).encode()


LAYOUT: Final = Layout("portable-cmm", "portable measuring arm (Element Name … MX Coord.)", _matches, read, write)
