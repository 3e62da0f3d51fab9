"""Compare accuracy before and after, with bootstrap intervals, and check predicted standard deviations."""

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
    e : (n, 3) or (n,) array [mm]
        The positional errors, or one component of them.

    Returns
    -------
    dict
        ``n``, ``mean_mm``, ``rms_mm``, ``std_mm`` (n − 1 in the denominator), ``p95_mm``, ``max_mm`` of the lengths.

    Raises
    ------
    DataError
        If the array is empty or not finite.

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


@dataclass(frozen=True, repr=False)
class Accuracy:
    """The accuracy of the same poses before and after; the result of `accuracy`.

    Attributes
    ----------
    before, after : dict
        The figures of the errors, see `summary`.
    axes : dict
        The same figures of each component ``x``, ``y``, ``z``, under ``before`` and ``after``.
    reduction_mean_percent, reduction_max_percent : float
        The reductions 100 (1 − after / before) of the mean and of the maximum.
    intervals : dict
        The 95 % bootstrap intervals of ``after_mean_mm``, ``after_max_mm``, ``reduction_mean_percent`` and
        ``reduction_max_percent``; each pose is resampled with its errors before and after. The interval of a maximum
        is too narrow, because the bootstrap has no pose worse than the measured ones.
    """

    before: dict[str, float]
    after: dict[str, float]
    axes: dict[str, dict[str, dict[str, float]]]
    reduction_mean_percent: float
    reduction_max_percent: float
    intervals: dict[str, tuple[float, float]]

    def __repr__(self) -> str:
        lines = [
            f"Accuracy of {self.before['n']} poses [mm]",
            f"{'before':>15} {'after':>8}  reduction (95 % interval)",
        ]
        for name in ("mean", "rms", "p95", "max"):
            row = f"  {name:4} {self.before[f'{name}_mm']:8.3f} {self.after[f'{name}_mm']:8.3f}"
            if name in ("mean", "max"):
                low, high = self.intervals[f"reduction_{name}_percent"]
                row += f"  {getattr(self, f'reduction_{name}_percent'):.1f} % ({low:.1f} to {high:.1f})"
            lines.append(row)
        return "\n".join(lines)

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
        The positional errors of the same held-out poses, in the same order.
    rng : Generator or int
        The random generator of the bootstrap, or its seed.

    Returns
    -------
    Accuracy

    Raises
    ------
    DataError
        If the shapes differ, an error is not finite, or there is none.

    Examples
    --------
    >>> accuracy([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]], [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]])
    Accuracy of 2 poses [mm]
             before    after  reduction (95 % interval)
      mean    1.500    0.150  90.0 % (90.0 to 90.0)
      rms     1.581    0.158
      p95     1.950    0.195
      max     2.000    0.200  90.0 % (90.0 to 90.0)
    """
    e_before, e_after = np.asarray(before, float), np.asarray(after, float)
    if e_before.shape != e_after.shape or e_before.ndim != 2:
        raise DataError(
            f"before has shape {e_before.shape}, after {e_after.shape}; expected (n, 3) errors of the same poses"
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
class IntervalCoverage:
    """The agreement of predicted standard deviations with held-out errors, over components; see `coverage`.

    Attributes
    ----------
    within_68, within_95 : float
        The share of components inside ±0.994 and ±1.960 standard deviations; ideally 0.68 and 0.95.
    standardised_rms : float
        The RMS of residual / std; ideally 1. Above 1 the predicted standard deviations are too small.
    standardised_mean : tuple of 3 float
        The mean of residual / std in each direction; ideally 0. Otherwise the predictions are biased.
    """

    within_68: float
    within_95: float
    standardised_rms: float
    standardised_mean: tuple[float, ...] = ()


def coverage(residual: ArrayLike, std: ArrayLike) -> IntervalCoverage:
    """Return the share of residuals inside their predicted intervals.

    Parameters
    ----------
    residual, std : (n, 3) arrays [mm]
        The held-out residuals and their predicted standard deviations, measurement noise included.

    Raises
    ------
    DataError
        If the shapes differ, or a standard deviation is not positive.

    Examples
    --------
    >>> round(coverage(np.random.default_rng(0).normal(size=(1000, 3)), np.ones((1000, 3))).within_95, 2)
    0.95
    """
    left, predicted = np.asarray(residual, float), np.asarray(std, float)
    if left.shape != predicted.shape or left.ndim != 2:
        raise DataError(f"residuals have shape {left.shape}, their std {predicted.shape}; expected (n, 3) for both")
    bad = np.flatnonzero(~(predicted > 0.0).all(axis=1))
    if len(bad):
        raise DataError(f"std of pose {bad[0]} is {predicted[bad[0]]}; expected positive numbers, noise included")
    z = left / predicted
    return IntervalCoverage(
        within_68=float(np.mean(np.abs(z) < 0.99446)),
        within_95=float(np.mean(np.abs(z) < 1.95996)),
        standardised_rms=float(np.sqrt(np.mean(z**2))),
        standardised_mean=tuple(z.mean(axis=0).tolist()),
    )


def mean_noise(covariance: ArrayLike) -> FloatArray:
    """Return the mean length of normal noise, which is the lower limit of any predictor's mean residual.

    With eigenvalues λ of the covariance it is 2 √(2/π) R_G(λ1, λ2, λ3), Carlson's integral: the mean of √(uᵀΣu) over
    directions u is R_G (DLMF 19.16.3, 19.23.7), and E|uᵀx| = √(2/π) √(uᵀΣu) is half of E‖x‖ when averaged over them.

    Parameters
    ----------
    covariance : (n, 3, 3) array [mm²]
        The covariances of repeatability and reading noise together.

    Returns
    -------
    (n,) array [mm]
        The mean lengths.

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
        raise DataError(f"expected errors of shape (n, 3) with n > 0, got {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise DataError(
            f"error {bad[0]} is not finite ({len(bad)} in all); remove these poses before computing accuracy"
        )
    return np.asarray(np.linalg.norm(array, axis=1))


def _reduction(before_after: FloatArray) -> FloatArray:
    """Return the reduction in percent; rows are before and after. It is 0 where before is 0."""
    before, after = before_after
    return np.asarray(100.0 * (1.0 - np.divide(after, before, out=np.ones_like(before), where=before > 0)))
