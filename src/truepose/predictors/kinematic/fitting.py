"""Search for the hyperparameters of (10): restricted likelihood with weak priors, gradients, several starts.

A search that knows nothing descends by L-BFGS-B from several starts, and then finds the second derivatives from
differences of gradients. They change little from one part of the samples to another, so a search of similar samples
starts with them at the optimum and needs a fifth of the evaluations: BFGS with a known metric (Nocedal and Wright 2006,
section 6.1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from scipy.optimize import Bounds, minimize

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.predictors.kinematic.basis import Basis
from truepose.predictors.kinematic.basis_form import BasisSums, gradient_by_hyper, negative_log_likelihood
from truepose.predictors.kinematic.covariance_form import Likelihood
from truepose.predictors.kinematic.hyperparameters import Hyperparameters

_STARTS: Final = (1.0, 0.3)  # factors of the joint lengths that a search starts from
_SHORT: Final = 25  # iterations after which only the best start continues
_LONG: Final = 120
_SETTLED: Final = 1e-6  # relative change of the log likelihood, about 0.002, that ends a search by L-BFGS-B
_NEAR: Final = 0.002  # expected decrease of the negative log likelihood that ends any other search
_PAYS: Final = 2.0  # gain of the log likelihood from which the effect of a condition is in the model
_DIFFERENCE: Final = 1e-4  # of the logarithms, for second derivatives
_STILL: Final = 1e-6  # change of the logarithms: a search that ends this near its start did not move


@dataclass(frozen=True, eq=False)
class Start:
    """Where a search starts that knows the optimum of similar samples.

    Attributes
    ----------
    hyper : Hyperparameters
        The hyperparameters at that optimum.
    curvature : (p, p) array
        The second derivatives of the negative log likelihood per sample by the logarithms of `Hyperparameters`, without
        the priors; positive semidefinite, approximately known.
    """

    hyper: Hyperparameters
    curvature: FloatArray


@dataclass(frozen=True, eq=False)
class Search:
    """The result of a search.

    Attributes
    ----------
    hyper : Hyperparameters
        The best hyperparameters.
    log_likelihood : float
        The marginal log likelihood at `hyper`: the logarithm of the normal density of all 3n errors [mm] with its
        constant, the drift integrated out under its normal priors; without the priors of the hyperparameters.
    bounds_hit : tuple of int
        The places of the hyperparameters at a bound, see `Hyperparameters.names`.
    evaluations : int
        The number of evaluations of the likelihood.
    """

    hyper: Hyperparameters
    log_likelihood: float
    bounds_hit: tuple[int, ...]
    evaluations: int


def search(likelihood: Likelihood, starts: list[Hyperparameters]) -> tuple[Search, Start]:
    """Minimise the negative log likelihood plus the weak priors, in covariance form, from several starts.

    Parameters
    ----------
    likelihood : Likelihood
        The likelihood of the samples.
    starts : list of Hyperparameters
        The starting points.

    Returns
    -------
    Search
        The result.
    Start
        The start of searches with similar samples.

    Raises
    ------
    KrigingError
        If no start has a finite likelihood.
    """
    objective = _Objective(likelihood, starts[0])
    at = [start.to_vector() for start in starts]
    found = [objective.descend(theta, objective.bounds, _SHORT) for theta in at]
    if all(np.abs(moved - theta).max() < _STILL for (_, moved), theta in zip(found, at, strict=True)):
        found += [objective.descend(theta, objective.bounds, _SHORT) for theta in objective.elsewhere()]
    theta = min(found, key=lambda one: one[0])[1]
    metric = _positive(objective.curvature(theta)) + objective.prior
    return objective.finish(theta, metric, likelihood, _NEAR)


def search_near(likelihood: Likelihood, start: Start, *, settled: float = _NEAR) -> tuple[Search, Start]:
    """Minimise as `search` does, from the optimum of similar samples.

    Parameters
    ----------
    likelihood : Likelihood
        The likelihood of the samples.
    start : Start
        The optimum of similar samples.
    settled : float
        The expected decrease of the negative log likelihood that ends the search.

    Returns
    -------
    Search, Start
        As of `search`.

    Raises
    ------
    KrigingError
        If the likelihood is not finite at the start.
    """
    objective = _Objective(likelihood, start.hyper)
    metric = likelihood.n * start.curvature + objective.prior
    return objective.finish(start.hyper.to_vector(), metric, likelihood, settled)


def refine(basis: Basis, sums: BasisSums, start: Hyperparameters) -> Search:
    """Refine hyperparameters from a subset with all samples, in basis form; lengths and ranges stay fixed.

    Parameters
    ----------
    basis : Basis
        The columns.
    sums : BasisSums
        The sums over all samples, with the noise variances of `start`.
    start : Hyperparameters
        The hyperparameters of the subset.
    """

    def likelihood(hyper: Hyperparameters) -> tuple[float, FloatArray]:
        scale = (hyper.noise / start.noise) ** 2
        value, by_variance, by_scale = negative_log_likelihood(basis, sums, hyper, scale)
        return value, gradient_by_hyper(basis, hyper, by_variance, by_scale)

    objective, theta = _Objective(likelihood, start), start.to_vector()
    k, ranges = len(start.joint_std), len(start.rest_range)
    held = np.r_[np.zeros(k), np.ones(k), np.zeros(len(start.tolerance) + 1 + (ranges > 0)), np.ones(ranges)]
    bounds = np.where(held[:, None], theta[:, None], objective.bounds)
    return objective.result(*objective.descend(theta, bounds, _LONG), sums.constant)


def spread_starts(start: Hyperparameters) -> list[Hyperparameters]:
    """Return starts with several joint lengths, because the likelihood may have several optima."""
    vector, k = start.to_vector(), len(start.joint_std)
    out = []
    for factor in _STARTS:
        theta = vector.copy()
        theta[k : 2 * k] += np.log(factor)
        out.append(start.with_vector(theta))
    return out


def without_effects(likelihood: Likelihood, hyper: Hyperparameters) -> Hyperparameters:
    """Return hyperparameters in which the effect of each condition that does not raise the likelihood is negligible."""
    low = hyper.least_tolerance
    for i in range(2, len(hyper.tolerance)):
        tolerance = hyper.tolerance.copy()
        tolerance[i] = low[i]
        without = replace(hyper, tolerance=tolerance)
        if likelihood(without)[0] < likelihood(hyper)[0] + _PAYS:
            hyper = without
    return hyper


def log_evidence(likelihood: Likelihood, optimum: Start) -> float:
    """Return the log likelihood with the hyperparameters integrated out under their priors, by Laplace's method.

    Parameters
    ----------
    likelihood : Likelihood
        The likelihood of the samples.
    optimum : Start
        The hyperparameters that maximise it with the priors, and its second derivatives there.
    """
    centre, std = optimum.hyper.prior()
    pull = (optimum.hyper.to_vector() - centre) / std
    precision = np.diag(std**-2.0) + likelihood.n * optimum.curvature
    value = likelihood(optimum.hyper)[0] + likelihood.constant + 0.5 * float(pull @ pull)
    return -value - float(np.log(std).sum()) - 0.5 * float(np.linalg.slogdet(precision)[1])


class _Objective:
    """The negative log likelihood, without its constant, plus the weak priors: a function of the logarithms.

    Attributes
    ----------
    bounds : (p, 2) array
        The bounds of the logarithms.
    prior : (p, p) array
        The second derivatives of the priors.
    evaluations : int
        The number of evaluations so far.
    """

    def __init__(
        self, likelihood: Callable[[Hyperparameters], tuple[float, FloatArray]], shape: Hyperparameters
    ) -> None:
        self._likelihood, self._shape = likelihood, shape
        self._centre, self._std = shape.prior()
        self.prior = np.diag(self._std**-2.0)
        self.bounds = np.array(shape.bounds())
        self.evaluations = 0

    def at(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Return the value and its gradient."""
        self.evaluations += 1
        value, gradient = self._likelihood(self._shape.with_vector(theta))
        pull = (theta - self._centre) / self._std
        return value + 0.5 * float(pull @ pull), gradient + pull / self._std

    def elsewhere(self) -> list[FloatArray]:
        """Return starts for a search that did not move: one prior standard deviation above and below the centres."""
        return [np.clip(self._centre + sign * self._std, *self.bounds.T) for sign in (1.0, -1.0)]

    def descend(self, theta: FloatArray, bounds: FloatArray, iterations: int) -> tuple[float, FloatArray]:
        """Return the value and place that L-BFGS-B reaches from `theta`."""
        options: Any = {"maxiter": iterations, "ftol": _SETTLED}
        found = minimize(self.at, theta, jac=True, method="L-BFGS-B", bounds=Bounds(*bounds.T), options=options)
        return float(found.fun), np.asarray(found.x)

    def finish(
        self, theta: FloatArray, metric: FloatArray, likelihood: Likelihood, settled: float
    ) -> tuple[Search, Start]:
        """Descend by BFGS from `theta`; return the result and the start of similar searches.

        `metric` (p, p) approximates the second derivatives and is positive definite. Parameters stay at a bound while
        the gradient holds them there.
        """
        low, high = self.bounds.T
        value, gradient = self.at(theta)
        for turn in range(_LONG):
            free = ~((theta <= low) & (gradient > 0.0) | (theta >= high) & (gradient < 0.0))
            step = np.zeros_like(theta)
            step[free] = -np.linalg.solve(metric[np.ix_(free, free)], gradient[free])
            if not -0.5 * float(gradient @ step) > settled:
                break
            for _ in range(_SHORT):
                moved = np.clip(theta + step, low, high) - theta
                next_value, next_gradient = self.at(theta + moved)
                if next_value <= value + 1e-4 * float(gradient @ moved):  # the condition of Armijo
                    break
                step *= 0.4
            else:
                if turn == 0:  # the metric does not suit: without one, the search may move
                    value, theta = self.descend(theta, self.bounds, _LONG)
                break
            change = next_gradient - gradient
            if moved @ change > 1e-9:
                along = metric @ moved
                metric = metric + np.outer(change, change) / (moved @ change) - np.outer(along, along) / (moved @ along)
            theta, value, gradient = theta + moved, next_value, next_gradient
        result = self.result(value, theta, likelihood.constant)
        return result, Start(result.hyper, _positive(metric - self.prior) / likelihood.n)

    def curvature(self, theta: FloatArray) -> FloatArray:
        """Return the second derivatives of the negative log likelihood at `theta`, without the priors."""
        here = self.at(theta)[1]
        rows = [(self.at(theta + _DIFFERENCE * one)[1] - here) / _DIFFERENCE for one in np.eye(len(theta))]
        return 0.5 * (np.array(rows) + np.transpose(rows)) - self.prior

    def result(self, value: float, theta: FloatArray, constant: float) -> Search:
        """Return the result of a search that ended with `value` at `theta`; `constant` is that of the likelihood."""
        if not np.isfinite(value):
            raise KrigingError(
                "kinematic Kriging found no hyperparameters with a finite likelihood; are the samples repeated?"
            )
        hyper, pull = self._shape.with_vector(theta), (theta - self._centre) / self._std
        low, high = self.bounds.T
        hit = np.flatnonzero((theta <= low + 1e-9) | (theta >= high - 1e-9))
        log_likelihood = 0.5 * float(pull @ pull) - value - constant
        return Search(hyper, log_likelihood, tuple(hit.tolist()), self.evaluations)


def _positive(matrix: FloatArray) -> FloatArray:
    """Return a symmetric matrix with 0 for its negative eigenvalues."""
    value, vector = np.linalg.eigh(matrix)
    return np.asarray((vector * np.maximum(value, 0.0)) @ vector.T)
