"""Pictures of arms: parts, joints and limits; the pages move the parts themselves."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from truepose._io.files import LARGEST_CONFIG
from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.errors import DataError
from truepose.planning.measurement_space import work_region
from truepose.robots import Robot, list_robots, load_robot
from truepose.web.arms.shells import PartKind, body_transforms, resting_pose, shells
from truepose.web.problems import missing
from truepose.web.workspace import InCell

router = APIRouter(tags=["arms"])

Matrix = list[list[float]]
Point = tuple[float, float, float]


class ArmPart(BaseModel):
    """A truncated cone of the picture, in the frame of its body."""

    body: int = Field(description="the body: 0 is the base, i turns with joint i")
    kind: PartKind
    start_mm: Point
    end_mm: Point
    radii_mm: tuple[float, float]


class WorkBox(BaseModel):
    """A box in the base frame."""

    name: str
    tf_base_box: Matrix = Field(description="pose of the box's centre, mm, base frame")
    size_mm: Point


class ArmPicture(BaseModel):
    """An arm as the pages draw it. Lengths in mm, base frame; angles in degrees."""

    robot: str
    title: str
    bodies: list[Matrix] = Field(description="L of T = L_0 Rz(sign_1 q_1) L_1 … L_n, offsets and the tool included, mm")
    sign: list[float]
    limits_deg: list[tuple[float | None, float | None]] = Field(description="null where a joint has no limit")
    parts: list[ArmPart]
    q_deg: list[float] = Field(description="the joints of the frames; a resting pose unless asked for")
    frames: list[Matrix] = Field(description="joint frames 1 … n, flange and tool at q_deg, mm, base frame")
    reach_mm: float = Field(description="largest distance of the tool from the base that the lengths allow")
    region: WorkBox | None = None
    obstacles: list[WorkBox] = []
    tf_base_tracker: Matrix | None = Field(None, description="the tracker's station as the cell file states it, mm")


Joints = Annotated[str | None, Query(description="joints in degrees, separated by commas", max_length=400)]


@router.get("/robots/{robot}/arm")
def robot_arm(robot: str, q: Joints = None) -> ArmPicture:
    """Return the picture of an arm of the library."""
    if robot not in list_robots():
        raise missing("this robot")
    found = load_robot(robot)
    return _picture(found, np.eye(4), _joints(found, q))


@router.get("/cells/{cell}/arm")
def cell_arm(cell: InCell, q: Joints = None) -> ArmPicture:
    """Return the picture of a cell: arm and tool, work region, obstacles, and the tracker's station if it is stated."""
    return _of_cell(cell.load(), q)


class CellFileText(BaseModel):
    """The text of a cell file that is not saved."""

    text: str = Field(max_length=LARGEST_CONFIG)


@router.post("/cells/{cell}/arm")
def unsaved_arm(cell: InCell, unsaved: CellFileText) -> ArmPicture:
    """Return the picture of a cell whose file is being edited; nothing is written."""
    return _of_cell(Cell.from_toml(unsaved.text, folder=cell.folder, source=cell.file.name), None)


def _of_cell(stated: Cell, q: str | None) -> ArmPicture:
    robot = stated.load_robot()
    home = None if stated.region is None else np.deg2rad(stated.region.home_deg)
    picture = _picture(robot, stated.tf_flange_tool, _joints(robot, q, home))
    picture.region = _region(stated)
    picture.obstacles = [_box(name, np.array([box.x_mm, box.y_mm, box.z_mm])) for name, box in stated.obstacles.items()]
    if not stated.station_fitted:
        picture.tf_base_tracker = stated.tf_base_tracker.tolist()
    return picture


def _joints(robot: Robot, text: str | None, home: FloatArray | None = None) -> FloatArray:
    """Return the joints of a query (dof,) [rad]; without one home, or a resting pose."""
    if text is None:
        return resting_pose(robot) if home is None else home
    try:
        q = np.deg2rad([float(word) for word in text.split(",")])
    except ValueError:
        raise DataError(f"q: expected {robot.dof} joints in degrees, separated by commas; got {text!r}") from None
    return robot.check_joints(q)


def _picture(robot: Robot, tf_flange_tool: FloatArray, q: FloatArray) -> ArmPicture:
    bodies = body_transforms(robot, tf_flange_tool)
    ends = robot.forward(q), robot.forward(q, tool=tf_flange_tool)
    limits = [(_finite(low), _finite(high)) for low, high in np.rad2deg(robot.limits)]
    return ArmPicture(
        robot=robot.name,
        title=f"{robot.maker} {robot.model}".strip() or robot.name,
        bodies=bodies.tolist(),
        sign=robot.sign.tolist(),
        limits_deg=limits,
        parts=[
            ArmPart(
                body=part.body,
                kind=part.kind,
                start_mm=_point(part.start),
                end_mm=_point(part.end),
                radii_mm=part.radii,
            )
            for part in shells(robot, tf_flange_tool)
        ],
        q_deg=np.rad2deg(q).tolist(),
        frames=[*robot.frames(q)[1:].tolist(), *(end.tolist() for end in ends)],
        reach_mm=float(np.linalg.norm(bodies[:, :3, 3], axis=1).sum()),
    )


def _finite(angle: float) -> float | None:
    return float(angle) if np.isfinite(angle) else None


def _point(p: FloatArray) -> Point:
    x, y, z = p.tolist()
    return x, y, z


def _region(cell: Cell) -> WorkBox | None:
    if cell.region is None:
        return None
    region = work_region(cell)
    inside = np.eye(4)
    inside[:3, :3], inside[:3, 3] = region.rotation.as_matrix(), region.centre
    return WorkBox(name="", tf_base_box=(region.tf_base_frame @ inside).tolist(), size_mm=_point(region.size))


def _box(name: str, edges: FloatArray) -> WorkBox:
    tf = np.eye(4)
    tf[:3, 3] = edges.mean(axis=1)
    return WorkBox(name=name, tf_base_box=tf.tolist(), size_mm=_point(np.diff(edges, axis=1)[:, 0]))
