"""Spreadsheet tables with a header (layout 7): semicolons and decimal commas, or commas and points; units in the names.

Time stamps that a spreadsheet turned into ``2,02E+13`` are left out, and the summary says so. Without a unit lengths
are mm, and an error where they look like metres.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from truepose.samples import Samples
from truepose.trackers.columns import read_columns, read_millimetres
from truepose.trackers.exporting import row_names
from truepose.trackers.formats.headed import header_columns, names_xyz, states_unit
from truepose.trackers.readings import Layout, Readings, decode


def read(data: bytes, path: str | Path) -> Readings:
    """Read the columns that the header names x, y, z, name, time, rx, ry, rz or q0 … q3.

    Raises
    ------
    FileError
        If the header contradicts itself, or a field cannot be read; with the line.
    """
    text = decode(data, path)
    columns = header_columns(text, path)
    reader = read_columns if states_unit(text) else read_millimetres
    return reader(data, path, columns, LAYOUT.name)


def write(samples: Samples) -> bytes:
    """Write joints [rad] and positions [m] with decimal commas, to 0.1 µrad and 0.1 µm, time stamps rounded."""
    joints = np.zeros((len(samples), 6)) if samples.q is None else samples.q
    names = [f"j{k + 1} [rad]" for k in range(joints.shape[1])]
    header = ";".join(["Time", "Point", *names, "X [m]", "Y [m]", "Z [m]"])
    name = row_names(samples)
    rows = (
        ";".join(
            ["2.02E+13", name[i], *(f"{value:.7f}" for value in joints[i]), *(f"{1e-3 * value:.7f}" for value in p)]
        ).replace(".", ",")
        for i, p in enumerate(samples.p_meas)
    )
    return ("\r\n".join([header, *rows]) + "\r\n").encode()


LAYOUT: Final = Layout("spreadsheet", "table with a header that names x, y and z", names_xyz, read, write)
