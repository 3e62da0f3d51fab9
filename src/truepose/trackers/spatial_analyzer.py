"""SpatialAnalyzer ASCII point lists, with header (layout 1) and without (layout 2)."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from truepose.errors import FileError
from truepose.trackers.readings import Layout, Readings, check_metres, decode, millimetres_per

_NUMBER: Final = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?nan"
_ROW: Final = re.compile(
    rf"^\s*(?P<name>[^/].*?)\s*,\s*(?P<x>{_NUMBER})\s*,\s*(?P<y>{_NUMBER})\s*,\s*(?P<z>{_NUMBER})"
    r"(?:\s*,\s*(?P<date>\d+/\d+/\d+[^,]*?))?\s*,?\s*$",
    re.IGNORECASE,
)
_AXES: Final = re.compile(r"AXES\s*=\s*(?P<axes>\w+)[^(]*(?:\((?P<unit>[^)]*)\))?", re.IGNORECASE)
_FRAME: Final = re.compile(r"Coordinate Frame\s+'?(?P<frame>[^']+?)'?\s*$", re.IGNORECASE)
_BARE: Final = re.compile(
    rf"^\s*[^,;\s/]+\s*,\s*(?:{_NUMBER})\s*,\s*(?:{_NUMBER})\s*,\s*(?:{_NUMBER})\s*$", re.IGNORECASE
)
_DATES: Final = (
    "%m/%d/%y %H:%M:%S",
    "%m/%d/%Y %H:%M:%S",
    "%m/%d/%y %I:%M:%S %p",
    "%m/%d/%Y %I:%M:%S %p",
    "%m/%d/%y",
    "%m/%d/%Y",
)


def _matches(text: str) -> bool:
    return text.lstrip().startswith("//")


def _matches_bare(text: str) -> bool:
    first = next((line for line in text.splitlines() if line.strip()), "")
    return _BARE.match(first) is not None


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
        time=np.array([_seconds(date, path, body[i][0]) for i, date in enumerate(dates)]) if all(dates) else None,
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


def _seconds(date: str, path: str | Path, line: int) -> float:
    for form in _DATES:
        try:
            return datetime.strptime(date.strip(), form).replace(tzinfo=UTC).timestamp()
        except ValueError:
            continue
    raise FileError(path, f"the date {date.strip()!r} is not month/day/year hour:minute:second", line=line)


WITH_HEADER: Final = Layout("SpatialAnalyzer ASCII with // header", _matches, read)
BARE: Final = Layout("SpatialAnalyzer ASCII without header (id, x, y, z in mm)", _matches_bare, read)
