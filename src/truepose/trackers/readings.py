"""What every layout is read into: positions in the tracker frame, and what the file said about them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose._io.delimited import check_lines
from truepose._io.units import MM_PER
from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import FileError
from truepose.samples import Samples, looks_like_metres

_NAMED_LINES: Final = 6
_UNIT_NAMES: Final = {
    "millimeters": "mm",
    "meters": "m",
    "metres": "m",
    "centimeters": "cm",
    "inches": "in",
    "inch": "in",
    '"': "in",
}


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings in the order of their file.

    Attributes
    ----------
    p : (n, 3) array [mm], tracker frame
        NaN or all zero where the file has no reading; see `missing`.
    line : (n,) array of int
        Line of the file, from 1.
    layout : str
        What the file was recognised as.
    source : str
        The file, for messages.
    p_std : (n, 3) array [mm], optional
        Standard deviation of each reading.
    rotation : Rotation of length n, optional
        Measured orientations.
    rotation_std : (n, 3) array [rad], optional
    name : (n,) array of str, optional
        Names of the points, as in the file.
    time : (n,) array [s], optional
        Since 1970, by the clock of the file.
    unit : str
        Unit of length in the file.
    frame : str
        What the file says about its frame, if anything.
    notes : tuple of str
        Sentences on what was seen and left out, for the summary.
    """

    p: FloatArray
    line: IntArray
    layout: str
    source: str
    p_std: FloatArray | None = None
    rotation: Rotation | None = None
    rotation_std: FloatArray | None = None
    name: NDArray[np.str_] | None = None
    time: FloatArray | None = None
    unit: str = "mm"
    frame: str = ""
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.p)

    def __getitem__(self, index: NDArray[Any] | slice) -> Self:
        """Return the readings that a mask, an index array or a slice selects."""
        names = [f.name for f in fields(self) if f.name not in ("layout", "source", "unit", "frame", "notes")]
        return replace(self, **{name: value[index] for name in names if (value := getattr(self, name)) is not None})

    @property
    def missing(self) -> BoolArray:
        """Where the tracker had no reading: not finite, or all zero."""
        missing: BoolArray = ~np.isfinite(self.p).all(axis=1) | (self.p == 0.0).all(axis=1)
        return missing

    def lines(self, which: NDArray[Any]) -> str:
        """Return the lines of readings (a mask, or indices) for a message: "line 3", "lines 3, 7, 9 and 12 more"."""
        lines = self.line[which]
        more = f" and {len(lines) - _NAMED_LINES} more" if len(lines) > _NAMED_LINES else ""
        return f"line{'s' if len(lines) != 1 else ''} {', '.join(map(str, lines[:_NAMED_LINES]))}{more}"


@dataclass(frozen=True)
class Layout:
    """A layout of measurement files: how to tell it, how to read it, and how to write it.

    Attributes
    ----------
    key : str
        Short name, for `write_readings`.
    name : str
        As messages call it.
    matches : callable
        Whether a text is of this layout, from its first lines.
    read : callable
        ``read(data, path) -> Readings``; raises `FileError` with the line.
    write : callable
        ``write(samples) -> bytes``: a row for each sample, in their order.
    """

    key: str
    name: str
    matches: Callable[[str], bool]
    read: Callable[[bytes, str | Path], Readings]
    write: Callable[[Samples], bytes]


def first_line(text: str) -> str:
    """Return the first line that is not blank."""
    return next((line.strip() for line in text.splitlines() if line.strip()), "")


def decode(data: bytes, path: str | Path) -> str:
    """Return the text of a measurement file: UTF-8, UTF-16 with its mark, else latin-1 (which takes every byte).

    Raises
    ------
    FileError
        If it is empty or no text at all.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", errors="replace")
        check_lines(list(enumerate(text.splitlines(), start=1)), path)
        return text
    if not data.strip():
        raise FileError(path, "is empty; export the readings again")
    if b"\0" in data[:4096] or data.startswith(b"PK\x03\x04"):
        raise FileError(path, "is not a text file; export the readings as ASCII or CSV")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    check_lines(list(enumerate(text.splitlines(), start=1)), path)
    return text


def millimetres_per(unit: str, path: str | Path, line: int) -> float:
    """Return the millimetres in a unit as vendors write it.

    Raises
    ------
    FileError
        If the unit is not known.
    """
    lower = unit.strip().lower()
    factor = MM_PER.get(_UNIT_NAMES.get(lower, lower))
    if factor is None:
        raise FileError(path, f"the unit {unit!r} is not known; known are {', '.join(MM_PER)}", line=line)
    return factor


def check_metres(readings: Readings) -> Readings:
    """Return the readings, or raise where a file without units holds metres.

    Raises
    ------
    FileError
        If the readings spread over a few units near the origin: a work region in metres.
    """
    p = readings.p[~readings.missing]
    if looks_like_metres(p):
        spread = np.linalg.norm(np.ptp(p, axis=0))
        raise FileError(readings.source, f"the readings spread over {spread:.2f} mm; metres? Export them in mm")
    return readings
