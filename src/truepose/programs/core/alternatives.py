"""The other poses that one correction of a target must suit: derived positions, frames and tools within tolerances.

A program that moves to ``Offs(p1,0,0,50)`` moves there with the correction of p1. So that correction must be right at
both places, and the map is asked at both. The same holds for a frame that the program sets at run time near its stored
value: the correction in the frame must be right wherever the frame may lie. And for a tool: the correction must be
right for whichever tool within the tolerance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.geometry import make_transform
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.program import FrameTolerance
from truepose.programs.core.target import Target

_BLOCK: Final = 1 << 14
"""Number of poses that the map is asked about at a time."""


@dataclass(frozen=True, eq=False)
class Alternatives:
    """Poses that the corrections of targets must suit, too.

    Attributes
    ----------
    owner : (m,) array of int
        The target of each, by its place in the columns.
    poses : (m, 4, 4) array [mm]
        Base to tool.
    tf_base_frame : (m, 4, 4) array [mm]
        The frames in which the corrections count.
    lever : (m, 3) array [mm], the target's own frame
        The part of the position that turns with the orientation of the target.
    words : list of m str
        How the program gets there.
    tool : (m, 4, 4) array [mm]
        The deviations of the tools, in their own axes.
    """

    owner: IntArray
    poses: FloatArray
    tf_base_frame: FloatArray
    lever: FloatArray
    words: list[str]
    tool: FloatArray

    def __len__(self) -> int:
        return len(self.owner)

    def corrections(self, change: FloatArray) -> FloatArray:
        """Return what the correction of each target is at its alternatives, (m, 3 or 6) [mm, rad].

        `change`, (n, 3 or 6) [mm, rad], are the corrections of the targets in their frames.
        """
        given: FloatArray = change[self.owner].copy()
        if change.shape[1] > 3:
            given[:, :3] += Rotation.from_rotvec(given[:, 3:]).apply(self.lever) - self.lever
        return given


def alternatives(
    columns: TargetColumns,
    rows: IntArray,
    tolerance: FrameTolerance | None = None,
    tool_tolerance: FrameTolerance | None = None,
) -> Iterator[Alternatives]:
    """Yield the alternatives of some targets with a pose, some thousand at a time; those of one target together.

    `tolerance` is that of the frames, `tool_tolerance` that of the tools which the program sets at run time.
    """
    kinds, which = columns.shared()
    loose = np.array([bool(kind.frame_changed) and tolerance is not None for kind in kinds])[which]
    loose_tool = np.array([bool(kind.tool_changed) and tool_tolerance is not None for kind in kinds])[which]
    few = [k for k in rows.tolist() if k in columns.derived or loose[k] or loose_tool[k]]
    turned = _frames_within(tolerance) if tolerance is not None else None
    other = _frames_within(tool_tolerance) if tool_tolerance is not None else None
    waiting: list[Alternatives] = []
    for k in few:
        one = columns.take(np.array([k]))
        found = _of_target(one.target(0), k, one.tf_base_frame()[0], turned if loose[k] else None)
        waiting.append(found)
        if loose_tool[k]:
            waiting.append(_with_tools(one.target(0), k, one.tf_base_frame()[0], other))
        if sum(map(len, waiting)) >= _BLOCK:
            yield _joined(waiting)
            waiting = []
    if waiting:
        yield _joined(waiting)


def _of_target(target: Target, k: int, tf_base_frame: FloatArray, within: FloatArray | None) -> Alternatives:
    """Return the alternatives of one target; `within`, (v, 4, 4) [mm], are the deviations of its frame."""
    assert target.rotation is not None
    own = make_transform(target.rotation, target.p)
    nothing = np.zeros((1, 3))
    found = [(nothing, nothing), *(one.vectors(target.rotation) for one in target.derived)]
    shifts, levers = (np.concatenate(part) for part in zip(*found, strict=True))
    named = [f"at the position that is derived from it, {one.how}" for one in target.derived for _ in one.shifts]
    words = ["", *named]
    poses = np.repeat(own[None], len(shifts), axis=0)
    poses[:, :3, 3] += shifts
    frames = tf_base_frame[None]
    if within is not None:
        frames = np.concatenate([frames, tf_base_frame @ within])
        border = f"with its frame at the border of the tolerance ({target.frame_changed})"
        words += [border] * (len(words) * len(within))
    whole = frames.repeat(len(poses), axis=0)
    everything = (frames[:, None] @ poses).reshape(-1, 4, 4)
    lever = np.tile(levers, (len(frames), 1))
    own_place = slice(1, None)  # the first is the target itself
    m = len(words) - 1
    return Alternatives(
        np.full(m, k),
        everything[own_place],
        whole[own_place],
        lever[own_place],
        words[own_place],
        np.tile(np.eye(4), (m, 1, 1)),
    )


def _with_tools(target: Target, k: int, tf_base_frame: FloatArray, within: FloatArray | None) -> Alternatives:
    """Return a target, and the positions derived from it, with its tool at the borders of a tolerance."""
    assert target.rotation is not None
    assert within is not None  # the tolerance of a loose tool
    own = make_transform(target.rotation, target.p)
    nothing = np.zeros((1, 3))
    found = [(nothing, nothing), *(one.vectors(target.rotation) for one in target.derived)]
    shifts, levers = (np.concatenate(part) for part in zip(*found, strict=True))
    poses = np.repeat((tf_base_frame @ own)[None], len(shifts), axis=0)
    poses[:, :3, 3] += shifts @ tf_base_frame[:3, :3].T
    n = len(shifts)
    words = [f"with its tool at the border of the tolerance ({target.tool_changed})"] * (n * len(within))
    frames = np.repeat(tf_base_frame[None], len(words), axis=0)
    return Alternatives(
        np.full(len(words), k),
        np.tile(poses, (len(within), 1, 1)),
        frames,
        np.tile(levers, (len(within), 1)),
        words,
        np.repeat(within, n, axis=0),
    )


def _joined(parts: list[Alternatives]) -> Alternatives:
    return Alternatives(
        np.concatenate([part.owner for part in parts]),
        np.concatenate([part.poses for part in parts]),
        np.concatenate([part.tf_base_frame for part in parts]),
        np.concatenate([part.lever for part in parts]),
        [text for part in parts for text in part.words],
        np.concatenate([part.tool for part in parts]),
    )


def _frames_within(tolerance: FrameTolerance) -> FloatArray:
    """Return the deviations of a frame at the corners of a tolerance, (v, 4, 4) [mm], in its own axes."""
    signs = np.array(list(product((-1.0, 1.0), repeat=3)))
    turns = np.deg2rad(tolerance.deg) * signs if tolerance.deg else np.zeros((1, 3))
    both = [(shift, turn) for shift in tolerance.mm * signs for turn in turns]
    shifts, vectors = (np.array(part) for part in zip(*both, strict=True))
    return make_transform(Rotation.from_rotvec(vectors), shifts)
