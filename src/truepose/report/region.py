"""Predicted error and uncertainty at positions, and on planes through the work region."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.error_map import ErrorMap
from truepose.error_map.target_joints import BranchTracker
from truepose.errors import RobotError
from truepose.geometry import make_transform

_STEPS: Final = 33  # of the grid, along each axis of a plane


@dataclass(frozen=True, eq=False)
class Plane:
    """Predictions on one plane parallel to two axes of the base frame.

    Attributes
    ----------
    i, j : int
        The axes, 0, 1, 2 for x, y, z; the samples extend farther along i.
    u, v : (m,) arrays [mm]
        The coordinates along the axes.
    error, std : (m, m) arrays [mm]
        The length of the predicted error and of its standard deviation, rows along v; NaN out of reach.
    """

    i: int
    j: int
    u: FloatArray
    v: FloatArray
    error: FloatArray
    std: FloatArray


def planes(error_map: ErrorMap) -> list[Plane]:
    """Return predictions on the coordinate planes through the middle of the samples' bounding box.

    A map that predicts from joints is evaluated at the joints that reach the points with the orientation of the sample
    nearest to the mean orientation; the list is empty if the robot has no inverse kinematics.
    """
    low, high = error_map.p_cmd.min(axis=0), error_map.p_cmd.max(axis=0)
    extent = high - low
    pairs = [(i, j) for i, j in combinations(range(3), 2) if extent[i] > 0 and extent[j] > 0]
    axes = [(i, j) if extent[i] >= extent[j] else (j, i) for i, j in pairs]
    grids = [(np.linspace(low[i], high[i], _STEPS), np.linspace(low[j], high[j], _STEPS)) for i, j in axes]
    points = np.tile((low + high) / 2, (len(axes), _STEPS, _STEPS, 1))
    for plane, (i, j), (u, v) in zip(points, axes, grids, strict=True):
        plane[..., i], plane[..., j] = u, v[:, None]
    try:
        error, std = (np.linalg.norm(v, axis=1) for v in predict_positions(error_map, points.reshape(-1, 3)))
    except RobotError:
        return []
    shape = (len(axes), _STEPS, _STEPS)
    return [
        Plane(i, j, u, v, e, s)
        for (i, j), (u, v), e, s in zip(axes, grids, error.reshape(shape), std.reshape(shape), strict=True)
    ]


def plane_at(error_map: ErrorMap, i: int, j: int, at: float, steps: int) -> Plane:
    """Return predictions on a plane along the axes i and j, over the samples' bounding box.

    Parameters
    ----------
    error_map : ErrorMap
        The map.
    i, j : int
        The axes of the base frame, 0, 1, 2 for x, y, z.
    at : float [mm]
        The place of the plane along the third axis.
    steps : int
        The number of points along each axis.

    Raises
    ------
    RobotError
        If the map predicts from joints and the robot has no inverse kinematics.
    """
    low, high = error_map.p_cmd.min(axis=0), error_map.p_cmd.max(axis=0)
    u, v = (np.linspace(low[k], high[k], steps) for k in (i, j))
    points = np.full((steps, steps, 3), at)
    points[..., i], points[..., j] = u, v[:, None]
    error, std = (np.linalg.norm(one, axis=1) for one in predict_positions(error_map, points.reshape(-1, 3)))
    return Plane(i, j, u, v, error.reshape(steps, steps), std.reshape(steps, steps))


def predict_positions(error_map: ErrorMap, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return predicted errors and their standard deviation at positions, both (n, 3) [mm], base frame.

    Rows are NaN where a position is out of reach. A map that predicts from joints is evaluated at the joints that reach
    the positions with the orientation of the sample nearest to the mean orientation.

    Parameters
    ----------
    error_map : ErrorMap
        The map.
    p : (n, 3) array [mm], base frame
        The positions.

    Raises
    ------
    RobotError
        If joints are needed and the robot has no inverse kinematics.
    """
    if not len(p):
        return np.empty((0, 3)), np.empty((0, 3))
    if error_map.space == "cartesian":
        return error_map.predict_at(p)
    q = error_map.samples.q
    assert q is not None  # or the map could not predict from joints
    rotations = Rotation.from_matrix(error_map.robot.forward(q, tool=error_map.tf_flange_tool)[:, :3, :3])
    usual = rotations[int(np.argmin((rotations * rotations.mean().inv()).magnitude()))]
    poses = make_transform(Rotation.from_matrix(np.tile(usual.as_matrix(), (len(p), 1, 1))), p)
    tools = np.broadcast_to(error_map.tf_flange_tool, (len(p), 4, 4))
    follower = BranchTracker(error_map.robot, poses, tools, q)
    lost = follower.lost[:, None]
    e, std = error_map.predict_at(follower.q)
    return np.where(lost, np.nan, e), np.where(lost, np.nan, std)
