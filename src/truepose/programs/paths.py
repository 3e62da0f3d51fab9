"""Straight paths: neighbouring corrections that differ so much that the commanded path bends are told.

Three targets in a row, driven in straight lines and lying on one, stay on a line where the arm's errors change evenly.
The bend is how far the middle target's correction is from that of its neighbours, interpolated. A bend may be right:
the errors are then just so. But it is also what a wrong map looks like, so a user should see it.
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose.programs.columns import Columns, IntArray
from truepose.programs.target import FloatArray

BEND: Final = 0.3
"""[mm] Bends beyond this are told."""
_STRAIGHT: Final = 0.05  # [mm] off the line of its neighbours
_LINEAR: Final = re.compile(r"S?LIN|SPL|Move?L\w*|TriggL\w*|ArcL\w*|L|move[lp]|MOVL|G1|GOTO|target", re.I)


class StraightPaths:
    """Looks for bends in a program, some targets at a time in their order."""

    def __init__(self, limit: float = BEND) -> None:
        self._limit = limit
        self._rows = np.empty(0, np.int64)
        self._linear = np.empty(0, bool)
        self._p, self._correction = np.empty((0, 3)), np.empty((0, 3))

    def bends(
        self, columns: Columns, rows: IntArray, p: FloatArray, correction: FloatArray
    ) -> list[tuple[int, int, int, float]]:
        """Return the bends that these targets complete: the rows of three in a row, and the bend at the middle [mm].

        Parameters
        ----------
        columns : Columns
            The next n targets.
        rows : (n,) array of int
            Their places in the program.
        p, correction : (n, 3) arrays [mm], base frame
            Positions, and what is added; zero where a target stays as it is.
        """
        kinds, which = columns.shared()
        linear = np.array([bool(t.motions) and all(_LINEAR.fullmatch(word) for word in t.motions) for t in kinds])
        rows = np.concatenate([self._rows, rows])
        linear = np.concatenate([self._linear, linear[which]])
        p, correction = np.concatenate([self._p, p]), np.concatenate([self._correction, correction])
        self._rows, self._linear, self._p, self._correction = rows[-2:], linear[-2:], p[-2:], correction[-2:]
        found = _bends(linear, p, correction, self._limit)
        return [(int(rows[i - 1]), int(rows[i]), int(rows[i + 1]), size) for i, size in found.items()]


def _bends(linear: NDArray[np.bool_], p: FloatArray, correction: FloatArray, limit: float) -> dict[int, float]:
    """Return which targets bend a straight path, and by how much [mm]."""
    if len(p) < 3:
        return {}
    a, b, c = p[:-2], p[1:-1], p[2:]
    along = c - a
    length = np.linalg.norm(along, axis=1)
    share = np.einsum("ij,ij->i", b - a, along) / np.maximum(length**2, np.finfo(float).tiny)
    off = np.linalg.norm(b - a - share[:, None] * along, axis=1)
    straight = linear[1:-1] & linear[2:] & (length > 0) & (share > 0) & (share < 1) & (off < _STRAIGHT)
    even = correction[:-2] + share[:, None] * (correction[2:] - correction[:-2])
    bend = np.linalg.norm(correction[1:-1] - even, axis=1)
    return {i + 1: float(bend[i]) for i in np.flatnonzero(straight & (bend > limit)).tolist()}
