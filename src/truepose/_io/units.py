"""Units of files and options; inside the package all lengths are mm and all angles rad (theory)."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Final

from truepose.errors import DataError, FileError

MM_PER: Final = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "in": 25.4}
"""Millimetres in one unit of length, by the unit's name."""
RAD_PER: Final = {"deg": math.pi / 180.0, "rad": 1.0, "mrad": 1e-3}
"""Radians in one unit of angle, by the unit's name."""
_ALIASES: Final = {
    "millimeters": "mm",
    "meters": "m",
    "metres": "m",
    "centimeters": "cm",
    "inches": "in",
    "inch": "in",
    '"': "in",
}
_UNITS: Final = "|".join((*MM_PER, *RAD_PER, "°"))
_NAMED_UNITS: Final = (
    re.compile(r"(?P<stem>.*?)\s*\[\s*(?P<unit>[^\]]*?)\s*\]"),
    re.compile(rf"(?P<stem>.*?)\s*\(\s*(?P<unit>{_UNITS})\s*\)"),
    re.compile(rf"(?P<stem>.+)_(?P<unit>{_UNITS})"),
)
KNOWN_UNITS: Final = frozenset((*MM_PER, *RAD_PER, *_ALIASES, "°", "s", "kg", "C", "°C"))
"""The names of units in tables."""
_SHARE: Final = re.compile(r"([0-9]{1,9}(?:\.[0-9]{0,9})?)\s*(%)?")


def millimetres_per(unit: str, path: str | Path, line: int) -> float:
    """Return the millimetres in one unit of length, as vendors write its name.

    Raises
    ------
    FileError
        If the unit is not known.
    """
    lower = unit.strip().lower()
    factor = MM_PER.get(_ALIASES.get(lower, lower))
    if factor is None:
        raise FileError(path, f"the unit {unit!r} is not known; known are {', '.join(MM_PER)}", line=line)
    return factor


def is_length(unit: str) -> bool:
    """Return whether a name is that of a unit of length, as vendors write it."""
    lower = unit.strip().lower()
    return _ALIASES.get(lower, lower) in MM_PER


def split_unit(column: str) -> tuple[str, str]:
    """Return the name of a column in lower case and its unit, which is empty if none is stated.

    Examples
    --------
    >>> split_unit("MX Coord. [mm]"), split_unit("j1 (°)"), split_unit("x_m"), split_unit("Time")
    (('mx coord', 'mm'), ('j1', 'deg'), ('x', 'm'), ('time', ''))
    """
    plain = " ".join(column.strip().strip('"').split())
    for pattern in _NAMED_UNITS:
        if found := pattern.fullmatch(plain):
            unit = found["unit"]
            return found["stem"].lower().rstrip("."), "deg" if unit == "°" else unit
    return plain.lower().rstrip("."), ""


def parse_share(value: object) -> float:
    """Return a share between 0 and 1 from a number or from a text such as ``"95%"`` or ``"0.95"``.

    Raises
    ------
    DataError
        If it is neither, or not between 0 and 1.

    Examples
    --------
    >>> parse_share("95%"), parse_share(0.5)
    (0.95, 0.5)
    """
    share = -1.0
    if isinstance(value, str) and (m := _SHARE.fullmatch(value.strip())):
        share = float(m[1]) / (100.0 if m[2] else 1.0)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        share = float(value)
    if 0.0 <= share <= 1.0:
        return share
    raise DataError(f'expected a share such as "95%" or 0.95, got {value!r}')
