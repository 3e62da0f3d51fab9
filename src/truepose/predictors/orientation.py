"""Predict errors of the pose from measured positions, with their uncertainty and at other tool points."""

from __future__ import annotations

from abc import abstractmethod
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.predictors.base import Predictor

_UNSEEN = 0.05  # of the largest lever; joints with a shorter lever do not move the tool point


def rotation_per_mm(lever: FloatArray) -> FloatArray:
    """Return the rotation of the tool per unexplained positional error, (m,) [rad/mm], for each direction.

    All joints are assumed to contribute equally: joint j turns by its part of the error divided by its lever, so the
    variance is the mean of 1/|∂P/∂q_j|² over the joints that move the tool point.

    Parameters
    ----------
    lever : (m, r, dof) array [mm/rad]
        The levers ∂P/∂q_j, in the first three rows.

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


def unknown_rotations(std: FloatArray) -> FloatArray:
    """Return columns of unknown rotations about each axis with standard deviations (m,) [rad]: (m, 6, 3)."""
    columns = np.zeros((len(std), 6, 3))
    columns[:, 3:] = std[:, None, None] * np.eye(3)
    return columns


def at_offset(columns: FloatArray, offset: FloatArray | None) -> FloatArray:
    """Return the columns of a pose's error at another point of the tool, e + w × r.

    Parameters
    ----------
    columns : (m, 6, p) array
        The columns [mm, rad], per any unit.
    offset : (m, 3) array [mm], base frame, optional
        The vector r from the point of the columns to the other point; None returns the columns unchanged.
    """
    if offset is None:
        return columns
    moved = columns.copy()
    moved[:, :3] += np.cross(columns[:, 3:], offset[:, :, None], axis=1)
    return moved


class PosePredictor(Predictor):
    """An error model that predicts orientation errors from measured positions."""

    @abstractmethod
    def _predict_pose(
        self, X: FloatArray, return_std: bool, offset: FloatArray | None
    ) -> tuple[FloatArray, FloatArray | None]:
        """Predict at checked joints; std is None unless requested."""

    @abstractmethod
    def _lever(self, X: FloatArray) -> FloatArray:
        """Return ∂P/∂q_j at checked joints, (m, 3, dof) [mm/rad]."""

    @overload
    def predict_pose(
        self,
        X: ArrayLike,
        return_std: Literal[False] = ...,
        offset: FloatArray | None = ...,
        unexplained: FloatArray | None = ...,
    ) -> FloatArray: ...
    @overload
    def predict_pose(
        self,
        X: ArrayLike,
        return_std: Literal[True],
        offset: FloatArray | None = ...,
        unexplained: FloatArray | None = ...,
    ) -> tuple[FloatArray, FloatArray]: ...
    def predict_pose(
        self,
        X: ArrayLike,
        return_std: bool = False,
        offset: FloatArray | None = None,
        unexplained: FloatArray | None = None,
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Predict errors of position and orientation, both from measured positions.

        `rotation_per_mm` converts the unexplained part into an uncertainty of orientation. The tool's orientation on
        the flange is assumed to be exact.

        Parameters
        ----------
        X : (m, dof) or (m, 2 dof) array_like [rad]
            The joints, as for `predict`.
        return_std : bool
            Whether to return the standard deviations.
        offset : (m, 3) array [mm], base frame, optional
            The vector from the measured point to the wanted point of the tool, on the nominal arm.
        unexplained : (3,) or (m, 3) array [mm²], optional
            The variance of the arm's errors beyond the field in each direction, a part of `nugget_`; default: none.

        Returns
        -------
        error : (m, 6) array [mm, rad], base frame
            The errors e, and the rotation vectors w of R_meas R_cmdᵀ.
        std : (m, 6) array [mm, rad]
            Their standard deviations; only with `return_std`.

        Raises
        ------
        DataError
            If X is not valid, see `predict`.
        """
        self._check_fitted()
        x = self._validate(X)[0]
        error, std = self._predict_pose(x, return_std, offset)
        if std is None:
            return error
        if unexplained is None:
            return error, std
        rotations = unknown_rotations(np.sqrt(np.mean(unexplained, axis=-1)) * rotation_per_mm(self._lever(x)))
        variance = std**2 + np.sum(at_offset(rotations, offset) ** 2, axis=2)
        variance[:, :3] += unexplained
        return error, np.sqrt(variance)
