"""Several reflectors on one tool, read in turn at each pose: keep one of them, or combine all into a pose."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.trackers.readings import Readings

_SAME_MM: Final = 0.5  # distances between reflectors of a rigid tool


def combine_reflectors(readings: Readings, reflectors: ArrayLike | int, *, keep: int | None = None) -> Readings:
    """Return one reading per pose from readings of several reflectors.

    If the readings are named 1, 2, 3, 1, 2, 3 …, a new pose begins where the names restart, and single readings may be
    missing; otherwise every pose has one reading per reflector.

    Parameters
    ----------
    readings : Readings
        The readings of all reflectors.
    reflectors : (m, 3) array [mm], tool frame, or int
        The positions of the reflectors on the tool in the order of reading, which give poses of the tool; or their
        number, if only one is kept.
    keep : int, optional
        The number of the one reflector to keep, from 1.

    Raises
    ------
    DataError
        If the number of readings is wrong, the positions on the tool are collinear, or the measured distances between
        reflectors differ from those on the tool.
    """
    on_tool = None if isinstance(reflectors, int) else np.atleast_2d(np.asarray(reflectors, dtype=np.float64))
    count = reflectors if isinstance(reflectors, int) else len(np.atleast_2d(reflectors))
    places = places_of(readings, count)
    if on_tool is None or keep is not None:
        if keep is None or not 1 <= keep <= count:
            message = f"{count} reflectors; state which to keep (1 to {count}), or their positions on the tool"
            raise DataError(f"{readings.source}: {message}")
        return _pick(readings, places[:, keep - 1])
    if on_tool.shape != (count, 3) or np.linalg.matrix_rank(on_tool - on_tool.mean(axis=0), tol=1.0) < 2:
        raise DataError(f"reflectors have shape {on_tool.shape}; expected (m, 3) positions [mm] that are not on a line")
    p = np.where(places[..., None] < 0, np.nan, readings.p[places])
    p[(p == 0.0).all(axis=2)] = np.nan
    whole = np.isfinite(p).all(axis=(1, 2))
    if not whole.any():
        raise DataError(f"{readings.source}: no pose has readings of all {count} reflectors")
    _check_distances(readings, places[whole], p[whole], on_tool)
    origin, turn = np.full((len(p), 3), np.nan), np.tile([0.0, 0.0, 0.0, 1.0], (len(p), 1))
    origin[whole], rotation = fit_rigid(on_tool, p[whole])
    turn[whole] = rotation.as_quat()
    first = _pick(readings, places.max(axis=1))
    lost = int((~whole).sum())
    note = f"Each pose is combined from {count} reflectors" + (f"; {lost} poses lack one." if lost else ".")
    return replace(first, p=origin, p_std=None, rotation=Rotation.from_quat(turn), notes=(*readings.notes, note))


def places_of(readings: Readings, count: int) -> IntArray:
    """Return the indices of the readings of each pose, (poses, count); -1 for a missing one."""
    cycle = _cycle(readings.name, count)
    if cycle is None:
        if len(readings) % count:
            message = f"{len(readings)} readings are not a multiple of {count} reflectors"
            raise DataError(f"{readings.source}: {message}; put rows of zeros where one is missing")
        return np.arange(len(readings)).reshape(-1, count)
    pose = np.cumsum(np.diff(cycle, prepend=count) <= 0) - 1
    places = np.full((pose[-1] + 1, count), -1)
    places[pose, cycle] = np.arange(len(readings))
    return places


def _cycle(names: NDArray[np.str_] | None, count: int) -> IntArray | None:
    """Return the reflector of each reading by name; None unless there are as many names as reflectors."""
    if names is None:
        return None
    found, which = np.unique(names, return_inverse=True)
    if len(found) != count:
        return None
    order = np.argsort([np.flatnonzero(which == k)[0] for k in range(count)])
    return np.asarray(np.argsort(order)[which.reshape(-1)])


def _pick(readings: Readings, place: IntArray) -> Readings:
    """Return the readings at some indices; -1 gives a missing one."""
    picked = readings[np.maximum(place, 0)]
    return replace(picked, p=np.where(place[:, None] < 0, np.nan, picked.p))


def _check_distances(readings: Readings, places: IntArray, p: FloatArray, on_tool: FloatArray) -> None:
    """Refuse readings whose mutual distances differ from those on the tool: another order or tool, a gross reading."""
    pairs = np.triu_indices(len(on_tool), k=1)
    stated = np.linalg.norm(on_tool[pairs[0]] - on_tool[pairs[1]], axis=1)
    read = np.linalg.norm(p[:, pairs[0]] - p[:, pairs[1]], axis=2)
    off = np.abs(read - stated).max(axis=1)
    wrong = off > _SAME_MM
    if not wrong.any():
        return
    if wrong.mean() > 0.5:
        seen, expected = (", ".join(f"{value:.1f}" for value in values) for values in (np.median(read, axis=0), stated))
        message = f"measured distances between reflectors are {seen} mm, expected {expected} mm; another order or tool?"
        raise DataError(f"{readings.source}: {message}")
    lines = readings.lines(places[wrong].min(axis=1))
    message = f"distances between reflectors are wrong by up to {off.max():.3g} mm in the poses that start at {lines}"
    raise DataError(f"{readings.source}: {message}; correct the swapped or gross reading, or replace it by zeros")


def fit_rigid(p_body: FloatArray, p: FloatArray) -> tuple[FloatArray, Rotation]:
    """Fit the pose of a body to its points, for many poses at once (Arun, Huang, Blostein 1987, by SVD).

    Parameters
    ----------
    p_body : (m, 3) array [mm], body frame
        The points on the body, m ≥ 3, not collinear.
    p : (n, m, 3) array [mm]
        The same points, measured at n poses.

    Returns
    -------
    origin : (n, 3) array [mm]
        The origin of the body frame at each pose.
    rotation : Rotation of length n
        The orientation of the body at each pose.
    """
    centre_body, centre = p_body.mean(axis=0), p.mean(axis=1)
    u, _, vt = np.linalg.svd(np.einsum("mi,nmj->nij", p_body - centre_body, p - centre[:, None]))
    v, ut = vt.transpose(0, 2, 1), u.transpose(0, 2, 1)
    mirror = np.ones((len(p), 3))
    mirror[:, 2] = np.linalg.det(v @ ut)
    rotation = Rotation.from_matrix((v * mirror[:, None]) @ ut)
    return np.asarray(centre - rotation.apply(centre_body)), rotation
