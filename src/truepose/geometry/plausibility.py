"""Causes of a poor fit of commanded and measured positions: units, mirrored axes, shifted or swapped rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from truepose._io.units import MM_PER
from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import DataError
from truepose.geometry.arrays import name_rows
from truepose.geometry.station import StationPoses

_MISFIT: Final = 0.1  # median residual over median distance from the centre: larger than any robot's errors
_EXPLAINED: Final = 0.1  # a cause must reduce the median residual below this part of it
_SHIFTS: Final = (1, -1, 2, -2, 3, -3)


def median_radius(points: FloatArray) -> float:
    """Return the median distance of points (n, 3) from their median [mm], which outliers hardly affect."""
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def check_units(p_commanded: FloatArray, p_measured: FloatArray, units: Iterable[str], tolerance: float) -> None:
    """Raise `DataError` if the sizes of the point sets differ by the factor of another unit, up to a tolerance."""
    commanded, measured = median_radius(p_commanded), median_radius(p_measured)
    if commanded == 0.0 or measured == 0.0:
        return
    for unit in units:
        for name, small, large in (("measured", measured, commanded), ("commanded", commanded, measured)):
            ratio = large / small / MM_PER[unit]
            if 1 / tolerance < ratio < tolerance:
                raise DataError(
                    f"{name} positions look like {unit}, expected mm: their median distance from the centre is "
                    f"{small:.6g}, that of the others {large:.6g} mm; multiply them by {MM_PER[unit]:g}"
                )


def explain_misfit(poses: StationPoses, median: float, refit: Callable[[StationPoses], float]) -> None:
    """Raise `DataError` if the residuals are too large for robot errors; the message names the probable cause.

    Parameters
    ----------
    poses : StationPoses
        The commanded poses and readings.
    median : float [mm]
        The median norm of the residuals.
    refit : callable
        The function that returns the median norm of the residuals of other poses.
    """
    size = median_radius(poses.p_measured)
    if median <= _MISFIT * size:
        return
    misfit = (
        f"commanded and measured positions do not fit: median residual {median:.4g} mm over a spread of {size:.4g} mm"
    )
    n = len(poses.p_measured)
    mirrored = StationPoses(poses.p_commanded, poses.p_measured * [1.0, 1.0, -1.0], poses.rotations)
    if refit(mirrored) < _EXPLAINED * median:
        raise DataError(f"{misfit}; mirrored they fit: one axis has the wrong sign, or two columns are swapped")
    for shift in _SHIFTS:
        rows = np.arange(max(shift, 0), n + min(shift, 0))
        if len(rows) < n // 2 + 2:
            continue
        moved = StationPoses(poses[rows].p_commanded, poses.p_measured[rows - shift], poses[rows].rotations)
        if refit(moved) < _EXPLAINED * median:
            raise DataError(
                f"{misfit}; with row i of the readings at row i{shift:+d} of the commands they fit: "
                "a row is missing, or there is one too many, at the start"
            )
    raise DataError(f"{misfit}; check that commands and readings belong together and all readings are from one station")


def find_swapped(tcp: FloatArray, measured: FloatArray, outliers: BoolArray, limit: float) -> IntArray:
    """Return pairs (row of a command, row of the matching reading) among the outliers: (k, 2)."""
    rows = np.flatnonzero(outliers)
    if len(rows) < 2:
        return np.empty((0, 2), dtype=np.intp)
    distance, nearest = cKDTree(measured[rows]).query(tcp[rows], distance_upper_bound=limit)
    found = np.isfinite(distance)
    return np.column_stack([rows[found], rows[np.asarray(nearest)[found]]]).astype(np.intp)


def write_hint(outliers: BoolArray, swapped: IntArray, name: Callable[[IntArray], str] = name_rows) -> str:
    """Return a hint if rows seem swapped or many readings are outliers, or an empty text; `name` names rows."""
    if len(swapped):
        pairs = ", ".join(f"the reading of {name(one[1:])} fits the command of {name(one[:1])}" for one in swapped[:5])
        return f"rows are swapped or shifted: {pairs}{' …' if len(swapped) > 5 else ''}"
    if outliers.mean() > 0.1:
        rows = name(np.flatnonzero(outliers))
        return f"{outliers.sum()} of {len(outliers)} readings are outliers ({rows}): rows may be swapped or shifted"
    return ""
