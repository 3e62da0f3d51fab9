"""Our own tidy table as a source of readings (layout 11): x_meas_mm … and what else is measured."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

from scipy.spatial.transform import Rotation

from truepose._io.delimited import parse
from truepose.samples import samples_text
from truepose.samples.columns import gather, require
from truepose.trackers.readings import Layout, Readings, decode

_MEASURED: Final = {"name", "p_meas", "rxyz_meas", "p_std", "rotation_std", "time"}


def _matches(text: str) -> bool:
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    return re.search(r"\b[xyz]_meas", first, re.IGNORECASE) is not None


def read(data: bytes, path: str | Path) -> Readings:
    """Read the measured columns of a tidy table; those of joints and commanded poses are not looked into.

    Raises
    ------
    FileError
        If a column is misnamed or missing, or a field is no number; with the line.
    """
    table = parse(decode(data, path), path)
    arrays: dict[str, Any] = dict(gather(table, _MEASURED, finite=False))
    require(table, arrays, "x_meas")
    if (rxyz := arrays.pop("rxyz_meas", None)) is not None:
        arrays["rotation"] = Rotation.from_euler("XYZ", rxyz)
    return Readings(p=arrays.pop("p_meas"), line=table.line, layout=LAYOUT.name, source=str(path), **arrays)


LAYOUT: Final = Layout(
    "tidy",
    "tidy table (x_meas_mm, y_meas_mm, z_meas_mm, …)",
    _matches,
    read,
    lambda samples: samples_text(samples).encode(),
)
