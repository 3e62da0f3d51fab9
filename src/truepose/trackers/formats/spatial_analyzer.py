"""SpatialAnalyzer ASCII point lists, with header (layout 1) and without (layout 2)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from truepose.errors import FileError
from truepose.samples import Samples
from truepose.trackers.exporting import row_names, row_times
from truepose.trackers.readings import Layout, Readings, check_metres, decode, first_line, millimetres_per
from truepose.trackers.times import date, seconds

_NUMBER: Final = r"[+-]?(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[eE][+-]?[0-9]++)?+|[+-]?nan"
_ROW: Final = re.compile(
    rf"^\s*(?P<name>[^/].*?)\s*,\s*(?P<x>{_NUMBER})\s*,\s*(?P<y>{_NUMBER})\s*,\s*(?P<z>{_NUMBER})"
    r"(?:\s*,\s*(?P<date>[0-9]+/[0-9]+/[0-9]+[^,]*?))?\s*,?\s*$",
    re.IGNORECASE,
)
_AXES: Final = re.compile(r"AXES\s*=\s*(?P<axes>\w+)[^(]*(?:\((?P<unit>[^)]*)\))?", re.IGNORECASE)
_FRAME: Final = re.compile(r"Coordinate Frame\s+'?(?P<frame>[^']+?)'?\s*$", re.IGNORECASE)
_BARE: Final = re.compile(
    rf"^\s*[^,;\s/]+\s*,\s*(?:{_NUMBER})\s*,\s*(?:{_NUMBER})\s*,\s*(?:{_NUMBER})\s*$", re.IGNORECASE
)


def _matches(text: str) -> bool:
    return text.lstrip().startswith("//")


def _matches_bare(text: str) -> bool:
    return _BARE.match(first_line(text)) is not None


def read(data: bytes, path: str | Path) -> Readings:
    """Read a SpatialAnalyzer ASCII file, with or without its ``//`` header.

    The unit stands in the header, ``AXES = CARTESIAN: X, Y, Z (mm)``; without header it is mm. Names are joined with
    ``::``, dates are month/day/year.

    Parameters
    ----------
    data : bytes
        Content of the file.
    path : str or Path
        For messages.

    Returns
    -------
    Readings

    Raises
    ------
    FileError
        If a line is no point, a date is no US date, the axes are not Cartesian, or the unit is not known.
    """
    lines = [(number, line) for number, line in enumerate(decode(data, path).splitlines(), start=1) if line.strip()]
    header = [(number, line) for number, line in lines if line.lstrip().startswith("//")]
    body = [(number, line) for number, line in lines if not line.lstrip().startswith("//")]
    unit, factor, frame = _header(header, path)
    rows = [_ROW.match(line) for _, line in body]
    for (number, line), row in zip(body, rows, strict=True):
        if row is None:
            raise FileError(
                path, f"expected names, x, y, z and perhaps a date, found {line.strip()[:60]!r}", line=number
            )
    found = [row for row in rows if row is not None]
    if not found:
        raise FileError(path, "has a header but no readings")
    names = [re.split(r"\s*,\s*", row["name"]) for row in found]
    odd = next((i for i, name in enumerate(names) if len(name) != len(names[0])), None)
    if odd is not None:  # a missing number would make a point's name a coordinate
        message = f"has {len(names[odd])} names before x, y, z, the first reading has {len(names[0])}"
        raise FileError(path, f"{message}; is a number missing?", line=body[odd][0])
    dates = [row["date"] for row in found]
    readings = Readings(
        p=factor * np.array([(row["x"], row["y"], row["z"]) for row in found]).astype(np.float64),
        line=np.array([number for number, _ in body], dtype=np.int64),
        layout=WITH_HEADER.name if header else BARE.name,
        source=str(path),
        name=np.array(["::".join(name) for name in names]),
        time=np.array([seconds(text, path, body[i][0]) for i, text in enumerate(dates)]) if all(dates) else None,
        unit=unit,
        frame=frame,
    )
    return check_metres(readings)


def _header(header: list[tuple[int, str]], path: str | Path) -> tuple[str, float, str]:
    unit, factor, frame = "mm", 1.0, ""
    for number, line in header:
        if named := _FRAME.search(line):
            frame = named["frame"]
        if axes := _AXES.search(line):
            if axes["axes"].upper() != "CARTESIAN":
                raise FileError(path, f"the axes are {axes['axes']}; export Cartesian X, Y, Z", line=number)
            unit = (axes["unit"] or "mm").strip()
            factor = millimetres_per(unit, path, number)
    return unit, factor, frame


def write(samples: Samples) -> bytes:
    """Write points with a header, to 0.1 µm and one second."""
    name, time = row_names(samples), row_times(samples)
    rows = (
        f"Station1, Main, {name[i]}, {x:.4f},  {y:.4f},  {z:.4f}, {date(time[i], '%m/%d/%y %H:%M:%S')}\n"
        for i, (x, y, z) in enumerate(samples.p_meas)
    )
    header = "// Points Relative to Coordinate Frame 'A::WORLD'\n// AXES = CARTESIAN: X,  Y,  Z (mm)\n"
    return (header + "".join(rows)).encode()


def write_bare(samples: Samples) -> bytes:
    """Write points without header or names, to 1 µm."""
    rows = (f"{i},  {x:.3f},  {y:.3f},  {z:.3f}\n" for i, (x, y, z) in enumerate(samples.p_meas, start=1))
    return "".join(rows).encode()


WITH_HEADER: Final = Layout("spatial-analyzer", "SpatialAnalyzer ASCII with // header", _matches, read, write)
BARE: Final = Layout(
    "bare", "SpatialAnalyzer ASCII without header (id, x, y, z in mm)", _matches_bare, read, write_bare
)
