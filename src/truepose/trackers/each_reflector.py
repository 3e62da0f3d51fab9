"""Readings of several reflectors as rows of their own: a plan with one row for each reflector of a pose."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from truepose._typing import IntArray
from truepose.cell import Cell
from truepose.errors import DataError
from truepose.geometry import apply_transform
from truepose.samples import Poses
from truepose.trackers.readings import Readings
from truepose.trackers.reflectors import places_of

EACH: Final = "each"
"""The setting of `truepose.trackers.import_readings` that keeps the readings of all reflectors as rows."""


def rows_of_reflectors(readings: Readings, plan: Poses, cell: Cell) -> tuple[Readings, Poses, IntArray]:
    """Return readings and plan with one row for each reflector of each pose, and the pose of each row.

    The readings are named like the reflectors of the cell, or in the order in which the cell states them; at a pose
    some may be missing. The positions of the plan become those of the reflectors.

    Parameters
    ----------
    readings : Readings
        The readings of all reflectors.
    plan : Poses
        The commanded poses, with joints.
    cell : Cell
        The cell with ``[reflectors]``.

    Raises
    ------
    DataError
        If the cell states no reflectors, the plan has no joints, or the readings are not those of these reflectors.
    """
    names = list(cell.reflectors)
    if not names:
        raise DataError("the cell file states no reflectors; add [reflectors.A] … with their positions on the flange")
    if plan.q is None:
        raise plan.error("readings of several reflectors need the joints (q1_deg …)")
    place = _in_order_of_cell(readings, places_of(readings, len(names)), names)
    if len(place) != len(plan):
        raise DataError(
            f"{readings.source}: {len(readings)} readings of {len(names)} reflectors ({', '.join(names)}) are "
            f"{len(place)} poses, but the plan has {len(plan)}; put rows of zeros where readings are missing"
        )
    gone = (place < 0) | readings.missing[np.maximum(place, 0)]
    kept = ~gone | gone.all(axis=1, keepdims=True)  # a pose without any reading is one of the plan that is missing
    pose, which = np.nonzero(kept)
    p_flange = np.array([one.p_flange for one in cell.reflectors.values()])[which]
    whole = plan[pose]
    assert whole.q is not None
    expected = apply_transform(cell.load_robot().forward(whole.q), p_flange)
    if whole.name is None:
        assert plan.row is not None
        whole = replace(whole, name=np.array([f"P{number + 1}" for number in plan.row[pose]]))
    read = readings[np.maximum(place[pose, which], 0)]
    lost = int((gone.any(axis=1) & ~gone.all(axis=1)).sum())
    note = f"Each pose has a row for each of {len(names)} reflectors" + (
        f"; some are missing at {lost}." if lost else "."
    )
    rows = replace(
        whole, p_cmd=expected, reflector=np.array(names)[which], row=np.arange(len(pose)), line=None, source=plan.source
    )
    p = np.where(gone[pose, which][:, None], np.nan, read.p)
    return replace(read, p=p, name=None, notes=(*readings.notes, note)), rows, pose


def _in_order_of_cell(readings: Readings, place: IntArray, names: list[str]) -> IntArray:
    """Return the readings of each pose (poses, m) in the order of the cell, where the file names reflectors."""
    if readings.name is None:
        return place
    key = [name.strip().casefold() for name in readings.name.tolist()]
    wanted = [name.casefold() for name in names]
    if not set(key) <= set(wanted):
        return place
    out = np.full_like(place, -1)
    for row, of_pose in enumerate(place):
        for reading in of_pose[of_pose >= 0].tolist():
            out[row, wanted.index(key[reading])] = reading
    return out
