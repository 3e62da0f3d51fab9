"""Joints of commanded poses on the branch that each target is to be reached on, for predictors in joint space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from truepose.errors import RobotError
from truepose.geometry import invert_transform
from truepose.robots import Robot, nearest_branch, select

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Follower:
    """Follows targets through small changes of their position, each on its own branch.

    Parameters
    ----------
    robot : Robot
        Nominal: what the controller computes with.
    poses : (n, 4, 4) array [mm]
        Targets, base to tool centre point.
    tf_flange_tool : (n, 4, 4) array [mm]
    q_samples : (m, dof) array [rad]
        Measured configurations; a target that names no branch takes the one nearest to any of them.
    status, turn : (n,) arrays of int, optional
        KUKA configuration of each target, −1 where it is not given.

    Attributes
    ----------
    q : (n, dof) array [rad]
        Joints of the last positions; where a target is out of reach, those of a sample.
    lost : (n,) array of bool
        Targets out of reach on their branch.
    """

    def __init__(
        self,
        robot: Robot,
        poses: FloatArray,
        tf_flange_tool: FloatArray,
        q_samples: FloatArray,
        status: IntArray | None = None,
        turn: IntArray | None = None,
    ) -> None:
        self._robot, self._poses = robot, poses
        self._tf_tool_flange = invert_transform(tf_flange_tool)
        solutions = robot.inverse(poses @ self._tf_tool_flange)
        self.q = _near_samples(solutions, q_samples)
        if status is not None and (status >= 0).any():
            try:
                turns = np.full(len(poses), -1) if turn is None else turn
                named = select(robot, solutions, np.maximum(status, 0), np.maximum(turns, 0))
            except RobotError:
                pass  # no KUKA arm: its programs name no Status
            else:
                named = np.where((turns >= 0)[:, None], named, _near_samples(named[:, None], q_samples))
                self.q[status >= 0] = named[status >= 0]
        self.lost: NDArray[np.bool_] = np.asarray(np.isnan(self.q).any(axis=1))
        self.q[self.lost] = q_samples[0]

    def joints(self, p_command: FloatArray, rows: IntArray) -> FloatArray:
        """Return the joints of some targets moved to positions (m, 3) [mm], (m, dof) [rad]."""
        poses = self._poses[rows].copy()
        poses[:, :3, 3] = p_command
        q = nearest_branch(self._robot.inverse(poses @ self._tf_tool_flange[rows]), self.q[rows])
        missing = np.asarray(np.isnan(q).any(axis=1))
        q[missing] = self.q[rows[missing]]
        self.lost[rows[missing]] = True
        self.q[rows] = q
        return q


def _near_samples(solutions: FloatArray, q_samples: FloatArray) -> FloatArray:
    """Return of each target's branches (n, b, dof) the one nearest to a sample, at the turn nearest to it, or NaN."""
    exists = np.asarray(~np.isnan(solutions).any(axis=2))
    q = np.where(exists[..., None], solutions, 0.0)
    tree = KDTree(np.concatenate([np.cos(q_samples), np.sin(q_samples)], axis=1))
    distance, nearest = tree.query(np.concatenate([np.cos(q), np.sin(q)], axis=2))
    best = np.argmin(np.where(exists, distance, np.inf), axis=1)
    row = np.arange(len(q))
    chosen, near = q[row, best], q_samples[np.asarray(nearest)[row, best]]
    chosen = near + (chosen - near + np.pi) % (2.0 * np.pi) - np.pi
    chosen[~exists.any(axis=1)] = np.nan
    return np.asarray(chosen)
