"""Where poses are offered: a box with the tool's orientation in it, or a list; and which of them can be measured."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from truepose._typing import FloatArray
from truepose.errors import RobotError
from truepose.geometry import make_transform
from truepose.planning.collision import Surroundings
from truepose.robots import nearest_branch
from truepose.robots.inverse.branches import SINGULAR
from truepose.robots.inverse.newton import smallest_singular


@dataclass(frozen=True, eq=False)
class Reach:
    """Configurations asked for, and why some of them are left out.

    Attributes
    ----------
    q : (n, dof) array [rad]
        Those that can be measured.
    left_out : dict of str to int
        How many of the others, by reason.
    asked : int
    """

    q: FloatArray
    left_out: dict[str, int]
    asked: int

    def describe(self) -> str:
        """Return a sentence: how much of the region can be measured, and what is in the way."""
        share = 100.0 * len(self.q) / self.asked
        why = ", ".join(f"{100.0 * n / self.asked:.0f} % {reason}" for reason, n in self.left_out.items())
        return f"{share:.0f} % of the poses offered can be measured" + (f" ({why})" if why else "")


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasurementSpace(ABC):
    """Where poses are offered, and how the arm goes to them.

    Attributes
    ----------
    collision : Surroundings
        With the arm and its tool.
    home : (dof,) array [rad]
        Joints on the branch of the work, and where the measuring program starts.
    margin : float [rad]
        From the joint limits.
    approach : float [rad]
        Every joint comes to its pose from that far below, or from above where a limit is too near.
    """

    collision: Surroundings
    home: FloatArray
    margin: float = np.deg2rad(5.0)
    approach: float = 0.0

    @abstractmethod
    def spread(self, count: int, seed: int) -> Reach:
        """Return about `count` configurations, or more, spread evenly.

        Raises
        ------
        RobotError
            If none can be measured.
        """

    def approach_signs(self, q: FloatArray) -> FloatArray:
        """Return the sign of each joint's last motion to joints (n, dof) [rad]: (n, dof) of -1, +1."""
        return np.where(q - self.approach < self.collision.robot.limits[:, 0], -1.0, 1.0)

    def before(self, q: FloatArray) -> FloatArray:
        """Return the joints that the last motion to joints (n, dof) [rad] comes from."""
        return np.asarray(q - self.approach * self.approach_signs(q))

    def measurable(self, q: FloatArray) -> Reach:
        """Return which of joints (n, dof) [rad] can be measured, and why the others cannot; NaN is out of reach."""
        around = self.collision
        low, high = around.robot.limits.T
        reason = _first_reason(
            q,
            lambda q: np.where(np.isnan(q).any(axis=1), "out of reach", ""),
            lambda q: np.where(
                ((q > low + self.margin) & (q < high - self.margin)).all(axis=1), "", "at a joint limit"
            ),
            lambda q: np.where(smallest_singular(around.robot, q) < SINGULAR, "near a singularity", ""),
            self.in_the_way,
            lambda q: np.where(around.sees(q), "", "not seen by the tracker"),
        )
        good = reason == ""
        return Reach(q[good], dict(Counter(reason[~good].tolist()).most_common()), len(q))

    def in_the_way(self, q: FloatArray) -> NDArray[np.object_]:
        """Return which box keeps the arm from joints (n, dof) [rad], there or on the ways from and to home, "" if none.

        (n,) strings.
        """
        return _first_reason(
            q,
            lambda q: _named("in the box {}", self.collision.touched(q)),
            lambda q: self._way("behind the box {} on the way from home", self.home, self.before(q)),
            lambda q: self._way("behind the box {} on the last way", self.before(q), q),
            lambda q: self._way("behind the box {} on the way home", q, self.home),
        )

    @staticmethod
    def _some(found: Reach) -> Reach:
        if not len(found.q):
            raise RobotError(
                f"{found.describe()}; check [region] (centre, orientation and home_deg), the tool, the boxes of "
                "[obstacles], the position of [tracker] and [measuring] reflector_axis"
            )
        return found

    def _way(self, wording: str, q_from: FloatArray, q_to: FloatArray) -> NDArray[np.object_]:
        return _named(wording, self.collision.way_touches(*np.broadcast_arrays(q_from, q_to)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Listed(MeasurementSpace):
    """Configurations to choose from, (n, dof) [rad], such as those of a program that runs already."""

    q: FloatArray

    def spread(self, count: int, seed: int) -> Reach:
        """Return those of the list that can be measured, however many."""
        return self._some(self.measurable(self.q))


@dataclass(frozen=True, eq=False, kw_only=True)
class WorkRegion(MeasurementSpace):
    """A box in a frame, the tool's orientation in it, and the branch on which the arm works there.

    Attributes
    ----------
    tf_base_frame : (4, 4) array [mm]
        The frame that the box is stated in.
    centre, size : (3,) arrays [mm]
        Of the box, in its frame.
    rotation : Rotation
        Of the tool at rest, in the box's frame.
    tilt : float [rad]
        By how much the work turns away from it, about each axis of the tool.
    """

    tf_base_frame: FloatArray
    centre: FloatArray
    size: FloatArray
    rotation: Rotation
    tilt: float

    @property
    def dimensions(self) -> int:
        """Of `poses`: 3 for positions, 6 with orientations."""
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
        around = self.collision
        branches = around.robot.inverse(self.poses(unit), tool=around.tf_flange_tool)
        return self.measurable(nearest_branch(branches, self.home))

    def spread(self, count: int, seed: int) -> Reach:
        """Return about `count` configurations, or more, spread evenly over the region (scrambled Sobol points)."""
        sobol = qmc.Sobol(self.dimensions, rng=np.random.default_rng(seed))
        return self._some(self.reach(sobol.random_base2(int(np.ceil(np.log2(count))))))


def _first_reason(q: FloatArray, *checks: Callable[[FloatArray], NDArray[Any]]) -> NDArray[np.object_]:
    """Return the first reason that a check has against each of joints (n, dof), "" where none has: (n,)."""
    reason = np.full(len(q), "", dtype=np.object_)
    for check in checks:
        open_ = np.flatnonzero(reason == "")
        reason[open_] = check(q[open_])
    return reason


def _named(wording: str, box: NDArray[np.str_]) -> NDArray[np.object_]:
    return np.array([wording.format(name) if name else "" for name in box], dtype=np.object_)
