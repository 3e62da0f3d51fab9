"""Predictors whose input may have conditions after the joints, which may be unknown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.predictors.orientation import PosePredictor
from truepose.robots import Robot


class ConditionedPredictor(PosePredictor):
    """An error model of an arm whose input is [q, conditions]; see `truepose.predictors.conditions`."""

    if TYPE_CHECKING:
        conditions: Sequence[str]
        robot: Robot | None

    def _validate(self, X: ArrayLike, y: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
        """Return joints and conditions (n, d), and y; conditions may be NaN, or left out for a prediction."""
        if self.robot is None or not self.conditions:
            return super()._validate(X, y)
        table = np.atleast_2d(np.asarray(X, float))
        q, checked = super()._validate(np.ascontiguousarray(table[:, : self.robot.dof]), y)
        return np.concatenate([q, table[:, self.robot.dof :]], axis=1), checked
