"""The search for hyperparameters of (10): restricted likelihood, weak priors, analytic gradients, several starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.optimize import minimize

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.predictors.kinematic.basis_form import Basis, Sums, gradient_by_hyper, negative_log_likelihood
from truepose.predictors.kinematic.covariance_form import Likelihood
from truepose.predictors.kinematic.hyperparameters import Hyperparameters

_STARTS: Final = (1.0, 0.3)  # factors of the joint lengths that a search starts from
_SHORT: Final = 25  # iterations after which the better start goes on alone
_LONG: Final = 120
_SETTLED: Final = 1e-6  # relative change of the log likelihood: some 0.002, no reason to go on


@dataclass(frozen=True, eq=False)
class Search:
    """Where a search ended.

    Attributes
    ----------
    hyper : Hyperparameters
    log_likelihood : float
        Marginal, at `hyper`: the logarithm of the normal density of all 3n errors [mm], with its full constant, the
        drift integrated out under its normal priors; without the priors of the hyperparameters.
    bounds_hit : list of str
        Hyperparameters at a bound.
    evaluations : int
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
    starts : list of Hyperparameters
    iterations : int
        At most.

    Raises
    ------
    KrigingError
        If no start has a finite likelihood.
    """
    return _minimise(likelihood, starts, likelihood.constant, iterations)


def refine(basis: Basis, sums: Sums, start: Hyperparameters) -> Search:
    """Go on from hyperparameters of a subset with all samples, in basis form; its lengths and ranges stay as they are.

    Parameters
    ----------
    basis : Basis
    sums : Sums
        With the noise variances of `start`.
    start : Hyperparameters
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
    """Return a start with several joint lengths: the likelihood may have an optimum at each."""
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
    """Minimise; parameters that are held (1 of 0 and 1) stay where the first start has them.

    `constant` is what the negative log likelihood leaves out; `iterations` are those of the last search.
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
