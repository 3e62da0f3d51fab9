"""Leica CSV with U(95) (layout 3): names with double blanks and units, quaternions, an apostrophe before the time.

U(95) is read as an expanded uncertainty with k = 2 for each axis (not confirmed by the maker): the standard deviation
is half of it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose.samples import Samples
from truepose.trackers.formats.headed import header_columns
from truepose.trackers.layout import Layout, in_columns, row_names, row_times
from truepose.trackers.readings import first_line
from truepose.trackers.times import date


def _write(samples: Samples) -> bytes:
    """Write positions and U(95) to 0.1 µm and quaternions to nine digits, in Latin-1."""
    n = len(samples)
    rotation, std = samples.rotation_meas, samples.p_std
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)) if rotation is None else rotation.as_quat(scalar_first=True)
    u95 = np.zeros(n) if std is None else 2.0 * np.sqrt((std**2).mean(axis=1))
    rows = ["Name,X  [mm],Y  [mm],Z  [mm],U(95)  [mm],Temp  [°C],Q0 ,Q1 ,Q2 ,Q3 ,Time,"]
    for name, time, p, u, q in zip(
        row_names(samples), row_times(samples), samples.p_meas, u95, quaternion, strict=True
    ):
        numbers = ",".join([*(f"{value:.4f}" for value in (*p, u)), "20.0", *(f"{value:.9f}" for value in q)])
        rows.append(f"{name},{numbers},'{date(time, '%Y-%m-%d %H:%M:%S.%f')},")
    return ("\r\n".join(rows) + "\r\n").encode("latin-1")


LAYOUT: Final = Layout(
    "leica",
    "Leica CSV with U(95)",
    lambda text: "U(95)" in first_line(text),
    in_columns(header_columns, unit_stated=True),
    _write,
)
