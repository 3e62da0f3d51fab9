"""Drifts over the coordinates: their functions, and the residuals of a drift fitted by least squares (theory)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError, KrigingError
from truepose.similarity.experimental import check_points


@dataclass(frozen=True, eq=False)
class Trend:
    """A drift fitted by least squares; n samples, c components, p columns.

    Attributes
    ----------
    residual : (n, c) array [mm]
        The errors less the drift. Their semivariogram is too low at long lags, since the drift fits part of the
        correlated field too (N. Cressie, Statistics for Spatial Data, 1993, §3.4.3).
    coefficients : (p, c) array
        The coefficients of the columns.
    explained : float
        The share of the errors' variance about their mean that the drift explains, over all components.
    adjusted : float
        The same, corrected for the noise that p columns fit by chance: 1 − (1 − R²)(n − 1)/(n − p); may be negative.
    rank : int
        The number of independent columns; below p, some are combinations of others.
    """

    residual: FloatArray
    coefficients: FloatArray
    explained: float
    adjusted: float
    rank: int


def remove_drift(x: ArrayLike, e: ArrayLike, drift: str | ArrayLike = "linear") -> Trend:
    """Fit a drift to errors by least squares and take it off.

    Parameters
    ----------
    x : (n, d) array_like
        Positions [mm] or joints [rad].
    e : (n, c) or (n,) array_like [mm]
        The errors.
    drift : {"constant", "linear", "quadratic"} or (n, p) array_like
        The drift: polynomials of x, or columns of your own.

    Raises
    ------
    DataError
        If shapes disagree, or there are no more samples than columns.

    Examples
    --------
    >>> x = np.arange(6.0)[:, None]
    >>> remove_drift(x, 2 * x + 1).explained
    1.0
    """
    points, errors = check_points(x, e)
    columns = polynomial(points, drift) if isinstance(drift, str) else np.asarray(drift, dtype=np.float64)
    if columns.ndim != 2 or len(columns) != len(points) or not np.isfinite(columns).all():
        raise DataError(
            f"drift has shape {columns.shape}; expected ({len(points)}, p) finite numbers, one row a sample"
        )
    n, p = columns.shape
    if n <= p:
        raise DataError(
            f"{n} samples do not determine a drift of {p} columns; use a simpler drift, or measure more points"
        )
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    beta, _, rank, _ = np.linalg.lstsq(columns / size, errors, rcond=1e-10)
    residual = errors - columns / size @ beta
    about_mean = float(((errors - errors.mean(axis=0)) ** 2).sum())
    left = float((residual**2).sum()) / about_mean if about_mean > 0 else 1.0
    adjusted = 1 - left * (n - 1) / (n - int(rank))
    return Trend(residual, beta / size[:, None], 1 - left, adjusted, int(rank))


def polynomial(x: FloatArray, drift: str) -> FloatArray:
    """Return the columns of a polynomial of x (n, d), in coordinates scaled to −1 … 1."""
    if drift not in ("constant", "linear", "quadratic"):
        raise DataError(f"drift is {drift!r}; expected constant, linear, quadratic, or columns of your own")
    return DriftBasis.polynomial(DEGREES[drift], x)(x)


DriftLike = str | int | Sequence[int] | Callable[[FloatArray], FloatArray]

DEGREES: Final = {"constant": 0, "linear": 1, "quadratic": 2, "cubic": 3}
STEP: Final = 6e-6
"""Step of central differences, in units of the spread of the samples: the cube root of the rounding error."""


@dataclass(frozen=True, eq=False)
class DriftBasis:
    """The functions of X whose combination is the drift F beta of universal Kriging (8); always with the constant.

    Attributes
    ----------
    centre, spread : (d,) arrays
        The shift and scale of the coordinates: polynomials are of (x − centre)/spread, so that columns have one size.
    monomials : tuple of tuple of int
        The coordinates whose product is each polynomial column; the first is empty, the constant.
    columns : (c,) array of int
        The columns of X that are columns of the drift and not coordinates.
    function : callable, optional
        A function of X (m, d) that returns further columns (m, p).
    """

    centre: FloatArray
    spread: FloatArray
    monomials: tuple[tuple[int, ...], ...]
    columns: IntArray
    function: Callable[[FloatArray], FloatArray] | None = None

    @classmethod
    def of(cls, drift: DriftLike, x: FloatArray) -> Self:
        """Return the basis of a drift as a user states it, for samples at x (n, d).

        Raises
        ------
        KrigingError
            If the drift is not a name, a degree, columns of X, or a function.
        """
        d = x.shape[1]
        degree, columns, function = 0, np.empty(0, np.int64), None
        if callable(drift):
            function = drift
        elif isinstance(drift, str | int):
            degree = DEGREES.get(drift, -1) if isinstance(drift, str) else drift
            if not 0 <= degree <= 3:
                raise KrigingError(
                    f"drift is {drift!r}; expected {', '.join(DEGREES)}, a degree from 0 to 3, columns of X, or a "
                    "function"
                )
        else:
            columns = np.asarray(drift)
            if columns.dtype.kind not in "iu" or columns.ndim != 1 or not set(columns.tolist()) < set(range(d)):
                raise KrigingError(f"drift is {drift!r}; expected columns of X below {d}, but not all of them")
        if degree == 0 and not columns.size and function is None:  # the constant alone has no scale
            return cls(np.zeros(d), np.ones(d), ((),), columns)
        return cls(x.mean(axis=0), _half_extent(x), _monomials(degree, d), columns, function)

    @classmethod
    def polynomial(cls, degree: int, x: FloatArray) -> Self:
        """Return the polynomials up to a degree, in coordinates scaled to −1 … 1 at points x (n, d)."""
        half = np.ptp(x, axis=0) / 2
        return cls(x.min(axis=0) + half, _half_extent(x), _monomials(degree, x.shape[1]), np.empty(0, np.int64))

    @property
    def _is_constant(self) -> bool:
        return len(self.monomials) == 1 and not self.columns.size and self.function is None

    def coordinates(self, x: FloatArray) -> FloatArray:
        """Return the columns of X that are coordinates."""
        return np.ascontiguousarray(np.delete(x, self.columns, axis=1)) if self.columns.size else x

    def __call__(self, x: FloatArray) -> FloatArray:
        """Return the columns of the drift at x (m, d), (m, p)."""
        if self._is_constant:
            return np.ones((len(x), 1))
        z = (x - self.centre) / self.spread
        parts = [_product(z, c) for c in self.monomials] + [z[:, [c]] for c in self.columns]
        return np.hstack(parts if self.function is None else [*parts, self._called(x)])

    def gradient(self, x: FloatArray) -> FloatArray:
        """Return the derivative of the columns by X, (m, p, d); that of a function by central differences."""
        z = (x - self.centre) / self.spread
        slopes = []
        for a, spread in enumerate(self.spread):
            parts = [_product(z, c, without=a) * (c.count(a) / spread) for c in self.monomials]
            parts += [np.full((len(x), 1), float(c == a) / spread) for c in self.columns]
            if self.function is not None:
                step = np.zeros(x.shape[1])
                step[a] = STEP * spread
                parts.append((self._called(x + step) - self._called(x - step)) / (2 * step[a]))
            slopes.append(np.hstack(parts))
        return np.stack(slopes, axis=2)

    def _called(self, x: FloatArray) -> FloatArray:
        assert self.function is not None
        columns = np.asarray(self.function(x), dtype=np.float64)
        columns = columns[:, None] if columns.ndim == 1 else columns
        if columns.ndim != 2 or len(columns) != len(x) or not np.isfinite(columns).all():
            raise KrigingError(
                f"the drift function returned shape {columns.shape} for {len(x)} points; expected ({len(x)}, p), "
                "finite, without a column of ones"
            )
        return columns


def _half_extent(x: FloatArray) -> FloatArray:
    half = np.ptp(x, axis=0) / 2
    return np.where(half > 0, half, 1.0)


def _monomials(degree: int, d: int) -> tuple[tuple[int, ...], ...]:
    return tuple(c for k in range(degree + 1) for c in combinations_with_replacement(range(d), k))


def _product(z: FloatArray, coordinates: tuple[int, ...], without: int | None = None) -> FloatArray:
    """Return the product of columns of z as one column; one factor less where its derivative is wanted."""
    left = list(coordinates)
    if without in left:
        left.remove(without)
    product: FloatArray = np.prod(z[:, left], axis=1, keepdims=True)
    return product
