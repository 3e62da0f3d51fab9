"""What interpolators without a statistical model have in common: a standard deviation from leave-one-out (12)."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from truepose._typing import FloatArray
from truepose.predictors.base import LeaveOneOut, Predictor


class Interpolator(Predictor):
    """Base of interpolators that know no noise.

    The standard deviation is the same everywhere: the root mean square of the leave-one-out residuals, less `noise_std`
    of the readings where it is given, which the predictions do not use otherwise.

    Attributes
    ----------
    std_ : (k,) array [mm]
        Root mean square of the leave-one-out residuals.
    """

    has_local_std = False

    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None:
        self._x, self._e = X, e
        self._prepare()
        self.std_ = np.sqrt(np.mean(self._left_out() ** 2, axis=0))

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        e = self._interpolate(X)
        return e, np.broadcast_to(self._error_std(), e.shape).copy() if return_std else None

    def _error_std(self) -> FloatArray:
        """Return the standard deviation of the error itself; at least that of the mean of all readings, (k,) [mm]."""
        noise = self._given[2]
        known = np.zeros_like(self.std_) if noise is None else np.mean(noise**2, axis=0)
        return np.asarray(np.sqrt(np.maximum(self.std_**2 - known, known / len(self._x))))

    def _nugget_variance(self) -> FloatArray:
        return np.zeros_like(self.std_)  # all that is left out counts to the error

    def _leave_one_out(self) -> LeaveOneOut:
        residual = self._left_out()
        return LeaveOneOut(residual, np.broadcast_to(self.std_, residual.shape).copy())

    def _left_out(self) -> FloatArray:
        """Return the leave-one-out residuals (n, k); a point is left out with all its repeats."""
        points, inverse = np.unique(self._x, axis=0, return_inverse=True)
        if len(points) == 1:
            return np.asarray(self._e - self._e.mean(axis=0))
        return np.asarray(self._e - self._interpolate(points, leave_out=True)[inverse.reshape(-1)])

    def _prepare(self) -> None:
        """Check the parameters; prepare what all targets need."""

    @abstractmethod
    def _interpolate(self, X: FloatArray, leave_out: bool = False) -> FloatArray:
        """Return the errors at X (m, k); of the samples that are not at the target, with `leave_out`."""
