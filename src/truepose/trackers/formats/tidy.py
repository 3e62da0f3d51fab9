"""The tidy table of truepose as a source of readings (layout 11): x_meas_mm … and the other measured quantities."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

from scipy.spatial.transform import Rotation

from truepose._io.delimited import first_row, parse
from truepose.samples import samples_text
from truepose.samples.columns import gather, require
from truepose.trackers.layout import Layout
from truepose.trackers.readings import Readings

_MEASURED: Final = {"name", "p_meas", "rxyz_meas", "p_std", "rotation_std", "time"}


def _read(text: str, path: str | Path) -> Readings:
    """Read the measured columns of a tidy table; those of joints and commanded poses are not read."""
    table = parse(text, path)
    arrays: dict[str, Any] = dict(gather(table, _MEASURED, finite=False))
    require(table, arrays, "x_meas")
    if (rxyz := arrays.pop("rxyz_meas", None)) is not None:
        arrays["rotation"] = Rotation.from_euler("XYZ", rxyz)
    return Readings(p=arrays.pop("p_meas"), line=table.line, source=str(path), **arrays)


LAYOUT: Final = Layout(
    "tidy",
    "tidy table (x_meas_mm, y_meas_mm, z_meas_mm, …)",
    lambda text: re.search(r"\b[xyz]_meas", first_row(text), re.IGNORECASE) is not None,
    _read,
    lambda samples: samples_text(samples).encode(),
)
