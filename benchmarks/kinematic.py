"""Kinematic Kriging: fit with hyperparameters, prediction with standard deviation, compensation.

scikit-learn's GaussianProcessRegressor has three ranges and noise, no drift, and one kernel for the three components.
The samples are those of the virtual cell "hard": errors of geometry, compliance and every joint.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from benchmarks.harness import Call, Job, Memory, Slow
from truepose import ErrorMap, VirtualCell, choose, fit_cell
from truepose.error_map.selection import CellSamples
from truepose.geometry import register
from truepose.predictors import Choice, KinematicKriging
from truepose.predictors.folds import split_samples
from truepose.predictors.selection.choice import QUICK
from truepose.samples import Poses

TITLE = "Benchmarks: kinematic Kriging"
PACKAGES = ("truepose", "numpy", "scipy", "numba", "scikit-learn")
FloatArray = NDArray[np.float64]
COMPARED = 1_000


def jobs(*, quick: bool = False) -> Iterator[Job]:
    """Yield the jobs."""
    n, many = (150, 600) if quick else (COMPARED, 12_000)
    sizes = (100, 300) if quick else (100, 300, 3_000, 100_000)
    m, targets = (500, 100) if quick else (100_000, 10_000)
    yield Job(
        f"fit with hyperparameters, n = {n:,}",
        {"truepose": _once(partial(_fitted, n)), "scikit-learn GPR": _once(partial(_process, n))},
        target=">= 1",
    )
    yield Job(
        f"fit with hyperparameters, n = {many:,} (scikit-learn: n = {n:,}, not more)",
        {"truepose": _once(partial(_fit, many)), f"scikit-learn GPR, n = {n:,}": _once(partial(_scikit_learn, n))},
        memory=Memory(partial(_fit, 60), partial(_fit, many)),
        target=">= 0.05; < 2,000 MB",
    )
    for size in sizes:
        yield Job(f"time against n: n = {size:,}", {"truepose": _once(partial(_fit, size))})
    for size, longest in ((60, 5), (100, 5)) if quick else ((150, 5), (600, 10), (2_000, 25)):
        yield Job(
            f"choice among the default candidates, n = {size:,}",
            {
                "truepose, one process": _once(partial(_choose, size)),
                "truepose, two processes": _once(partial(_choose, size, workers=2)),
                "the fits alone, each from scratch": _once(partial(_apart, size)),
            },
            target=f">= 1; two processes at most {longest} s",
        )
    q, p = _samples(m)[0][:m], _samples(m)[1][:m]
    model, process = _fitted(n), _process(n)
    yield Job(
        f"prediction with standard deviation, {m:,} configurations, n = {n:,} (both from {m // 10:,})",
        {
            "truepose": Slow(lambda count: model.predict(q[:count], return_std=True), (m // 10,)),
            "scikit-learn GPR": Slow(lambda count: process.predict(p[:count], return_std=True), (m // 10,)),
        },
        items=m,
        target=">= 1",
    )
    error_map, poses = _map(n if quick else 300, targets)
    few = targets // 10
    yield Job(
        f"correction (16) of {targets:,} poses, guards included (from {few:,})",
        {
            "truepose": Slow(lambda count: error_map.correct(poses[:count], on_guard="skip"), (few,)),
            "two predictions and two inverse kinematics": Slow(lambda count: _twice(error_map, poses[:count]), (few,)),
            "position and orientation": Slow(
                lambda count: error_map.correct(poses[:count], on_guard="skip", orientation=True), (few,)
            ),
        },
        items=targets,
        target=">= 0.5 of two of each",
    )


def _once(call: Call) -> Slow:
    return Slow(lambda _count: call(), (1,), repeats=1)


@cache
def _samples(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return joints (n, 6) [rad], commanded positions and errors (n, 3) [mm]."""
    virtual = VirtualCell("hard", seed=100)
    samples = virtual.measure(virtual.design(n))
    assert samples.q is not None
    p_cmd = virtual.robot.forward(samples.q, tool=virtual.tf_flange_tool)[:, :3, 3]
    return samples.q, p_cmd, register(p_cmd, samples.p_meas).residuals


def _fit(n: int) -> KinematicKriging:
    q, _, e = _samples(n)
    virtual = VirtualCell("hard", seed=100)
    return KinematicKriging(virtual.robot, virtual.tf_flange_tool).fit(q, e)


def _choose(n: int, workers: int = 1) -> Choice:
    """Fit, predict and compare all candidates on ten folds, and fit the best."""
    virtual = VirtualCell("hard", seed=100)
    return choose("quick", virtual.measure(virtual.design(n)), virtual.cell, workers=workers)


def _apart(n: int) -> None:
    """Fit the same candidates to the same ten folds; no fit knows another."""
    virtual = VirtualCell("hard", seed=100)
    errors = CellSamples(virtual.cell, virtual.robot, virtual.measure(virtual.design(n))).registered_by()
    for fold in split_samples(("points", "blocks"), errors.coordinates).values():
        for out in range(5):
            for name in QUICK:
                errors.fit(name, np.flatnonzero(fold != out))


def _scikit_learn(n: int) -> GaussianProcessRegressor:
    _, p, e = _samples(n)
    kernel = ConstantKernel(0.1) * RBF([500.0] * 3, (1.0, 1e5)) + WhiteKernel(0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return GaussianProcessRegressor(kernel).fit(p, e)


_fitted = cache(_fit)
_process = cache(_scikit_learn)


@cache
def _map(n: int, targets: int) -> tuple[ErrorMap, FloatArray]:
    """Return a map of n samples, and poses (targets, 4, 4) [mm] among them."""
    virtual = VirtualCell("hard", seed=100)
    error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(n)), "kinematic-kriging")
    return error_map, virtual.robot.forward(virtual.design(targets, seed=7), tool=virtual.tf_flange_tool)


def _twice(error_map: ErrorMap, poses: FloatArray) -> None:
    for _ in range(2):
        q = error_map.robot.inverse(poses, tool=error_map.tf_flange_tool)[:, 0]
        error_map.predict_errors(Poses(q=q))
