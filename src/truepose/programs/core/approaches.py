"""From where a program reaches its targets, where this is certain: along a straight line from the target before.

The direction in which each joint comes to a target decides on which side of its backlash it stands. A joint motion may
start anywhere, and a circle or a spline ends in another direction than that of its chord, so their targets are unknown.
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.programs.core.program import Program

_STRAIGHT: Final = re.compile(r"S?LIN(_REL)?|MoveL\w*|L|MOVL|movel|G0?1|GOTO", re.I)


def poses_before(program: Program) -> FloatArray:
    """Return the pose from which a straight motion reaches each target, (n, 4, 4) [mm], base frame; else NaN.

    A target that several motions reach from different targets is unknown.
    """
    targets = program.targets
    before = np.full((len(targets), 4, 4), np.nan)
    row, on_path = targets.motions
    if not len(row):
        return before
    source = np.full(len(targets), -1)
    came, first = np.where(on_path[1:], row[:-1], -2), row[1:]
    source[first[::-1]] = came[::-1]
    several = first[came != source[first]]
    source[several] = -2
    source[row[0]] = -2
    straight = np.zeros(len(targets), np.bool_)
    for start, columns in targets.chunks():
        kinds, which = columns.shared()
        only = [bool(kind.motions) and all(_STRAIGHT.fullmatch(word) for word in kind.motions) for kind in kinds]
        straight[start : start + len(columns)] = np.array(only, np.bool_)[which]
    straight[sorted({i for circle in program.circles for i in circle})] = False
    straight[list(targets.follows)] = False
    known = np.flatnonzero(straight & (source >= 0))
    if len(known):
        before[known] = _poses(program)[source[known]]
    return before


def _poses(program: Program) -> FloatArray:
    """Return the poses of all targets, (n, 4, 4) [mm], base frame; NaN where not known."""
    poses = np.full((len(program.targets), 4, 4), np.nan)
    for first, columns in program.targets.chunks():
        known = np.isfinite(columns.values).all(axis=1) & np.isfinite(columns.tf_base_frame()).all(axis=(1, 2))
        rows = np.flatnonzero(known & ~columns.commands_joints)
        if len(rows):
            poses[first + rows] = columns.take(rows).poses_base()
    return poses
