"""Interpolation by radial basis functions (12), which is scipy's `RBFInterpolator`."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations_with_replacement
from typing import Any, Final

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial.distance import cdist

from truepose._typing import FloatArray
from truepose.errors import DataError, KrigingError
from truepose.predictors.baselines.interpolator import Interpolator
from truepose.predictors.kriging.repeats import Points

KERNELS: Final[dict[str, tuple[Callable[[FloatArray], FloatArray], int]]] = {
    "linear": (lambda r: -r, 0),
    "thin_plate_spline": (lambda r: r**2 * np.log(np.where(r > 0, r, 1.0)), 1),
    "cubic": (lambda r: r**3, 1),
    "quintic": (lambda r: -(r**5), 2),
}
"""Kernels that have no length, with the degree of the polynomial that each needs."""


class RadialBasis(Interpolator):
    """Polyharmonic splines: radial basis functions with a polynomial.

    The leave-one-out residuals are closed form from one inverse. Source: S. Rippa, "An algorithm for selecting a good
    value for the parameter c in radial basis function interpolation", Advances in Computational Mathematics 11 (1999).

    Parameters
    ----------
    kernel : {"linear", "thin_plate_spline", "cubic", "quintic"}
        As of scipy; "linear" is the biharmonic spline of three coordinates.
    smoothing : float
        0 passes through the samples (means of repeats); more smooths.

    Examples
    --------
    >>> RadialBasis("cubic").fit([[0.0], [1.0], [2.0]], [0.0, 1.0, 2.0]).predict([[1.5]]).round(6)
    array([1.5])
    """

    def __init__(self, kernel: str = "linear", smoothing: float = 0.0) -> None:
        self.kernel = kernel
        self.smoothing = smoothing

    def _prepare(self) -> None:
        if self.kernel not in KERNELS:
            raise DataError(f"RadialBasis: kernel is {self.kernel!r}; expected {', '.join(KERNELS)}")
        if not (np.isfinite(self.smoothing) and self.smoothing >= 0):
            raise DataError(f"RadialBasis: smoothing is {self.smoothing}; expected a number of 0 or more")
        kernel: Any = self.kernel
        self._points = Points.of(self._x)
        self._mean_e, _ = self._points.average(self._e, np.ones_like(self._e))
        try:
            self._spline = RBFInterpolator(
                self._points.x, self._mean_e, kernel=kernel, smoothing=self.smoothing, degree=self._degree
            )
        except (np.linalg.LinAlgError, ValueError) as error:
            raise KrigingError(
                f"{len(self._points.x)} points cannot bear the {self.kernel} spline in {self._x.shape[1]} coordinates "
                f"({' '.join(str(error).split())}); measure more, or use kernel='linear'"
            ) from None

    @property
    def _degree(self) -> int:
        return KERNELS[self.kernel][1]

    def _interpolate(self, X: FloatArray, leave_out: bool = False) -> FloatArray:
        return np.asarray(self._spline(X))

    def _left_out(self) -> FloatArray:
        x = self._points.x
        n, d = x.shape
        z = (x - x.mean(axis=0)) / max(float(np.ptp(x)), np.finfo(float).tiny)
        monomials = [
            np.prod(z[:, list(c)], axis=1) for k in range(self._degree + 1)
            for c in combinations_with_replacement(range(d), k)
        ]  # fmt: skip
        polynomial = np.column_stack(monomials)
        p = polynomial.shape[1]
        if n <= p:
            return np.asarray(self._e - self._mean_e.mean(axis=0))
        system = np.zeros((n + p, n + p))
        system[:n, :n] = KERNELS[self.kernel][0](cdist(x, x)) + self.smoothing * np.eye(n)
        size = np.abs(system).max()
        system[:n, n:] = size * polynomial
        system[n:, :n] = size * polynomial.T
        inverse = np.linalg.inv(system)[:n, :n]
        residual = inverse @ self._mean_e / inverse.diagonal()[:, None]
        others = self._mean_e - residual
        return np.asarray(self._e - others[self._points.inverse])
