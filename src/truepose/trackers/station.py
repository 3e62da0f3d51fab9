"""Detect a moved tracker: two rigid registrations, before and after a reading, fit better than one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.geometry.registration import register
from truepose.geometry.transforms import apply_transform
from truepose.samples import Poses
from truepose.trackers.assignment import Assignment, assign
from truepose.trackers.readings import Readings

_FEWEST: Final = 8  # readings on either side
_BETTER: Final = 0.8  # of the RMS residual of one registration, per degree of freedom
_THAN_SPACE: Final = 0.8  # of the residual of the best cut through the work region: an arm's errors are similar nearby
_MOST: Final = 0.7  # share of the unexplained readings that a second registration must explain
_BEYOND_DOUBT: Final = 0.25  # no arm's errors resemble a move this much


@dataclass(frozen=True)
class Move:
    """A tracker that was moved.

    Attributes
    ----------
    at : int
        The first reading after the move.
    shift_mm, turn_deg : float
        The displacement of the readings' centre, and the angle of rotation.
    one_mm, two_mm : float
        The RMS residual of one registration, and of two.
    """

    at: int
    shift_mm: float
    turn_deg: float
    one_mm: float
    two_mm: float


def find_move(p_plan: FloatArray, p_read: FloatArray) -> Move | None:
    """Return the move of the tracker, or None if it did not move.

    The cut with the smallest sum of squared residuals is compared with no cut, and with the best cuts of the points
    sorted along each axis: arm errors that differ between two halves of the work region are not a move.

    Parameters
    ----------
    p_plan, p_read : (n, 3) arrays [mm]
        The commanded positions and their readings, in the order of reading.

    Returns
    -------
    Move or None
    """
    n = len(p_plan)
    if n < 2 * _FEWEST:
        return None
    by_time = _squares_by_cut(p_plan, p_read)
    at = int(by_time[1:].argmin()) + 1
    one, two = float(by_time[0]), float(by_time[at])
    centred = p_plan - p_plan.mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2].T
    orders = np.argsort(along, axis=0, kind="stable").T
    in_space = min(float(_squares_by_cut(p_plan[order], p_read[order])[1:].min()) for order in orders)
    fairly = (3 * n - 12) / (3 * n - 6)  # two registrations have six parameters more
    moved = two < _BETTER**2 * fairly * one and two < _THAN_SPACE**2 * in_space
    if not moved and two > _BEYOND_DOUBT**2 * one:
        return None
    before, after = (register(p_plan[part], p_read[part], robust=False) for part in (slice(at), slice(at, n)))
    centre = p_read.mean(axis=0, keepdims=True)
    shift = apply_transform(after.tf_base_tracker, centre) - apply_transform(before.tf_base_tracker, centre)
    turn = Rotation.from_matrix(after.tf_base_tracker[:3, :3] @ before.tf_base_tracker[:3, :3].T)
    return Move(
        at=at,
        shift_mm=float(np.linalg.norm(shift)),
        turn_deg=float(np.rad2deg(turn.magnitude())),
        one_mm=float(np.sqrt(one / n)),
        two_mm=float(np.sqrt(two / n)),
    )


def describe_move(readings: Readings, plan: Poses, found: Assignment | None, repeat_mm: float) -> str:
    """Describe a move of the tracker; return "" if there is none.

    A change of the payload by the plan does not count as a move.

    Parameters
    ----------
    readings : Readings
        The readings.
    plan : Poses
        The plan, with commanded positions.
    found : Assignment, optional
        The assignment by one registration; without it, readings belong to the rows in order.
    repeat_mm : float [mm]
        The largest distance of repeats, see `assign`.
    """
    assert plan.p_cmd is not None
    if found is None:
        rows = places = np.flatnonzero(~readings.missing)
    else:
        found = _with_second_station(readings, plan.p_cmd, found, repeat_mm)
        rows = np.flatnonzero((found.reading >= 0) & ~found.outlier)
        rows = rows[np.argsort(found.reading[rows])]
        places = found.reading[rows]
    move = find_move(plan.p_cmd[rows], readings.p[places])
    if move is None or (_load_changes(plan, rows, move.at) and move.two_mm > _BEYOND_DOUBT * move.one_mm):
        return ""
    by = f"by {move.shift_mm:.3g} mm and {move.turn_deg:.2g} deg"
    why = f"two registrations leave {move.two_mm:.3g} mm RMS, one {move.one_mm:.3g} mm"
    return f"the tracker was moved before line {readings.line[places[move.at]]}, {by}: {why}"


def _load_changes(plan: Poses, rows: IntArray, at: int) -> bool:
    return plan.load is not None and bool(np.median(plan.load[rows[:at]]) != np.median(plan.load[rows[at:]]))


def _with_second_station(readings: Readings, p_plan: FloatArray, found: Assignment, repeat_mm: float) -> Assignment:
    """Return the assignment with the rest added, if most of it fits a second registration."""
    rows = np.flatnonzero((found.reading < 0) | found.outlier)
    places = np.flatnonzero(((found.owner < 0) | np.isin(found.owner, rows)) & ~readings.missing)
    if min(len(rows), len(places)) < _FEWEST:
        return found
    try:
        rest = assign(p_plan[rows], readings.p[places], repeat_mm)
    except DataError:
        return found
    fits = (rest.reading >= 0) & ~rest.outlier
    if fits.sum() < _MOST * min(len(rows), len(places)):
        return found
    reading, outlier = found.reading.copy(), found.outlier.copy()
    reading[rows[fits]], outlier[rows[fits]] = places[rest.reading[fits]], False
    return replace(found, reading=reading, outlier=outlier)


def _squares_by_cut(p: FloatArray, r: FloatArray) -> FloatArray:
    """Return the sums of squared residuals of two registrations, the second from each index on: (n,) [mm²].

    At index 0 there is one registration; cuts that leave fewer than `_FEWEST` on a side are infinite. Running sums give
    all cuts at once.
    """
    p, r = p - p.mean(axis=0), r - r.mean(axis=0)
    squares, crossed = (p**2 + r**2).sum(axis=1)[:, None], np.einsum("ni,nj->nij", r, p).reshape(-1, 9)
    running = np.cumsum(np.hstack([p, r, squares, crossed]), axis=0)
    n = len(p)
    cut = np.arange(_FEWEST, n - _FEWEST + 1)
    first = running[cut - 1]
    total = np.full(n, np.inf)
    total[0] = _squares(running[-1:], np.array([n]))[0]
    total[cut] = _squares(first, cut) + _squares(running[-1] - first, n - cut)
    return total


def _squares(sums: FloatArray, count: IntArray) -> FloatArray:
    """Return Σ‖p − R r − t‖² at the best R and t: Σ‖p‖² + Σ‖r‖² − 2 Σ s_k, centred (Umeyama 1991, (33)).

    From sums (k, 16) of p, r, ‖p‖² + ‖r‖² and r pᵀ over `count` points.
    """
    p, r = sums[:, :3], sums[:, 3:6]
    spread = sums[:, 6] - (p**2 + r**2).sum(axis=1) / count
    cross = sums[:, 7:].reshape(-1, 3, 3) - np.einsum("ki,kj->kij", r, p) / count[:, None, None]
    singular = np.linalg.svd(cross, compute_uv=False)
    singular[:, 2] *= np.where(np.linalg.det(cross) < 0.0, -1.0, 1.0)
    return np.asarray(np.maximum(spread - 2.0 * singular.sum(axis=1), 0.0))
