"""A predictor of our own: a quadratic polynomial of the coordinates, by regularised least squares."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from sklearn.preprocessing import PolynomialFeatures

from truepose.errors import DataError
from truepose.predictors import LeaveOneOut, Predictor


class QuadraticTrend(Predictor):
    """Predict the error by a quadratic polynomial in the coordinates.

    Parameters
    ----------
    ridge : float
        The weight that keeps coefficients small where the samples do not determine them, relative to one sample.

    Attributes
    ----------
    std_ : (k,) array [mm]
        The standard deviation of a reading about the polynomial.
    """

    def __init__(self, ridge: float = 1e-3) -> None:
        self.ridge = ridge

    def _fit(self, X, e, noise_std):
        if not self.ridge > 0:
            raise DataError(f"QuadraticTrend: ridge must be above 0, got {self.ridge}")
        if len(X) < 2:
            raise DataError(f"QuadraticTrend: expected at least 2 samples, got n_samples = {len(X)}")
        extent = np.ptp(X, axis=0)
        self._centre, self._scale = X.mean(axis=0), np.where(extent > 0, extent, 1.0)
        F = self._columns(X)
        penalty = np.full(F.shape[1], self.ridge)
        penalty[0] = 0.0  # the constant is free
        self._factor = cho_factor(F.T @ F + np.diag(penalty))
        self.coefficients_ = cho_solve(self._factor, F.T @ e)
        self._free = 1.0 - self._leverage(F)[:, None]
        self._residual = e - F @ self.coefficients_
        self.std_ = np.sqrt(np.mean(self._residual**2 / self._free, axis=0))

    def _predict(self, X, return_std):
        F = self._columns(X)
        return F @ self.coefficients_, np.sqrt(self._leverage(F))[:, None] * self.std_ if return_std else None

    def _nugget_variance(self):
        noise = self._given[2]  # the known standard deviation of the readings (n, k), or None
        known = 0.0 if noise is None else np.mean(noise**2, axis=0)
        return np.maximum(self.std_**2 - known, 0.0)

    def _leave_one_out(self):
        return LeaveOneOut(self._residual / self._free, self.std_ / np.sqrt(self._free))

    def _columns(self, X):
        return PolynomialFeatures(2).fit_transform((X - self._centre) / self._scale)

    def _leverage(self, F):
        return np.einsum("ij,ji->i", F, cho_solve(self._factor, F.T))
