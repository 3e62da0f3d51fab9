"""Interpolation by inverse distance (12), the baseline of every comparison. Shepard, ACM National Conference (1968)."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.distance import cdist

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.predictors.baselines.interpolator import Interpolator

CHUNK = 2**22  # distances in memory at once


class InverseDistance(Interpolator):
    """Weighted mean of the samples' errors with weights h^-power, theory (12).

    It passes through the samples and knows no noise. Its standard deviation is the root mean square of its
    leave-one-out residuals, the same everywhere, less `noise_std` where it is given.

    Parameters
    ----------
    power : float
        Exponent of the distance, above 0.
    neighbours : int, optional
        Nearest samples used for each target; all when not given.

    Examples
    --------
    >>> model = InverseDistance(power=1).fit([[0.0], [3.0]], [0.0, 3.0])
    >>> model.predict([[1.0], [3.0]])
    array([1., 3.])
    """

    def __init__(self, power: float = 2, neighbours: int | None = None) -> None:
        self.power = power
        self.neighbours = neighbours

    def _prepare(self) -> None:
        if not (math.isfinite(self.power) and self.power > 0):
            raise DataError(f"InverseDistance: power is {self.power}; expected a number above 0")
        if self.neighbours is not None and self.neighbours < 1:
            raise DataError(f"InverseDistance: neighbours is {self.neighbours}; expected at least 1, or None for all")

    def _interpolate(self, X: FloatArray, leave_out: bool = False) -> FloatArray:
        n, k = self._e.shape
        near = n if self.neighbours is None else min(self.neighbours, n)
        rows = max(1, CHUNK // max(n, 1))
        out = np.empty((len(X), k))
        for start in range(0, len(X), rows):
            part = slice(start, start + rows)
            h: FloatArray = cdist(X[part], self._x)
            if leave_out:
                h[h == 0] = np.inf
            if near < n:
                h[h > np.partition(h, near - 1, axis=1)[:, near - 1 : near]] = np.inf
            out[part] = inverse_power(h, self.power) @ self._e
        return out


def inverse_power(h: FloatArray, power: float) -> FloatArray:
    """Return h^-power (m, n), each row with the sum 1; a sample at the target takes all weight."""
    nearest = h.min(axis=1, keepdims=True)
    at_sample = nearest == 0
    weights = np.where(at_sample, h == 0, (np.where(at_sample, 1.0, nearest) / np.where(h == 0, 1.0, h)) ** power)
    share: FloatArray = weights / weights.sum(axis=1, keepdims=True)
    return share
