"""What positions measured alone leave unknown of the orientation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_UNSEEN = 0.05  # of the largest lever: joints with a shorter one are not what moves the tool point


def rotation_per_mm(lever: FloatArray) -> FloatArray:
    """Return what an unexplained error of 1 mm in each direction turns the tool by in each direction, (m,) [rad/mm].

    It is taken to come from all joints in equal parts: joint j turns by its part of the error over its lever, so that
    the variance is the mean of 1/|∂P/∂q_j|² over the joints that move the tool point.

    Parameters
    ----------
    lever : (m, r, dof) array [mm/rad]
        ∂P/∂q_j in the first three rows.

    Examples
    --------
    >>> import numpy as np
    >>> rotation_per_mm(np.array([[[1000.0, 0.0], [0.0, 500.0], [0.0, 0.0]]])).round(5)
    array([0.00158])
    """
    squared = np.sum(lever[:, :3] ** 2, axis=1)
    moves = squared > _UNSEEN**2 * squared.max(axis=1, keepdims=True)
    inverse = np.where(moves, 1.0 / np.where(moves, squared, 1.0), 0.0)
    return np.asarray(np.sqrt(inverse.sum(axis=1) / moves.sum(axis=1)))
