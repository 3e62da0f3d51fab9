"""Leica CSV with U(95) (layout 3): names with double blanks and units, quaternions, an apostrophe before the time.

U(95) is taken as an expanded uncertainty with k = 2 that holds for each axis (unconfirmed): half of it is the standard
deviation.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from truepose.samples import Samples
from truepose.trackers.columns import read_columns
from truepose.trackers.exporting import row_names, row_times
from truepose.trackers.formats.headed import header_columns
from truepose.trackers.readings import Layout, Readings, decode, first_line
from truepose.trackers.times import date


def _matches(text: str) -> bool:
    return "U(95)" in first_line(text)


def read(data: bytes, path: str | Path) -> Readings:
    """Read a Leica CSV: positions, standard deviations, orientations and times by the names of its columns.

    Raises
    ------
    FileError
        If x, y and z are not among the columns, or a field cannot be read; with the line.
    """
    columns = header_columns(decode(data, path), path)
    return read_columns(data, path, columns, LAYOUT.name)


def write(samples: Samples) -> bytes:
    """Write positions and U(95) to 0.1 µm and quaternions to nine digits, in latin-1."""
    quaternion = (
        np.tile([1.0, 0.0, 0.0, 0.0], (len(samples), 1))
        if samples.rotation_meas is None
        else samples.rotation_meas.as_quat(scalar_first=True)
    )
    u95 = np.zeros(len(samples)) if samples.p_std is None else 2.0 * np.sqrt((samples.p_std**2).mean(axis=1))
    header = "Name,X  [mm],Y  [mm],Z  [mm],U(95)  [mm],Temp  [°C],Q0 ,Q1 ,Q2 ,Q3 ,Time,\r\n"
    name, time = row_names(samples), row_times(samples)
    rows = (
        f"{name[i]},{x:.4f},{y:.4f},{z:.4f},{u95[i]:.4f},20.0,"
        + ",".join(f"{value:.9f}" for value in quaternion[i])
        + f",'{date(time[i], '%Y-%m-%d %H:%M:%S.%f')},\r\n"
        for i, (x, y, z) in enumerate(samples.p_meas)
    )
    return (header + "".join(rows)).encode("latin-1")


LAYOUT: Final = Layout("leica", "Leica CSV with U(95)", _matches, read, write)
