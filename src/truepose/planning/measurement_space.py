"""Where poses are measured: a work region or a list, the checks that leave poses out, and what a cell file states."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.cell.sections import RegionSection
from truepose.errors import DataError, RobotError
from truepose.geometry import make_transform
from truepose.planning.collision import CollisionModel
from truepose.robots import nearest_branch
from truepose.robots.inverse.branches import SINGULAR
from truepose.robots.inverse.newton import smallest_singular

_MIXING: Final = (30.0, 90.0)  # 1/rad: a side changes with some hundredths of a radian of any joint


@dataclass(frozen=True, eq=False)
class Reach:
    """The measurable ones among some configurations, and why the others are left out.

    Attributes
    ----------
    q : (n, dof) array [rad]
        The configurations that can be measured.
    left_out : dict of str to int
        The number of configurations left out, by reason.
    asked : int
        The number of configurations that were checked.
    """

    q: FloatArray
    left_out: dict[str, int]
    asked: int

    def describe(self) -> str:
        """Return a sentence on how much of the region can be measured, and the obstacles."""
        share = 100.0 * len(self.q) / self.asked
        why = ", ".join(f"{100.0 * n / self.asked:.0f} % {reason}" for reason, n in self.left_out.items())
        return f"{share:.0f} % of the poses offered can be measured" + (f" ({why})" if why else "")


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasurementSpace(ABC):
    """The poses that can be chosen, and how the arm moves to them.

    Attributes
    ----------
    collision : CollisionModel
        The model of arm, tool, boxes and tracker.
    home : (dof,) array [rad]
        The joints on the branch of the work, where the measuring program starts.
    margin : float [rad]
        The smallest distance to the joint limits.
    approach : float [rad]
        The last motion of every joint.
    both_sides : bool
        Whether joints come from either side, in about half of the poses each, which separates backlash from the shape
        of the errors; otherwise from below. Where a limit is too near, a joint comes from the other side.
    """

    collision: CollisionModel
    home: FloatArray
    margin: float = np.deg2rad(5.0)
    approach: float = 0.0
    both_sides: bool = False

    @abstractmethod
    def spread(self, count: int, rng: int) -> Reach:
        """Return about `count` configurations, or more, spread evenly.

        Raises
        ------
        RobotError
            If none can be measured.
        """

    def approach_signs(self, q: FloatArray) -> FloatArray:
        """Return the sign of each joint's last motion to joints (n, dof) [rad]: (n, dof) of -1, +1.

        The side is a function of the pose that varies from pose to pose as if it were drawn.
        """
        wanted = np.ones_like(q)
        if self.both_sides:
            mixed = q @ np.random.default_rng(0).uniform(*_MIXING, (q.shape[1],) * 2)
            wanted = np.where(np.floor(mixed) % 2.0, 1.0, -1.0)
        low, high = self.collision.robot.limits.T
        beyond = (q - self.approach * wanted < low) | (q - self.approach * wanted > high)
        return np.where(beyond, -wanted, wanted)

    def approach_start(self, q: FloatArray, signs: FloatArray | None = None) -> FloatArray:
        """Return the joints at the start of the last motion to joints (n, dof) [rad]; sides that are 0 are chosen."""
        chosen = self.approach_signs(q)
        return np.asarray(q - self.approach * (chosen if signs is None else np.where(signs == 0.0, chosen, signs)))

    def measurable(self, q: FloatArray) -> Reach:
        """Return which of joints (n, dof) [rad] can be measured, and why the others cannot; NaN is out of reach."""
        collision = self.collision
        low, high = collision.robot.limits.T
        reason = _first_reason(
            q,
            lambda q: np.where(np.isnan(q).any(axis=1), "out of reach", ""),
            lambda q: np.where(
                ((q > low + self.margin) & (q < high - self.margin)).all(axis=1), "", "at a joint limit"
            ),
            lambda q: np.where(smallest_singular(collision.robot, q) < SINGULAR, "near a singularity", ""),
            self.in_the_way,
            lambda q: np.where(collision.sees(q), "", "not seen by the tracker"),
        )
        good = reason == ""
        return Reach(q[good], dict(Counter(reason[~good].tolist()).most_common()), len(q))

    def in_the_way(self, q: FloatArray) -> NDArray[np.object_]:
        """Return the box that blocks joints (n, dof) [rad], or the ways from and to home, "" if none: (n,) of str."""
        return _first_reason(
            q,
            lambda q: _named("in the box {}", self.collision.touched(q)),
            lambda q: self._way("behind the box {} on the way from home", self.home, self.approach_start(q)),
            lambda q: self._way("behind the box {} on the last way", self.approach_start(q), q),
            lambda q: self._way("behind the box {} on the way home", q, self.home),
        )

    @staticmethod
    def _checked(found: Reach) -> Reach:
        if not len(found.q):
            raise RobotError(
                f"{found.describe()}; check [region] (centre, orientation and home_deg), the tool, the boxes of "
                "[obstacles], the position of [tracker] and [measuring] reflector_axis"
            )
        return found

    def _way(self, wording: str, q_from: FloatArray, q_to: FloatArray) -> NDArray[np.object_]:
        return _named(wording, self.collision.way_touches(*np.broadcast_arrays(q_from, q_to)))


@dataclass(frozen=True, eq=False, kw_only=True)
class ConfigurationList(MeasurementSpace):
    """Configurations to choose from, (n, dof) [rad], such as those of an existing program."""

    q: FloatArray

    def spread(self, count: int, rng: int) -> Reach:
        """Return the configurations of the list that can be measured."""
        return self._checked(self.measurable(self.q))


@dataclass(frozen=True, eq=False, kw_only=True)
class WorkRegion(MeasurementSpace):
    """A box in a frame, and the tool's orientations in it.

    Attributes
    ----------
    tf_base_frame : (4, 4) array [mm]
        The frame in which the box is stated.
    centre, size : (3,) arrays [mm]
        The centre and the edges of the box, in its frame.
    rotation : Rotation
        The tool's mean orientation, in the box's frame.
    tilt : float [rad]
        The largest rotation away from it, about each axis of the tool.
    """

    tf_base_frame: FloatArray
    centre: FloatArray
    size: FloatArray
    rotation: Rotation
    tilt: float

    @property
    def dimensions(self) -> int:
        """The dimensions of `poses`: 3 for positions, 6 with orientations."""
        return 6 if self.tilt else 3

    def poses(self, unit: FloatArray) -> FloatArray:
        """Return tool poses in the base frame, (n, 4, 4) [mm], of points of the unit cube, (n, 3) or (n, 6)."""
        shift = np.asarray(unit, float) - 0.5
        turn = np.zeros((len(shift), 3))
        turn[:, : shift.shape[1] - 3] = 2.0 * self.tilt * shift[:, 3:]
        inside = make_transform(self.rotation * Rotation.from_rotvec(turn), self.centre + shift[:, :3] * self.size)
        return np.asarray(self.tf_base_frame @ inside)

    def reach(self, unit: FloatArray) -> Reach:
        """Return the configurations for points of the unit cube that can be measured, and why others cannot."""
        collision = self.collision
        branches = collision.robot.inverse(self.poses(unit), tool=collision.tf_flange_tool)
        return self.measurable(nearest_branch(branches, self.home))

    def spread(self, count: int, rng: int) -> Reach:
        """Return about `count` configurations, or more, spread evenly over the region (scrambled Sobol points)."""
        sobol = qmc.Sobol(self.dimensions, rng=np.random.default_rng(rng))
        return self._checked(self.reach(sobol.random_base2(int(np.ceil(np.log2(count))))))


def _first_reason(q: FloatArray, *checks: Callable[[FloatArray], NDArray[Any]]) -> NDArray[np.object_]:
    """Return the first objection of the checks to each of joints (n, dof), "" where there is none: (n,)."""
    reason = np.full(len(q), "", dtype=np.object_)
    for check in checks:
        open_ = np.flatnonzero(reason == "")
        reason[open_] = check(q[open_])
    return reason


def _named(wording: str, box: NDArray[np.str_]) -> NDArray[np.object_]:
    return np.array([wording.format(name) if name else "" for name in box], dtype=np.object_)


def work_region(cell: Cell) -> WorkRegion:
    """Return the work region that a cell states, with obstacles and tracker.

    Raises
    ------
    DataError
        If it states none, or its frame is not among ``[frames.bases]``.
    """
    region = cell.region
    if region is None:
        raise DataError("the cell has no [region]: state the work region's centre, size_mm and home_deg in cell.toml")
    inside = region.matrix(cell.controller)
    return WorkRegion(
        **_space_arguments(cell),
        home=np.deg2rad(region.home_deg),
        tf_base_frame=_frame(cell, region),
        centre=inside[:3, 3],
        size=np.array(region.size_mm),
        rotation=Rotation.from_matrix(inside[:3, :3]),
        tilt=np.deg2rad(region.tilt_deg),
    )


def configuration_list(cell: Cell, candidates: FloatArray) -> ConfigurationList:
    """Return configurations to choose from, with obstacles and tracker; home is the region's, or the first of them.

    Raises
    ------
    DataError
        If they are not joint vectors of the robot.
    """
    q = cell.load_robot().check_joints(candidates)
    return ConfigurationList(
        **_space_arguments(cell), home=q[0] if cell.region is None else np.deg2rad(cell.region.home_deg), q=q
    )


def _space_arguments(cell: Cell) -> dict[str, Any]:
    """Return the arguments of `MeasurementSpace` other than home."""
    how, station = cell.measuring, cell.tf_base_tracker[:3, 3]
    collision = CollisionModel(
        robot=cell.load_robot(),
        tf_flange_tool=cell.tf_flange_tool,
        boxes={name: np.array([box.x_mm, box.y_mm, box.z_mm]).T for name, box in cell.obstacles.items()},
        link_radius=how.link_radius_mm,
        p_tracker=station if station.any() else None,
        reflector_axis=None if how.reflector_axis is None else np.array(how.reflector_axis),
        acceptance=np.deg2rad(how.acceptance_deg),
    )
    return {
        "collision": collision,
        "margin": np.deg2rad(how.limit_margin_deg),
        "approach": np.deg2rad(how.approach_deg),
        "both_sides": how.approach == "both",
    }


def _frame(cell: Cell, region: RegionSection) -> FloatArray:
    if region.frame is None:
        return np.eye(4)
    if region.frame not in cell.bases:
        known = ", ".join(map(str, cell.bases)) or "none"
        raise DataError(f"[region] frame {region.frame} is not among [frames.bases] (known: {known})")
    return cell.bases[region.frame]
