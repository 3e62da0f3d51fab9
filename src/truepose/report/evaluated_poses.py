"""Poses at which a map is described: in the work region of the cell file, or between the samples."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.error_map import ErrorMap
from truepose.error_map.target_joints import BranchTracker
from truepose.errors import RobotError
from truepose.geometry import make_transform
from truepose.samples import Poses

REGION: Final = "in the work region of the cell file"
SAMPLES: Final = "between the samples"
AT_SAMPLES: Final = "at the samples"
_COUNT: Final = 200
_STEP: Final = 0.5  # of the way from one sample to another


class EvaluatedPoses(NamedTuple):
    """Poses at which a map is described.

    Attributes
    ----------
    poses : Poses
        The joints, or the positions for a map in Cartesian space.
    where : str
        Where they are: `REGION`, `SAMPLES` or `AT_SAMPLES`.
    """

    poses: Poses
    where: str


def evaluated_poses(error_map: ErrorMap, rng: np.random.Generator) -> EvaluatedPoses:
    """Return poses of the work region of the cell file; without one, poses between pairs of samples.

    Positions and orientations of the tool are drawn, never joints: joints between those of two samples can turn the
    tool in a way that nobody measured or needs. A map in joint space takes the joints that reach each pose on the
    branch of the nearest sample, and a map that knows the backlash of joints comes to each pose from a known side.

    Parameters
    ----------
    error_map : ErrorMap
        The map.
    rng : Generator
        The source of the poses.
    """
    region = _in_region(error_map, rng)
    where = SAMPLES if region is None else REGION
    if error_map.space == "cartesian":
        p = _positions_between(error_map, rng)[0] if region is None else region[:, :3, 3]
        return EvaluatedPoses(Poses(p_cmd=p), where)
    q_samples = error_map.samples.q
    assert q_samples is not None  # or the map could not predict from joints
    poses = _between_samples(error_map, q_samples, rng) if region is None else region
    try:
        tools = np.broadcast_to(error_map.tf_flange_tool, poses.shape)
        found = BranchTracker(error_map.robot, poses, tools, q_samples)
    except RobotError:  # no inverse kinematics
        return EvaluatedPoses(Poses(q=q_samples), AT_SAMPLES)
    reached = ~found.lost & error_map.robot.within_limits(found.q).all(axis=1)
    if not reached.any():
        return EvaluatedPoses(Poses(q=q_samples), AT_SAMPLES)
    q = found.q[reached]
    approach = rng.choice([-1.0, 1.0], q.shape) if error_map.knows_approach else None
    return EvaluatedPoses(Poses(q=q, approach=approach), where)


def _in_region(error_map: ErrorMap, rng: np.random.Generator) -> FloatArray | None:
    """Return poses (n, 4, 4) [mm], base frame, in the work region of the map's cell; None without one."""
    cell = error_map.cell
    region = cell.region
    if region is None or (region.frame is not None and region.frame not in cell.bases):
        return None
    tf_base_frame = np.eye(4) if region.frame is None else cell.bases[region.frame]
    tf_frame_region = region.matrix(cell.controller)
    p = tf_frame_region[:3, 3] + rng.uniform(-0.5, 0.5, (_COUNT, 3)) * np.array(region.size_mm)
    tilt = np.deg2rad(region.tilt_deg) * rng.uniform(-1.0, 1.0, (_COUNT, 3))
    rotation = Rotation.from_matrix(tf_frame_region[:3, :3]) * Rotation.from_rotvec(tilt)
    poses: FloatArray = tf_base_frame @ make_transform(rotation, p)
    return poses


def _positions_between(error_map: ErrorMap, rng: np.random.Generator) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return positions between pairs of samples (n, 3) [mm], the pairs (2, n), and the share of the way (n, 1)."""
    p = error_map.p_cmd
    pairs = rng.integers(len(p), size=(2, _COUNT))
    share = rng.uniform(0.0, _STEP, (_COUNT, 1))
    between: FloatArray = p[pairs[0]] + share * (p[pairs[1]] - p[pairs[0]])
    return between, pairs, share


def _between_samples(error_map: ErrorMap, q: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return poses (n, 4, 4) [mm] between pairs of samples, turned the shorter way between their orientations."""
    p, (first, second), share = _positions_between(error_map, rng)
    rotation = Rotation.from_matrix(error_map.robot.forward(q, tool=error_map.tf_flange_tool)[:, :3, :3])
    turn = (rotation[second] * rotation[first].inv()).as_rotvec()
    return make_transform(Rotation.from_rotvec(share * turn) * rotation[first], p)
