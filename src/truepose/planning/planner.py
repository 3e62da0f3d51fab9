"""The plan of a measurement: which poses, in which order, what accuracy to expect, and the program that goes there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.error_map import ErrorMap
from truepose.errors import DataError
from truepose.geometry import apply_transform, invert_transform
from truepose.identification import Observability, observability
from truepose.planning.designs import METHODS, Task
from truepose.planning.measurement_space import listed, work_region
from truepose.planning.measuring import measuring_program, write_measurement
from truepose.planning.prior import Prior
from truepose.planning.region import MeasurementSpace, Reach
from truepose.planning.selection import Progress, lowest_mean
from truepose.planning.tour import shortest_tour
from truepose.predictors import KinematicKriging
from truepose.predictors.kinematic.terms import COMPLIANCE
from truepose.samples import Poses

_TARGETS: Final = 512
_ANCHORS: Final = 120
_READING_MM: Final = 0.015  # standard deviation of a reading where the cell says nothing of its tracker
_STEPS: Final = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0)
_AWAY: Final = np.array([2000.0, 0.0, 0.0])  # mm: where a tracker is taken to stand, seen from the base


@dataclass(frozen=True, eq=False)
class Plan:
    """Configurations to measure, in order.

    Attributes
    ----------
    cell : Cell
    method : str
        Of `truepose.planning.METHODS`.
    ground : MeasurementSpace
    q : (n, dof) array [rad]
    way : list of str
        For each pose, the box that the straight way from the one before would touch, or ""; where there is one the
        program goes by home.
    reach : Reach
        How much of the work region can be measured.
    expected : list of dict
        ``n`` poses of this plan and ``mean_mm``, the mean length by which a reading in the work region will then differ
        from its prediction, noise included. Beyond the plan's own n: with as many poses again of the same method.
    observability : Observability
        Of registration and geometry.
    """

    cell: Cell
    method: str
    ground: MeasurementSpace
    q: FloatArray
    way: list[str]
    reach: Reach
    expected: list[dict[str, float]]
    observability: Observability

    @property
    def poses(self) -> Poses:
        """The plan as a table, named P001 and on: joints, commanded poses of the tool as stated, approach."""
        tf = self.cell.load_robot().forward(self.q, tool=self.cell.tf_flange_tool)
        return Poses(
            q=self.q,
            p_cmd=tf[:, :3, 3],
            rotation_cmd=Rotation.from_matrix(tf[:, :3, :3]),
            approach=self.ground.approach_signs(self.q),
            name=np.array([f"P{number:03d}" for number in range(1, len(self.q) + 1)]),
            source=f"{len(self.q)} poses, {self.method}",
        )

    @property
    def expected_mm(self) -> float:
        """Mean length by which a reading in the work region will differ from its prediction after this plan [mm]."""
        return next(row["mean_mm"] for row in self.expected if row["n"] == len(self.q))

    def program(self, name: str = "measure") -> tuple[str, str]:
        """Return the ending and the text of the measuring program, see `measuring_program`."""
        return measuring_program(self.cell, self.poses, ground=self.ground, name=name)

    def write(self, directory: str | Path) -> list[Path]:
        """Write plan.csv and, where the maker's language is known, the measuring program; return their paths."""
        return write_measurement(Path(directory) / "plan.csv", self.cell, self.poses, ground=self.ground)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for a screen or a file."""
        return {
            "method": self.method,
            "n": len(self.q),
            "measurable_percent": 100.0 * len(self.reach.q) / self.reach.asked,
            "left_out": self.reach.left_out,
            "expected": self.expected,
            "by_home": sum(box != "" for box in self.way),
            "observability": self.observability.indices,
            "not_told": self.observability.describe(),
        }


def plan(
    cell: Cell,
    n: int,
    method: str = "posterior",
    *,
    candidates: FloatArray | None = None,
    after: ErrorMap | None = None,
    seed: int = 0,
    progress: Progress = lambda done, of: None,
) -> Plan:
    """Choose n configurations of the cell's work region to measure.

    Parameters
    ----------
    cell : Cell
        With ``[region]``; ``[measuring]``, ``[obstacles]`` and the position of ``[tracker]`` count where stated.
    n : int
    method : str
        Of `truepose.planning.METHODS`. "posterior" leaves the lowest mean predicted variance over the region,
        "posterior-largest" the lowest largest, both by the prior of theory (10); "d-optimal", "o2" … "o5" are
        observability indices of the geometry; "grid", "latin-hypercube" and "sobol" know no model.
    candidates : (m, dof) array [rad], optional
        Choose among these instead of the work region, for predictions at all of them.
    after : ErrorMap, optional
        Of a first series: what to measure next, with its fitted hyperparameters and given its samples.
    seed : int
        Of candidates, targets and random methods.
    progress : callable
        Takes steps done and steps in all.

    Returns
    -------
    Plan

    Raises
    ------
    DataError
        If the cell states no region, the method is unknown, n is not positive, or fewer poses can be measured.
    RobotError
        If nothing of the region can be measured, or the robot's joints are too many.
    """
    if method not in METHODS:
        raise DataError(f"no method {method!r}; there are {', '.join(METHODS)}")
    if n < 1:
        raise DataError(f"{n} poses are no plan; ask for 1 or more, better 60")
    ground = work_region(cell) if candidates is None else listed(cell, candidates)
    reach = ground.spread(_TARGETS, seed + 1)
    targets = reach.q
    prior = _prior(cell, ground, targets, seed, after)
    q = METHODS[method](Task(ground, prior, targets, n, seed, progress))
    q = q[shortest_tour(q, ground.home)]
    came_from = np.concatenate([ground.home[None], q[:-1]])
    terms = prior.basis.terms
    columns, names = (
        terms.at(q).drift[:, :, terms.group != COMPLIANCE],
        np.array(terms.names)[terms.group != COMPLIANCE],
    )
    return Plan(
        cell=cell,
        method=method,
        ground=ground,
        q=q,
        way=ground.collision.way_touches(came_from, ground.before(q)).tolist(),
        reach=reach,
        expected=_expected(prior, q, targets, ground, seed),
        observability=observability(columns, names.tolist(), np.ones(len(names))),
    )


def _prior(cell: Cell, ground: MeasurementSpace, targets: FloatArray, seed: int, after: ErrorMap | None) -> Prior:
    anchors = np.random.default_rng(seed).permutation(targets)[:_ANCHORS]
    if after is None:
        noise = float(np.hypot(cell.measuring.repeatability_mm, _reading_std(cell, targets)))
        return Prior.of(ground.collision.robot, cell.tf_flange_tool, anchors, noise)
    if after.samples.q is None:
        raise DataError("the map's samples have no joints; what to measure next is told of joints (q1_deg …)")
    model = after.predictor
    if not isinstance(model, KinematicKriging):
        model = KinematicKriging(after.robot, after.tf_flange_tool).fit(after.samples.q, after.e)
    return Prior.after(model, after.samples.q, anchors)


def _reading_std(cell: Cell, targets: FloatArray) -> float:
    """Return the standard deviation of readings at joints (m, dof) [rad], in each direction [mm], as the cell says."""
    p = cell.load_robot().forward(targets, tool=cell.tf_flange_tool)[:, :3, 3]
    station = cell.tf_base_tracker
    away = apply_transform(invert_transform(station), p) if station[:3, 3].any() else p + _AWAY
    std = cell.tracker.reading_std(away)
    return _READING_MM if std is None else float(np.sqrt(np.mean(std**2)))


def _expected(
    prior: Prior, q: FloatArray, targets: FloatArray, ground: MeasurementSpace, seed: int
) -> list[dict[str, float]]:
    """Accuracy of the plan, and of fewer and more poses chosen one after the other for the lowest mean variance."""
    counts = sorted({max(1, round(share * len(q))) for share in _STEPS} - {len(q)})
    offered = ground.spread(max(_TARGETS, 2 * counts[-1]), seed).q
    columns, left_out = prior.at(offered)
    rows = prior.at(targets)[0].reshape(-1, columns.shape[2])
    aim = rows.T @ rows / len(targets)
    most = min(counts[-1], len(offered))
    order = lowest_mean(columns, prior.noise(left_out), aim, most, lambda done, of: None, passes=0)
    found = {k: prior.given(offered[order[:k]]).expected(targets) for k in counts if k <= most}
    found[len(q)] = prior.given(q).expected(targets)
    return [{"n": k, "mean_mm": found[k]} for k in sorted(found)]
