"""Find the distance from the sampled orientations up to which a map of positions holds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.errors import TrueposeError

LeaveBlocksOut = Callable[[IntArray], tuple[FloatArray, FloatArray]]

ONE_ORIENTATION: Final = float(np.deg2rad(2.0))
"""The angle that samples at one orientation support [rad]: a tool point known to 1 mm moves by 0.035 mm."""
_STEPS: Final = np.deg2rad([5.0, 10.0, 15.0, 20.0])
_LARGEST_RATIO: Final = 1.5  # of residuals to predicted standard deviations, RMS
_FEWEST: Final = 5  # samples per step
_MOST_BLOCKS: Final = 10


def supported_angle(leave_blocks_out: LeaveBlocksOut, rotation: Rotation) -> float:
    """Return the largest angle to the nearest sampled orientation at which a map of positions holds [rad].

    The samples are divided by orientation, and each block is predicted from the other blocks. The residuals are grouped
    in steps of 5° by the angle to the nearest orientation of another block. The map holds up to the first step whose
    residuals exceed 1.5 times their predicted standard deviation (RMS). Steps with fewer than five samples are skipped.
    Samples at one orientation support 2°.

    Parameters
    ----------
    leave_blocks_out : callable
        A function from a label for each sample to residuals and their standard deviations, (n, 3) [mm].
    rotation : Rotation of length n
        The orientations of the samples' tool.

    Returns
    -------
    float
        The angle [rad].
    """
    block = orientation_blocks(rotation)
    if block.max(initial=0) == 0:
        return ONE_ORIENTATION
    try:
        residual, std = leave_blocks_out(block)
    except TrueposeError:  # the remaining samples do not support the model
        return ONE_ORIENTATION
    ratio = np.mean((residual / np.maximum(std, np.finfo(float).tiny)) ** 2, axis=1)
    angle = _angle_to_others(rotation, block)
    supported = ONE_ORIENTATION
    for low, high in zip([0.0, *_STEPS], _STEPS, strict=False):
        here = (angle > low) & (angle <= high)
        if here.sum() < _FEWEST:
            continue
        if not np.mean(ratio[here]) <= _LARGEST_RATIO**2:
            break
        supported = max(supported, float(angle[here].max()))
    return supported


def orientation_blocks(rotation: Rotation) -> IntArray:
    """Return the block of each of n orientations, (n,): equal orientations together, and at most ten blocks.

    Orientations within 2° of the first of their kind count as equal. More than ten kinds are divided repeatedly across
    their widest direction.
    """
    kind, kinds = _kinds(rotation)
    if len(kinds) <= _MOST_BLOCKS:
        return kind
    turns = (rotation[kinds] * rotation[kinds].mean().inv()).as_rotvec()
    parts = [np.arange(len(kinds))]
    while len(parts) < _MOST_BLOCKS:
        widest = max(range(len(parts)), key=lambda k: np.ptp(turns[parts[k]], axis=0).max())
        rows = parts.pop(widest)
        along = rows[np.argsort(turns[rows, np.argmax(np.ptp(turns[rows], axis=0))], kind="stable")]
        parts += [along[: len(along) // 2], along[len(along) // 2 :]]
    of_kind = np.empty(len(kinds), np.int64)
    for k, rows in enumerate(parts):
        of_kind[rows] = k
    return of_kind[kind]


def _kinds(rotation: Rotation) -> tuple[IntArray, IntArray]:
    """Return the kind of each orientation, and the first sample of each kind."""
    kind = np.full(len(rotation), -1, np.int64)
    first: list[int] = []
    while (free := np.flatnonzero(kind < 0)).size:
        alike = (rotation[free[0]].inv() * rotation[free]).magnitude() <= ONE_ORIENTATION
        kind[free[alike]] = len(first)
        first.append(int(free[0]))
    return kind, np.array(first, np.int64)


def _angle_to_others(rotation: Rotation, block: IntArray) -> FloatArray:
    """Return the angle from each orientation to the nearest one of another block, (n,) [rad]."""
    quaternions = rotation.as_quat()
    angle = np.empty(len(block))
    for k in np.unique(block):
        others = quaternions[block != k]
        chord = np.asarray(KDTree(np.concatenate([others, -others])).query(quaternions[block == k])[0])
        angle[block == k] = 4.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))
    return angle
