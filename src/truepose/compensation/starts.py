"""From where a program's motions reach its targets: this decides on which side of its backlash each joint stands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from truepose._typing import BoolArray, FloatArray, IntArray


class Starts(NamedTuple):
    """From where a motion reaches each of n targets.

    Attributes
    ----------
    poses : (n, 4, 4) array [mm], base frame
        The poses of the tool there; NaN where they are not known.
    by_joints : (n,) array of bool
        Whether the motion is a joint motion, on which no joint turns back; else it is a straight line.
    status, turn : (n,) arrays of int
        The KUKA configuration there, −1 where it is not known.
    """

    poses: FloatArray
    by_joints: BoolArray
    status: IntArray
    turn: IntArray

    @classmethod
    def of_lines(cls, poses: FloatArray) -> Starts:
        """Return the starts of straight lines, at poses (n, 4, 4) [mm], base frame; NaN where not known."""
        n = len(poses)
        unknown = np.full(n, -1)
        return cls(np.asarray(poses, float), np.zeros(n, np.bool_), unknown, unknown)

    @property
    def known(self) -> BoolArray:
        """Whether it is known from where each target is reached, (n,)."""
        return np.asarray(np.isfinite(self.poses).all(axis=(1, 2)))

    def take(self, rows: IntArray) -> Starts:
        """Return some of them, also one several times."""
        return Starts(self.poses[rows], self.by_joints[rows], self.status[rows], self.turn[rows])
