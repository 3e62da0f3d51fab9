"""The readings of a measurement file: positions in the tracker frame, and the file's statements about them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose._io.units import millimetres_per
from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import FileError
from truepose.samples import looks_like_metres, name_points

_OF_FILE: Final = ("layout", "source", "unit", "unit_stated", "frame", "notes", "columns")


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings in the order of their file; n readings.

    Attributes
    ----------
    p : (n, 3) array [mm], tracker frame
        The measured positions; NaN or zero in all components where the file has no reading, see `missing`.
    line : (n,) array of int
        The line of each reading in the file, from 1.
    source : str
        The file, for messages.
    layout : str
        The name of the layout of the file.
    p_std : (n, 3) array [mm], optional
        The standard deviation of each reading.
    rotation : Rotation of length n, optional
        The measured orientations, tracker frame.
    rotation_std : (n, 3) array [rad], optional
        The standard deviation of the measured orientations.
    name : (n,) array of str, optional
        The names of the points in the file.
    time : (n,) array [s], optional
        The time of each reading since 1970, by the clock of the file.
    unit : str
        The unit of length in the file.
    unit_stated : bool
        Whether the file or its layout states the unit; if not, it is mm unless the user states another.
    frame : str
        The name of the frame, if the file states one.
    notes : tuple of str
        Sentences for the import summary about data that were left out.
    columns : tuple of (str, int)
        The quantities and their columns in the file, from 1; empty for a layout without columns.
    """

    p: FloatArray
    line: IntArray
    source: str
    layout: str = ""
    p_std: FloatArray | None = None
    rotation: Rotation | None = None
    rotation_std: FloatArray | None = None
    name: NDArray[np.str_] | None = None
    time: FloatArray | None = None
    unit: str = "mm"
    unit_stated: bool = True
    frame: str = ""
    notes: tuple[str, ...] = ()
    columns: tuple[tuple[str, int], ...] = ()

    def __len__(self) -> int:
        return len(self.p)

    def __getitem__(self, index: NDArray[Any] | slice) -> Self:
        """Return the readings selected by a mask, an index array or a slice."""
        names = [f.name for f in fields(self) if f.name not in _OF_FILE]
        return replace(self, **{name: value[index] for name in names if (value := getattr(self, name)) is not None})

    @property
    def missing(self) -> BoolArray:
        """A mask (n,) of the rows without a reading: not finite, or zero in all components."""
        missing: BoolArray = ~np.isfinite(self.p).all(axis=1) | (self.p == 0.0).all(axis=1)
        return missing

    def lines(self, which: NDArray[Any]) -> str:
        """Return the lines of readings (a mask, or indices) for a message: "line 3", "lines 3, 7, 9 and 12 more"."""
        return name_points([{"line": line} for line in self.line[which].tolist()])

    def points(self, which: NDArray[Any]) -> str:
        """Return the names and lines of readings (a mask, or indices) for a message: "point P3 (line 4)"."""
        names = [""] * len(self.line[which]) if self.name is None else self.name[which].tolist()
        lines = self.line[which].tolist()
        return name_points([{"point": name, "line": line} for name, line in zip(names, lines, strict=True)])


def first_line(text: str) -> str:
    """Return the first line that is not blank."""
    return next((line.strip() for line in text.splitlines() if line.strip()), "")


def in_unit(readings: Readings, unit: str | None) -> Readings:
    """Return readings in mm from those of a file that states no unit; the user may state it.

    Raises
    ------
    FileError
        If no unit is stated, and the readings spread over a few units near the origin, as a work region in metres does;
        or if file and user state different units.
    """
    if unit is not None:
        factor = millimetres_per(unit, readings.source, 1)
        if not readings.unit_stated:
            std = None if readings.p_std is None else factor * readings.p_std
            return replace(readings, p=factor * readings.p, p_std=std, unit=unit)
        if factor != millimetres_per(readings.unit, readings.source, 1):
            raise FileError(readings.source, f"states its lengths in {readings.unit}; leave out --unit {unit}")
    if readings.unit_stated:
        return readings
    p = readings.p[~readings.missing]
    if looks_like_metres(p):
        spread = np.linalg.norm(np.ptp(p, axis=0))
        option = 'pass --unit m (unit="m" in Python)'
        raise FileError(readings.source, f"the readings spread over {spread:.2f} mm; metres? If so, {option}")
    return readings
