"""ISO 9283 for samples and cells: the repeated poses, their frame, and the standard's test poses."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.error_map.registration import register_samples
from truepose.errors import RobotError
from truepose.geometry import apply_transform, make_transform, register
from truepose.robots import Robot
from truepose.samples import Poses, Samples, on_arm
from truepose.verification import performance as standard

EDGES_MM: Final = (1600.0, 1000.0, 630.0, 400.0, 250.0)
"""Edges of the standard's test cube [mm]."""

_SAME_MM: Final = 0.25
_SAME_RAD: Final = np.deg2rad(0.1)
_MOST_RAD: Final = np.deg2rad(5.0)  # larger orientation errors are those of the data
_INSET: Final = 0.1  # of the diagonal, from each corner of the plane to P2 … P5
_GRID: Final = 16
_ORIENTATIONS: Final = (
    (0.0, 180.0, 0.0),
    (0.0, 135.0, 0.0),
    (0.0, 90.0, 0.0),
)  # tool down, between, forward (ZYX, deg)
# corners of the plane C1 C2 C7 C8: an edge above and the edge below that lies opposite, in units of half an edge
_PLANE: Final = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [-1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]])


def iso9283(measurements: Samples, *, cell: Cell | None = None, registered: bool = False) -> standard.Iso9283:
    """Return the figures of ISO 9283:1998 of repeated measurements, and the missing ones.

    Rows of one pose have the same name (P1 … P5; "path1" … for points of a path) where names repeat, otherwise the same
    commanded pose, and joints where known, within 0.25 mm and 0.1°.

    Parameters
    ----------
    measurements : Samples
        The readings of repeated poses.
    cell : Cell, optional
        The cell, whose tool and station, stated or fitted, transform readings to the base frame. Without it AP is
        computed after a rigid registration to the commanded positions; RP, vAP, AD, RD and RT do not depend on that.
    registered : bool
        Whether the readings are in the robot base frame already.

    Raises
    ------
    DataError
        If no pose was measured at least twice.

    Examples
    --------
    >>> from truepose.simulation import VirtualCell
    >>> virtual = VirtualCell("hard", seed=0)
    >>> figures = iso9283(virtual.measure(np.tile(virtual.design(5), (30, 1))))
    >>> [pose.n for pose in figures.poses], 0.05 < figures.RP_mm < 0.1
    ([30, 30, 30, 30, 30], True)
    """
    measurements = measurements if cell is None else on_arm(measurements, cell.load_robot())
    p_cmd, rotation_cmd, tf_base_tracker = _registered(measurements, cell, registered)
    return standard.performance_figures(
        standard.Attained(
            pose=_pose_names(measurements, p_cmd),
            p_cmd=p_cmd,
            p=apply_transform(tf_base_tracker, measurements.p_meas),
            turn=_turns(measurements, rotation_cmd, tf_base_tracker),
            direction=_directions(measurements),
            time=measurements.time,
        )
    )


def iso9283_poses(
    cell: Cell,
    *,
    edge_mm: float | None = None,
    centre_mm: tuple[float, float, float] | None = None,
    rotation: Rotation | None = None,
    cycles: int = standard.CYCLES,
) -> Poses:
    """Return the standard's test poses for a cell: P1 … P5 on a diagonal plane of a cube, cycle after cycle.

    The cube's edges are along the base frame. P1 is its centre; P2 … P5 lie on the diagonals of the plane C1 C2 C7 C8,
    a tenth of a diagonal from its ends. All corners and poses are reached on one branch.

    Parameters
    ----------
    cell : Cell
        The cell with robot and tool.
    edge_mm : float, optional
        The edge of the cube; by default the largest one of the standard that can be reached.
    centre_mm : tuple of 3, optional
        The centre of the cube, base frame; by default searched in the plane y = 0.
    rotation : Rotation, optional
        The orientation of the tool, base frame; by default searched from pointing down to pointing forward.
    cycles : int
        The number of repetitions of each pose.

    Raises
    ------
    RobotError
        If no such cube can be reached.

    Examples
    --------
    >>> from truepose import VirtualCell
    >>> poses = iso9283_poses(VirtualCell("paper").cell, edge_mm=400.0, cycles=2)
    >>> poses.name[:6].tolist()
    ['P1', 'P2', 'P3', 'P4', 'P5', 'P1']
    """
    robot = cell.load_robot()
    tool = cell.tf_flange_tool
    reach = float(np.abs(robot.a).sum() + np.abs(robot.d).sum())
    x, z = np.meshgrid(np.linspace(0.15, 0.85, _GRID), np.linspace(-0.15, 0.85, _GRID), indexing="ij")
    centres = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()]) * reach
    if centre_mm is not None:
        centres = np.array([centre_mm], dtype=np.float64)
    rotations = [Rotation.from_euler("ZYX", angles, degrees=True) for angles in _ORIENTATIONS]
    for edge in EDGES_MM if edge_mm is None else (edge_mm,):
        for turned in rotations if rotation is None else [rotation]:
            if (found := _reachable_cube(robot, tool, centres, edge, turned)) is not None:
                return _cycled(*found, turned, cycles, f"ISO 9283 test poses, cube of {edge:g} mm")
    asked = f"edge {edge_mm:g} mm" if edge_mm is not None else f"the least edge of the standard, {EDGES_MM[-1]:g} mm"
    remedy = "state edge_mm, centre_mm or rotation"
    raise RobotError(f"{robot.name}: no cube with {asked} is within reach and limits on one branch; {remedy}")


def _reachable_cube(
    robot: Robot, tool: FloatArray, centres: FloatArray, edge: float, rotation: Rotation
) -> tuple[FloatArray, FloatArray] | None:
    """Return joints and positions of P1 … P5 at the innermost of the centres that can be reached."""
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    poses = np.vstack([np.zeros(3), _PLANE * (1.0 - 2.0 * _INSET)])
    points = 0.5 * edge * np.vstack([poses, corners])
    p = centres[:, None] + points
    q = robot.inverse(make_transform(rotation, p.reshape(-1, 3)), tool=tool)
    good = (
        np.all(robot.within_limits(q), axis=2).reshape(len(centres), len(points), -1).all(axis=1)
    )  # (centres, branches)
    if not good.any():
        return None
    branch = int(good.sum(axis=0).argmax())
    inside = centres[good[:, branch]]
    best = int(np.flatnonzero(good[:, branch])[np.linalg.norm(inside - inside.mean(axis=0), axis=1).argmin()])
    joints = q.reshape(*p.shape[:2], *q.shape[1:])[best, : len(poses), branch]
    return joints, p[best, : len(poses)]


def _cycled(q: FloatArray, p: FloatArray, rotation: Rotation, cycles: int, source: str) -> Poses:
    order = np.tile(np.arange(len(q)), cycles)
    return Poses(
        q=q[order],
        p_cmd=p[order],
        rotation_cmd=Rotation.from_quat(np.tile(rotation.as_quat(), (len(order), 1))),
        name=np.array(standard.POSES)[order],
        source=source,
    )


def _registered(
    measurements: Samples, cell: Cell | None, registered: bool
) -> tuple[FloatArray, Rotation | None, FloatArray]:
    """Return the commanded positions (n, 3) and orientations, and tf_base_tracker: the identity if already registered.

    With a cell and joints, orientations are the robot's own.
    """
    if cell is not None:
        robot = cell.load_robot()
        registration, _, p_cmd = register_samples(cell, robot, measurements)
        rotation = measurements.rotation_cmd
        if measurements.q is not None:
            rotation = Rotation.from_matrix(robot.forward(measurements.q)[:, :3, :3])
        return p_cmd, rotation, registration.tf_base_tracker
    if measurements.p_cmd is None:
        raise measurements.error("has no commanded positions (x_cmd_mm …); add them, or give the cell to compute them")
    station = np.eye(4)
    if not registered:
        station = register(measurements.p_cmd, measurements.p_meas, robust=True).tf_base_tracker
    return measurements.p_cmd, measurements.rotation_cmd, station


def _pose_names(measurements: Samples, p_cmd: FloatArray) -> NDArray[np.str_]:
    if measurements.name is not None and len(np.unique(measurements.name)) < len(measurements):
        return measurements.name
    features = [p_cmd / _SAME_MM]
    if measurements.rotation_cmd is not None:  # ‖R_1 − R_2‖ is √2 times the angle between them
        features.append(measurements.rotation_cmd.as_matrix().reshape(-1, 9) / (np.sqrt(2.0) * _SAME_RAD))
    if measurements.q is not None:
        features.append(measurements.q / _SAME_RAD)
    pairs = cKDTree(np.hstack(features)).query_pairs(1.0, output_type="ndarray")
    n = len(measurements)
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, group = connected_components(graph, directed=False)
    _, first, which = np.unique(group, return_index=True, return_inverse=True)
    return np.array([measurements.rows(np.array([i])) for i in first])[which]


def _turns(measurements: Samples, rotation_cmd: Rotation | None, tf_base_tracker: FloatArray) -> FloatArray | None:
    """Return rotation vectors from commanded to attained orientations, (n, 3) [rad], base frame.

    The orientation of the reflector on the tool is unknown; it is estimated by the mean of R_cmdᵀ R_meas.
    """
    if rotation_cmd is None or measurements.rotation_meas is None:
        return None
    attained = Rotation.from_matrix(tf_base_tracker[:3, :3]) * measurements.rotation_meas
    on_tool = (rotation_cmd.inv() * attained).mean()
    turn = attained * on_tool.inv() * rotation_cmd.inv()
    if (far := turn.magnitude() > _MOST_RAD).any():
        message = f"measured orientations are up to {np.rad2deg(turn.magnitude().max()):.3g} deg from commanded ones"
        remedy = "pass the cell, which computes these from the joints, or remove the columns of orientations"
        raise measurements.error(f"{message}; {remedy}", far)
    return np.asarray(turn.as_rotvec())


def _directions(measurements: Samples) -> IntArray | None:
    if measurements.approach is None:
        return None
    return np.asarray(np.unique(measurements.approach, axis=0, return_inverse=True)[1].reshape(-1), dtype=np.int64)
