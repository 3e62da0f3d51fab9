"""Accuracy before and after, with bootstrap intervals, and whether the predicted standard deviation tells the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import elliprg

from truepose._typing import FloatArray
from truepose.errors import DataError

_BOOTSTRAPS: Final = 2000
_ROUNDING: Final = 1e-12


def summary(e: ArrayLike) -> dict[str, float]:
    """Summarise positional errors by the length of each.

    Parameters
    ----------
    e : (n, 3) array [mm]
        Positional errors; or (n,), one component.

    Returns
    -------
    dict
        ``n``, ``mean_mm``, ``rms_mm``, ``std_mm`` (n − 1 in the denominator), ``p95_mm``, ``max_mm`` of the lengths.

    Raises
    ------
    DataError
        If there is no error, or one is not finite.

    Examples
    --------
    >>> summary([[3.0, 4.0, 0.0], [0.0, 0.0, 1.0]])["mean_mm"]
    3.0
    """
    length = _lengths(e)
    return {
        "n": len(length),
        "mean_mm": float(length.mean()),
        "rms_mm": float(np.sqrt(np.mean(length**2))),
        "std_mm": float(length.std(ddof=1)) if len(length) > 1 else 0.0,
        "p95_mm": float(np.percentile(length, 95)),
        "max_mm": float(length.max()),
    }


@dataclass(frozen=True)
class Accuracy:
    """Held-out accuracy before and after (theory, verification); see `accuracy`.

    Attributes
    ----------
    before, after : dict
        As `summary` gives them.
    axes : dict
        ``x``, ``y``, ``z``, each with ``before`` and ``after``.
    reduction_mean_percent, reduction_max_percent : float
        100 (1 − after / before).
    intervals : dict
        95 % bootstrap interval of ``after_mean_mm``, ``after_max_mm``, ``reduction_mean_percent``,
        ``reduction_max_percent``; poses are resampled in pairs of before and after. The bootstrap of a maximum is
        too narrow: it knows no pose worse than those measured.
    """

    before: dict[str, float]
    after: dict[str, float]
    axes: dict[str, dict[str, dict[str, float]]]
    reduction_mean_percent: float
    reduction_max_percent: float
    intervals: dict[str, tuple[float, float]]

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain numbers, for JSON."""
        return {
            "before": self.before,
            "after": self.after,
            "axes": self.axes,
            "reduction_mean_percent": self.reduction_mean_percent,
            "reduction_max_percent": self.reduction_max_percent,
            "intervals_95": {name: list(interval) for name, interval in self.intervals.items()},
        }


def accuracy(before: ArrayLike, after: ArrayLike, *, rng: np.random.Generator | int = 0) -> Accuracy:
    """Compare the errors of the same poses before and after.

    Parameters
    ----------
    before, after : (n, 3) arrays [mm], base frame
        Positional errors of the same held-out poses, in the same order.
    rng : Generator or int
        For the bootstrap.

    Raises
    ------
    DataError
        If the shapes differ, an error is not finite, or there is none.

    Examples
    --------
    >>> accuracy([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]], [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]]).reduction_max_percent
    90.0
    """
    e_before, e_after = np.asarray(before, float), np.asarray(after, float)
    if e_before.shape != e_after.shape or e_before.ndim != 2:
        raise DataError(
            f"before has shape {e_before.shape}, after {e_after.shape}; both must be (n, 3) errors of the same poses"
        )
    length = np.stack([_lengths(e_before), _lengths(e_after)])
    n = length.shape[1]
    draw = np.random.default_rng(rng).integers(0, n, size=(_BOOTSTRAPS, n))
    mean, largest = length[:, draw].mean(axis=2), length[:, draw].max(axis=2)
    intervals = {
        "after_mean_mm": mean[1],
        "after_max_mm": largest[1],
        "reduction_mean_percent": _reduction(mean),
        "reduction_max_percent": _reduction(largest),
    }
    return Accuracy(
        before=summary(e_before),
        after=summary(e_after),
        axes={
            axis: {"before": summary(e_before[:, k]), "after": summary(e_after[:, k])}
            for k, axis in enumerate("xyz"[: e_before.shape[1]])
        },
        reduction_mean_percent=float(_reduction(length.mean(axis=1))),
        reduction_max_percent=float(_reduction(length.max(axis=1))),
        intervals={name: tuple(np.percentile(values, [2.5, 97.5]).tolist()) for name, values in intervals.items()},
    )


@dataclass(frozen=True)
class Coverage:
    """How honest a predicted standard deviation is, over components of held-out errors.

    Attributes
    ----------
    within_68, within_95 : float
        Share of components inside ±0.994 and ±1.960 standard deviations; 0.68 and 0.95 are right.
    standardised_rms : float
        RMS of residual / std; 1 is right, above 1 the predictor is too sure.
    standardised_mean : tuple of 3 float
        Mean of residual / std in each direction; 0 is right, otherwise all errors go one way.
    """

    within_68: float
    within_95: float
    standardised_rms: float
    standardised_mean: tuple[float, ...] = ()


def coverage(residual: ArrayLike, std: ArrayLike) -> Coverage:
    """Return how often residuals lie inside their predicted intervals.

    Parameters
    ----------
    residual, std : (n, 3) arrays [mm]
        Held-out residuals and the standard deviation predicted for them, measurement noise included.

    Raises
    ------
    DataError
        If the shapes differ, or a standard deviation is not positive.
    """
    left, predicted = np.asarray(residual, float), np.asarray(std, float)
    if left.shape != predicted.shape or left.ndim != 2:
        raise DataError(f"residuals have shape {left.shape}, their std {predicted.shape}; both must be (n, 3)")
    bad = np.flatnonzero(~(predicted > 0.0).all(axis=1))
    if len(bad):
        raise DataError(f"std of pose {bad[0]} is {predicted[bad[0]]}; expected positive numbers, noise included")
    z = left / predicted
    return Coverage(
        within_68=float(np.mean(np.abs(z) < 0.99446)),
        within_95=float(np.mean(np.abs(z) < 1.95996)),
        standardised_rms=float(np.sqrt(np.mean(z**2))),
        standardised_mean=tuple(z.mean(axis=0).tolist()),
    )


def mean_noise(covariance: ArrayLike) -> FloatArray:
    """Return the mean length of normal noise: the least that any predictor leaves of readings with that noise.

    With eigenvalues λ of the covariance it is 2 √(2/π) R_G(λ1, λ2, λ3), Carlson's integral: the mean of √(uᵀΣu) over
    directions u is R_G (DLMF 19.16.3, 19.23.7), and E|uᵀx| = √(2/π) √(uᵀΣu) is half of E‖x‖ when averaged over them.

    Parameters
    ----------
    covariance : (n, 3, 3) array [mm²]
        Repeatability and reading noise together.

    Returns
    -------
    (n,) array [mm]

    Raises
    ------
    DataError
        If a matrix is not 3 by 3, finite, and without negative eigenvalues.

    Examples
    --------
    >>> mean_noise([np.eye(3)]).round(3)
    array([1.596])
    """
    matrices = np.asarray(covariance, float)
    if matrices.ndim != 3 or matrices.shape[1:] != (3, 3) or not np.isfinite(matrices).all():
        raise DataError(f"covariance has shape {matrices.shape}; expected finite matrices (n, 3, 3)")
    eigenvalues = np.linalg.eigvalsh(matrices)
    if (eigenvalues < -_ROUNDING * np.abs(eigenvalues).max(axis=1, keepdims=True)).any():
        raise DataError("a covariance has a negative eigenvalue; expected a positive semidefinite matrix")
    eigenvalues = np.maximum(eigenvalues, 0.0)
    return np.asarray(2.0 * np.sqrt(2.0 / np.pi) * elliprg(*eigenvalues.T))


def _lengths(e: ArrayLike) -> FloatArray:
    array = np.asarray(e, float)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or len(array) == 0:
        raise DataError(f"errors of shape {array.shape} came, (n, 3) with n > 0 was expected")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise DataError(
            f"error {bad[0]} is not finite ({len(bad)} in all): remove these poses before computing accuracy"
        )
    return np.asarray(np.linalg.norm(array, axis=1))


def _reduction(before_after: FloatArray) -> FloatArray:
    """Percent reduction; rows are before and after. Nothing to reduce counts as 0."""
    before, after = before_after
    return np.asarray(100.0 * (1.0 - np.divide(after, before, out=np.ones_like(before), where=before > 0)))
