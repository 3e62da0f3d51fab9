"""SpatialAnalyzer ASCII point lists, with header (layout 1) and without (layout 2)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from truepose._io.units import millimetres_per
from truepose.errors import FileError
from truepose.samples import Samples
from truepose.trackers.layout import NUMBER, Layout, row_names, row_times
from truepose.trackers.readings import Readings, first_line
from truepose.trackers.times import date, seconds

_ROW: Final = re.compile(
    rf"^\s*(?P<name>[^/].*?)\s*,\s*(?P<x>{NUMBER})\s*,\s*(?P<y>{NUMBER})\s*,\s*(?P<z>{NUMBER})"
    r"(?:\s*,\s*(?P<date>[0-9]+/[0-9]+/[0-9]+[^,]*?))?\s*,?\s*$",
    re.IGNORECASE,
)
_AXES: Final = re.compile(r"AXES\s*=\s*(?P<axes>\w+)[^(]*(?:\((?P<unit>[^)]*)\))?", re.IGNORECASE)
_FRAME: Final = re.compile(r"Coordinate Frame\s+'?(?P<frame>[^']+?)'?\s*$", re.IGNORECASE)
_BARE: Final = re.compile(rf"^\s*[^,;\s/]+\s*,\s*{NUMBER}\s*,\s*{NUMBER}\s*,\s*{NUMBER}\s*$", re.IGNORECASE)


def _matches(text: str) -> bool:
    return text.lstrip().startswith("//")


def _matches_bare(text: str) -> bool:
    return _BARE.match(first_line(text)) is not None


def _read(text: str, path: str | Path) -> Readings:
    """Read points with or without a ``//`` header.

    The header states the unit, ``AXES = CARTESIAN: X, Y, Z (mm)``; without a header it is mm. Names are joined with
    ``::``; dates are month/day/year.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    header = [(number, line) for number, line in lines if line.lstrip().startswith("//")]
    body = [(number, line) for number, line in lines if not line.lstrip().startswith("//")]
    unit, factor, frame = _header(header, path)
    rows = [_ROW.match(line) for _, line in body]
    for (number, line), row in zip(body, rows, strict=True):
        if row is None:
            raise FileError(
                path, f"expected names, x, y, z and an optional date, got {line.strip()[:60]!r}", line=number
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
    return Readings(
        p=factor * np.array([(row["x"], row["y"], row["z"]) for row in found]).astype(np.float64),
        line=np.array([number for number, _ in body], dtype=np.int64),
        source=str(path),
        name=np.array(["::".join(name) for name in names]),
        time=np.array([seconds(text, path, body[i][0]) for i, text in enumerate(dates)]) if all(dates) else None,
        unit=unit,
        frame=frame,
        unit_stated=any(_AXES.search(line) for _, line in header),
    )


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


def _write(samples: Samples) -> bytes:
    """Write points with a header, to 0.1 µm and one second."""
    rows = (
        f"Station1, Main, {name}, {x:.4f},  {y:.4f},  {z:.4f}, {date(time, '%m/%d/%y %H:%M:%S')}\n"
        for name, time, (x, y, z) in zip(row_names(samples), row_times(samples), samples.p_meas, strict=True)
    )
    header = "// Points Relative to Coordinate Frame 'A::WORLD'\n// AXES = CARTESIAN: X,  Y,  Z (mm)\n"
    return (header + "".join(rows)).encode()


def _write_bare(samples: Samples) -> bytes:
    """Write points without header or names, to 1 µm."""
    rows = (f"{i},  {x:.3f},  {y:.3f},  {z:.3f}\n" for i, (x, y, z) in enumerate(samples.p_meas, start=1))
    return "".join(rows).encode()


WITH_HEADER: Final = Layout("spatial-analyzer", "SpatialAnalyzer ASCII with // header", _matches, _read, _write)
BARE: Final = Layout("bare", "SpatialAnalyzer ASCII without header (id, x, y, z)", _matches_bare, _read, _write_bare)
