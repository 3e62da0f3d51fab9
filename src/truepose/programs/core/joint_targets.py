"""Joint targets: the joints that a program commands, as a controller writes them.

Readers give the numbers with their form and know no robot. Poses are made where the robot of the map is known
(`truepose.programs.joint_correction`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, Self

import numpy as np

from truepose._typing import FloatArray
from truepose.programs.core.source import Span

MOST_JOINTS: Final = 6
"""The largest number of joints of a joint target: arms with more reach a pose in infinitely many ways."""
STATE: Final = "state that the map was measured with commands of this controller (--controller-kinematics)"
"""What allows joints of a controller with an arm of its own."""


class OwnArm(NamedTuple):
    """The arm as the controller calculates with it: standard D-H parameters that the program states.

    Attributes
    ----------
    theta, alpha : tuple of float [rad]
        The joint offsets and the twists.
    a, d : tuple of float [mm]
        The lengths and the offsets along the axes.
    stated : bool
        Whether the user states that the map was measured with commands of this controller.
    """

    theta: tuple[float, ...]
    alpha: tuple[float, ...]
    a: tuple[float, ...]
    d: tuple[float, ...]
    stated: bool = False


class OwnLengths(NamedTuple):
    """The lengths of the arm as the controller stores them: those of the map's arm, measured on this very robot.

    Attributes
    ----------
    a, d : tuple of float [mm]
        The magnitudes of the lengths and of the offsets along the axes; NaN where they are those of the map's arm.
    """

    a: tuple[float, ...]
    d: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class JointForm:
    """How a controller writes the joints of a target.

    Attributes
    ----------
    unit : {"deg", "rad", "pulse"}
        The unit of the numbers, for the record.
    scale : tuple of float [rad]
        The joint angle that one unit of each number means; negative where it counts against the robot's joint. Its
        length is the number of joints.
    step : float [unit]
        The smallest step of a written number, unless a number is finer already.
    ground : bool
        Whether J3 counts from the ground, as FANUC's does, where the robot file states no coupling; see
        `truepose.robots.shown_joints`.
    arm : OwnArm or OwnLengths, optional
        The arm as the controller calculates with it; None: that of the map.
    """

    unit: Literal["deg", "rad", "pulse"]
    scale: tuple[float, ...]
    step: float
    ground: bool = False
    arm: OwnArm | OwnLengths | None = None

    @property
    def count(self) -> int:
        """The number of joints."""
        return len(self.scale)

    def joints(self, numbers: FloatArray) -> FloatArray:
        """Return the joints as the controller shows them (…, dof) [rad] of numbers, or the change of a change."""
        return np.asarray(numbers[..., : self.count] * np.array(self.scale))

    def numbers(self, shown: FloatArray) -> FloatArray:
        """Return the numbers (…, dof) of joints as the controller shows them [rad], or the change of a change."""
        return np.asarray(shown / np.array(self.scale))


def in_degrees(step: float, *, ground: bool = False, count: int = MOST_JOINTS) -> JointForm:
    """Return the form of joints in degrees."""
    return JointForm("deg", (math.radians(1.0),) * count, step, ground)


def in_radians(step: float, count: int = MOST_JOINTS) -> JointForm:
    """Return the form of joints in radians."""
    return JointForm("rad", (1.0,) * count, step)


def in_pulses(per_degree: tuple[float, ...], arm: OwnLengths | None = None) -> JointForm:
    """Return the form of joints in whole pulses of the motors.

    `per_degree` are the pulses of one degree of each joint; negative where they count against the robot's joint. Joints
    at zero have zero pulses, and no joint moves another.

    Examples
    --------
    >>> in_pulses((1000.0, -500.0)).joints(np.array([90000.0, 45000.0])).round(4)
    array([ 1.5708, -1.5708])
    """
    return JointForm("pulse", tuple([math.radians(1.0) / pulses for pulses in per_degree]), 1.0, arm=arm)


KUKA: Final = in_degrees(1e-5)
ABB: Final = in_degrees(1e-5)
FANUC: Final = in_degrees(1e-3, ground=True)
UR: Final = in_radians(1e-7)


class JointNumbers(NamedTuple):
    """The joints of a point: values in the controller's unit, their bytes, and their form."""

    values: tuple[float, ...]
    spans: tuple[Span, ...]
    form: JointForm


@dataclass(frozen=True, eq=False)
class JointOutcomes:
    """The outcomes of the joint targets among n targets; NaN at all others.

    Attributes
    ----------
    p, change : (n, 3) arrays [mm], base frame
        The positions of the tool at the joints, and how far the written joints move it.
    after : (n, 6) array [the controller's unit]
        The numbers that are written; NaN where a target is not corrected.
    remaining : (n,) array [mm]
        The distances between the positions of the written joints and the wanted ones, since joints have few digits.
    """

    p: FloatArray
    change: FloatArray
    after: FloatArray
    remaining: FloatArray

    @classmethod
    def none(cls, n: int) -> Self:
        """Return the outcomes before any correction."""
        p, change, after, remaining = (np.full((n, k), np.nan) for k in (3, 3, MOST_JOINTS, 1))
        return cls(p, change, after, remaining[:, 0])

    def summary(self) -> dict[str, float | int]:
        """Return the number of corrected joint targets, and the largest remaining distance [mm]."""
        written = np.isfinite(self.remaining)
        largest = float(self.remaining[written].max(initial=0.0))
        return {"joint_targets": int(np.count_nonzero(written)), "largest_remaining_mm": largest}
