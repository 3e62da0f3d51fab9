"""Nominal and actual poses on one line (layout 6): a name, six nominal values, six measured; mm, deg, blanks.

Angles are about fixed axes x, y, z (unconfirmed); a mapping may say another order.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.errors import DataError
from truepose.samples import Samples
from truepose.trackers.columns import Columns, first_row, read_millimetres
from truepose.trackers.exporting import row_names
from truepose.trackers.readings import Layout, Readings

_NUMBER: Final = r"(?:[+-]?[0-9]++(?:\.[0-9]*+)?+(?:[eE][+-]?[0-9]++)?+|nan)"
_ROW: Final = re.compile(rf"\S+(?:\s+{_NUMBER}){{12}}", re.IGNORECASE)
_COLUMNS: Final = Columns(name=1, x=8, y=9, z=10, rotation=(11, 12, 13), delimiter=" ")


def _matches(text: str) -> bool:
    return _ROW.fullmatch(first_row(text)) is not None


def read(data: bytes, path: str | Path) -> Readings:
    """Read the measured poses; the nominal ones are the plan's, and are not looked into."""
    return read_millimetres(data, path, _COLUMNS, LAYOUT.name)


def write(samples: Samples) -> bytes:
    """Write to 0.1 µm and 0.0001°; without orientations these are 0.

    Raises
    ------
    DataError
        If there are no commanded positions.
    """
    if samples.p_cmd is None:
        raise DataError(f"{samples.source}: has no commanded positions (x_cmd_mm …), which this layout holds")
    nominal, actual = (
        np.column_stack([p, _angles(rotation, len(samples))])
        for p, rotation in ((samples.p_cmd, samples.rotation_cmd), (samples.p_meas, samples.rotation_meas))
    )
    rows = (
        f"Motion{name} " + " ".join(f"{value:.4f}" for value in values) + "\n"
        for name, values in zip(row_names(samples), np.hstack([nominal, actual]), strict=True)
    )
    return "".join(rows).encode()


def _angles(rotation: Rotation | None, n: int) -> NDArray[np.float64]:
    return np.zeros((n, 3)) if rotation is None else np.asarray(rotation.as_euler("xyz", degrees=True))


LAYOUT: Final = Layout("motion", "name, six nominal and six measured values", _matches, read, write)
