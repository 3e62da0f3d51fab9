"""What a cell file says of where to measure."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.cell.sections import RegionSection
from truepose.errors import DataError
from truepose.planning.collision import Surroundings
from truepose.planning.region import Listed, WorkRegion


def work_region(cell: Cell) -> WorkRegion:
    """Return the work region that a cell states, with what stands around.

    Raises
    ------
    DataError
        If it states none, or its frame is not among ``[frames.bases]``.
    """
    region = cell.region
    if region is None:
        raise DataError("the cell has no [region]: state the work region's centre, size_mm and home_deg in cell.toml")
    inside = region.matrix(cell.controller)
    return WorkRegion(
        **_ways(cell),
        home=np.deg2rad(region.home_deg),
        tf_base_frame=_frame(cell, region),
        centre=inside[:3, 3],
        size=np.array(region.size_mm),
        rotation=Rotation.from_matrix(inside[:3, :3]),
        tilt=np.deg2rad(region.tilt_deg),
    )


def listed(cell: Cell, candidates: FloatArray) -> Listed:
    """Return configurations to choose from, with what stands around; home is the region's, or the first of them.

    Raises
    ------
    DataError
        If they are no joint vectors of the robot.
    """
    q = cell.load_robot().check_joints(candidates)
    return Listed(**_ways(cell), home=q[0] if cell.region is None else np.deg2rad(cell.region.home_deg), q=q)


def _ways(cell: Cell) -> dict[str, Any]:
    """Return what `MeasurementSpace` needs besides home."""
    how, station = cell.measuring, cell.tf_base_tracker[:3, 3]
    collision = Surroundings(
        robot=cell.load_robot(),
        tf_flange_tool=cell.tf_flange_tool,
        boxes={name: np.array([box.x_mm, box.y_mm, box.z_mm]).T for name, box in cell.obstacles.items()},
        link_radius=how.link_radius_mm,
        p_tracker=station if station.any() else None,
        reflector_axis=None if how.reflector_axis is None else np.array(how.reflector_axis),
        acceptance=np.deg2rad(how.acceptance_deg),
    )
    return {
        "collision": collision,
        "margin": np.deg2rad(how.limit_margin_deg),
        "approach": np.deg2rad(how.approach_deg),
    }


def _frame(cell: Cell, region: RegionSection) -> FloatArray:
    if region.frame is None:
        return np.eye(4)
    if region.frame not in cell.bases:
        known = ", ".join(map(str, cell.bases)) or "none"
        raise DataError(f"[region] frame {region.frame} is not among [frames.bases]; there is {known}")
    return cell.bases[region.frame]
