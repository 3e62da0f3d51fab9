"""Import a measurement file with its plan: samples and a summary."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.errors import DataError
from truepose.geometry import tool_suspected
from truepose.samples import Mask, Poses, Samples, check_against, on_arm
from truepose.trackers.by_name import owners_by_name
from truepose.trackers.columns import Columns
from truepose.trackers.each_reflector import EACH, rows_of_reflectors
from truepose.trackers.matching import ImportSummary, match
from truepose.trackers.readings import Readings
from truepose.trackers.recognise import read_readings
from truepose.trackers.reflectors import combine_reflectors


def import_readings(
    path: str | Path,
    plan: Poses,
    *,
    cell: Cell | None = None,
    columns: Columns | None = None,
    unit: str | None = None,
    reflectors: ArrayLike | int | str | None = None,
    keep: int | None = None,
    reorder: bool = False,
    missing: bool = False,
    two_stations: bool = False,
    mask: Mask | None = None,
) -> tuple[Samples, ImportSummary]:
    """Read a measurement file and join it with its plan.

    Parameters
    ----------
    path : str or Path
        The measurement file.
    plan : Poses
        The commanded poses. Missing commanded positions are computed from the joints with robot and tool of `cell`.
    cell : Cell, optional
        The cell; its robot is used to compare joints with commanded positions.
    columns : Columns, optional
        The columns of a file of unknown layout.
    unit : str, optional
        The unit of lengths in a file that states none, see `read_readings`.
    reflectors, keep : optional
        The reflectors read at each pose; see `combine_reflectors`. "each" keeps all readings as rows of the reflectors
        that `cell` states.
    reorder, missing, two_stations : bool
        The permissions of `match`.
    mask : Mask, optional
        The points to leave out later, which are not checked.

    Returns
    -------
    samples : Samples
        The samples in the order of the plan, with the masked ones.
    summary : ImportSummary
        The summary of the import.

    Raises
    ------
    FileError, DataError
        For the reasons of `read_readings`, `match` and `check_against`.
    """
    each = isinstance(reflectors, str) and reflectors == EACH
    if each and (cell is None or keep is not None):
        raise DataError("reflectors = each needs a cell that states them, and keeps all: leave out --keep")
    whole = None if each else reflectors
    readings = read_measurement(path, columns=columns, unit=unit, reflectors=whole, keep=keep)
    plan = plan if cell is None or plan.q_shown is None else on_arm(plan, cell.load_robot())
    if cell is not None and plan.q is not None:
        robot = cell.load_robot()
        if plan.p_cmd is None:
            tf = robot.forward(plan.q, tool=cell.tf_flange_tool)
            plan = replace(plan, p_cmd=tf[:, :3, 3], rotation_cmd=Rotation.from_matrix(tf[:, :3, :3]))
        else:
            check_against(plan, robot)
    if each and cell is not None:
        readings, rows, pose = rows_of_reflectors(readings, plan, cell)
        samples, summary = match(readings, rows, reorder=reorder, missing=missing, two_stations=two_stations, mask=mask)
        assert plan.p_cmd is not None
        return replace(samples, p_cmd=plan.p_cmd[pose[samples.row]]), summary  # that of the tool, not of reflectors
    permissions = {"reorder": reorder, "missing": missing, "two_stations": two_stations}
    if cell is None or plan.q is None:
        return match(readings, plan, **permissions, mask=mask)
    with tool_suspected(partial(_pairs, readings, plan, cell), cell.tf_flange_tool[:3, 3], readings.source):
        return match(readings, plan, **permissions, mask=mask)


def read_measurement(
    path: str | Path,
    *,
    columns: Columns | None = None,
    unit: str | None = None,
    reflectors: ArrayLike | int | str | None = None,
    keep: int | None = None,
) -> Readings:
    """Read a measurement file, with one reading per pose.

    Parameters
    ----------
    path : str or Path
        The measurement file.
    columns, unit : optional
        The columns and the unit of lengths of a file that does not state them; see `read_readings`.
    reflectors, keep : optional
        The reflectors read at each pose; see `combine_reflectors`.

    Returns
    -------
    Readings

    Raises
    ------
    FileError, DataError
        For the reasons of `read_readings` and `combine_reflectors`.
    """
    readings = read_readings(path, columns, unit=unit)
    if isinstance(reflectors, str):
        raise DataError(f"reflectors is {reflectors!r}; expected their number or their positions on the tool")
    return readings if reflectors is None else combine_reflectors(readings, reflectors, keep=keep)


def _pairs(readings: Readings, plan: Poses, cell: Cell) -> tuple[FloatArray, FloatArray] | None:
    """Return the flange poses and readings of points that have one name, or else of the file in order."""
    assert plan.q is not None
    owner = owners_by_name(readings, [] if plan.name is None else plan.name.tolist())
    if (owner < 0).all():
        if len(readings) != len(plan):
            return None
        owner = np.arange(len(plan))
    used = (owner >= 0) & ~readings.missing
    return cell.load_robot().forward(plan.q[owner[used]]), readings.p[used]
