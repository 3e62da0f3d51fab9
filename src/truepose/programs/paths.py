"""Straight paths: neighbouring corrections that differ so much that the commanded path bends are told.

Three targets in a row, driven in straight lines and lying on one, stay on a line where the arm's errors change evenly.
The bend is how far the middle target's correction is from that of its neighbours, interpolated. A bend may be right:
the errors are then just so. But it is also what a wrong map looks like, so a user should see it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from truepose.programs.targets import FloatArray, Target

BEND: Final = 0.3
"""[mm] Bends beyond this are told."""
_STRAIGHT: Final = 0.05  # [mm] off the line of its neighbours
_LINEAR: Final = re.compile(r"S?LIN|SPL|Move?L\w*|TriggL\w*|ArcL\w*|L|move[lp]|MOVL|G1|GOTO|target", re.I)


def bends(targets: Sequence[Target], p: FloatArray, correction: FloatArray, limit: float = BEND) -> dict[int, str]:
    """Return which targets bend a straight path, each with words.

    Parameters
    ----------
    targets : sequence of n Target
        In the order of the program.
    p, correction : (n, 3) arrays [mm], base frame
        Positions, and what is added; zero where a target stays as it is.
    limit : float [mm]
    """
    linear = np.array([bool(t.motions) and all(_LINEAR.fullmatch(word) for word in t.motions) for t in targets])
    if len(targets) < 3:
        return {}
    a, b, c = p[:-2], p[1:-1], p[2:]
    along = c - a
    length = np.linalg.norm(along, axis=1)
    share = np.einsum("ij,ij->i", b - a, along) / np.maximum(length**2, np.finfo(float).tiny)
    off = np.linalg.norm(b - a - share[:, None] * along, axis=1)
    straight = linear[1:-1] & linear[2:] & (length > 0) & (share > 0) & (share < 1) & (off < _STRAIGHT)
    even = correction[:-2] + share[:, None] * (correction[2:] - correction[:-2])
    bend = np.linalg.norm(correction[1:-1] - even, axis=1)
    return {
        i + 1: f"bends a straight path by {bend[i]:.3f} mm against its neighbours {targets[i].name} and "
        f"{targets[i + 2].name}"
        for i in np.flatnonzero(straight & (bend > limit)).tolist()
    }
