"""Check the arm between targets: the corrected path of a straight motion is compared with the programmed one.

A correction of a millimetre turns the joints by some hundredths of a degree. Near a singularity it can turn them by
much more, and near a limit of a joint or of the reach the corrected path can leave what the programmed one keeps. This
may happen between two targets that are both sound. So positions on long segments are followed on the branch of the arm
that the word of configuration names, or that the motions before lead to. Where the branch is not known nothing is
judged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import RobotError
from truepose.geometry import invert_transform, make_transform
from truepose.programs.core.configurations import joints_of_words
from truepose.programs.core.outcomes import Outcomes
from truepose.robots import Robot, nearest_branch
from truepose.robots.inverse.branches import inverse

STEP: Final = 20.0
"""Distance [mm] between positions on a segment; shorter segments are judged at their targets alone."""
MOST: Final = 60
"""Largest number of positions on one segment."""
LARGEST_CHANGE: Final = float(np.deg2rad(5.0))
"""Largest difference of a joint between the corrected and the programmed path."""


@dataclass(frozen=True, eq=False)
class _Ends:
    """The targets at the ends of segments.

    Attributes
    ----------
    pose : (k, 4, 4) array [mm]
        What the controller interpolates, as programmed: base to tool, or flange to tool where the robot holds the part.
    change : (k, 3) array [mm], base frame
        The corrections.
    other : (k, 4, 4) array [mm]
        The transforms from tool to flange, or from base to tool where the robot holds the part.
    held : (k,) array of bool
        Whether the robot holds the part.
    q : (k, dof) array [rad]
        The joints on the branch of the target; NaN where it is not known.
    """

    pose: FloatArray
    change: FloatArray
    other: FloatArray
    held: BoolArray
    q: FloatArray

    def flange(self, pose: FloatArray, at: IntArray) -> FloatArray:
        """Return the flanges, base to flange (m, 4, 4) [mm], of poses on the way from the targets `at` (m,)."""
        held = self.held[at][:, None, None]
        flange: FloatArray = np.where(held, self.other[at] @ invert_transform(pose), pose @ self.other[at])
        return flange


def unsafe_segments(
    robot: Robot, outcomes: Outcomes, pairs: IntArray, near: FloatArray | None, tf_flange_tool: FloatArray
) -> dict[int, str]:
    """Return the reasons why targets must stay nominal because of the segments between them, by target.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    outcomes : Outcomes
        The outcomes, with the changes of targets in their own frames in `after`.
    pairs : (s, 2) array of int
        The targets at both ends of each straight motion.
    near : (n, dof) array [rad], optional
        The joints of targets as the motions before lead to them; NaN where not known.
    tf_flange_tool : (4, 4) array [mm]
        The tool of targets that name none.
    """
    if not len(pairs):
        return {}
    rows, place = np.unique(pairs, return_inverse=True)
    try:
        ends = _ends(robot, outcomes, rows, near, tf_flange_tool)
        place = place.reshape(pairs.shape)
        judged = np.isfinite(ends.q[place[:, 0]]).all(axis=1)
        found = _follow(robot, ends, place[judged])
    except RobotError:
        return {}  # an arm of another kind: the branch is not known
    reasons: dict[int, str] = {}
    for pair, why in zip(pairs[judged].tolist(), found, strict=True):
        if why:
            first, last = (f"{end.name} (line {end.line})" for end in (outcomes.program.targets[i] for i in pair))
            for i in pair:
                if outcomes.corrected[i]:
                    reasons.setdefault(i, f"between {first} and {last} {why}")
    return reasons


def _ends(
    robot: Robot, outcomes: Outcomes, rows: IntArray, near: FloatArray | None, tf_flange_tool: FloatArray
) -> _Ends:
    """Return the data of some targets."""
    k = len(rows)
    whole, none = np.empty((2, k, 4, 4)), np.zeros(k, np.bool_)
    ends = _Ends(whole[0], np.zeros((k, 3)), whole[1], none, np.full((k, robot.dof), np.nan))
    for first, columns in outcomes.program.targets.chunks():
        here = np.flatnonzero((rows >= first) & (rows < first + len(columns)))
        if not len(here):
            continue
        some = columns.take(rows[here] - first)
        poses, tools = some.poses_base(), some.tf_flange_tool(tf_flange_tool)
        ends.held[here] = held = some.held
        ends.pose[here] = np.where(held[:, None, None], tools, poses)
        ends.other[here] = np.where(held[:, None, None], poses, invert_transform(tools))
        moved = outcomes.corrected[rows[here]]
        change = np.where(moved[:, None], outcomes.after[rows[here], :3], 0.0)
        ends.change[here] = np.einsum("nji,nj->ni", some.base_to_frame(), change)
        ends.q[here] = joints_of_words(robot, some, ends.flange(ends.pose[here], here))
    if near is not None:
        known = np.isfinite(near[rows]).all(axis=1)
        ends.q[known] = near[rows[known]]
    return ends


def _follow(robot: Robot, ends: _Ends, place: IntArray) -> list[str]:
    """Return for each segment what is wrong with its corrected path; empty where nothing is."""
    a, b = place.T
    start, end = ends.pose[a], ends.pose[b]
    turn = (Rotation.from_matrix(start[:, :3, :3]).inv() * Rotation.from_matrix(end[:, :3, :3])).as_rotvec()
    length = np.linalg.norm(end[:, :3, 3] - start[:, :3, 3], axis=1)
    count = np.clip(np.ceil(length / STEP).astype(int) - 1, 0, MOST)
    q, why = ends.q[a].copy(), [""] * len(a)
    for step in range(1, int(count.max(initial=0)) + 1):
        on = np.flatnonzero((count >= step) & np.isfinite(q).all(axis=1))
        t = (step / (count[on] + 1))[:, None]
        pose = make_transform(
            Rotation.from_matrix(start[on, :3, :3]) * Rotation.from_rotvec(t * turn[on]),
            start[on, :3, 3] + t * (end[on, :3, 3] - start[on, :3, 3]),
        )
        flange = ends.flange(pose, a[on])
        q[on] = nearest_branch(inverse(robot, flange), q[on])
        on, flange, t = (each[np.isfinite(q[on]).all(axis=1)] for each in (on, flange, t))
        flange[:, :3, 3] += ends.change[a[on]] + t * (ends.change[b[on]] - ends.change[a[on]])
        moved = nearest_branch(inverse(robot, flange), q[on])
        for i, text in zip(on.tolist(), _wrong(robot, q[on], moved), strict=True):
            why[i] = why[i] or text
    return why


def _wrong(robot: Robot, q: FloatArray, moved: FloatArray) -> list[str]:
    """Return what is wrong with the joints of the corrected path `moved` (m, dof) beside the programmed `q`."""
    reached = np.isfinite(moved).all(axis=1)
    change: FloatArray = np.rad2deg(np.abs(np.where(np.isfinite(moved), moved - q, 0.0)))
    size: FloatArray = change.max(axis=1)
    joint = change.argmax(axis=1)
    limit = np.rad2deg(LARGEST_CHANGE)
    texts = np.full(len(q), "", object)
    for i in np.flatnonzero(size > limit).tolist():
        texts[i] = (
            f"the corrected path turns joint {joint[i] + 1} by {size[i]:.1f}° from the programmed one "
            f"(limit {limit:g}°): it is near a singularity"
        )
    texts[_inside(robot, q) & ~_inside(robot, moved)] = "the corrected path leaves the limits of a joint"
    texts[~reached] = "the corrected path is out of reach"
    return [str(text) for text in texts]


def _inside(robot: Robot, q: FloatArray) -> BoolArray:
    """Return whether joints (m, dof) are within the limits of the arm."""
    low, high = robot.limits.T
    inside: BoolArray = ((q >= low) & (q <= high)).all(axis=1)
    return inside
