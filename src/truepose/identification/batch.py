"""Parameter identification in one batch, theory (11): iterated linear least squares, Levenberg–Marquardt.

The changes x minimise Σ r_iᵀ C_i⁻¹ r_i + Σ (x_k / s_k)², with C_i the reading's covariance plus misfit² and s_k the
tolerance of each parameter. The misfit is the standard deviation that the model leaves unexplained; it is estimated
with x so that the weighted squares equal their degrees of freedom. Without tolerances a minimal subset of parameters is
fitted, and the others are kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.optimize import brentq
from scipy.optimize import least_squares as scipy_least_squares

from truepose._typing import BoolArray, FloatArray
from truepose.errors import DataError, IdentifiabilityError
from truepose.identification.arm import ParametricArm
from truepose.identification.observability import observability
from truepose.identification.observations import Observations

Loss = Literal["linear", "huber", "soft_l1", "cauchy"]
LOSSES: Final = ("linear", "huber", "soft_l1", "cauchy")

_STEPS: Final = 50
_ROUNDS: Final = 20  # of the misfit's estimate
_SETTLED: Final = 1e-6  # change of x in tolerances, and relative change of the misfit
_FLOOR: Final = 1e-6  # mm and rad: smallest misfit
_DIGITS: Final = 1e-14  # of a system with tolerances, which has full rank by them
_RANK: Final = 1e-8  # singular values of scaled columns, relative
_DETERMINED: Final = 0.1  # one over standard deviation, in tolerances
_FIRST: Final = 100.0  # weight with which base and tool are preferred in a minimal subset


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """Identified changes and their uncertainty.

    Attributes
    ----------
    x : (p,) array
        The changes from the nominal values; zero for parameters that were kept.
    covariance : (p, p) array
        The covariance of the changes.
    free : (p,) bool array
        Whether each parameter was fitted.
    misfit : (kinds,) array [mm] or [mm], [rad]
        The standard deviation left unexplained by model and readings' covariance.
    residual : (n, k) array
        The measured minus the predicted numbers.
    jacobian : (n, k, p) array
        The derivative of the prediction by x.
    whitener : (n, k, k) array
        The inverse Cholesky factors of C_i, times the square root of the robust weight.
    """

    x: FloatArray
    covariance: FloatArray
    free: BoolArray
    misfit: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    whitener: FloatArray

    def __repr__(self) -> str:
        misfit = ", ".join(f"{value:.4g} {unit}" for value, unit in zip(self.misfit, ("mm", "rad"), strict=False))
        fitted = f"{self.free.sum()} of {len(self.x)} parameters from {len(self.residual)} readings"
        return f"<Identification: {fitted}; misfit {misfit}>"


def least_squares(
    arm: ParametricArm,
    data: Observations,
    tolerance: FloatArray | None = None,
    *,
    free: BoolArray | None = None,
    misfit: FloatArray | None = None,
) -> Identification:
    """Identify by iterated linear least squares (Gauss-Newton).

    Parameters
    ----------
    arm : ParametricArm
        The arm and its parameters.
    data : Observations
        The readings.
    tolerance : (p,) array, optional
        The standard deviations of the prior; no prior when not given.
    free : (p,) bool array, optional
        Whether each parameter is fitted; all when not given. Without tolerances they must be identifiable, as those of
        `minimal_subset`.
    misfit : (kinds,) array, optional
        The known misfit; estimated when not given.

    Raises
    ------
    IdentifiabilityError
        If the data cannot separate the free parameters and there are no tolerances, or the steps do not converge.
    """
    free = np.ones(len(arm.parameters), np.bool_) if free is None else free
    x, level = np.zeros(len(free)), _start(arm, data, misfit)
    for _ in range(_STEPS):
        residual, columns = data.residual(arm, x), data.jacobian(arm, x)
        white = whiteners(data, level)
        scale, rows, right = _system(white, residual, columns, x, tolerance, free)
        step = _solved(rows, right, arm, free, tolerance)
        x[free] += scale * step
        before = level
        if misfit is None:
            left = residual - columns[:, :, free] @ (scale * step)
            level = estimate_misfit(data, left, _leverage(rows, len(data), len(data.kind)))
        if np.abs(step).max() < _SETTLED and (np.abs(level - before) <= _SETTLED * before + _FLOOR**2).all():
            return finish(arm, data, x, level, tolerance, free=free)
    raise IdentifiabilityError(
        f"identification did not converge in {_STEPS} steps (last step {np.abs(step).max():.1e}); "
        'use method="lm", or check the readings for outliers'
    )


def levenberg_marquardt(
    arm: ParametricArm,
    data: Observations,
    tolerance: FloatArray | None = None,
    *,
    free: BoolArray | None = None,
    misfit: FloatArray | None = None,
    loss: Loss = "linear",
) -> Identification:
    """Identify by damped steps (scipy's trust region), with an optional robust loss of the whitened residuals.

    The parameters are those of `least_squares`. The loss is one of scipy's ("huber", "soft_l1", "cauchy") and does not
    apply to the tolerances. With a robust loss the misfit is estimated from the median.
    """
    if loss not in LOSSES:
        raise DataError(f'unknown loss "{loss}"; expected one of {", ".join(LOSSES)}')
    free = np.ones(len(arm.parameters), np.bool_) if free is None else free
    x, level = np.zeros(len(free)), _start(arm, data, misfit)
    settled = 1e-7 if loss == "linear" else 1e-3  # a median changes in jumps
    for _ in range(_ROUNDS):
        x = _damped(arm, data, x, whiteners(data, level), tolerance, free, loss)
        found = finish(arm, data, x, level, tolerance, free=free, loss=loss)
        if misfit is not None:
            return found
        before = level
        if loss == "linear":
            _, rows, _ = _system(found.whitener, found.residual, found.jacobian, x, tolerance, free)
            level = estimate_misfit(data, found.residual, _leverage(rows, len(data), len(data.kind)))
        else:
            level = _robust_misfit(data, found.residual, int(free.sum()))
        if (np.abs(level - before) <= settled * before + _FLOOR**2).all():
            return finish(arm, data, x, level, tolerance, free=free, loss=loss)
    return finish(arm, data, x, level, tolerance, free=free, loss=loss)


def finish(
    arm: ParametricArm,
    data: Observations,
    x: FloatArray,
    misfit: FloatArray,
    tolerance: FloatArray | None = None,
    *,
    free: BoolArray | None = None,
    loss: Loss = "linear",
) -> Identification:
    """Return the identification at known changes: covariance of the linearised problem, residuals, weights."""
    free = np.ones(len(arm.parameters), np.bool_) if free is None else free
    residual, columns = data.residual(arm, x), data.jacobian(arm, x)
    white = whiteners(data, misfit)
    if loss != "linear":
        weight = _rho(loss)(np.einsum("nij,nj->ni", white, residual) ** 2)[1]
        white = np.sqrt(weight)[:, :, None] * white
    scale, rows, _ = _system(white, residual, columns, x, tolerance, free)
    r = np.linalg.qr(rows, mode="r")
    diagonal = np.abs(np.diag(r))
    if len(rows) < rows.shape[1] or diagonal.min() < (_RANK if tolerance is None else _DIGITS) * diagonal.max():
        raise _cannot_tell(arm, free, rows)
    root = solve_triangular(r, np.eye(len(r)))
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = (scale[:, None] * root) @ (scale[:, None] * root).T
    return Identification(x, covariance, free, misfit, residual, columns, white)


def minimal_subset(arm: ParametricArm, data: Observations) -> BoolArray:
    """Return the largest set of parameters that the data can separate, (p,) bool: QR with column pivoting.

    Base and tool are preferred, then the parameters determined best; the others are to be kept at their nominal values.
    A parameter is included if the data determine it, given the previous ones, better than ten tolerances.
    """
    near = least_squares(arm, data, arm.tolerance)
    rows = (near.whitener @ near.jacobian).reshape(-1, len(arm.parameters)) * arm.tolerance
    first = np.array([_FIRST if p.group in ("base", "tool") else 1.0 for p in arm.parameters])
    r, order = qr(rows * first, mode="r", pivoting=True)
    determined = np.abs(np.diag(r)) / first[order[: len(r)]]
    free = np.zeros(len(arm.parameters), np.bool_)
    free[order[: len(r)][determined > max(_DETERMINED, _RANK * determined.max())]] = True
    return free


def whiteners(data: Observations, misfit: FloatArray) -> FloatArray:
    """Return inverse Cholesky factors of the readings' covariance plus misfit²: (n, k, k)."""
    total = data.covariance + np.diag(np.maximum(misfit, _FLOOR)[data.kind] ** 2)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(total)))


def estimate_misfit(data: Observations, residual: FloatArray, leverage: FloatArray) -> FloatArray:
    """Return the misfit at which the weighted squares equal their degrees of freedom, for each kind of number.

    Parameters
    ----------
    data : Observations
        The readings.
    residual : (n, k) array
        The residuals.
    leverage : (n, k) array
        The share of each number that the fit has absorbed.
    """
    variance = np.einsum("nkk->nk", data.covariance)
    found = []
    for kind in np.unique(data.kind):
        own = data.kind == kind
        square, known = residual[:, own] ** 2, variance[:, own]
        freedom = max(float((1.0 - leverage[:, own]).sum()), 1.0)
        if not known.any():
            found.append(np.sqrt(square.sum() / freedom))
            continue

        def excess(
            extra: float, square: FloatArray = square, known: FloatArray = known, freedom: float = freedom
        ) -> float:
            return float((square / np.maximum(known + extra, _FLOOR**2)).sum() - freedom)

        most = float(square.sum() / freedom) + _FLOOR**2
        found.append(np.sqrt(brentq(excess, 0.0, most, xtol=1e-18)) if excess(0.0) > 0.0 > excess(most) else 0.0)
    return np.maximum(found, _FLOOR)


def _start(arm: ParametricArm, data: Observations, misfit: FloatArray | None) -> FloatArray:
    if misfit is not None:
        return np.maximum(misfit, _FLOOR)
    residual = data.residual(arm, np.zeros(len(arm.parameters)))
    return estimate_misfit(data, residual, np.zeros(residual.shape))


def _robust_misfit(data: Observations, residual: FloatArray, used: int) -> FloatArray:
    """Return 1.4826 times the median size (consistent for normal numbers), less the part of the readings."""
    share = residual.size / max(residual.size - used, 1)
    variance = np.einsum("nkk->nk", data.covariance)
    found = []
    for kind in np.unique(data.kind):
        own = data.kind == kind
        size = share * (1.4826 * np.median(np.abs(residual[:, own]))) ** 2
        found.append(np.sqrt(max(size - np.median(variance[:, own]), 0.0)))
    return np.maximum(found, _FLOOR)


def _system(
    white: FloatArray,
    residual: FloatArray,
    columns: FloatArray,
    x: FloatArray,
    tolerance: FloatArray | None,
    free: BoolArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the scale of each step, and the matrix and right side of the linear problem in scaled steps."""
    rows = (white @ columns[:, :, free]).reshape(-1, int(free.sum()))
    right = np.einsum("nij,nj->ni", white, residual).ravel()
    if tolerance is None:
        length = np.linalg.norm(rows, axis=0)
        scale = 1.0 / np.where(length > 0, length, 1.0)
        return scale, rows * scale, right
    scale = tolerance[free]
    return scale, np.vstack([rows * scale, np.eye(len(scale))]), np.concatenate([right, -x[free] / scale])


def _solved(
    rows: FloatArray, right: FloatArray, arm: ParametricArm, free: BoolArray, tolerance: FloatArray | None
) -> FloatArray:
    q, r = np.linalg.qr(rows)
    diagonal = np.abs(np.diag(r))
    if len(rows) < rows.shape[1] or diagonal.min() < (_RANK if tolerance is None else _DIGITS) * diagonal.max():
        raise _cannot_tell(arm, free, rows)
    return np.asarray(solve_triangular(r, q.T @ right))


def _cannot_tell(arm: ParametricArm, free: BoolArray, rows: FloatArray) -> IdentifiabilityError:
    names = [name for name, taken in zip(arm.names, free, strict=True) if taken]
    seen = observability(rows[:, None, :], names)
    return IdentifiabilityError(
        f"identification: rank {seen.rank} of {len(names)} parameters; the data cannot separate {seen.describe()}; "
        'use tolerances (prior="tolerance"), a minimal subset (prior="subset"), or measure other poses'
    )


def _leverage(rows: FloatArray, n: int, k: int) -> FloatArray:
    q = np.linalg.qr(rows)[0][: n * k]
    return np.asarray((q**2).sum(axis=1).reshape(n, k))


def _damped(
    arm: ParametricArm,
    data: Observations,
    x: FloatArray,
    white: FloatArray,
    tolerance: FloatArray | None,
    free: BoolArray,
    loss: Loss,
) -> FloatArray:
    scale = arm.tolerance[free]

    def changes(z: FloatArray) -> FloatArray:
        full = np.zeros(len(free))
        full[free] = scale * z
        return full

    def fun(z: FloatArray) -> FloatArray:
        r = -np.einsum("nij,nj->ni", white, data.residual(arm, changes(z))).ravel()
        return r if tolerance is None else np.concatenate([r, scale * z / tolerance[free]])

    def jac(z: FloatArray) -> FloatArray:
        rows = (white @ data.jacobian(arm, changes(z))[:, :, free]).reshape(-1, len(scale)) * scale
        return rows if tolerance is None else np.vstack([rows, np.diag(scale / tolerance[free])])

    n_data = white.shape[0] * white.shape[1]
    robust = _rho(loss)

    def rho(square: FloatArray) -> FloatArray:
        out = np.stack([square, np.ones_like(square), np.zeros_like(square)])
        out[:, :n_data] = robust(square[:n_data])
        return out

    kernel: Any = "linear" if loss == "linear" else rho
    start = x[free] / scale
    found = scipy_least_squares(fun, start, jac=jac, loss=kernel, ftol=1e-13, xtol=1e-10, gtol=1e-10, max_nfev=100)
    return changes(np.asarray(found.x))


def _rho(loss: Loss) -> Callable[[FloatArray], FloatArray]:
    """Return ρ, ρ', ρ'' of the squared residual (3, …), as `scipy.optimize.least_squares` defines them."""

    def linear(z: FloatArray) -> FloatArray:
        return np.stack([z, np.ones_like(z), np.zeros_like(z)])

    def huber(z: FloatArray) -> FloatArray:
        limit = 1.345**2  # 95 % efficiency for normal residuals
        far = np.maximum(z, limit)
        value = np.where(z <= limit, z, 2 * np.sqrt(limit * far) - limit)
        return np.stack([value, np.sqrt(limit / far), np.where(z <= limit, 0.0, -0.5 * np.sqrt(limit) * far**-1.5)])

    def soft_l1(z: FloatArray) -> FloatArray:
        t = 1.0 + z
        return np.stack([2 * (np.sqrt(t) - 1), t**-0.5, -0.5 * t**-1.5])

    def cauchy(z: FloatArray) -> FloatArray:
        limit = 2.385**2
        t = 1.0 + z / limit
        return np.stack([limit * np.log(t), 1 / t, -1 / t**2 / limit])

    return {"linear": linear, "huber": huber, "soft_l1": soft_l1, "cauchy": cauchy}[loss]
