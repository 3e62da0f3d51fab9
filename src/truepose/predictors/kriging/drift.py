"""The drift F beta of universal Kriging (8): polynomials of the coordinates, columns of X, or any function of X."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Final, Self

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.errors import KrigingError

DriftLike = str | int | Sequence[int] | Callable[[FloatArray], FloatArray]

DEGREES: Final = {"constant": 0, "linear": 1, "quadratic": 2, "cubic": 3}
STEP: Final = 6e-6
"""Step of central differences, in units of the spread of the samples: the cube root of the rounding error."""


@dataclass(frozen=True, eq=False)
class Drift:
    """A basis of functions of X, always with the constant.

    Attributes
    ----------
    centre, spread : (d,) arrays
        Polynomials are of (x − centre)/spread, so that their columns are of one size.
    monomials : tuple of tuple of int
        Coordinates whose product is each polynomial column; the first is empty, the constant.
    columns : (c,) array of int
        Columns of X that are columns of the drift and no coordinates.
    function : callable, optional
        X (m, d) to further columns (m, p).
    """

    centre: FloatArray
    spread: FloatArray
    monomials: tuple[tuple[int, ...], ...]
    columns: IntArray
    function: Callable[[FloatArray], FloatArray] | None = None

    @classmethod
    def of(cls, drift: DriftLike, x: FloatArray) -> Self:
        """Understand what the user gave, for samples at x (n, d).

        Raises
        ------
        KrigingError
            If it is nothing of the kind.
        """
        d = x.shape[1]
        columns = np.empty(0, np.int64)
        degree, function = 0, None
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
        spread = np.ptp(x, axis=0) / 2
        monomials = tuple(c for k in range(degree + 1) for c in combinations_with_replacement(range(d), k))
        return cls(x.mean(axis=0), np.where(spread > 0, spread, 1.0), monomials, columns, function)

    def coordinates(self, x: FloatArray) -> FloatArray:
        """Return the columns of X that are coordinates."""
        return np.ascontiguousarray(np.delete(x, self.columns, axis=1)) if self.columns.size else x

    def __call__(self, x: FloatArray) -> FloatArray:
        """Return the columns of the drift at x (m, d), (m, p)."""
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


def _product(z: FloatArray, coordinates: tuple[int, ...], without: int | None = None) -> FloatArray:
    """Return the product of columns of z as one column; one factor less where its derivative is wanted."""
    left = list(coordinates)
    if without in left:
        left.remove(without)
    product: FloatArray = np.prod(z[:, left], axis=1, keepdims=True)
    return product
