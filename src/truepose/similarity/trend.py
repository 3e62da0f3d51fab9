"""Trend: a drift over the coordinates, and the errors that are left when it is taken off (theory, similarity)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.similarity.experimental import check_points


@dataclass(frozen=True, eq=False)
class Trend:
    """A drift fitted by least squares; n samples, c components, p columns.

    Attributes
    ----------
    residual : (n, c) array [mm]
        Errors less the drift. Their semivariogram is too low at long lags, since the drift fits part of the
        correlated field too (N. Cressie, Statistics for Spatial Data, 1993, §3.4.3).
    coefficients : (p, c) array
        Of the columns.
    explained : float
        Share of the errors' variance about their mean that the drift takes away, all components together.
    adjusted : float
        The same less what p columns take away from noise by chance: 1 − (1 − R²)(n − 1)/(n − p); may be negative.
    rank : int
        Columns that can be told apart; below p, some are combinations of others.
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
    drift : {"constant", "linear", "quadratic"} or (n, p) array_like
        Polynomials of x, or columns of your own.

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
        raise DataError(f"{n} samples cannot bear a drift of {p} columns; use a simpler drift, or measure more points")
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
        raise DataError(f"drift {drift!r} is not known; use constant, linear, quadratic, or columns of your own")
    columns = [np.ones((len(x), 1))]
    half = np.ptp(x, axis=0) / 2
    u = (x - x.min(axis=0)) / np.where(half > 0, half, 1.0) - 1
    if drift != "constant":
        columns.append(u)
    if drift == "quadratic":
        i, j = np.triu_indices(x.shape[1])
        columns.append(u[:, i] * u[:, j])
    return np.hstack(columns)
