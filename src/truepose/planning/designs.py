"""Ways to choose n configurations of a work region, by name (theory, planning)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import qmc

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.planning.prior import Prior
from truepose.planning.region import MeasurementSpace, WorkRegion
from truepose.planning.selection import Progress, lowest_largest, lowest_mean, most_observable
from truepose.predictors.kinematic.terms import COMPLIANCE

_CANDIDATES: Final = 1024
_FEWER_CANDIDATES: Final = 400  # each costs the eigenvalues of a matrix, at every step
_ROUNDS: Final = 12
_GROWTH: Final = 1.3
_DOUBLINGS: Final = 4


@dataclass(frozen=True, eq=False)
class Task:
    """What a method gets: where to measure, what is believed there, and how many.

    Attributes
    ----------
    ground : MeasurementSpace
    prior : Prior
    targets : (m, dof) array [rad]
        Configurations over the region that are to be known well.
    n : int
    seed : int
    progress : callable
        Takes steps done and steps in all.
    """

    ground: MeasurementSpace
    prior: Prior
    targets: FloatArray
    n: int
    seed: int
    progress: Progress


def _posterior(task: Task) -> FloatArray:
    q, columns, noise = _candidates(task, _CANDIDATES)
    aim = task.prior.at(task.targets)[0].reshape(-1, columns.shape[2])
    return np.asarray(q[lowest_mean(columns, noise, aim.T @ aim / len(task.targets), task.n, task.progress)])


def _posterior_largest(task: Task) -> FloatArray:
    q, columns, noise = _candidates(task, _CANDIDATES)
    return np.asarray(q[lowest_largest(columns, noise, task.n, task.progress)])


def _observable(name: str) -> Callable[[Task], FloatArray]:
    def choose(task: Task) -> FloatArray:
        q = _measurable(task, _FEWER_CANDIDATES)
        terms = task.prior.basis.terms
        columns = terms.at(q).drift[:, :, terms.group != COMPLIANCE]
        # parameters that no sample can tell from others would make every index zero: in their place what can be told
        _, size, basis = np.linalg.svd(columns.reshape(-1, columns.shape[2]), full_matrices=False)
        told = basis[size > 1e-6 * size[0]].T
        return np.asarray(q[most_observable(columns @ told, _INDICES[name], task.n, task.progress)])

    return choose


def _grid(task: Task) -> FloatArray:
    """Points of an even grid over the box, orientations spread over them."""

    def draw(region: WorkRegion, count: int) -> FloatArray:
        step = (np.prod(region.size) / count) ** (1 / 3)
        counts = np.maximum(np.round(region.size / step).astype(int), 2)
        axes = np.meshgrid(*(np.linspace(0.0, 1.0, k) for k in counts), indexing="ij")
        unit = np.stack(axes, axis=-1).reshape(-1, 3)
        turns = qmc.Halton(3, rng=np.random.default_rng(task.seed)).random(len(unit))
        return np.concatenate([unit, turns], axis=1)

    return _enough(task, draw)


def _latin_hypercube(task: Task) -> FloatArray:
    rng = np.random.default_rng(task.seed)
    return _enough(task, lambda region, count: qmc.LatinHypercube(region.dimensions, rng=rng).random(count))


def _sobol(task: Task) -> FloatArray:
    return _measurable(task, task.n)[: task.n]


def _enough(task: Task, draw: Callable[[WorkRegion, int], FloatArray]) -> FloatArray:
    """Return n configurations, evenly out of those of the smallest draw of which n can be measured."""
    region, count = task.ground, float(task.n)
    if not isinstance(region, WorkRegion):
        raise DataError("a grid or a Latin hypercube is laid over a [region]; from a list, choose by another method")
    for _ in range(_ROUNDS):
        q = region.reach(draw(region, int(np.ceil(count)))[:, : region.dimensions]).q
        if len(q) >= task.n:
            return np.asarray(q[np.round(np.linspace(0, len(q) - 1, task.n)).astype(int)])
        count *= _GROWTH
    raise _too_few(len(q), task.n)


def _measurable(task: Task, count: int) -> FloatArray:
    """Return at least n configurations spread over the region, of about `count` or more."""
    for doubled in range(_DOUBLINGS):
        q = task.ground.spread(count << doubled, task.seed).q
        if len(q) >= task.n:
            return q
    raise _too_few(len(q), task.n)


def _candidates(task: Task, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return configurations to choose from, their columns, and the noise of their readings."""
    q = _measurable(task, max(count, 2 * task.n))
    columns, left_out = task.prior.at(q)
    return q, columns, task.prior.noise(left_out)


def _too_few(found: int, wanted: int) -> DataError:
    return DataError(
        f"{wanted} poses are wanted, and {found} of those offered can be measured; widen [region] or the list"
    )


METHODS: Final[dict[str, Callable[[Task], FloatArray]]] = {
    "posterior": _posterior,
    "posterior-largest": _posterior_largest,
    **{name: _observable(name) for name in ("d-optimal", "o2", "o3", "o4", "o5")},
    "grid": _grid,
    "latin-hypercube": _latin_hypercube,
    "sobol": _sobol,
}
"""By name: lowest mean variance over the targets; lowest largest; the observability indices O1 (D-optimal) to O5; and
spread without a model."""

_INDICES: Final[dict[str, Callable[[FloatArray, int], FloatArray]]] = {
    # of the eigenvalues σ², ascending, of n samples; O1 without the factor that all candidates share
    "d-optimal": lambda value, n: np.log(np.maximum(value, np.finfo(float).tiny)).sum(axis=1),
    "o2": lambda value, n: value[:, 0] / value[:, -1],
    "o3": lambda value, n: value[:, 0],
    "o4": lambda value, n: value[:, 0] / np.sqrt(value[:, -1]),
    "o5": lambda value, n: -(1.0 / np.sqrt(np.maximum(value, np.finfo(float).tiny))).sum(axis=1),
}
