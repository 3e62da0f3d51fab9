"""The tidy table of truepose as a source of readings (layout 11): x_meas_mm … and the other measured quantities."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

from scipy.spatial.transform import Rotation

from truepose._io.delimited import find_delimiter, first_row, parse
from truepose.samples import samples_text
from truepose.samples.columns import gather, header_of, require
from truepose.trackers.layout import Layout
from truepose.trackers.readings import Readings

_MEASURED: Final = {"name", "p_meas", "rxyz_meas", "p_std", "rotation_std", "time"}


def _read(text: str, path: str | Path) -> Readings:
    """Read the measured columns of a tidy table; those of joints and commanded poses are not read."""
    skip, line = _header(text)
    table = parse(text, path, skip=skip, delimiter=find_delimiter(line))
    arrays: dict[str, Any] = dict(gather(table, _MEASURED, finite=False))
    require(table, arrays, "x_meas")
    if (rxyz := arrays.pop("rxyz_meas", None)) is not None:
        arrays["rotation"] = Rotation.from_euler("XYZ", rxyz)
    return Readings(p=arrays.pop("p_meas"), line=table.line, source=str(path), **arrays)


def _header(text: str) -> tuple[int | None, str]:
    """Return the number of lines up to the header, None if no title stands above it, and the header."""
    skip = header_of(text)
    return skip, first_row(text) if skip is None else text.splitlines()[skip - 1]


LAYOUT: Final = Layout(
    "tidy",
    "tidy table (x_meas_mm, y_meas_mm, z_meas_mm, …)",
    lambda text: re.search(r"\b[xyz]_meas", _header(text)[1], re.IGNORECASE) is not None,
    _read,
    lambda samples: samples_text(samples).encode(),
)
