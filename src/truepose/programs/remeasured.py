"""Assign re-measured readings to the targets of a program: by name, or else by position."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy.spatial import cKDTree

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.cell import Cell
from truepose.errors import DataError
from truepose.geometry import Registration, apply_transform, register
from truepose.trackers import Readings
from truepose.trackers.assignment import assign
from truepose.trackers.by_name import owners_by_name

MatchBy = Literal["auto", "name", "position"]

_FAR_MM: Final = 10.0
"""A larger distance of a reading from its target is no error of a robot."""
_CLEARLY: Final = 2.0
"""Factor by which the second nearest target must be farther away than the nearest."""
_FEWEST: Final = 4  # targets for a registration whose residuals mean anything
_SAME_MM: Final = 1e-3
_REPEAT_MM: Final = 1.0
_REPEATS: Final = 5  # for an estimate of the uncertainty


@dataclass(frozen=True, eq=False)
class Remeasured:
    """The mean reading of each target that was measured; m of n targets.

    Attributes
    ----------
    target : (m,) array of int
        The place of each target among the nominal ones, ascending.
    count : (m,) array of int
        The number of its readings.
    p_tracker, p_base : (m, 3) arrays [mm]
        The mean reading in the tracker frame and in the base frame.
    std : (m,) array [mm]
        The standard uncertainty of the mean reading, in the direction where it is largest.
    std_origin : str
        Where it is stated.
    dof : float
        Its degrees of freedom; without limit where it is stated and not estimated from repeats.
    registration : Registration
        The station of the readings.
    by_name : int
        The number of readings that were matched by name.
    """

    target: IntArray
    count: IntArray
    p_tracker: FloatArray
    p_base: FloatArray
    std: FloatArray
    registration: Registration
    by_name: int
    std_origin: str = ""
    dof: float = np.inf


def remeasured(
    readings: Readings,
    names: list[str],
    p_nominal: FloatArray,
    place: IntArray,
    station: Registration | None,
    cell: Cell,
    *,
    by: MatchBy = "auto",
    uncertainty_mm: float | None = None,
) -> Remeasured:
    """Assign readings to targets, and average those of one target.

    Parameters
    ----------
    readings : Readings
        The readings; rows without a position are ignored.
    names : list of n str
        The names of the targets.
    p_nominal : (n, 3) array [mm], base frame
        The nominal positions of the measured point.
    place : (n,) array of int
        The first target with the same pose as each target.
    station : Registration or None
        The station of the readings; without it, the readings are registered to the nominal positions.
    cell : Cell
        The cell with the noise of the tracker.
    by : {"auto", "name", "position"}
        The way to match. By default by name where names of readings are names of targets, else by position.
    uncertainty_mm : float [mm], optional
        The standard uncertainty of a reading, instead of that of the file or the cell.

    Raises
    ------
    DataError
        If a reading belongs to no target or to several, or the uncertainty of the readings is not known.
    """
    readings = readings[~readings.missing]
    if not len(readings):
        raise DataError(f"{readings.source}: holds no reading")
    named = _by_name(readings, names) if by != "position" else np.full(len(readings), -1)
    if by == "name" and (named < 0).any():
        raise DataError(f"{readings.source}: {readings.lines(named < 0)}: no target has the name of the point")
    if station is None:
        named, station = _registered(readings, named, p_nominal, np.unique(place), cell)
    p_base = station.apply(readings.p)
    owner = _by_position(readings, named, names, p_nominal, np.unique(place), p_base)
    target, group, count = np.unique(owner, return_inverse=True, return_counts=True)
    p_tracker = np.stack([np.bincount(group, column) for column in readings.p.T], axis=1) / count[:, None]
    std, origin, dof = _std(readings, group, count, p_tracker, cell, uncertainty_mm)
    p_mean = apply_transform(station.tf_base_tracker, p_tracker)
    return Remeasured(target, count, p_tracker, p_mean, std, station, int((named >= 0).sum()), origin, dof)


def _by_name(readings: Readings, names: list[str]) -> IntArray:
    """Return the target that each reading is named after, (m,); −1 where there is none, or more than one."""
    own = [name.strip().casefold() for name in names]
    count = Counter(own)
    return owners_by_name(readings, [name if count[name] == 1 else "" for name in own])


def _registered(
    readings: Readings, named: IntArray, p_nominal: FloatArray, places: IntArray, cell: Cell
) -> tuple[IntArray, Registration]:
    """Return the targets of the readings, and the registration of the readings to them."""
    if (named < 0).any():
        found = assign(p_nominal[places], readings.p, _REPEAT_MM).owner
        named = np.where(found >= 0, places[found], -1)
    if len(np.unique(named[named >= 0])) < _FEWEST:
        raise DataError(
            f"{readings.source}: a registration to the nominal targets needs readings of {_FEWEST} targets or more"
        )
    used = named >= 0
    return named, register(p_nominal[named[used]], readings.p[used], robust=cell.tracker.robust)


def _by_position(
    readings: Readings,
    named: IntArray,
    names: list[str],
    p_nominal: FloatArray,
    places: IntArray,
    p_base: FloatArray,
) -> IntArray:
    """Return the target of each reading: the one that it is named after, else the nearest."""
    distance, nearest = cKDTree(p_nominal[places]).query(p_base, k=min(2, len(places)))
    distance, nearest = np.reshape(distance, (len(p_base), -1)), places[np.reshape(nearest, (len(p_base), -1))]
    owner = np.where(named >= 0, named, nearest[:, 0])
    away = np.linalg.norm(p_base - p_nominal[owner], axis=1)
    if (far := away > _FAR_MM).any():
        raise _far(readings, names, far, owner, away, nearest[:, 0], distance[:, 0])
    if distance.shape[1] > 1:
        unclear = (named < 0) & (distance[:, 1] < np.maximum(_CLEARLY * distance[:, 0], _SAME_MM))
        if unclear.any():
            k = int(np.argmax(unclear))
            raise DataError(
                f"{readings.source}: {_reading(readings, k)} lies {distance[k, 0]:.3f} mm from {names[nearest[k, 0]]} "
                f"and {distance[k, 1]:.3f} mm from {names[nearest[k, 1]]}; name the points after their targets"
            )
    return owner


def _far(
    readings: Readings,
    names: list[str],
    far: BoolArray,
    owner: IntArray,
    away: FloatArray,
    nearest: IntArray,
    distance: FloatArray,
) -> DataError:
    """Return the error for readings that are far from their targets."""
    k = int(np.argmax(np.where(far, away, 0.0)))
    where = f"{readings.source}: {_reading(readings, k)} lies {away[k]:.3f} mm from target {names[owner[k]]}"
    if distance[k] < _FAR_MM:
        return DataError(
            f"{where}, whose name it has, but {distance[k]:.3f} mm from {names[nearest[k]]}; correct the names, or "
            "match by position (--match position)"
        )
    unit = "" if readings.unit_stated else f"are its lengths in {readings.unit} (if not, pass --unit), "
    return DataError(
        f"{where} ({int(far.sum())} of {len(far)} readings are far off); {unit}is it this program and the map's "
        "reflector, and did the tracker stay where it was? Register the readings again with --register if it was moved"
    )


def _reading(readings: Readings, k: int) -> str:
    name = "" if readings.name is None else f" ({readings.name[k]})"
    return f"the reading of line {readings.line[k]}{name}"


def _std(
    readings: Readings,
    group: IntArray,
    count: IntArray,
    p_tracker: FloatArray,
    cell: Cell,
    stated: float | None,
) -> tuple[FloatArray, str, float]:
    """Return the standard uncertainty of mean readings in their worst direction, (m,) [mm].

    With it come its origin and its degrees of freedom.
    """
    single, origin, dof = None, "", np.inf
    if stated is not None:
        if not (np.isfinite(stated) and stated > 0.0):
            raise DataError(f"expected a positive standard uncertainty in mm, got {stated!r}")
        single, origin = np.full(len(count), stated), "stated for this verification"
    elif readings.p_std is not None:
        squares = np.bincount(group, readings.p_std.max(axis=1) ** 2) / count
        single, origin = np.sqrt(squares), "file of readings"
    elif (known := cell.tracker.reading_std(p_tracker)) is not None:
        single, origin = known.max(axis=1), "[tracker]"
    elif (repeats := len(group) - len(count)) >= _REPEATS:
        about = readings.p - p_tracker[group]
        single = np.full(len(count), np.sqrt((about**2).sum(axis=0).max() / repeats))
        origin, dof = f"{repeats} repeats", float(repeats)
    if single is None:
        raise DataError(
            f"{readings.source}: the uncertainty of the readings is not known; state std_mm (or range_um …) under "
            "[tracker] in the cell file, or give --uncertainty"
        )
    return np.asarray(single / np.sqrt(count)), origin, dof
