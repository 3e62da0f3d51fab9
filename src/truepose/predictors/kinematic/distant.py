"""Kinematic Kriging with distances from fixed points beside its positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Self

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.predictors.conditions import joined
from truepose.predictors.distances import DistanceRows
from truepose.predictors.kinematic.design import take
from truepose.predictors.kinematic.distances import aimed, noise_blocks, owners, widened
from truepose.predictors.kinematic.fitted import FittedKriging
from truepose.predictors.kinematic.fitting import Start
from truepose.predictors.kinematic.terms import Terms
from truepose.predictors.kinematic.weights import GROSS, ROUNDS, SETTLED, robust_weights


class DistantKriging(FittedKriging):
    """The rows of a fit and their noise; distances enter the solution after the search for hyperparameters."""

    gross_distances_: IntArray

    if TYPE_CHECKING:
        conditions: Sequence[str]
        distances: bool
        distance_rows: DistanceRows | None
        robust: bool
        bounds_hit_: list[str]
        log_likelihood_: float
        _optimum: Start
        _nominal: Terms
        _x: FloatArray
        _e: FloatArray
        _reading: FloatArray
        _own: IntArray
        _weight: FloatArray
        _distant: int
        _along: tuple[FloatArray, FloatArray]
        _p: FloatArray

        def _solve(self) -> None: ...
        def _poses_out(self) -> tuple[FloatArray, FloatArray]: ...

    def _left_out_alone(self, *, poses: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return left-out residuals and covariances, each reading of full weight; alone, or with its whole pose."""
        residual, covariance = self._poses_out() if poses else self._form.alone
        variance = np.asarray((self.hyper_.noise**2 + self._reading**2) / self._weight[:, None])
        if self._distant:
            return residual, covariance - widened(variance, self._weight, *self._along)
        return residual, covariance - (variance * (1.0 - self._weight[:, None]))[:, :, None] * np.eye(3)

    def _noise_variance(self) -> FloatArray:
        """Return the noise of all rows: variances (n, 3), or with distances covariances (n, 3, 3) [mm²]."""
        variance = np.asarray((self.hyper_.noise**2 + self._reading**2) / self._weight[:, None])
        return noise_blocks(variance, self._weight, *self._along) if self._distant else variance

    def _settle(self, weight: FloatArray, *, solved: bool = False) -> None:
        """Take in the distances, with given weights or robust ones, and solve; those of positions stay."""
        rows = self.distance_rows if self.distances else None
        self.gross_distances_ = np.empty(0, np.int64)
        if rows is None or not len(rows):
            if not solved:
                self._solve()
            return
        n, m = len(self._e), len(rows)
        x = joined(rows.q, self.conditions, rows.conditions)
        self._p = self._nominal.at(x).p
        u, e = aimed(rows, self._p, np.zeros((m, 3)))
        self._distant, self._along = m, (u, rows.std)
        samples = self._given[0][:, : rows.q.shape[1]]
        self._own = np.concatenate([self._own, owners(rows, samples)])
        self._x, self._e = np.concatenate([self._x, x]), np.concatenate([self._e, e])
        self._reading = np.concatenate([self._reading, np.zeros((m, 3))])
        self._weight = np.concatenate([self._weight, weight if len(weight) else np.ones(m)])
        self._solve()
        for _ in range(0 if len(weight) or not self.robust else ROUNDS):
            before = self._weight[n:].copy()
            self._weight[n:] = robust_weights(*self._left_out_alone())[n:]
            self._solve()
            if np.abs(np.sqrt(self._weight[n:]) - np.sqrt(before)).max() < SETTLED:
                break
        self.gross_distances_ = np.flatnonzero(self._weight[n:] < GROSS)

    def _aim(self) -> None:
        """Linearise distances at the errors of the last solution."""
        if not self._distant or self.distance_rows is None:
            return
        here = take(self._form.design, slice(len(self._e) - self._distant, None))
        u, e = aimed(self.distance_rows, self._p, self._form.mean(here) + self._known(here))
        self._along, self._e[-self._distant :] = (u, self.distance_rows.std), e

    def with_distances(self, rows: DistanceRows) -> tuple[Self, bool]:
        """Return the fit with distances beside its positions, and whether left-out readings gain from them.

        Hyperparameters, and weights of positions, are those of this fit. Gain is a smaller sum of the residuals of
        left-out readings, of a position per component.

        Parameters
        ----------
        rows : DistanceRows
            The distances.
        """
        self._check_fitted()
        x, e, noise = self._given
        other = self.with_fitted_parameters().set_params(distance_rows=rows).fit(x, e, noise)
        if hasattr(self, "_optimum"):  # found here, not given
            other._optimum = self._optimum
        other.log_likelihood_ = self.log_likelihood_
        other.bounds_hit_ = self.bounds_hit_
        kept = np.setdiff1d(np.arange(len(rows)), other.gross_distances_)
        if not len(kept):
            return other, False
        p = other._p + self._predict(joined(rows.q, self.conditions, rows.conditions), False)[0]
        known = np.abs(rows.distance - np.linalg.norm(p - rows.origin, axis=1))[kept].sum()
        left = other._form.left_out(other._own)[0][-len(rows) :]
        found = np.abs(np.einsum("ma,ma->m", other._along[0], left))[kept].sum()
        after, before = (np.linalg.norm(one.leave_one_out().residual, axis=1).sum() for one in (other, self))
        return other, bool(after / np.sqrt(3.0) + found < before / np.sqrt(3.0) + known)
