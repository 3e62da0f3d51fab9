"""Fit many candidates to many parts of the samples, in one process or in several, with the same results."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError, KrigingError, TrueposeError
from truepose.numerics.executor import Executor, Inputs, Task
from truepose.numerics.processes import local
from truepose.numerics.threads import cores, one_thread
from truepose.predictors.abilities import Conditional, DistanceTaking, Startable, TurnTaking
from truepose.predictors.base import Predictor
from truepose.predictors.conditions import CONDITIONS, joined
from truepose.predictors.distances import DistanceRows
from truepose.predictors.outliers import fit_without_gross
from truepose.predictors.reflectors import REFLECTOR, whole_poses
from truepose.predictors.registry import ArmContext, conditions_wanted, make_predictor, predictor_spec

FAILURES = (TrueposeError, np.linalg.LinAlgError, ArithmeticError, MemoryError)
"""What a fit may raise where samples do not suffice."""

_WORTH_PROCESSES: Final = 2000
"""Samples times candidates from which processes save more time than their start takes, about 2 s."""


@dataclass(frozen=True, eq=False)
class PositionalErrors:
    """Positional errors of samples with their coordinates, noise and arm: the input of predictors.

    Attributes
    ----------
    coordinates : mapping
        The commanded positions ``cartesian`` (n, 3) [mm], and the joints ``joint`` (n, dof) [rad] where known.
    e : (n, 3) array [mm], base frame
        The positional errors.
    conditions : mapping
        The conditions that the samples tell apart, see `truepose.predictors.conditions`.
    noise_std : (n, 3) array [mm], optional
        The standard deviations of the readings.
    arm : ArmContext, optional
        The arm, for predictors that need it.
    distances : DistanceRows, optional
        Distances beside the positions, for predictors that take them.
    """

    coordinates: Mapping[str, FloatArray]
    e: FloatArray
    noise_std: FloatArray | None = None
    arm: ArmContext | None = None
    conditions: Mapping[str, FloatArray] = field(default_factory=dict)
    distances: DistanceRows | None = None

    def __post_init__(self) -> None:
        for name, values in {**self.coordinates, "e": self.e}.items():
            if len(values) != len(self.e):
                raise DataError(f"{name} has {len(values)} rows, e has {len(self.e)}")
            bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
            if len(bad):
                raise DataError(f"{name} has NaN or infinity in row {bad[0]} ({len(bad)} rows in all)")

    def __len__(self) -> int:
        return len(self.e)

    @property
    def pose(self) -> IntArray:
        """The pose of each row, (n,): rows of several reflectors at one pose stay together in folds."""
        own = self.conditions.get(REFLECTOR)
        q = self.coordinates.get("joint")
        return np.arange(len(self)) if own is None or q is None else whole_poses(q, own[:, 1])

    def registered_by(self, rows: IntArray | slice) -> PositionalErrors:
        """Return the errors themselves: they are registered already."""
        return self

    def fit(self, name: str, rows: IntArray | slice = slice(None), optimum: Any = None) -> tuple[Predictor, FloatArray]:
        """Return a predictor fitted to some rows, and how gross each of them is, see `fit_without_gross`.

        A `Startable` starts at `optimum` where it is given.
        """
        model = make_predictor(name, arm=self.arm)
        if optimum is not None and isinstance(model, Startable):
            model.start_from(optimum)
        if not self.supports(name):
            if REFLECTOR in self.conditions and not model.takes_reflectors:
                raise DataError(
                    f"predictor {name!r} does not know the arm, so it cannot take readings of several reflectors; fit "
                    "kinematic-kriging or calibration, or keep the rows of one reflector"
                )
            raise DataError(f"predictor {name!r} works in joint space: it needs joints (q1_deg …)")
        noise = None if self.noise_std is None else self.noise_std[rows]
        used = self._used(name)
        if isinstance(model, Conditional):
            model.set_params(conditions=tuple(one for one in used if one != "orientation"))
        try:
            gross = fit_without_gross(model, self.inputs(name, model)[rows], self.e[rows], noise)
        except KrigingError as error:
            raise error.of_rows(np.arange(len(self))[rows].tolist()) from None
        if "orientation" in used and isinstance(model, TurnTaking):
            x = joined(self.coordinates[predictor_spec(name).space], used, self.conditions)[rows]
            oriented, gains = model.with_turns(x[gross == 0], used)
            if gains or "orientation" in predictor_spec(name).defaults.get("conditions", ()):
                model = oriented
        return self._with_distances(name, model), gross

    def _with_distances(self, name: str, model: Predictor) -> Predictor:
        """Return the fit with the distances, if it takes them and gains from them, or the name asks for them."""
        if self.distances is None or not isinstance(model, DistanceTaking) or not model.distances:
            return model
        other, gains = model.with_distances(self.distances)
        if gains or "distances" in predictor_spec(name).defaults:
            return other
        model.distances = False  # as a stored map has them
        return model

    def _used(self, name: str) -> tuple[str, ...]:
        """Return the conditions that a named predictor takes: those it wants, and always the reflector."""
        wanted = (*conditions_wanted(name), REFLECTOR)
        return tuple(one for one in (*CONDITIONS, REFLECTOR) if one in self.conditions and one in wanted)

    def inputs(self, name: str, model: Predictor) -> FloatArray:
        """Return the input of a named predictor, (n, d): its coordinates, and the conditions that `model` uses."""
        x = self.coordinates[predictor_spec(name).space]
        return joined(x, model.conditions, self.conditions) if isinstance(model, Conditional) else x

    def supports(self, name: str) -> bool:
        """Return whether a predictor can be fitted: coordinates are known, and the arm or reflectors where needed."""
        spec = predictor_spec(name)
        if REFLECTOR in self.conditions and not spec.family.takes_reflectors:
            return False
        return spec.space in self.coordinates and not (spec.family.arm_parameters and self.arm is None)


class Registrable(Protocol):
    """Samples whose registration can be repeated with some of the rows."""

    def registered_by(self, rows: IntArray | slice) -> PositionalErrors:
        """Return the errors of all samples after a registration with these rows."""


@dataclass(frozen=True)
class FoldFit:
    """A candidate fitted to all samples but one fold of a split."""

    candidate: str
    split: str
    fold: int


@dataclass(frozen=True, eq=False)
class FoldResult:
    """The result of a `FoldFit`.

    Attributes
    ----------
    fit : FoldFit
        The fit.
    rows : (m,) array of int
        The held-out samples.
    residual, std : (m, 3) arrays [mm]
        Their residuals and predicted standard deviations, reading noise included.
    inner : mapping of str to (residual, std)
        For each split: the same of the samples of the fit, each predicted without its fold, (n − m, 3) [mm].
    note : str
        The reason of a failure; empty for a success.
    """

    fit: FoldFit
    rows: IntArray
    residual: FloatArray
    std: FloatArray
    inner: dict[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True, eq=False)
class Job:
    """The data that all fits share.

    Attributes
    ----------
    samples : Registrable
        The samples.
    splits : mapping of str to (n,) array of int
        The fold of each sample in each split.
    """

    samples: Registrable
    splits: Mapping[str, IntArray]
    _registered: dict[tuple[str, int], PositionalErrors] = field(default_factory=dict)  # shared by all candidates

    def run(self, fit: FoldFit, optimum: Any = None) -> FoldResult:
        """Fit, and predict the held-out samples; a `Startable` candidate starts at `optimum`."""
        label = self.splits[fit.split]
        out, known = np.flatnonzero(label == fit.fold), np.flatnonzero(label != fit.fold)
        nothing = np.full((len(out), 3), np.nan)
        try:
            with one_thread():  # in workers and without them: the sums are the same
                return self._result(fit, optimum, out, known)
        except FAILURES as error:
            return FoldResult(fit, out, nothing, nothing, note=f"failed: {error}")

    def _result(self, fit: FoldFit, optimum: Any, out: IntArray, known: IntArray) -> FoldResult:
        key = fit.split, fit.fold
        if key not in self._registered:
            self._registered[key] = self.samples.registered_by(known)
        errors = self._registered[key]
        model, gross = errors.fit(fit.candidate, known, optimum)
        x = errors.inputs(fit.candidate, model)

        def held_out(rows: IntArray) -> tuple[FloatArray, FloatArray]:
            if not len(rows):
                return np.empty((0, 3)), np.empty((0, 3))
            e, std = model.predict(x[rows], return_std=True, include_nugget=True)
            noise = 0.0 if errors.noise_std is None else errors.noise_std[rows]
            return errors.e[rows] - e, np.sqrt(std**2 + noise**2)

        inner = {}
        for name, label in self.splits.items():
            kept, residual, std = gross == 0, np.full((len(known), 3), np.nan), np.full((len(known), 3), np.nan)
            block = label[known[kept]]
            if (block == block[0]).all():  # only one branch remains: leave out single samples
                block = errors.pose[known[kept]]
            residual[~kept], std[~kept] = held_out(known[~kept])
            with suppress(*FAILURES):  # too few samples for this candidate: NaN excludes it from the inner choice
                residual[kept], std[kept] = model.leave_blocks_out(block)
            inner[name] = residual, std
        return FoldResult(fit, out, *held_out(out), inner)


def cross_validate(
    job: Job,
    candidates: Sequence[str],
    *,
    optimum: Callable[[str], Any] = lambda _: None,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Callable[[str], Any] = str,
) -> list[FoldResult]:
    """Run every candidate on every fold of every split; the result does not depend on the number of workers.

    Parameters
    ----------
    job : Job
        The samples and their splits.
    candidates : sequence of str
        The names of the predictors.
    optimum : callable
        A function that returns what the fits of a candidate start from, see `Startable`. It runs in this process, while
        others run fits.
    workers : int
        The number of processes, each with one thread; never more than the processors available to this process.
        A script that asks for more than one needs the usual ``if __name__ == "__main__":``. 0: all processors if the
        fits take longer than the start of processes.
    executor : Executor, optional
        Where the fits run, instead of processes of this machine.
    progress : callable
        A function that receives a line after each fit.

    Returns
    -------
    list of FoldResult
        The results, in the order of candidates, splits and folds.

    Raises
    ------
    DataError
        If a worker process died.
    """
    fits = {
        name: [FoldFit(name, split, int(fold)) for split, label in job.splits.items() for fold in np.unique(label)]
        for name in candidates
    }
    count = sum(len(some) for some in fits.values())
    if executor is None:
        if not workers:
            n = len(next(iter(job.splits.values())))
            workers = cores() if n * len(candidates) > _WORTH_PROCESSES else 1
        with local(min(workers, count), "cross-validation") as here:
            return _collect(here, job, fits, count, optimum, progress)
    return _collect(executor, job, fits, count, optimum, progress)


def _collect(
    executor: Executor,
    job: Job,
    fits: dict[str, list[FoldFit]],
    count: int,
    optimum: Callable[[str], Any],
    progress: Callable[[str], Any],
) -> list[FoldResult]:
    """Run all fits and return their results in order."""
    key = executor.share(lambda: pickle.dumps(job), job)
    found: dict[FoldFit, FoldResult] = {}
    # the last candidates are the slowest: start them first, so that no worker waits for them at the end
    tasks = (_task(key, fit, start) for name in reversed(fits) for start in [optimum(name)] for fit in fits[name])
    for _, result in executor.run(run_fit, tasks):
        found[result.fit] = result
        progress(f"Cross-validation: {len(found)} of {count} fits, {result.fit.candidate}")
    return [found[fit] for some in fits.values() for fit in some]


def _task(key: str, fit: FoldFit, optimum: Any) -> Task:
    return Task((key,), (fit, optimum), f"{fit.candidate} {fit.split} {fit.fold}")


def run_fit(inputs: Inputs, task: Task) -> FoldResult:
    """Run one fit of a shared `Job`: the task of a cross-validation."""
    job: Job = inputs.get(task.inputs[0], pickle.loads)
    return job.run(*task.values)
