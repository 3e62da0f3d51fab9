"""Assign readings to the points of a plan by their names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import DataError
from truepose.geometry.registration import register
from truepose.geometry.transforms import apply_transform
from truepose.samples import Poses
from truepose.trackers.assignment import Assignment, assign, gate_of
from truepose.trackers.readings import Readings

BY_NAME: Final = "The readings were matched with the plan by the names of the points."
_CLEARLY: Final = 3.0  # times smaller residuals
_MANY: Final = 0.1  # share of the plan


@dataclass(frozen=True)
class NameMatch:
    """The result of `match_names`.

    Attributes
    ----------
    assignment : Assignment, optional
        The assignment by names; None if the names cannot be used.
    note : str
        A sentence for the import summary: names were used, or why not; empty where there are none.
    """

    assignment: Assignment | None = None
    note: str = ""


def match_names(readings: Readings, plan: Poses, p_cmd: FloatArray, repeat_mm: float) -> NameMatch:
    """Assign readings to the points of a plan that have the same name, in any order of the file.

    Names are compared without regard to case; of a name in parts (``Station1::Main::P3``) the last part may agree
    alone. Names are used if at least half of the readings or of the plan, whichever is fewer, has a partner, and the
    positions agree.

    Raises
    ------
    DataError
        If several readings of one name lie further apart than repeats.
    """
    if readings.name is None or plan.name is None:
        return NameMatch()
    planned = [_key(name) for name in plan.name.tolist()]
    owner = owners_by_name(readings, planned)
    named, there = owner >= 0, ~readings.missing
    if np.unique(owner[named]).size < 0.5 * min(len(plan), int(there.sum())):
        return NameMatch()
    if (twice := _repeated(planned)).any():
        same = plan.rows(twice)
        return NameMatch(note=f"The plan repeats a name ({same}), so readings were matched by their positions.")
    assignment = _assignment(readings.p, np.where(there, owner, -1), p_cmd)
    if assignment is None or _explained_better(assignment, readings, p_cmd, repeat_mm):
        why = "The names of the readings do not agree with the plan's positions"
        return NameMatch(note=f"{why}, so readings were matched by their positions.")
    _check_repeats(readings, assignment, repeat_mm)
    return NameMatch(assignment, BY_NAME)


def _key(name: str) -> str:
    return name.strip().casefold()


def _repeated(names: list[str]) -> BoolArray:
    _, group, count = np.unique(names, return_inverse=True, return_counts=True)
    repeated: BoolArray = count[group.reshape(-1)] > 1
    return repeated


def owners_by_name(readings: Readings, names: list[str]) -> IntArray:
    """Return the point with the name of each reading, (m,); -1 without one, the last of several.

    Names are compared without regard to case; of a name in parts (``Station1::Main::P3``) the last part may agree
    alone.
    """
    if readings.name is None:
        return np.full(len(readings), -1)
    place = {name: i for i, name in enumerate(map(_key, names)) if name}
    whole = [_key(name) for name in readings.name.tolist()]
    return np.array([place.get(name, place.get(name.rpartition("::")[2], -1)) for name in whole], dtype=np.int64)


def _assignment(p_read: FloatArray, owner: IntArray, p_plan: FloatArray) -> Assignment | None:
    """Return the assignment to given owners; None if no rigid motion fits more than half of the pairs."""
    reading = np.full(len(p_plan), -1)
    used = np.flatnonzero(owner >= 0)
    reading[owner[used[::-1]]] = used[::-1]  # the first of repeats
    rows = np.flatnonzero(reading >= 0)
    try:
        tf = register(p_plan[rows], p_read[reading[rows]], robust=True).tf_base_tracker
    except DataError:
        return None
    residual = np.full(len(p_plan), np.nan)
    residual[rows] = np.linalg.norm(apply_transform(tf, p_read[reading[rows]]) - p_plan[rows], axis=1)
    gate = gate_of(residual[rows])
    outlier = np.nan_to_num(residual) > gate
    if gate > max(float(np.sqrt(p_plan.var(axis=0).sum())), 2.0):
        return None
    return Assignment(reading, owner, residual, outlier, gate, tf)


def _explained_better(named: Assignment, readings: Readings, p_plan: FloatArray, repeat_mm: float) -> bool:
    """Return whether positions alone explain the readings much better: the tracker's own numbers as names."""
    p_read = np.where(readings.missing[:, None], np.nan, readings.p)
    try:
        found = assign(p_plan, p_read, repeat_mm)
    except DataError:
        return False
    more = int((found.residual <= found.gate).sum() - (named.residual <= named.gate).sum())
    return found.gate < named.gate / _CLEARLY or (more > _MANY * len(p_plan) and found.gate <= named.gate)


def _check_repeats(readings: Readings, found: Assignment, repeat_mm: float) -> None:
    """Refuse readings of one name that are too far apart to be repeats of one point."""
    used = np.flatnonzero(found.owner >= 0)
    apart = np.zeros(len(readings))
    apart[used] = np.linalg.norm(readings.p[used] - readings.p[found.reading[found.owner[used]]], axis=1)
    if (far := apart > repeat_mm).any():
        which = np.flatnonzero(found.owner == found.owner[int(apart.argmax())])
        message = f"one name for several readings, {apart.max():.4g} mm apart: {readings.points(which)}"
        raise DataError(f"{readings.source}: {message}; correct the name in {readings.lines(np.flatnonzero(far))}")
