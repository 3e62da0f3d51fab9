"""Several reflectors on one tool: the points at which the rows of a predictor's input were measured.

Their errors are those of one pose: the error of the tool point, the turn of the tool, and what each reflector is away
from its stated place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray

REFLECTOR: Final = "reflector"
"""The columns of X that name the reflector of a row and the visit to its pose; NaN for the tool point."""

_ON_A_LINE: Final = 1.0  # mm
_SAME: Final = 1e-6  # rad


@dataclass(frozen=True, eq=False)
class Reflectors:
    """The reflectors of a tool.

    Attributes
    ----------
    names : tuple of str
        Their names.
    p_tool : (m, 3) array [mm], tool frame
        Their stated positions.
    std : (m,) array [mm]
        What each may deviate from its stated position, per axis.
    """

    names: tuple[str, ...]
    p_tool: FloatArray
    std: FloatArray

    @property
    def on_a_line(self) -> bool:
        """Whether the reflectors are on one line, so that they do not show the turn of the tool about it."""
        return on_a_line(self.p_tool)

    def at(self, index: FloatArray) -> FloatArray:
        """Return the positions of the reflectors by number (n,), (n, 3) [mm], tool frame; zero for NaN."""
        named = np.isfinite(index)
        return np.where(named[:, None], self.p_tool[np.where(named, index, 0.0).astype(np.int64)], 0.0)


def on_a_line(p: FloatArray) -> bool:
    """Return whether points (m, 3) [mm] are on one line.

    Examples
    --------
    >>> on_a_line(np.array([[0.0, 0, 0], [0, 0, 50], [0, 0, 80]])), on_a_line(np.diag([50.0, 50.0, 50.0]))
    (True, False)
    """
    spread = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    return bool(len(p) < 3 or spread[1] <= _ON_A_LINE)


def distance_from_line(p: FloatArray) -> float:
    """Return the distance of the origin from the line through points (m, 3) [mm] that lie on one; from one point.

    Examples
    --------
    >>> distance_from_line(np.array([[30.0, 0, 0], [30, 0, 50]]))
    30.0
    """
    middle = p.mean(axis=0)
    spread, axes = np.linalg.svd(p - middle)[1:]
    if spread[0] > _ON_A_LINE:
        middle = middle - (middle @ axes[0]) * axes[0]
    return float(np.linalg.norm(middle))


def whole_poses(q: FloatArray, visit: FloatArray | None) -> IntArray:
    """Return the number of the pose of each row, (n,): rows of one visit, and visits with the same joints.

    Parameters
    ----------
    q : (n, dof) array [rad]
        The joints.
    visit : (n,) array, optional
        The visits; None or NaN: a row is a pose of its own.

    Examples
    --------
    >>> whole_poses(np.array([[0.1], [0.1], [0.2], [0.1]]), np.array([0.0, 0.0, 1.0, 2.0]))
    array([0, 0, 1, 0])
    """
    if visit is None or np.isnan(visit).all():
        return np.arange(len(q))
    own = np.where(np.isnan(visit), np.nanmax(visit) + 1.0 + np.arange(len(q)), visit)
    _, first, number = np.unique(own, return_index=True, return_inverse=True)
    joints = np.round(q[first] / _SAME).astype(np.int64)
    _, same = np.unique(joints, axis=0, return_inverse=True)
    return np.asarray(same.reshape(-1)[number.reshape(-1)], np.int64)
