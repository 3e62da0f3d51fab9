"""Assign readings to the rows of a plan by distances between points; the order decides between equal candidates.

A rigid motion transforms readings to commanded positions up to the errors of the robot (and of an unknown tool). It is
found from the given order or, if readings are missing or repeated, from short runs of rows with equal mutual distances.
A reading belongs to a row if it then lies within the gate, six times the median residual.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import DataError
from truepose.geometry.registration import register
from truepose.geometry.transforms import apply_transform

_GATE: Final = 6.0
_SMALLEST_GATE_MM: Final = 1.0
_WINDOWS: Final = (4, 6, 12, 24)
_SEEDS: Final = 12  # windows tried of each length
_FLAT: Final = 0.05
_ROUNDS: Final = 4
_SLACK: Final = 3.0  # rows by which a gross reading may be out of place
_IN_ORDER: Final = 0.8  # share of rows that must fit in the given order for it to be accepted


@dataclass(frozen=True, eq=False)
class Assignment:
    """The assignment of m readings to n plan rows.

    Attributes
    ----------
    reading : (n,) array of int
        The index of the reading of each plan row; -1 without one.
    owner : (m,) array of int
        The plan row of each reading, including repeats; -1 without one.
    residual : (n,) array [mm]
        The distance of the reading from the commanded position after registration; NaN without a reading.
    outlier : (n,) array of bool
        A mask of the rows whose reading lies outside the gate and was assigned by order.
    gate : float [mm]
        The largest residual of a reading that is not an outlier.
    tf_base_tracker : (4, 4) array [mm]
        The registration.
    """

    reading: IntArray
    owner: IntArray
    residual: FloatArray
    outlier: BoolArray
    gate: float
    tf_base_tracker: FloatArray


def assign(p_plan: FloatArray, p_read: FloatArray, repeat_mm: float) -> Assignment:
    """Assign readings (m, 3) [mm], tracker frame, to plan rows (n, 3) [mm], base frame.

    Rows of `p_read` that are not finite are missing readings; they keep their place in the order. Readings closer than
    `repeat_mm` to an assigned one are its repeats.

    Raises
    ------
    DataError
        If no rigid motion brings a part of the readings to a part of the plan.
    IdentifiabilityError
        If the positions do not determine a rigid motion: fewer than three, or all on a line.
    """
    p_given, repeated = p_read, _repeats_the_one_before(p_plan, p_read, repeat_mm)
    p_read = np.where(repeated[:, None], np.nan, p_given)
    tf, in_order = _start(p_plan, p_read, repeated)
    gate = gate_of(_nearest(tf, p_plan, p_read))
    reading = np.full(len(p_plan), -1)
    for _ in range(_ROUNDS):
        previous, p_base = reading, apply_transform(tf, p_read)
        reading = _pair(p_plan, p_base, gate, in_order)
        paired = np.flatnonzero(reading >= 0)
        if np.array_equal(reading, previous) or len(paired) < 4:
            break
        tf = register(p_plan[paired], p_read[reading[paired]], robust=True).tf_base_tracker
        residual = np.linalg.norm(apply_transform(tf, p_read[reading[paired]]) - p_plan[paired], axis=1)
        gate = gate_of(residual)
    p_base = apply_transform(tf, p_given)
    owner = _find_repeats(reading, p_given, repeat_mm)
    outlier = _pair_by_order(reading, owner, p_plan, p_base)
    residual = np.where(reading >= 0, np.linalg.norm(p_base[reading] - p_plan, axis=1), np.nan)
    return Assignment(reading, owner, residual, outlier, gate, tf)


def gate_of(residual: FloatArray) -> float:
    """Return the largest residual [mm] of a reading that is not an outlier."""
    return max(_GATE * float(np.median(residual)), _SMALLEST_GATE_MM)


def _start(p_plan: FloatArray, p_read: FloatArray, repeated: BoolArray) -> tuple[FloatArray, bool]:
    """Return a first registration, and whether it uses the given order."""
    candidates: list[FloatArray] = []
    if len(p_plan) == len(p_read) and (registration := _register(p_plan, p_read, robust=True)) is not None:
        tf, residual = registration
        gate = gate_of(residual)
        spread = float(np.linalg.norm(np.std(p_plan, axis=0)))
        if (residual <= gate).mean() >= _IN_ORDER and gate < max(spread, 2 * _SMALLEST_GATE_MM):
            return tf, True
        candidates.append(tf)
    candidates += [tf for width in _WINDOWS for tf in _from_windows(p_plan, p_read[~repeated], width)]
    if not candidates:
        raise DataError("no run of readings has the distances of a run of the plan")
    scores = [float(np.median(_nearest(tf, p_plan, p_read))) for tf in candidates]
    return candidates[int(np.argmin(scores))], False


def _register(p_plan: FloatArray, p_read: FloatArray, *, robust: bool) -> tuple[FloatArray, FloatArray] | None:
    """Return the registration of rows in order and its residuals (k,) [mm]; None if they do not match."""
    there = _is_there(p_read)
    try:
        registration = register(p_plan[there], p_read[there], robust=robust)
    except DataError:
        return None
    return registration.tf_base_tracker, np.asarray(np.linalg.norm(registration.residuals, axis=1))


def _repeats_the_one_before(p_plan: FloatArray, p_read: FloatArray, repeat_mm: float) -> BoolArray:
    """Return a mask of the readings that repeat the previous one; empty if the plan itself repeats rows."""
    repeated = np.zeros(len(p_read), dtype=np.bool_)
    if np.linalg.norm(np.diff(p_plan, axis=0), axis=1).min() > 2 * repeat_mm:
        repeated[1:] = np.linalg.norm(np.diff(p_read, axis=0), axis=1) <= repeat_mm
    return repeated


def _nearest(tf_base_tracker: FloatArray, p_plan: FloatArray, p_read: FloatArray) -> FloatArray:
    """Return the distance of each plan row to the nearest reading, (n,) [mm]."""
    there = _is_there(p_read)
    distance, _ = cKDTree(apply_transform(tf_base_tracker, p_read[there])).query(p_plan)
    return np.asarray(distance, dtype=np.float64)


def _is_there(p_read: FloatArray) -> BoolArray:
    return np.asarray(np.isfinite(p_read).all(axis=1))


def _from_windows(p_plan: FloatArray, p_read: FloatArray, width: int) -> list[FloatArray]:
    """Return registrations from the runs of `width` rows whose distances agree best with those of a run of readings."""
    n, m = len(p_plan) - width + 1, len(p_read) - width + 1
    if n < 1 or m < 1:
        return []
    most = abs(len(p_plan) - len(p_read)) + len(p_plan) // 7 + 10
    shifts = np.arange(-most, most + 1)
    start = np.arange(n)[:, None] + shifts  # (n, shifts): the run of readings that a run of rows is compared with
    inside = (start >= 0) & (start < m)
    start = np.where(inside, start, 0)
    worst, largest = np.where(inside, 0.0, np.inf), np.zeros(n)
    for step in range(1, width):
        in_plan = np.linalg.norm(p_plan[step : step + n] - p_plan[:n], axis=1)
        in_readings = np.linalg.norm(p_read[step : step + m] - p_read[:m], axis=1)
        worst = np.fmax(worst, np.nan_to_num(np.abs(in_readings[start] - in_plan[:, None]), nan=np.inf))
        largest = np.maximum(largest, in_plan)
    runs = np.lib.stride_tricks.sliding_window_view(p_plan, width, axis=0).transpose(0, 2, 1)
    singular = np.linalg.svd(runs - runs.mean(axis=1, keepdims=True), compute_uv=False)
    flat = singular[:, 1] < _FLAT * np.maximum(singular[:, 0], np.finfo(float).tiny)
    score = worst / np.maximum(largest, np.finfo(float).tiny)[:, None]
    score[flat] = np.inf
    best = np.argsort(score, axis=None, kind="stable")[:_SEEDS]
    found = []
    for row, column in zip(*np.unravel_index(best, score.shape), strict=True):
        if np.isfinite(score[row, column]):
            first = int(start[row, column])
            rows, readings = slice(row, row + width), slice(first, first + width)
            if (registration := _register(p_plan[rows], p_read[readings], robust=False)) is not None:
                found.append(registration[0])
    return found


def _pair(p_plan: FloatArray, p_base: FloatArray, gate: float, in_order: bool) -> IntArray:
    """Assign as many readings within the gate as possible to plan rows; the order decides between equal candidates."""
    reading = np.full(len(p_plan), -1)
    if in_order:
        reading = np.where(np.linalg.norm(p_base - p_plan, axis=1) <= gate, np.arange(len(p_plan)), -1)
    there = _is_there(p_base)
    there[reading[reading >= 0]] = False
    rows, free = np.flatnonzero(reading < 0), np.flatnonzero(there)
    if not len(rows) or not len(free):
        return reading
    near = cKDTree(p_plan[rows]).sparse_distance_matrix(cKDTree(p_base[free]), gate, output_type="coo_matrix")
    per_row, per_reading = np.bincount(near.row, minlength=len(rows)), np.bincount(near.col, minlength=len(free))
    unique = (per_row[near.row] == 1) & (per_reading[near.col] == 1)
    reading[rows[near.row[unique]]] = free[near.col[unique]]
    rows = np.setdiff1d(rows[per_row > 0], rows[near.row[unique]])
    free = np.setdiff1d(free[per_reading > 0], free[near.col[unique]])
    if len(rows) and len(free):
        distance = cdist(p_plan[rows], p_base[free]) / gate
        outside = distance > 1.0
        unlikely = np.maximum(distance - 2.0 / _GATE, 0.0) ** 2  # up to twice the median residual all are alike
        # convex in the difference of places, so that rows at one position keep their order
        place = ((_expected(rows, reading, len(p_base))[:, None] - free) / len(p_base)) ** 2
        chosen, column = linear_sum_assignment(np.where(outside, 1.0, 0.1 * unlikely) + 1e-3 * place)
        good = ~outside[chosen, column]
        reading[rows[chosen[good]]] = free[column[good]]
    return reading


def _expected(rows: IntArray, reading: IntArray, n_readings: int) -> FloatArray:
    """Return the expected places in the file of the readings of rows, interpolated from the assigned ones."""
    paired = np.flatnonzero(reading >= 0)
    in_order = np.sort(reading[paired])  # sorted, so that swapped rows do not disturb the order
    return np.asarray(np.interp(rows, [-1, *paired, len(reading)], [-1, *in_order, n_readings]))


def _find_repeats(reading: IntArray, p_read: FloatArray, repeat_mm: float) -> IntArray:
    """Return the plan row of every reading including repeats, (m,); -1 without one."""
    owner = np.full(len(p_read), -1)
    rows = np.flatnonzero(reading >= 0)
    taken = reading[rows]
    owner[taken] = rows
    extra = np.flatnonzero((owner < 0) & _is_there(p_read))
    if len(extra) and len(taken):
        distance = cdist(p_read[extra], p_read[taken])
        place = np.where(distance <= repeat_mm, np.abs(extra[:, None] - taken), len(p_read))
        nearest = place.argmin(axis=1)
        repeats = place[np.arange(len(extra)), nearest] < len(p_read)
        owner[extra[repeats]] = rows[nearest[repeats]]
    return owner


def _pair_by_order(reading: IntArray, owner: IntArray, p_plan: FloatArray, p_base: FloatArray) -> BoolArray:
    """Assign free readings near their place in the order to rows without one, in place; return a mask of these rows."""
    outlier = np.zeros(len(reading), dtype=np.bool_)
    empty, paired = np.flatnonzero(reading < 0), np.flatnonzero(reading >= 0)
    free = np.flatnonzero((owner < 0) & _is_there(p_base))
    if not len(empty) or not len(free) or not len(paired):
        return outlier
    allowed = np.abs(_expected(empty, reading, len(p_base))[:, None] - free) <= _SLACK
    distance = cdist(p_plan[empty], p_base[free])
    chosen, column = linear_sum_assignment(np.where(allowed, distance, 1e3 * distance.max() + 1.0))
    good = allowed[chosen, column]
    rows = empty[chosen[good]]
    reading[rows], outlier[rows] = free[column[good]], True
    owner[reading[rows]] = rows
    return outlier
