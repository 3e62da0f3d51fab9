"""Export of a fictitious probe: a title line with the unit, a header, semicolons and decimal commas."""

import re
from pathlib import Path

import numpy as np

from truepose.samples import Samples
from truepose.trackers import Columns, Layout, in_columns, row_names

TITLE = re.compile(r"Probe export;unit=(?P<unit>\w+)")
TABLE = Columns(name="Target", x="X", y="Y", z="Z", std=("RMS",), delimiter=";", skip=2)


def matches(text: str) -> bool:
    """Return whether a text starts with the title line."""
    return TITLE.match(text) is not None


def columns(text: str, path: str | Path) -> Columns:
    """Return the columns, with the unit of the title line."""
    return Columns.from_dict({**vars(TABLE), "unit": TITLE.match(text)["unit"]})


def write(samples: Samples) -> bytes:
    """Write positions and standard deviations to 1 µm."""
    std = np.zeros(len(samples)) if samples.p_std is None else np.sqrt((samples.p_std**2).mean(axis=1))
    rows = [
        f"{i};{name};{x:.3f};{y:.3f};{z:.3f};{s:.3f}".replace(".", ",")
        for i, (name, (x, y, z), s) in enumerate(zip(row_names(samples), samples.p_meas, std, strict=True), start=1)
    ]
    return "\r\n".join(["Probe export;unit=mm", "Nr;Target;X;Y;Z;RMS", *rows, ""]).encode()


PROBE = Layout("probe", "probe export", matches, in_columns(columns, unit_stated=True), write)
