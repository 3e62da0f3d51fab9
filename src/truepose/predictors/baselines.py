"""Baselines: interpolators of theory (12), and no error model at all."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from itertools import combinations_with_replacement
from typing import Any, Final

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from truepose._typing import FloatArray
from truepose.errors import DataError, KrigingError
from truepose.predictors.base import LeaveOneOut, Predictor
from truepose.predictors.repeats import Points

CHUNK: Final = 2**20
"""Distances in memory at once."""

KERNELS: Final[dict[str, tuple[Callable[[FloatArray], FloatArray], int]]] = {
    "linear": (lambda r: -r, 0),
    "thin_plate_spline": (lambda r: r**2 * np.log(np.where(r > 0, r, 1.0)), 1),
    "cubic": (lambda r: r**3, 1),
    "quintic": (lambda r: -(r**5), 2),
}
"""Kernels that have no length, with the degree of the polynomial that each needs."""


class Interpolator(Predictor):
    """Base of interpolators that have no model of noise.

    The standard deviation is the same everywhere: the root mean square of the leave-one-out residuals. If `noise_std`
    is given, its mean square is subtracted; the predictions do not use it.

    Attributes
    ----------
    std_ : (k,) array [mm]
        The root mean square of the leave-one-out residuals.
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
        return np.zeros_like(self.std_)  # all of the residual is attributed to the error

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
        """Return the errors at X, (m, k); with `leave_out` from the samples that are not at the target."""


class InverseDistance(Interpolator):
    """Weighted mean of the samples' errors with weights h^-power, theory (12).

    It passes through the samples. Its standard deviation is the same everywhere: the root mean square of its
    leave-one-out residuals, with `noise_std` subtracted where it is given.

    Parameters
    ----------
    power : float
        The exponent of the distance, above 0.
    neighbours : int, optional
        The number of nearest samples used for each target; all when not given.

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

    The corner in each direction is the nearest sample of that orthant about the target. On a grid of samples these are
    the corners of the cell, but no grid is needed. Outside the samples only the orthants with samples are used. As with
    all cell methods, the prediction jumps where the cell changes.

    Parameters
    ----------
    power : float
        The exponent of the distance, above 0.

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
            raise DataError(f"GridCell: expected at most 62 coordinates, got {self._x.shape[1]}")

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


class RadialBasis(Interpolator):
    """Polyharmonic splines: radial basis functions with a polynomial.

    The leave-one-out residuals are closed form from one inverse. Source: S. Rippa, "An algorithm for selecting a good
    value for the parameter c in radial basis function interpolation", Advances in Computational Mathematics 11 (1999).

    Parameters
    ----------
    kernel : {"linear", "thin_plate_spline", "cubic", "quintic"}
        The kernel, as of scipy; "linear" is the biharmonic spline of three coordinates.
    smoothing : float
        The smoothing; at 0 the prediction passes through the samples (means of repeats).

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
        from scipy.interpolate import RBFInterpolator

        kernel: Any = self.kernel
        self._points = Points.of(self._x)
        self._mean_e, _ = self._points.average(self._e, np.ones_like(self._e))
        try:
            self._spline = RBFInterpolator(
                self._points.x, self._mean_e, kernel=kernel, smoothing=self.smoothing, degree=self._degree
            )
        except (np.linalg.LinAlgError, ValueError) as error:
            raise KrigingError(
                f"{len(self._points.x)} points do not determine the {self.kernel} spline in "
                f"{self._x.shape[1]} coordinates ({' '.join(str(error).split())}); measure more, or use kernel='linear'"
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


class RegistrationOnly(Predictor):
    """Predict no error anywhere; the standard deviation is the root mean square of the samples' errors.

    Examples
    --------
    >>> model = RegistrationOnly().fit([[0.0], [1.0]], [3.0, 4.0])
    >>> model.predict([[5.0]])
    array([0.])
    """

    has_local_std = False
    takes_reflectors = True

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

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True
        return tags
