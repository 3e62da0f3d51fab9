"""Ways to choose n configurations of a work region, by name (theory, planning)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist
from scipy.stats import qmc

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.planning.greedy import Progress, lowest_largest, lowest_mean, most_observable
from truepose.planning.measurement_space import MeasurementSpace, WorkRegion
from truepose.planning.prior import Prior
from truepose.predictors.kinematic.terms import COMPLIANCE

_CANDIDATES: Final = 1024
_FEWER_CANDIDATES: Final = 400  # each costs the eigenvalues of a matrix, at every step
_ROUNDS: Final = 12
_GROWTH: Final = 1.3
_DOUBLINGS: Final = 4
_SAME: Final = 1e-3  # rad, in each joint: nearer than that is the same pose


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """The input of a method.

    Attributes
    ----------
    space : MeasurementSpace
        The poses that can be chosen.
    prior : Prior
        The distribution of the arm's errors before the measurement.
    targets : (m, dof) array [rad]
        The configurations over the region at which errors are to be predicted.
    n : int
        The number of poses.
    known : (k, dof) array [rad]
        The configurations that were measured already, which are not chosen again.
    rng : int
        The seed of candidates and random methods.
    progress : callable
        A function of the steps done and the total number of steps.
    """

    space: MeasurementSpace
    prior: Prior
    targets: FloatArray
    n: int
    known: FloatArray
    rng: int
    progress: Progress

    def unmeasured(self, q: FloatArray) -> FloatArray:
        """Return those of configurations (m, dof) [rad] that were not measured already."""
        near: FloatArray = cdist(q, self.known, "chebyshev").min(axis=1, initial=np.inf)
        return np.asarray(q[near > _SAME])


def _posterior(problem: DesignProblem) -> FloatArray:
    q, columns, noise = _candidates(problem, _CANDIDATES)
    aim = problem.prior.at(problem.targets)[0].reshape(-1, columns.shape[2])
    return np.asarray(q[lowest_mean(columns, noise, aim.T @ aim / len(problem.targets), problem.n, problem.progress)])


def _posterior_largest(problem: DesignProblem) -> FloatArray:
    q, columns, noise = _candidates(problem, _CANDIDATES)
    return np.asarray(q[lowest_largest(columns, noise, problem.n, problem.progress)])


def _observable(name: str) -> Callable[[DesignProblem], FloatArray]:
    def choose(problem: DesignProblem) -> FloatArray:
        q = _measurable(problem, _FEWER_CANDIDATES)
        terms = problem.prior.basis.terms
        columns = terms.at(q).drift[:, :, terms.group != COMPLIANCE]
        # inseparable parameters would make every index zero; their separable combinations replace them
        _, size, basis = np.linalg.svd(columns.reshape(-1, columns.shape[2]), full_matrices=False)
        separable = basis[size > 1e-6 * size[0]].T
        return np.asarray(q[most_observable(columns @ separable, _INDICES[name], problem.n, problem.progress)])

    return choose


def _grid(problem: DesignProblem) -> FloatArray:
    """Return configurations at an even grid over the box, with orientations spread over them."""

    def draw(region: WorkRegion, count: int) -> FloatArray:
        step = (np.prod(region.size) / count) ** (1 / 3)
        counts = np.maximum(np.round(region.size / step).astype(int), 2)
        axes = np.meshgrid(*(np.linspace(0.0, 1.0, k) for k in counts), indexing="ij")
        unit = np.stack(axes, axis=-1).reshape(-1, 3)
        turns = qmc.Halton(3, rng=np.random.default_rng(problem.rng)).random(len(unit))
        return np.concatenate([unit, turns], axis=1)

    return _enough(problem, draw)


def _latin_hypercube(problem: DesignProblem) -> FloatArray:
    rng = np.random.default_rng(problem.rng)
    return _enough(problem, lambda region, count: qmc.LatinHypercube(region.dimensions, rng=rng).random(count))


def _sobol(problem: DesignProblem) -> FloatArray:
    return _measurable(problem, problem.n)[: problem.n]


def _enough(problem: DesignProblem, draw: Callable[[WorkRegion, int], FloatArray]) -> FloatArray:
    """Return n configurations, evenly spaced in the smallest draw of which n can be measured."""
    region, count = problem.space, float(problem.n)
    if not isinstance(region, WorkRegion):
        raise DataError("the methods grid and latin-hypercube need a [region]; choose from a list by another method")
    for _ in range(_ROUNDS):
        q = problem.unmeasured(region.reach(draw(region, int(np.ceil(count)))[:, : region.dimensions]).q)
        if len(q) >= problem.n:
            return np.asarray(q[np.round(np.linspace(0, len(q) - 1, problem.n)).astype(int)])
        count *= _GROWTH
    raise _too_few(len(q), problem)


def _measurable(problem: DesignProblem, count: int) -> FloatArray:
    """Return at least n configurations spread over the region, of about `count` or more."""
    for doubled in range(_DOUBLINGS):
        q = problem.unmeasured(problem.space.spread(count << doubled, problem.rng).q)
        if len(q) >= problem.n:
            return q
    raise _too_few(len(q), problem)


def _candidates(problem: DesignProblem, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return candidate configurations, their columns, and the noise of their readings."""
    q = _measurable(problem, max(count, 2 * problem.n))
    columns, left_out = problem.prior.at(q)
    return q, columns, problem.prior.noise(left_out)


def _too_few(found: int, problem: DesignProblem) -> DataError:
    known = f" beside the {len(problem.known)} that were measured already" if len(problem.known) else ""
    return DataError(f"expected at least {problem.n} measurable poses{known}, got {found}; widen [region] or the list")


METHODS: Final[dict[str, Callable[[DesignProblem], FloatArray]]] = {
    "posterior": _posterior,
    "posterior-largest": _posterior_largest,
    **{name: _observable(name) for name in ("d-optimal", "o2", "o3", "o4", "o5")},
    "grid": _grid,
    "latin-hypercube": _latin_hypercube,
    "sobol": _sobol,
}
"""The methods by name: lowest mean variance over the targets; lowest maximum; the observability indices O1 (D-optimal)
to O5; and three designs without a model."""

_INDICES: Final[dict[str, Callable[[FloatArray, int], FloatArray]]] = {
    # of the eigenvalues σ², ascending, of n samples; O1 without the factor that all candidates share
    "d-optimal": lambda value, n: np.log(np.maximum(value, np.finfo(float).tiny)).sum(axis=1),
    "o2": lambda value, n: value[:, 0] / value[:, -1],
    "o3": lambda value, n: value[:, 0],
    "o4": lambda value, n: value[:, 0] / np.sqrt(value[:, -1]),
    "o5": lambda value, n: -(1.0 / np.sqrt(np.maximum(value, np.finfo(float).tiny))).sum(axis=1),
}
