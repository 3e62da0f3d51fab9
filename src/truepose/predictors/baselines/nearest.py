"""Interpolation by the nearest sample, and by the corners of the grid cell about the target (12)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.predictors.baselines.interpolator import Interpolator
from truepose.predictors.baselines.inverse_distance import inverse_power
from truepose.predictors.kriging.repeats import Points

CHUNK: Final = 2**20
"""Distances in memory at once."""


class Nearest(Interpolator):
    """The error of the nearest sample; of repeats of one point, their mean.

    Examples
    --------
    >>> Nearest().fit([[0.0], [3.0]], [1.0, 2.0]).predict([[1.0], [2.0]])
    array([1., 2.])
    """

    def _prepare(self) -> None:
        self._points = Points.of(self._x)
        self._mean_e, _ = self._points.average(self._e, np.ones_like(self._e))
        self._tree = KDTree(self._points.x)

    def _interpolate(self, X: FloatArray, leave_out: bool = False) -> FloatArray:
        near = np.asarray(self._tree.query(X, [2 if leave_out else 1])[1])
        return np.asarray(self._mean_e[near[:, 0]])


class GridCell(Interpolator):
    """Mean of the corners of the grid cell that holds the target, with weights h^-power.

    The corner in each direction is the nearest sample of that orthant about the target, which on a grid of samples is
    the cell's corner and needs no grid otherwise. Outside the samples the orthants that hold one are used. As all
    methods by cells it jumps where the cell changes.

    Parameters
    ----------
    power : float
        Exponent of the distance, above 0.

    Examples
    --------
    >>> GridCell(power=1).fit([[0.0], [3.0], [100.0]], [0.0, 3.0, 7.0]).predict([[1.0]])
    array([1.])
    """

    def __init__(self, power: float = 1) -> None:
        self.power = power

    def _prepare(self) -> None:
        if not (math.isfinite(self.power) and self.power > 0):
            raise DataError(f"GridCell: power is {self.power}; expected a number above 0")
        if self._x.shape[1] > 62:
            raise DataError(f"GridCell: {self._x.shape[1]} coordinates came; a cell has 62 at most")

    def _interpolate(self, X: FloatArray, leave_out: bool = False) -> FloatArray:
        n, d = self._x.shape
        rows = max(1, CHUNK // n)
        out = np.empty((len(X), self._e.shape[1]))
        for start in range(0, len(X), rows):
            part = slice(start, start + rows)
            square, orthant = np.zeros((2, len(X[part]), n))
            code = orthant.astype(np.int64)
            for a in range(d):
                offset = self._x[:, a] - X[part, a, None]
                square += offset**2
                code += (offset > 0).astype(np.int64) << a
            h = np.sqrt(square)
            if leave_out:
                h[h == 0] = np.inf
            order = np.lexsort((h, code), axis=1)
            sorted_code = np.take_along_axis(code, order, axis=1)
            first = np.ones_like(sorted_code, dtype=bool)
            first[:, 1:] = sorted_code[:, 1:] != sorted_code[:, :-1]
            corner = np.zeros_like(first)
            np.put_along_axis(corner, order, first, axis=1)
            h[~corner & (h > 0)] = np.inf  # a sample at the target counts with all its repeats
            out[part] = inverse_power(h, self.power) @ self._e
        return out
