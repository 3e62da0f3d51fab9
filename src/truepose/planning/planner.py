"""The plan of a measurement: poses, their order, the accuracy to expect, and the measuring program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.error_map import ErrorMap, fit_cell
from truepose.errors import DataError
from truepose.geometry import apply_transform, invert_transform
from truepose.identification import Observability, observability
from truepose.planning.designs import METHODS, DesignProblem
from truepose.planning.forecast import Forecast
from truepose.planning.greedy import Progress, lowest_mean
from truepose.planning.measurement_space import MeasurementSpace, Reach, configuration_list, work_region
from truepose.planning.measuring import measuring_program, write_measurement
from truepose.planning.prior import Prior
from truepose.predictors import KinematicKriging
from truepose.predictors.kinematic.terms import COMPLIANCE
from truepose.samples import Poses, Samples, on_arm

_TARGETS: Final = 512
_ANCHORS: Final = 120
_READING_MM: Final = 0.015  # standard deviation of a reading where the cell states none
_STEPS: Final = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0)
_COARSE: Final = 12  # numbers of poses that are compared first
_MEAN_LENGTH: Final = float(np.sqrt(8.0 / np.pi))  # of a normal vector with unit variance in each direction
_AWAY: Final = np.array([2000.0, 0.0, 0.0])  # mm: assumed position of the tracker, seen from the base


@dataclass(frozen=True, eq=False)
class Plan:
    """Configurations to measure, in order; made by `plan`.

    Attributes
    ----------
    cell : Cell
        The cell in which the poses are measured.
    method : str
        The name of the method in `truepose.planning.METHODS`.
    space : MeasurementSpace
        The poses that could be chosen.
    q : (n, dof) array [rad]
        The configurations, in the order of measuring.
    way : list of str
        The box that the straight way from the previous pose would touch, for each pose, or ""; the program moves by
        home there.
    reach : Reach
        The measurable part of the work region.
    expected : list of dict
        The mean length ``mean_mm`` by which a reading in the work region differs from its prediction after ``n`` poses,
        noise included, and ``low_mm`` and ``high_mm``, between which it lies with 80 % probability: arms of one type
        differ. Beyond the plan's own n: with additional poses of the lowest mean variance. In a plan after samples,
        n = 0 is what these reach alone.
    observability : Observability
        The observability of registration and geometry, with the samples that the plan continues.
    until_mm : float, optional
        The expected accuracy that was asked for.
    """

    cell: Cell
    method: str
    space: MeasurementSpace
    q: FloatArray
    way: list[str]
    reach: Reach
    expected: list[dict[str, float]]
    observability: Observability
    until_mm: float | None = None

    def __repr__(self) -> str:
        by_home = sum(box != "" for box in self.way)
        return (
            f"<Plan of {len(self.q)} poses for {self.cell.robot.model}: {self.method}, expected error "
            f"{self.expected_mm:.3f} mm (mean); {self.reach.describe()}; {by_home} motions by home>"
        )

    @property
    def poses(self) -> Poses:
        """The plan as a table with the names P001, P002, …: joints, commanded poses of the stated tool, approach."""
        tf = self.cell.load_robot().forward(self.q, tool=self.cell.tf_flange_tool)
        return Poses(
            q=self.q,
            p_cmd=tf[:, :3, 3],
            rotation_cmd=Rotation.from_matrix(tf[:, :3, :3]),
            approach=self.space.approach_signs(self.q),
            name=np.array([f"P{number:03d}" for number in range(1, len(self.q) + 1)]),
            source=f"{len(self.q)} poses, {self.method}",
        )

    @property
    def expected_mm(self) -> float:
        """Mean length by which a reading in the work region differs from its prediction after this plan [mm]."""
        return next(row["mean_mm"] for row in self.expected if row["n"] == len(self.q))

    @property
    def reaches(self) -> bool | None:
        """Whether the plan is expected to reach `until_mm`; None if nothing was asked for."""
        return None if self.until_mm is None else self.expected_mm <= self.until_mm

    def program(self, name: str = "measure") -> tuple[str, str]:
        """Return the ending and the text of the measuring program, see `measuring_program`."""
        return measuring_program(self.cell, self.poses, space=self.space, name=name)

    def write(self, directory: str | Path) -> list[Path]:
        """Write plan.csv and, where the maker's language is known, the measuring program; return their paths."""
        return write_measurement(Path(directory) / "plan.csv", self.cell, self.poses, space=self.space)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures of the plan as plain values."""
        return {
            "method": self.method,
            "n": len(self.q),
            "measurable_percent": 100.0 * len(self.reach.q) / self.reach.asked,
            "left_out": self.reach.left_out,
            "expected": self.expected,
            "until_mm": self.until_mm,
            "reaches": self.reaches,
            "by_home": sum(box != "" for box in self.way),
            "approach": self.cell.measuring.approach,
            "observability": self.observability.indices,
            "not_told": self.observability.describe(),
        }


def plan(
    cell: Cell,
    n: int,
    method: str = "posterior",
    *,
    candidates: FloatArray | None = None,
    after: ErrorMap | Samples | None = None,
    until: float | None = None,
    rng: int = 0,
    progress: Progress = lambda done, of: None,
) -> Plan:
    """Choose n configurations of the cell's work region to measure, or as many as an accuracy takes.

    Parameters
    ----------
    cell : Cell
        The cell, with a ``[region]``; ``[measuring]``, ``[obstacles]`` and the position of ``[tracker]`` are used where
        stated.
    n : int
        The number of poses; with `until`, the largest number.
    method : str
        The name of a method in `truepose.planning.METHODS`. "posterior" leaves the lowest mean predicted variance over
        the region, "posterior-largest" the lowest maximum, both by the prior of theory (10); "d-optimal", "o2" … "o5"
        are observability indices of the geometry; "grid", "latin-hypercube" and "sobol" use no model.
    candidates : (m, dof) array [rad], optional
        The configurations to choose from and to predict at, instead of the work region.
    after : ErrorMap or Samples, optional
        A first series, or its map; the plan continues it, with the hyperparameters that are fitted to it and given its
        samples, and does not repeat them.
    until : float [mm], optional
        The expected accuracy (`Plan.expected`) at which fewer poses suffice; a plan of no poses, if `after` suffices.
    rng : int
        The seed of candidates, targets and random methods.
    progress : callable
        A function of the steps done and the total number of steps.

    Returns
    -------
    Plan

    Raises
    ------
    DataError
        If the cell states no region, the method is unknown, n is not positive, or fewer poses can be measured; if
        `until` is not more than the noise of a reading, or the samples of `after` have no joints or cannot be fitted.
    RobotError
        If nothing of the region can be measured, or the robot has too many joints.

    Examples
    --------
    >>> from truepose import VirtualCell
    >>> found = plan(VirtualCell("paper").cell, 12, "sobol")
    >>> found.poses.name[:3].tolist()
    ['P001', 'P002', 'P003']
    """
    if method not in METHODS:
        raise DataError(f"unknown method {method!r}; expected one of {', '.join(METHODS)}")
    if n < 1:
        raise DataError(f"n must be at least 1 (60 or more recommended), got {n}")
    space = work_region(cell) if candidates is None else configuration_list(cell, candidates)
    reach = space.spread(_TARGETS, rng + 1)
    targets = reach.q
    if isinstance(after, Samples):
        after = _fitted(cell, after)
    prior, known = _prior(cell, space, targets, rng, after), _measured(after, targets)
    if until is not None:
        n = _needed(prior, targets, space, rng, known, until, n)
    q = known[:0]
    if n:
        q = METHODS[method](DesignProblem(space, prior, targets, n, known, rng, progress))
        q = q[shortest_tour(q, space.home)]
    previous = np.concatenate([space.home[None], q])[: len(q)]
    terms = prior.basis.terms
    geometric = terms.group != COMPLIANCE
    columns, names = terms.at(np.concatenate([known, q])).drift[:, :, geometric], np.array(terms.names)[geometric]
    return Plan(
        cell=cell,
        method=method,
        space=space,
        q=q,
        way=space.collision.way_touches(previous, space.approach_start(q)).tolist(),
        reach=reach,
        expected=_expected(prior, q, targets, space, rng, known),
        observability=observability(columns, names.tolist(), np.ones(len(names))),
        until_mm=until,
    )


def expected_accuracy(cell: Cell, q: ArrayLike, *, rng: int = 0) -> list[dict[str, float]]:
    """Return the accuracy to expect after measuring configurations, and fewer or more of them.

    Parameters
    ----------
    cell : Cell
        The cell, with a ``[region]``.
    q : (n, dof) array [rad]
        The configurations of a plan.
    rng : int
        The seed of the targets in the region.

    Returns
    -------
    list of dict
        As `Plan.expected`.

    Raises
    ------
    DataError, RobotError
        If the cell states no region, or nothing of it can be measured.

    Examples
    --------
    >>> from truepose import VirtualCell
    >>> cell = VirtualCell("paper").cell
    >>> found = plan(cell, 12, "sobol")
    >>> expected_accuracy(cell, found.q) == found.expected
    True
    """
    space = work_region(cell)
    targets = space.spread(_TARGETS, rng + 1).q
    joints = space.collision.robot.check_joints(q)
    prior = _prior(cell, space, targets, rng, None)
    return _expected(prior, joints, targets, space, rng, _measured(None, joints))


def _prior(cell: Cell, space: MeasurementSpace, targets: FloatArray, rng: int, after: ErrorMap | None) -> Prior:
    anchors = np.random.default_rng(rng).permutation(targets)[:_ANCHORS]
    if after is None:
        noise = float(np.hypot(cell.measuring.repeatability_mm, _reading_std(cell, targets)))
        return Prior.of(space.collision.robot, cell.tf_flange_tool, anchors, noise)
    if after.samples.q is None:
        raise DataError("the map's samples have no joints (q1_deg …), which a plan after it needs")
    model = after.predictor
    if not isinstance(model, KinematicKriging):
        model = KinematicKriging(after.robot, after.tf_flange_tool).fit(after.samples.q, after.e)
    return Prior.after(model, after.samples.q, anchors)


def _measured(after: ErrorMap | None, q: FloatArray) -> FloatArray:
    """Return the joints of the samples that a plan continues, (k, dof) [rad]."""
    return q[:0] if after is None or after.samples.q is None else after.samples.q


def _reading_std(cell: Cell, targets: FloatArray) -> float:
    """Return the standard deviation of readings at joints (m, dof) [rad], in each direction [mm], by the cell file."""
    p = cell.load_robot().forward(targets, tool=cell.tf_flange_tool)[:, :3, 3]
    station = cell.tf_base_tracker
    away = apply_transform(invert_transform(station), p) if station[:3, 3].any() else p + _AWAY
    std = cell.tracker.reading_std(away)
    return _READING_MM if std is None else float(np.sqrt(np.mean(std**2)))


def _expected(
    prior: Prior, q: FloatArray, targets: FloatArray, space: MeasurementSpace, rng: int, known: FloatArray
) -> list[dict[str, float]]:
    """Return the accuracy after the plan, and after fewer and more greedily chosen poses; after samples also n = 0."""
    counts = sorted({max(1, round(share * len(q))) for share in _STEPS} - {len(q)}) if len(q) else []
    forecast = Forecast.of(prior, targets, known, rng)
    found = forecast.after(q, [0, len(q)] if len(known) and len(q) else [len(q)])
    if counts:
        order = _greedy(prior, targets, space, rng, counts[-1])
        found += forecast.after(order, [k for k in counts if k <= len(order)])
    return sorted(found, key=lambda row: row["n"])


def _greedy(prior: Prior, targets: FloatArray, space: MeasurementSpace, rng: int, most: int) -> FloatArray:
    """Return configurations in the order in which they lower the mean variance most, (`most`, dof) [rad] or fewer."""
    offered = space.spread(max(_TARGETS, 2 * most), rng).q
    columns, left_out = prior.at(offered)
    rows = prior.at(targets)[0].reshape(-1, columns.shape[2])
    most, aim = min(most, len(offered)), rows.T @ rows / len(targets)
    return offered[lowest_mean(columns, prior.noise(left_out), aim, most, lambda done, of: None, passes=0)]


def _fitted(cell: Cell, samples: Samples) -> ErrorMap:
    """Return the map of a first series, whose samples must have the joints of the cell's robot."""
    robot = cell.load_robot()
    samples = on_arm(samples, robot)
    if samples.q is None:
        raise DataError(f"{samples.source}: a plan after samples needs their joints (q1_deg …), and there are none")
    if samples.q.shape[1] != robot.dof:
        raise DataError(
            f"{samples.source}: the samples have {samples.q.shape[1]} joints and {robot.name} has {robot.dof}; "
            "continue a series of this robot"
        )
    return fit_cell(cell, samples, "kinematic-kriging")


def _needed(
    prior: Prior, targets: FloatArray, space: MeasurementSpace, rng: int, known: FloatArray, until: float, most: int
) -> int:
    """Return the least number of poses that are expected to reach an accuracy [mm], or `most`.

    Raises
    ------
    DataError
        If it is not more than the length of a reading's noise.
    """
    noise = _MEAN_LENGTH * prior.hyper.noise
    if not until > noise:
        raise DataError(
            f"an accuracy of {until:g} mm cannot be reached: noise and repeatability of a reading alone are "
            f"{noise:.3f} mm; state a larger one"
        )
    forecast, order = Forecast.of(prior, targets, known, rng), _greedy(prior, targets, space, rng, most)
    most = min(most, len(order))
    coarse = np.unique(np.linspace(0 if len(known) else 1, most, _COARSE + 1).round().astype(int)).tolist()
    reached = [row["mean_mm"] <= until for row in forecast.after(order, coarse)]
    if not any(reached):
        return most
    place = reached.index(True)
    between = list(range(coarse[place - 1] + 1, coarse[place] + 1)) if place else coarse[:1]
    return next(int(row["n"]) for row in forecast.after(order, between) if row["mean_mm"] <= until)


def shortest_tour(q: ArrayLike, home: ArrayLike) -> IntArray:
    """Return an order of joints (n, dof) [rad] whose round trip from `home` (dof,) and back is short.

    The cost of a motion is that of its largest joint motion. Nearest neighbour, then 2-opt until no exchange helps.

    Examples
    --------
    >>> shortest_tour([[3.0], [1.0], [2.0]], [0.0]).tolist()
    [1, 2, 0]
    """
    stops = np.concatenate([[np.asarray(home, float)], np.asarray(q, float)])
    cost = np.abs(stops[:, None] - stops).max(axis=2)
    tour = _improved(_nearest_first(cost), cost)
    return tour[1:-1] - 1


def _nearest_first(cost: FloatArray) -> IntArray:
    """Return a round trip from stop 0 that visits the nearest open stop each time, (n + 1,)."""
    tour, open_ = [0], np.ones(len(cost), np.bool_)
    open_[0] = False
    while open_.any():
        tour.append(int(np.argmin(np.where(open_, cost[tour[-1]], np.inf))))
        open_[tour[-1]] = False
    return np.array([*tour, 0])


def _improved(tour: IntArray, cost: FloatArray) -> IntArray:
    """Reverse parts of the round trip as long as that shortens it (2-opt)."""
    better = True
    while better:
        better = False
        for i in range(len(tour) - 2):
            at, next_ = tour[:-1], tour[1:]
            saved = cost[at[i], next_[i]] + cost[at, next_] - cost[at[i], at] - cost[next_[i], next_]
            saved[: i + 2] = 0.0
            j = int(np.argmax(saved))
            if saved[j] > 1e-12:
                tour[i + 1 : j + 1] = tour[i + 1 : j + 1][::-1].copy()
                better = True
    return tour
