"""Points of a portable measuring arm (layout 5): several probings of one element, to be averaged; mm."""

from __future__ import annotations

from collections import Counter
from typing import Final

from truepose.samples import Samples
from truepose.trackers.columns import Columns
from truepose.trackers.layout import Layout, in_columns, row_names
from truepose.trackers.readings import first_line

_HEADER: Final = "Element Name,Number,Deviation,MX Coord.,MY Coord.,MZ Coord."


def _write(samples: Samples) -> bytes:
    """Write positions to 0.1 µm; the number counts the probings of an element."""
    probed: Counter[str] = Counter()
    rows = [_HEADER]
    for name, (x, y, z) in zip(row_names(samples), samples.p_meas, strict=True):
        probed[name] += 1
        rows.append(f"{name},{probed[name]},0.0000,{x:.4f},{y:.4f},{z:.4f}")
    return ("\n".join(rows) + "\n").encode()


LAYOUT: Final = Layout(
    "portable-cmm",
    "portable measuring arm (Element Name … MX Coord.)",
    lambda text: "MX Coord" in first_line(text),
    in_columns(Columns(name="Element Name", x="MX Coord.", y="MY Coord.", z="MZ Coord.", delimiter=",", skip=1)),
    _write,
)
