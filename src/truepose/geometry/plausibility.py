"""What went wrong when commanded and measured positions do not fit: units, mirrored axes, shifted or swapped rows."""

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

_MISFIT: Final = 0.1  # median residual over median distance from the middle: no robot is that bad
_EXPLAINED: Final = 0.1  # an explanation must bring the median residual below this part of it
_SHIFTS: Final = (1, -1, 2, -2, 3, -3)


def median_radius(points: FloatArray) -> float:
    """Return the median distance of points (n, 3) from their median [mm]; gross points do not move it."""
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def check_units(p_commanded: FloatArray, p_measured: FloatArray, units: Iterable[str], tolerance: float) -> None:
    """Raise `DataError` when the distances among the points differ by the factor of another unit, up to a tolerance."""
    commanded, measured = median_radius(p_commanded), median_radius(p_measured)
    if commanded == 0.0 or measured == 0.0:
        return
    for unit in units:
        for name, small, large in (("measured", measured, commanded), ("commanded", commanded, measured)):
            ratio = large / small / MM_PER[unit]
            if 1 / tolerance < ratio < tolerance:
                raise DataError(
                    f"{name} positions look like {unit}, expected mm: their median distance from the middle is "
                    f"{small:.6g}, that of the others {large:.6g} mm; multiply them by {MM_PER[unit]:g}"
                )


def explain_misfit(poses: StationPoses, median: float, refit: Callable[[StationPoses], float]) -> None:
    """Raise `DataError` when the residuals are no robot errors, with the change that would make them small.

    Parameters
    ----------
    poses : StationPoses
    median : float
        Median norm of the residuals [mm].
    refit : callable
        Returns the median norm of the residuals of other poses.
    """
    size = median_radius(poses.p_measured)
    if median <= _MISFIT * size:
        return
    told = (
        f"commanded and measured positions do not fit: median residual {median:.4g} mm over a spread of {size:.4g} mm"
    )
    n = len(poses.p_measured)
    mirrored = StationPoses(poses.p_commanded, poses.p_measured * [1.0, 1.0, -1.0], poses.rotations)
    if refit(mirrored) < _EXPLAINED * median:
        raise DataError(f"{told}; as a mirror image they fit: one axis has the wrong sign, or two columns are swapped")
    for shift in _SHIFTS:
        rows = np.arange(max(shift, 0), n + min(shift, 0))
        if len(rows) < n // 2 + 2:
            continue
        moved = StationPoses(poses[rows].p_commanded, poses.p_measured[rows - shift], poses[rows].rotations)
        if refit(moved) < _EXPLAINED * median:
            raise DataError(
                f"{told}; with row i of the readings at row i{shift:+d} of the commands they fit: "
                "a row is missing or too many at the start"
            )
    raise DataError(f"{told}; do the rows belong together, and are all of them from one station?")


def find_swapped(tcp: FloatArray, measured: FloatArray, outliers: BoolArray, limit: float) -> IntArray:
    """Return pairs (row of a command, row of the reading that fits it) among the outliers: (k, 2)."""
    rows = np.flatnonzero(outliers)
    if len(rows) < 2:
        return np.empty((0, 2), dtype=np.intp)
    distance, nearest = cKDTree(measured[rows]).query(tcp[rows], distance_upper_bound=limit)
    found = np.isfinite(distance)
    return np.column_stack([rows[found], rows[np.asarray(nearest)[found]]]).astype(np.intp)


def write_hint(outliers: BoolArray, swapped: IntArray) -> str:
    """Return what to look at when rows seem swapped, or many are gross; else an empty text."""
    if len(swapped):
        pairs = ", ".join(f"reading {reading} fits command {command}" for command, reading in swapped[:5])
        return f"rows are swapped or shifted: {pairs}{' …' if len(swapped) > 5 else ''}"
    if outliers.mean() > 0.1:
        rows = name_rows(np.flatnonzero(outliers))
        return f"{outliers.sum()} of {len(outliers)} readings are gross ({rows}): rows may be swapped or shifted"
    return ""
