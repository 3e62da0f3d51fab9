"""Sequential identification, theory (11): the parameters are the constant state of a Kalman filter.

Each observation corrects x and its covariance P, which start from zero and the tolerances. The extended filter
linearises where each step ends. The unscented filter uses sigma points (Wan and van der Merwe 2000) and the statistical
linearisation H = P_xyᵀ P⁻¹ instead. Both update P in Joseph's form, (I − K H) P (I − K H)ᵀ + K R Kᵀ, which stays
positive definite despite rounding.

A filter cannot revise a linearisation that was made far from its final state. So a series is filtered again from its
prior, linearised about the final state of the last pass, until this state settles. For the extended filter these are
Gauss-Newton steps (Bell 1994), for the unscented the iterated posterior linearisation (García-Fernández et al. 2015).
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from truepose._typing import FloatArray
from truepose.identification.arm import ParametricArm
from truepose.identification.batch import estimate_misfit
from truepose.identification.observations import Observations

Kind = Literal["ekf", "ukf"]
_Step = tuple[FloatArray, FloatArray, FloatArray, FloatArray]  # gain, H, noise, step of z

_ALPHA: Final = 0.1  # spread of the sigma points
_BETA: Final = 2.0  # normal prior
_ITERATIONS: Final = 5  # of one update of the extended filter
_STILL: Final = 1e-2  # change of its step, in tolerances
_PASSES: Final = 12
_SETTLED: Final = 0.01  # relative change of the misfit, and change of the parameters in standard deviations


class KalmanFilter:
    """A filter of an arm's parameters.

    Parameters
    ----------
    arm : ParametricArm
        The arm and its parameters.
    tolerance : (p,) array, optional
        The standard deviations before the first observation; those of the arm when not given.
    kind : {"ekf", "ukf"}
        The extended or the unscented filter.
    about : KalmanFilter, optional
        A filter that has already seen the series; this one linearises about its state instead of its own.

    Attributes
    ----------
    x : (p,) array
        The changes from the nominal values.
    covariance : (p, p) array
        The covariance of the changes.
    n : int
        The number of observations.
    """

    def __init__(
        self,
        arm: ParametricArm,
        tolerance: FloatArray | None = None,
        kind: Kind = "ekf",
        about: KalmanFilter | None = None,
    ) -> None:
        self.arm, self.kind, self.n, self._about = arm, kind, 0, about
        self._scale = arm.tolerance if tolerance is None else tolerance  # x = scale z: P of z is the identity
        self._z = np.zeros(len(self._scale))
        self._p = np.eye(len(self._scale))

    @property
    def x(self) -> FloatArray:
        """The changes from the nominal values: (p,)."""
        return self._scale * self._z

    @property
    def covariance(self) -> FloatArray:
        """The covariance of the changes: (p, p)."""
        return np.asarray(self._scale[:, None] * self._p * self._scale)

    def update(self, data: Observations, misfit: FloatArray) -> None:
        """Process observations one after the other; the misfit counts as noise.

        Parameters
        ----------
        data : Observations
            The readings.
        misfit : (kinds,) array [mm] or [mm], [rad]
            The standard deviation that the model leaves unexplained.
        """
        extra = np.diag(np.asarray(misfit, float)[data.kind] ** 2)
        step = self._extended if self.kind == "ekf" else self._unscented
        for i in range(len(data)):  # each step depends on the one before
            gain, columns, noise, moved = step(data, i, data.covariance[i] + extra)
            self._z = self._z + moved
            kept = np.eye(len(self._z)) - gain @ columns
            self._p = kept @ self._p @ kept.T + gain @ noise @ gain.T
            self.n += 1

    def _extended(self, data: Observations, i: int, noise: FloatArray) -> _Step:
        """Return one step, linearised at its end by iteration (iterated filter, Bell and Cathey 1993)."""
        one = data.one(i)
        moved = np.zeros(len(self._z)) if self._about is None else self._about._z - self._z
        for _ in range(_ITERATIONS if self._about is None else 1):
            x = self._scale * (self._z + moved)
            columns = one.jacobian(self.arm, x)[0] * self._scale
            gain = self._gain(columns, noise)
            before, moved = moved, gain @ (one.residual(self.arm, x)[0] + columns @ moved)
            if np.abs(moved - before).max() < _STILL:
                break
        return gain, columns, noise, moved

    def _unscented(self, data: Observations, i: int, noise: FloatArray) -> _Step:
        n = len(self._z)
        spread = _ALPHA * np.sqrt(n)
        centre = self if self._about is None else self._about
        root = np.linalg.cholesky(centre._p)
        points = centre._z + spread * np.concatenate([np.zeros((1, n)), root.T, -root.T])
        residual = data.residuals_of(self.arm, i, self._scale * points)
        # weights of the mean: w_0 = 1 − 1/α², the others 1 / (2 α² n); differences to the first avoid cancellation
        off = residual[1:] - residual[0]
        innovation = residual[0] + off.sum(axis=0) / (2 * spread**2)
        first = residual[0] - innovation
        away = residual[1:] - innovation
        weight = 1 - 1 / _ALPHA**2 + 1 - _ALPHA**2 + _BETA
        covariance = weight * np.outer(first, first) + away.T @ away / (2 * spread**2)
        cross = -(points[1:] - centre._z).T @ away / (2 * spread**2)  # the prediction is minus the residual
        columns = np.linalg.solve(root.T, np.linalg.solve(root, cross)).T
        noise = noise + covariance - columns @ centre._p @ columns.T  # the nonlinear part counts as noise
        gain = self._gain(columns, noise)
        return gain, columns, noise, gain @ (innovation + columns @ (centre._z - self._z))

    def _gain(self, columns: FloatArray, noise: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.solve(columns @ self._p @ columns.T + noise, columns @ self._p).T)

    def again(self, data: Observations, misfit: FloatArray) -> KalmanFilter:
        """Return a filter that processes the series again from the prior, linearised about this filter's state."""
        found = KalmanFilter(self.arm, self._scale, self.kind, about=self)
        found.update(data, misfit)
        found._about = None
        return found

    def moved(self, other: KalmanFilter) -> float:
        """Return the largest difference of the parameters, in standard deviations."""
        return float(np.abs((self._z - other._z) / np.sqrt(np.diag(self._p))).max())


def filtered(
    arm: ParametricArm,
    data: Observations,
    tolerance: FloatArray | None = None,
    *,
    kind: Kind = "ekf",
    misfit: FloatArray | None = None,
) -> tuple[KalmanFilter, FloatArray]:
    """Return a filter that has processed all observations, and the misfit.

    The series is filtered again, linearised about the last final state and (when the misfit is not given) with the
    misfit of this state, until both settle.
    """
    residual = data.residual(arm, np.zeros(len(arm.parameters)))
    level = estimate_misfit(data, residual, np.zeros(residual.shape)) if misfit is None else np.asarray(misfit, float)
    found = KalmanFilter(arm, tolerance, kind)
    found.update(data, level)
    for _ in range(_PASSES):
        before = level
        if misfit is None:
            level = _misfit_left(data, found, level)
        last, found = found, found.again(data, level)
        if found.moved(last) <= _SETTLED and (np.abs(level - before) <= _SETTLED * before).all():
            break
    return found, level


def _misfit_left(data: Observations, found: KalmanFilter, level: FloatArray) -> FloatArray:
    columns = data.jacobian(found.arm, found.x)
    noise = np.einsum("nkk->nk", data.covariance) + level[data.kind] ** 2
    leverage = np.einsum("nkp,pr,nkr->nk", columns, found.covariance, columns) / noise
    return estimate_misfit(data, data.residual(found.arm, found.x), leverage)
