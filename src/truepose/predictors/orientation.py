"""Errors of the pose from positions measured: what is left unknown, and how they are seen at another tool point."""

from __future__ import annotations

from abc import abstractmethod
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike
from sklearn.utils.validation import check_is_fitted

from truepose._typing import FloatArray
from truepose.predictors.base import Predictor

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


def turns(std: FloatArray) -> FloatArray:
    """Return columns of unknown turns about each axis with standard deviations (m,) [rad]: (m, 6, 3)."""
    columns = np.zeros((len(std), 6, 3))
    columns[:, 3:] = std[:, None, None] * np.eye(3)
    return columns


def at_offset(columns: FloatArray, offset: FloatArray | None) -> FloatArray:
    """Return columns of a pose's error for another point of the tool: e + w × r; as they are without an offset.

    Parameters
    ----------
    columns : (m, 6, p) array [mm, rad] over any unit
    offset : (m, 3) array [mm], base frame
        r, from the point that the columns are for.
    """
    if offset is None:
        return columns
    moved = columns.copy()
    moved[:, :3] += np.cross(columns[:, 3:], offset[:, :, None], axis=1)
    return moved


class PosePredictor(Predictor):
    """An error model that knows how the tool turns, though positions alone were measured."""

    @abstractmethod
    def _predict_pose(
        self, X: FloatArray, return_std: bool, offset: FloatArray | None
    ) -> tuple[FloatArray, FloatArray | None]:
        """Predict at checked joints; None in place of std where it is not asked for."""

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
        """Predict errors of position and orientation, both from positions measured.

        What the model does not explain is turned into an uncertainty of orientation by `rotation_per_mm`. The tool's
        orientation on the flange is taken as stated.

        Parameters
        ----------
        X : (m, dof) or (m, 2 dof) array_like [rad]
            As `predict`.
        return_std : bool
        offset : (m, 3) array [mm], base frame, optional
            From the measured point to the point of the tool that is asked for, on the nominal arm.
        unexplained : (3,) array [mm²], optional
            Variance of what the arm does beyond the field, in each direction: a part of `nugget_`. The standard
            deviation is that of the field alone when not given.

        Returns
        -------
        error : (m, 6) array [mm, rad], base frame
            e, and the rotation vector w of R_meas R_cmdᵀ.
        std : (m, 6) array [mm, rad]
            Only with `return_std`.

        Raises
        ------
        DataError
            As `predict`.
        """
        check_is_fitted(self)
        x = self._validate(X)[0]
        error, std = self._predict_pose(x, return_std, offset)
        if std is None:
            return error
        if unexplained is None:
            return error, std
        turned = turns(np.sqrt(np.mean(unexplained)) * rotation_per_mm(self._lever(x)))
        variance = std**2 + np.sum(at_offset(turned, offset) ** 2, axis=2)
        variance[:, :3] += unexplained
        return error, np.sqrt(variance)
