"""Joints of commanded poses on the branch of each target, and the guards that need joints."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import RobotError
from truepose.geometry import invert_transform
from truepose.robots import Robot, nearest_branch, select, status_turn
from truepose.robots.inverse.branches import SINGULAR
from truepose.robots.inverse.newton import smallest_singular

_BLOCK: Final = 1 << 20  # products held at a time


class BranchTracker:
    """Track the joints of targets through small changes of their pose, each on its own branch.

    Parameters
    ----------
    robot : Robot
        The nominal robot, which the controller computes with.
    poses : (n, 4, 4) array [mm]
        The targets, base to tool centre point.
    tf_flange_tool : (n, 4, 4) array [mm]
        The tool of each target.
    q_samples : (m, dof) array [rad]
        The measured configurations; a target that names no branch takes the one nearest to any of them.
    status, turn : (n,) arrays of int, optional
        The KUKA configuration of each target, −1 where it is not given.
    near : (n, dof) array [rad], optional
        The joints near which the controller reaches each target, NaN where they are not known. They select the branch
        and the full turns of every joint.
    q : (n, dof) array [rad], optional
        The joints of the targets, where they are known.

    Attributes
    ----------
    q_target : (n, dof) array [rad]
        The joints of the targets; where one is out of reach, those of a sample.
    q : (n, dof) array [rad]
        The joints of the last commands.
    lost : (n,) array of bool
        Whether each target is out of reach on its branch.
    """

    def __init__(
        self,
        robot: Robot,
        poses: FloatArray,
        tf_flange_tool: FloatArray,
        q_samples: FloatArray,
        status: IntArray | None = None,
        turn: IntArray | None = None,
        *,
        near: FloatArray | None = None,
        q: FloatArray | None = None,
    ) -> None:
        self._robot, self._poses, self._turn = robot, poses, turn
        self._named = np.zeros(len(poses), np.bool_) if status is None else status >= 0
        self._tf_tool_flange = invert_transform(tf_flange_tool)
        self.q = self._start(q_samples, status, turn, near) if q is None else q.copy()
        self.lost: BoolArray = np.asarray(np.isnan(self.q).any(axis=1))
        self.q[self.lost] = q_samples[0]
        self.q_target = self.q.copy()

    def _start(
        self, q_samples: FloatArray, status: IntArray | None, turn: IntArray | None, near: FloatArray | None
    ) -> FloatArray:
        """Return the targets' joints (n, dof): those near `near`, else of Status and Turn, else of the samples."""
        solutions = self._robot.inverse(self._poses @ self._tf_tool_flange)
        q = self._named_joints(solutions, q_samples, status, turn)
        if near is not None and len(known := np.flatnonzero(np.isfinite(near).all(axis=1))):
            q[known] = nearest_branch(solutions[known], near[known])
        return q

    def _named_joints(
        self, solutions: FloatArray, q_samples: FloatArray, status: IntArray | None, turn: IntArray | None
    ) -> FloatArray:
        """Return the targets' joints (n, dof) on the branch that Status and Turn name, or that of the samples."""
        q = _near_samples(self._robot, solutions, q_samples)
        if status is None or not self._named.any():
            return q
        turns = np.full(len(q), -1) if turn is None else turn
        try:
            named = select(self._robot, solutions, np.maximum(status, 0), np.maximum(turns, 0))
        except RobotError:
            return q  # no KUKA arm: its programs name no Status
        named = np.where((turns >= 0)[:, None], named, _near_samples(self._robot, named[:, None], q_samples))
        q[self._named] = named[self._named]
        return q

    def joints(self, command: FloatArray, rows: IntArray) -> FloatArray:
        """Return the joints of some targets' commands, (m, dof) [rad].

        Parameters
        ----------
        command : (m, 3) array [mm] or (m, 6) array [mm, rad], base frame
            Positions; and the rotation vectors by which the commands differ from the targets.
        rows : (m,) array of int
        """
        targets = self._poses[rows]
        poses = targets.copy()
        poses[:, :3, 3] = command[:, :3]
        if command.shape[1] == 6:
            poses[:, :3, :3] = Rotation.from_rotvec(command[:, 3:]).as_matrix() @ targets[:, :3, :3]
        same = np.asarray((poses == targets).all(axis=(1, 2)))
        self.q[rows[same]] = self.q_target[rows[same]]
        moved = rows[~same]
        if not len(moved):
            return self.q[rows]
        q = nearest_branch(self._robot.inverse(poses[~same] @ self._tf_tool_flange[moved]), self.q[moved])
        missing = np.asarray(np.isnan(q).any(axis=1))
        q[missing] = self.q[moved[missing]]
        self.lost[moved[missing]] = True
        self.q[moved] = q
        return self.q[rows]

    def reasons(self) -> list[str]:
        """Return for each target why its last command must not be sent, or an empty string."""
        reasons = [""] * len(self.q)
        within, sigma = self._robot.within_limits(self.q), smallest_singular(self._robot, self.q)
        for i, j in reversed(np.argwhere(~within).tolist()):
            low, high = np.rad2deg(self._robot.limits[j])
            angle = np.rad2deg(self.q[i, j])
            reasons[i] = f"joint {j + 1} would be at {angle:.3f}°, limits {low:g}° to {high:g}°"
        for i in np.flatnonzero(sigma < SINGULAR).tolist():
            reasons[i] = reasons[i] or (
                f"near a singularity: smallest singular value {sigma[i]:.2g} m/rad, limit {SINGULAR:g} m/rad"
            )
        for i, (before, after) in self._changed_words().items():
            reasons[i] = reasons[i] or f"its Status and Turn would change from {before} to {after}"
        for i in np.flatnonzero(self.lost).tolist():
            reasons[i] = "out of reach"
        return reasons

    def _changed_words(self) -> dict[int, tuple[str, str]]:
        """Return KUKA's words of the targets that name them and lose them, before and after."""
        rows = np.flatnonzero(self._named & ~self.lost)
        if not len(rows):
            return {}
        try:
            before, after = (np.stack(status_turn(self._robot, q[rows])) for q in (self.q_target, self.q))
        except RobotError:
            return {}  # no KUKA arm
        if self._turn is not None:
            before[1], after[1] = (np.where(self._turn[rows] >= 0, words[1], -1) for words in (before, after))
        changed = np.flatnonzero((before != after).any(axis=0))
        return {int(rows[k]): (_word(before[:, k]), _word(after[:, k])) for k in changed}


def _word(status_turn_bits: IntArray) -> str:
    status, turn = status_turn_bits.tolist()
    return f"S {status}" if turn < 0 else f"S {status}, T {turn}"


def _near_samples(robot: Robot, solutions: FloatArray, q_samples: FloatArray) -> FloatArray:
    """Return of each target's branches (n, b, dof) the one nearest to a sample, or NaN.

    Each joint is at the full turn nearest to that sample, or one turn from it if only that lies within the limits.
    """
    exists = np.asarray(~np.isnan(solutions).any(axis=2))
    closeness = np.full(exists.shape, -np.inf)
    nearest = np.zeros(exists.shape, np.int64)
    closeness[exists], nearest[exists] = _closest(solutions[exists], q_samples)
    best = np.argmax(closeness, axis=1)
    row = np.arange(len(solutions))
    chosen, near = solutions[row, best], q_samples[nearest[row, best]]
    q = near + (chosen - near + np.pi) % (2.0 * np.pi) - np.pi
    low, high = robot.limits.T
    other = q + 2.0 * np.pi * (np.less(q, low).astype(float) - np.greater(q, high))
    return np.asarray(np.where((other >= low) & (other <= high), other, q))


def _closest(q: FloatArray, q_samples: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return of configurations (n, dof) the closeness sum of cos(q - q_s) to the closest sample, and which it is.

    Products of matrices, a block at a time: in twelve coordinates a tree of a few hundred samples visits nearly all.
    """
    samples = np.concatenate([np.cos(q_samples), np.sin(q_samples)], axis=1).T
    points = np.concatenate([np.cos(q), np.sin(q)], axis=1)
    closeness, nearest = np.empty(len(q)), np.empty(len(q), np.int64)
    block = max(1, _BLOCK // len(q_samples))
    for start in range(0, len(q), block):
        here = slice(start, start + block)
        products = points[here] @ samples
        nearest[here] = products.argmax(axis=1)
        closeness[here] = products[np.arange(len(products)), nearest[here]]
    return closeness, nearest
