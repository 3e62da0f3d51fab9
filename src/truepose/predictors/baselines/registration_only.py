"""No error model: what registration alone leaves, the mark that every other predictor has to beat."""

from __future__ import annotations

import numpy as np

from truepose._typing import FloatArray
from truepose.predictors.base import LeaveOneOut, Predictor


class RegistrationOnly(Predictor):
    """Predict no error anywhere; the standard deviation is the root mean square of the samples' errors.

    Examples
    --------
    >>> model = RegistrationOnly().fit([[0.0], [1.0]], [3.0, 4.0])
    >>> model.predict([[5.0]])
    array([0.])
    """

    has_local_std = False

    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None:
        self._e = e
        self.std_ = np.sqrt(np.mean(e**2, axis=0))

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        shape = (len(X), self._e.shape[1])
        return np.zeros(shape), np.broadcast_to(self.std_, shape).copy() if return_std else None

    def _nugget_variance(self) -> FloatArray:
        return np.zeros_like(self.std_)

    def _leave_one_out(self) -> LeaveOneOut:
        return LeaveOneOut(self._e.copy(), np.broadcast_to(self.std_, self._e.shape).copy())
