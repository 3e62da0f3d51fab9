"""Fits of many candidates to many parts of the samples, in this process or in several, with the same results."""

from __future__ import annotations

import multiprocessing
import multiprocessing.context
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError, TrueposeError
from truepose.numerics.threads import become_worker, blas_threads, cores
from truepose.predictors.base import Predictor
from truepose.predictors.outliers import fit_without_gross
from truepose.predictors.registry import PREDICTORS, ArmContext, make_predictor

_FAILURES = (TrueposeError, np.linalg.LinAlgError, ArithmeticError, MemoryError)


@dataclass(frozen=True, eq=False)
class PositionalErrors:
    """Errors of samples, and what predictors may know of them.

    Attributes
    ----------
    coordinates : mapping
        ``cartesian``: commanded positions (n, 3) [mm]; ``joint``: joints (n, dof) [rad], where there are any.
    e : (n, 3) array [mm], base frame
    noise_std : (n, 3) array [mm], optional
        Standard deviation of the readings.
    arm : ArmContext, optional
        For candidates that know the arm.
    """

    coordinates: Mapping[str, FloatArray]
    e: FloatArray
    noise_std: FloatArray | None = None
    arm: ArmContext | None = None

    def __post_init__(self) -> None:
        for name, values in {**self.coordinates, "e": self.e}.items():
            if len(values) != len(self.e):
                raise DataError(f"{name} has {len(values)} rows, e has {len(self.e)}")
            bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
            if len(bad):
                raise DataError(f"{name} has NaN or infinity in row {bad[0]} ({len(bad)} rows in all)")

    def __len__(self) -> int:
        return len(self.e)

    def registered_by(self, rows: IntArray | slice) -> PositionalErrors:
        """Return the errors of all samples when only these rows are known: the same, as they are registered already."""
        return self

    def fit(self, name: str, rows: IntArray | slice = slice(None)) -> tuple[Predictor, FloatArray]:
        """Return a predictor fitted to some rows, and how gross each of these is, see `fit_without_gross`."""
        model = make_predictor(name, arm=self.arm)
        if not self.supports(name):
            raise DataError(f"predictor {name!r} works in joint space: it needs joints (q1_deg …)")
        noise = None if self.noise_std is None else self.noise_std[rows]
        return model, fit_without_gross(model, self.coordinates[PREDICTORS[name].space][rows], self.e[rows], noise)

    def supports(self, name: str) -> bool:
        """Return whether a predictor can be fitted: its coordinates are there, and the arm if it needs one."""
        predictor = PREDICTORS[name]
        return predictor.space in self.coordinates and not (predictor.family.arm_parameters and self.arm is None)


class Registrable(Protocol):
    """Samples whose errors are after a registration, which may be done anew with some of the rows."""

    def registered_by(self, rows: IntArray | slice) -> PositionalErrors:
        """Return the errors of all samples after a registration with these rows."""


@dataclass(frozen=True)
class Task:
    """A candidate fitted to all samples but one fold of a split."""

    candidate: str
    split: str
    fold: int


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of a task.

    Attributes
    ----------
    task : Task
    rows : (m,) array of int
        Samples held out.
    residual, std : (m, 3) arrays [mm]
        Of these; the standard deviation holds the noise of the reading.
    inner : mapping of str to (residual, std)
        For each split: the samples of the fit, each predicted without its fold, (n − m, 3) [mm].
    note : str
        Why there is nothing, if so.
    """

    task: Task
    rows: IntArray
    residual: FloatArray
    std: FloatArray
    inner: dict[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True, eq=False)
class Job:
    """All that tasks have in common."""

    samples: Registrable
    splits: Mapping[str, IntArray]
    _registered: dict[tuple[str, int], PositionalErrors] = field(default_factory=dict)  # once for all candidates

    def run(self, task: Task) -> Outcome:
        """Fit, and predict what was held out; BLAS in one thread, so that the result is the same everywhere."""
        label = self.splits[task.split]
        out, known = np.flatnonzero(label == task.fold), np.flatnonzero(label != task.fold)
        nothing = np.full((len(out), 3), np.nan)
        try:
            with blas_threads(0):  # one thread, in workers and without them: the sums are the same
                return self._outcome(task, out, known)
        except _FAILURES as error:
            return Outcome(task, out, nothing, nothing, note=f"failed: {error}")

    def _outcome(self, task: Task, out: IntArray, known: IntArray) -> Outcome:
        key = task.split, task.fold
        if key not in self._registered:
            self._registered[key] = self.samples.registered_by(known)
        errors = self._registered[key]
        model, gross = errors.fit(task.candidate, known)
        x = errors.coordinates[PREDICTORS[task.candidate].space]

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
            if (block == block[0]).all():  # of two branches one is left: each sample from the others
                block = np.arange(len(block))
            residual[~kept], std[~kept] = held_out(known[~kept])
            with suppress(*_FAILURES):  # too few for this candidate: it stays NaN, and is not chosen
                residual[kept], std[kept] = model.leave_blocks_out(block)
            inner[name] = residual, std
        return Outcome(task, out, *held_out(out), inner)


def cross_validate(
    job: Job, candidates: Sequence[str], *, workers: int = 1, progress: Callable[[str], Any] = str
) -> list[Outcome]:
    """Run every candidate on every fold of every split; the result does not depend on the number of workers.

    Parameters
    ----------
    job : Job
    candidates : sequence of str
    workers : int
        Processes, with one thread each; at most as many as processors that this process may use. They are started
        anew: a script that asks for more than one needs the usual ``if __name__ == "__main__":``.
    progress : callable
        Takes a line after each fit.

    Returns
    -------
    list of Outcome
        In the order of candidates, splits and folds.

    Raises
    ------
    DataError
        If a worker died.
    """
    tasks = [
        Task(name, split, int(fold))
        for name in candidates
        for split, label in job.splits.items()
        for fold in np.unique(label)
    ]
    found: dict[Task, Outcome] = {}
    with _runner(job, min(workers, cores(), len(tasks))) as run:
        for outcome in run(tasks):
            found[outcome.task] = outcome
            progress(f"Cross-validation: {len(found)} of {len(tasks)} fits, {outcome.task.candidate}")
    return [found[task] for task in tasks]


@contextmanager
def _runner(job: Job, workers: int) -> Iterator[Callable[[Sequence[Task]], Iterator[Outcome]]]:
    """Yield what runs tasks, in any order; all worker processes have ended when the context is left."""
    if workers <= 1:
        yield lambda tasks: map(job.run, tasks)
        return
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, _context(), _start, (job,))

    def run(tasks: Sequence[Task]) -> Iterator[Outcome]:
        # the last candidates are the slowest: they go first, so that no worker waits for them in the end
        futures = [pool.submit(_work, task) for task in reversed(tasks)]
        return (future.result() for future in as_completed(futures))

    try:
        yield run
        pool.shutdown()
    except BaseException as error:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        pool.shutdown(cancel_futures=True)  # waits until the pool itself has seen the end of each process
        if isinstance(error, BrokenProcessPool):
            raise DataError(
                f"cross-validation: one of {workers} worker processes died, perhaps for want of memory; take 1"
            ) from None
        raise


def _context() -> multiprocessing.context.BaseContext:
    """Return how processes start: from a server that has imported the code once, where the system has that."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    return context


_job: Job | None = None  # of a worker process


def _start(job: Job) -> None:
    global _job
    become_worker()
    _job = job


def _work(task: Task) -> Outcome:
    assert _job is not None
    return _job.run(task)
