"""From a measurement file and a plan to samples, with a summary of what was understood."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose.cell import Cell
from truepose.samples import Poses, Samples, check_against
from truepose.trackers.columns import Columns
from truepose.trackers.matching import ImportSummary, match
from truepose.trackers.recognise import read_readings
from truepose.trackers.reflectors import combine_reflectors


def import_readings(
    path: str | Path,
    plan: Poses,
    *,
    cell: Cell | None = None,
    columns: Columns | None = None,
    reflectors: ArrayLike | int | None = None,
    keep: int | None = None,
    reorder: bool = False,
    missing: bool = False,
    two_stations: bool = False,
) -> tuple[Samples, ImportSummary]:
    """Read a measurement file and join it with its plan.

    Parameters
    ----------
    path : str or Path
        A file of any layout that `read_readings` knows.
    plan : Poses
        What was commanded. Without commanded positions these are computed from the joints, robot and tool of `cell`.
    cell : Cell, optional
        Where the plan has both, joints and commanded positions are compared on its robot.
    columns : Columns, optional
        Where the quantities stand in a file of no known layout.
    reflectors, keep : optional
        Several reflectors read at each pose; see `combine_reflectors`.
    reorder, missing, two_stations : bool
        See `match`.

    Returns
    -------
    samples : Samples
    summary : ImportSummary

    Raises
    ------
    FileError, DataError
        See `read_readings`, `match` and `check_against`.
    """
    readings = read_readings(path, columns)
    if reflectors is not None:
        readings = combine_reflectors(readings, reflectors, keep=keep)
    if cell is not None and plan.q is not None:
        robot = cell.load_robot()
        if plan.p_cmd is None:
            tf = robot.forward(plan.q, tool=cell.tf_flange_tool)
            plan = replace(plan, p_cmd=tf[:, :3, 3], rotation_cmd=Rotation.from_matrix(tf[:, :3, :3]))
        else:
            check_against(plan, robot)
    return match(readings, plan, reorder=reorder, missing=missing, two_stations=two_stations)
