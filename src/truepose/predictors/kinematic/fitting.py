"""Search for the hyperparameters of (10): restricted likelihood with weak priors, gradients, several starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.optimize import minimize

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.predictors.kinematic.basis import Basis
from truepose.predictors.kinematic.basis_form import BasisSums, gradient_by_hyper, negative_log_likelihood
from truepose.predictors.kinematic.covariance_form import Likelihood
from truepose.predictors.kinematic.hyperparameters import Hyperparameters

_STARTS: Final = (1.0, 0.3)  # factors of the joint lengths that a search starts from
_SHORT: Final = 25  # iterations after which only the best start continues
_LONG: Final = 120
_SETTLED: Final = 1e-6  # relative change of the log likelihood, about 0.002, that ends a search


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
    bounds_hit : list of str
        The hyperparameters at a bound.
    evaluations : int
        The number of evaluations of the likelihood.
    """

    hyper: Hyperparameters
    log_likelihood: float
    bounds_hit: list[str]
    evaluations: int


def search(likelihood: Likelihood, starts: list[Hyperparameters], *, iterations: int = _LONG) -> Search:
    """Minimise the negative log likelihood plus the weak priors, in covariance form, from several starts.

    Parameters
    ----------
    likelihood : Likelihood
        The likelihood of the samples.
    starts : list of Hyperparameters
        The starting points.
    iterations : int
        The largest number of iterations.

    Raises
    ------
    KrigingError
        If no start has a finite likelihood.
    """
    return _minimise(likelihood, starts, likelihood.constant, iterations)


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

    k, ranges = len(start.joint_std), len(start.rest_range)
    return _minimise(
        likelihood,
        [start],
        sums.constant,
        _LONG,
        held=np.r_[np.zeros(k), np.ones(k), np.zeros(3 + (ranges > 0)), np.ones(ranges)],
    )


def spread_starts(start: Hyperparameters) -> list[Hyperparameters]:
    """Return starts with several joint lengths, because the likelihood may have several optima."""
    vector, k = start.to_vector(), len(start.joint_std)
    out = []
    for factor in _STARTS:
        theta = vector.copy()
        theta[k : 2 * k] += np.log(factor)
        out.append(start.with_vector(theta))
    return out


def _minimise(
    likelihood: Callable[[Hyperparameters], tuple[float, FloatArray]],
    starts: list[Hyperparameters],
    constant: float,
    iterations: int,
    held: FloatArray | None = None,
) -> Search:
    """Minimise from all starts; parameters with `held` = 1 keep their value in the first start.

    `constant` is omitted by `likelihood`; `iterations` limits the last search.
    """
    shape = starts[0]
    centre, std = shape.prior()
    bounds = shape.bounds()
    for i in np.flatnonzero(np.zeros(0) if held is None else held):
        bounds[i] = (shape.to_vector()[i],) * 2
    evaluations = 0

    def objective(theta: FloatArray) -> tuple[float, FloatArray]:
        nonlocal evaluations
        evaluations += 1
        value, gradient = likelihood(shape.with_vector(theta))
        pull = (theta - centre) / std
        return value + 0.5 * float(pull @ pull), gradient + pull / std

    def run(theta: FloatArray, iterations: int) -> tuple[float, FloatArray]:
        options: Any = {"maxiter": iterations, "ftol": _SETTLED}
        found = minimize(objective, theta, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        return float(found.fun), np.asarray(found.x)

    first = [run(start.to_vector(), _SHORT if len(starts) > 1 else iterations) for start in starts]
    value, theta = min(first, key=lambda found: found[0])
    if len(starts) > 1:
        value, theta = run(theta, iterations)
    if not np.isfinite(value):
        raise KrigingError(
            "kinematic Kriging found no hyperparameters with a finite likelihood; are the samples repeated?"
        )
    hyper = shape.with_vector(theta)
    hit = [
        name
        for name, at, (low, high) in zip(_names(hyper), theta, bounds, strict=True)
        if low < high and not low + 1e-9 < at < high - 1e-9
    ]
    pull = (theta - centre) / std
    return Search(hyper, 0.5 * float(pull @ pull) - value - constant, hit, evaluations)


def _names(hyper: Hyperparameters) -> list[str]:
    k, g = len(hyper.joint_std), len(hyper.rest_range)
    names = [f"joint std {i + 1}" for i in range(k)] + [f"joint length {i + 1}" for i in range(k)]
    names += ["tolerance of geometry", "tolerance of compliance", "noise"]
    return names + (["rest std", *(f"rest range {i + 1}" for i in range(g))] if g else [])
