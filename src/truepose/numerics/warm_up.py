"""Compiling all kernels ahead of their first use, each for the types of arrays that the package calls it with."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Final

import numpy as np

from truepose.numerics import first_use, frozen, frozen_deviation, kernels, kinematic, pairs, small_systems
from truepose.numerics.threads import become_worker, cores


def _correlations() -> None:
    u, out = np.zeros((2, 3)), np.empty((2, 2))
    packed = kernels.pack(u)
    kernels.correlate(0, 0.0, np.zeros(1))
    kernels.cross_correlation(0, 0.0, u, packed, out)
    kernels.weighted_sum(0, 0.0, u, packed, kernels.pack(out))


def _slopes() -> None:
    u, weights = np.zeros((2, 3)), np.zeros((2, 2))
    packed = kernels.pack(u)
    kernels.slope(0, 0.0, np.zeros(1))
    kernels.weighted_gradient(0, 0.0, u, packed, kernels.pack(weights))
    kernels.slope_moments(0, 0.0, u, packed, weights, False)


def _pairs() -> None:
    x = np.eye(3)
    pairs.pair_sums(x, x, np.array([0.0, 2.0]), np.empty(0), 0.0, 0.0)
    pairs.middle_gaps(x, x, np.array([0.0, 2.0]), np.empty(0), 0.0, 0.0)
    pairs.largest_distance(x)
    pairs.smallest_gap(np.arange(3.0), 1)


def _small_systems() -> None:
    points, near = np.eye(3), np.array([[0, 1]])
    rho = small_systems.pair_distances(points, points[:1], near)
    small_systems.eliminate(rho, near, 1.0, np.ones(3), np.zeros(1), points)


def _kinematic() -> None:
    half, lever, place = np.zeros((1, 1, 2)), np.zeros((1, 1, 3)), np.zeros((1, 3))
    one, matrix = np.ones(1), np.eye(3)
    kinematic.add_joints_and_rest(matrix, half, lever, half, lever, one, one, place, place, 1.0, True)
    kinematic.slopes(matrix, np.zeros(3), half, lever, one, one, place, np.zeros(3, dtype=np.int64), 1.0, 1)


def _frozen() -> None:
    shapes = {
        "links": (2, 2, 3, 4),
        "sign": (1,),
        "limits": (1, 2),
        "twist": (2, 6),
        "tables": (1, 2),
        "harmonics": (1, 4),
        "moment": (1, 2),
        "mass": (2, 3),
        "anchors": (1, 5, 16),
        "weights": (1, 3, 16),
        "place_scale": (4,),
        "by_joints": (1,),
        "away": (3,),
        "linear": (1,),
    }
    constants = frozen.Constants(**{name: np.zeros(shape) for name, shape in shapes.items()})
    frozen.predict(np.zeros((1, 1)), np.zeros((1, 3)), constants, frozen.scratch(constants))
    flat = {name: np.zeros(1) for name in ("prior_joint", "prior_rest", "inflation", "added", "margin")}
    wide = {"drift": np.zeros((12, 1)), "gravity": np.zeros((1, 2, 1)), "tables": np.zeros((1, 4, 1))}
    prior = {"prior_drift": np.zeros((12, 12)), "prior_gravity": np.zeros((1, 2)), "waves": np.zeros((1, 2, 1))}
    deviation = frozen_deviation.Deviation(**flat, **wide, **prior, rest=np.zeros((3, 16, 1)))
    frozen_deviation.deviations(np.zeros((1, 1)), constants, deviation)


GROUPS: Final[dict[str, Callable[[], None]]] = {
    "frozen": _frozen,
    "slopes": _slopes,
    "pairs": _pairs,
    "correlations": _correlations,
    "small systems": _small_systems,
    "kinematic": _kinematic,
}
"""Kernels that are compiled together, in one process; those that take longest first."""


def warm_up() -> Iterator[tuple[str, list[str]]]:
    """Compile the kernels that the cache does not hold, in as many processes as this one may use processors.

    Yields
    ------
    str
        The name of a group of kernels that is ready.
    list of str
        The names of its kernels that were compiled; empty if all of them came from the cache.
    """
    workers = min(cores(), len(GROUPS))
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), become_worker) as pool:
        futures = [pool.submit(_warm, group) for group in GROUPS]
        for future in as_completed(futures):
            yield future.result()


def _warm(group: str) -> tuple[str, list[str]]:
    before = set(first_use.compiled_now())
    GROUPS[group]()
    return group, [name for name in first_use.compiled_now() if name not in before]
