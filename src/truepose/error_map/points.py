"""The points at which samples were measured: the tool point, or the reflectors that a cell states.

The reflectors are one rigid body with the tool. A fit of the tool moves them together with it.
"""

from __future__ import annotations

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.errors import DataError
from truepose.geometry import apply_transform, invert_transform
from truepose.predictors.reflectors import Reflectors
from truepose.robots import Robot
from truepose.samples import Poses, Samples, check_rigid, reflector_index, visits


def reflectors_of(cell: Cell) -> Reflectors | None:
    """Return the reflectors of a cell in the tool frame; None where it states none."""
    if not cell.reflectors:
        return None
    every = cell.reflectors.values()
    p_tool = apply_transform(invert_transform(cell.tf_flange_tool), np.array([one.p_flange for one in every]))
    return Reflectors(tuple(cell.reflectors), p_tool, np.array([one.std_mm for one in every]))


def points_on_tool(poses: Poses, cell: Cell) -> FloatArray:
    """Return the measured point of each row, (n, 3) [mm], tool frame; zero, the tool point, without reflectors.

    Raises
    ------
    DataError
        If the cell does not state a reflector of the table.
    """
    reflectors = reflectors_of(cell)
    if poses.reflector is None:
        return np.zeros((len(poses), 3))
    index = reflector_index(poses, cell)
    assert reflectors is not None
    return reflectors.p_tool[index]


def commanded_points(robot: Robot, cell: Cell, poses: Poses, tf_flange_tool: FloatArray) -> FloatArray:
    """Return the nominal positions of the measured points at joints, (n, 3) [mm], base frame.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    cell : Cell
        The cell, which states the reflectors.
    poses : Poses
        The poses, with joints.
    tf_flange_tool : (4, 4) array [mm]
        The tool, fitted or as stated.
    """
    assert poses.q is not None
    tf = robot.forward(poses.q, tool=tf_flange_tool)
    if poses.reflector is None:
        return np.asarray(tf[:, :3, 3])
    return np.asarray(tf[:, :3, 3] + np.einsum("nij,nj->ni", tf[:, :3, :3], points_on_tool(poses, cell)))


def reflector_columns(poses: Poses, cell: Cell) -> FloatArray | None:
    """Return the columns of a predictor's input that name reflector and visit, (n, 2); None without reflectors."""
    if poses.reflector is None:
        return None
    return np.column_stack([reflector_index(poses, cell), visits(poses)]).astype(np.float64)


def check_points(samples: Samples, cell: Cell) -> None:
    """Refuse reflectors that the cell does not state, that moved, or that are elsewhere than stated.

    Raises
    ------
    DataError
        With the rows and the remedy.
    """
    if samples.reflector is None:
        return
    if samples.q is None:
        raise DataError(f"{samples.source}: readings of several reflectors need the joints (q1_deg …)")
    check_rigid(samples, cell)


def first_of_visits(poses: Poses) -> IntArray:
    """Return the first row of each visit to a pose, (v,): readings that are independent of each other."""
    return np.flatnonzero(np.diff(visits(poses), prepend=-1) > 0)


def of_one_reflector(samples: Samples, cell: Cell, tf_flange_tool: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the rows (k,) of the reflector that was read most often, and the transform from flange to it (4, 4) [mm].

    They are the readings of a campaign with one reflector, for tests that take readings as independent of each other.
    """
    index = reflector_index(samples, cell)
    rows = np.flatnonzero(index == np.bincount(index).argmax())
    tf = tf_flange_tool.copy()
    tf[:3, 3] += tf[:3, :3] @ points_on_tool(samples, cell)[rows[0]]
    return rows, tf
