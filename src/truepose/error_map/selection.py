"""From a cell's samples to positional errors, and the choice among predictors (theory (14))."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.error_map.conditions import modelled_conditions, work_of
from truepose.error_map.distances import distance_rows, with_origins
from truepose.error_map.exclusions import gross_readings, without_gross
from truepose.error_map.orientations import orientation_columns
from truepose.error_map.points import commanded_points, reflectors_of
from truepose.error_map.registration import check_samples, reading_noise, register_checked
from truepose.errors import DataError, IdentifiabilityError, KrigingError
from truepose.geometry import Registration, register
from truepose.numerics.executor import Executor
from truepose.predictors import ArmContext, Choice, PositionalErrors, rank_predictors
from truepose.robots import Robot
from truepose.samples import Samples, on_arm

Rows = IntArray | slice


@dataclass(frozen=True, eq=False)
class CellSamples:
    """Samples of a cell, which can be registered with any part of them.

    Attributes
    ----------
    cell : Cell
        The cell that was measured.
    robot : Robot
        The nominal robot.
    samples : Samples
        The samples.
    accepted : bool
        Whether `check_samples` has accepted them before, as those of a map.
    drifting : bool
        Whether the readings drift, so that a predictor has to know the times.
    fleet : mapping, optional
        What other robots of the type say, see `truepose.predictors.kinematic.fleet.Fleet`.
    """

    cell: Cell
    robot: Robot
    samples: Samples
    accepted: bool = False
    drifting: bool = False
    fleet: Mapping[str, Any] | None = None

    def register(self, rows: Rows = slice(None)) -> tuple[Registration, FloatArray]:
        """Return the registration with some rows, and the tool (4, 4) [mm] found with it or as stated."""
        if not self.accepted:
            _ = self._checked
        registration, tf_flange_tool, _ = register_checked(self.cell, self.robot, self.samples[rows])
        return registration, tf_flange_tool

    def without_gross(self) -> Self:
        """Return the samples without gross readings; see `truepose.error_map.exclusions`."""
        registration, tf_flange_tool = self.register()
        gross = gross_readings(self.cell, self.robot, self.samples, registration, tf_flange_tool)
        return replace(self, samples=without_gross(self.samples, registration, gross)) if gross.any() else self

    @cached_property
    def _checked(self) -> bool:
        """Whether all samples were checked; done once for all parts of them."""
        check_samples(self.cell, self.robot, self.samples)
        return True

    def registered_by(self, rows: Rows = slice(None)) -> PositionalErrors:
        """Return the errors of all samples after a registration with some rows.

        Where these cannot separate tool and station, the registration of all samples is used.
        """
        try:
            return self.errors(*self.register(rows))
        except IdentifiabilityError:
            return self.errors(*self.register())

    def errors(self, registration: Registration, tf_flange_tool: FloatArray) -> PositionalErrors:
        """Return the errors of all samples after a registration."""
        samples = self.samples
        if samples.q is None:
            assert samples.p_cmd is not None  # Poses holds one of them
            coordinates = {"cartesian": samples.p_cmd}
        else:
            p_cmd = commanded_points(self.robot, self.cell, samples, tf_flange_tool)
            coordinates = {"cartesian": p_cmd, "joint": samples.q}
        known = {} if samples.q is None else modelled_conditions(samples, self.cell, drifting=self.drifting)
        turns = orientation_columns(self.robot, samples, registration)
        return PositionalErrors(
            coordinates,
            registration.apply(samples.p_meas) - coordinates["cartesian"],
            reading_noise(self.cell, samples, registration),
            replace(arm_of(self.cell, self.robot, tf_flange_tool), fleet=self.fleet),
            known if turns is None else {**known, "orientation": turns},
            distance_rows(self.cell, samples, registration),
        )


@dataclass(frozen=True, eq=False)
class BareSamples:
    """Commanded and measured positions of an unknown arm."""

    samples: Samples

    def registered_by(self, rows: Rows = slice(None)) -> PositionalErrors:
        """Return the errors of all samples after a registration with some rows."""
        samples = self.samples
        if samples.p_cmd is None:
            raise DataError(f"{samples.source}: joints without positions need the arm; pass cell=load_cell(…)")
        registration = register(samples.p_cmd[rows], samples.p_meas[rows], robust=True)
        known = {} if samples.q is None else {"joint": samples.q}
        return PositionalErrors(
            {"cartesian": samples.p_cmd, **known}, registration.apply(samples.p_meas) - samples.p_cmd
        )


@contextmanager
def points_named(samples: Samples) -> Iterator[None]:
    """Within the block, name samples in errors of Kriging by point and line instead of by row."""
    try:
        yield
    except KrigingError as error:
        if not error.rows:
            raise
        raise error.with_names(samples.source, lambda rows: samples.rows(np.asarray(rows))) from None


def choose(
    candidates: str | Sequence[str],
    samples: Samples,
    cell: Cell | None = None,
    *,
    splits: Sequence[str] = ("points", "blocks"),
    folds: int = 5,
    rng: int = 0,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Callable[[str], Any] = str,
) -> Choice:
    """Rank predictors by nested cross-validation (14), registration in every fold, and fit the one to take.

    Parameters
    ----------
    candidates : "quick", "all", or sequence of str
        The names of predictors, with options as in `truepose.predictors.predictor_spec`.
    samples : Samples
        The commanded poses and readings. Gross ones are left out, and named in ``excluded`` of the result.
    cell : Cell, optional
        The cell; without it the samples need commanded positions, and candidates that use the arm are skipped.
    splits, folds, rng, workers, executor, progress
        The options of the cross-validation; see `truepose.predictors.rank_predictors`.

    Returns
    -------
    Choice
        The ``ranking``, the ``expected`` errors of the choice itself on unseen samples, and the fitted ``predictor``.
        `fit_cell` returns it as a map.

    Raises
    ------
    TrueposeError
        If the samples cannot be registered, or no candidate can be fitted.

    Examples
    --------
    >>> from truepose.simulation import VirtualCell
    >>> virtual = VirtualCell("paper")
    >>> choice = choose(["registration", "idw"], virtual.measure(virtual.design(40)), virtual.cell)
    >>> choice.predictor_name
    'idw'
    """
    registrable: BareSamples | CellSamples = BareSamples(samples)
    if cell is not None:
        robot = cell.load_robot()
        registrable = CellSamples(cell, robot, with_origins(cell, on_arm(samples, robot))).without_gross()
        samples = registrable.samples
    with points_named(samples):
        choice = rank_predictors(
            candidates,
            registrable,
            splits=splits,
            folds=folds,
            rng=rng,
            workers=workers,
            executor=executor,
            progress=progress,
        )
    return replace(choice, excluded=samples.excluded)


def arm_of(cell: Cell, robot: Robot, tf_flange_tool: FloatArray) -> ArmContext:
    """Return the properties of a cell's arm that predictors use."""
    load = cell.payload
    payload = (load.mass_kg, load.x_mm, load.y_mm, load.z_mm) if load.mass_kg else None
    return ArmContext(robot, tf_flange_tool, payload, work_of(cell), reflectors_of(cell))
