"""The columns of theory (10) at given configurations, as `truepose.predictors.kinematic.terms` computes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from truepose._typing import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Design:
    """All columns at n configurations.

    Attributes
    ----------
    q : (n, dof) array [rad]
        The joints.
    p : (n, 3) array [mm], base frame
        The nominal positions of the measured point.
    drift : (n, r, p) array
        The drift columns [mm, rad] per prior standard deviation of each parameter; r is 3, or 6 with orientation.
    lever : (n, r, dof) array [mm/rad], [rad/rad], base frame
        The levers ∂P/∂q_j, and the joint axes in the rows of orientation.
    place : (n, d) array
        The coordinates of the rest Z: cosine and sine of each joint angle, and metres for positions.
    unknown : (n, r, c) array
        The columns of the last c drift columns, those of conditions, where the condition is not known [mm, rad].
    mass : (n, r, b, c) array
        The columns of payloads for a standard deviation of the mass and of each coordinate of its centre, b in all,
        where these are not known [mm, rad].
    away : (n, 3) array [mm], tool frame
        The vectors from the tool point to the measured point.
    visit : (n,) array
        The visit to the pose; NaN where each row is one of its own.
    turn : (n,) array [mm]
        The lengths by which rows of orientation are multiplied, see `Terms.at`; 0 for rows of position.
    """

    q: FloatArray
    p: FloatArray
    drift: FloatArray
    lever: FloatArray
    place: FloatArray
    unknown: FloatArray
    mass: FloatArray
    away: FloatArray
    visit: FloatArray
    turn: FloatArray

    @property
    def rows(self) -> int:
        """The number of rows: 3 for positions, 6 for poses."""
        return int(self.lever.shape[1])


_ARRAYS: Final = ("q", "p", "drift", "lever", "place", "unknown", "mass", "away", "visit", "turn")


def take(design: Design, rows: slice | IntArray) -> Design:
    """Return some configurations of a design."""
    return Design(*(getattr(design, name)[rows] for name in _ARRAYS))


def parts(design: Design, size: int) -> list[Design]:
    """Return the design in parts of at most `size` configurations."""
    return [take(design, slice(start, start + size)) for start in range(0, len(design.q), size)]
