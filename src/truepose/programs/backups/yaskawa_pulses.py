"""The pulses of one degree of each joint of a Yaskawa robot, from the limits that its controller stores.

A limit in pulses, divided by that of the data sheet in degrees, is the constant of an axis. The upper and the lower
limit must give the same constant, and the lengths of the arm must be those of the robot, or near them: controllers
store the lengths that were measured on their robot. Where a limit differs from that of the data sheet, the points by
which user frames were taught give the constants: the controller stores them in pulses, and the frames in millimetres.
Otherwise nothing is said.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from itertools import pairwise, product
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from truepose._typing import FloatArray
from truepose.programs.core.joint_targets import OwnLengths
from truepose.programs.core.own_arm import own_robot
from truepose.programs.core.source import Source
from truepose.robots import Robot, list_robots, load_robot

_SECTION: Final = re.compile(rb"[ \t]*///(\w+)")
_MODEL: Final = re.compile(r"\b(GP\d{1,3}\w?)\b")
_LIMITS: Final = ("S1C1G", "RC1G")
_LENGTHS: Final = "RC1G"
_AGREE: Final = 1e-3
_PLAUSIBLE: Final = (50.0, 20_000.0)
_UM: Final = 1e-3  # [mm]
_LENGTH_MM: Final = 0.5
_CALIBRATED_MM: Final = 5.0
"""How far a measured length lies from the data sheet at most; that of another robot lies farther away."""
_MOST_OPEN: Final = 3
"""The largest number of axes whose constants are sought; the limits of the others show that the rows are limits."""
_EQUATIONS: Final = 6
_SPARE: Final = 3
"""Numbers of a frame that its points give, and how many more there must be than constants."""
_FACTORS: Final = (0.75, 1.35)
"""How far a constant lies from what one of its limits gives."""
_MISS_MM: Final = 0.05
_CERTAIN: Final = 3e-4
_PLACES: Final = (("a", 1), ("a", 2), ("a", 3), ("d", 3), ("d", 5))


class Pulses(NamedTuple):
    """The constants of a robot's axes.

    Attributes
    ----------
    per_degree : tuple of 6 float
        The pulses of one degree; empty where they are not known.
    reason : str
        The reason why they are not known.
    lengths : OwnLengths, optional
        The lengths of the arm that the controller stores.
    own : str
        How these differ from those of the data sheet, in words; empty where they do not.
    """

    per_degree: tuple[float, ...] = ()
    reason: str = ""
    lengths: OwnLengths | None = None
    own: str = ""


class TaughtFrame(NamedTuple):
    """A user frame with the points by which it was taught.

    Attributes
    ----------
    tf : (4, 4) array [mm]
        The transform from the robot's base to the frame.
    tf_flange_tool : (4, 4) array [mm]
        The tool.
    pulses : (3, 6) array
        The pulses at its origin, at a point on its x axis, and at a point beside that with a positive y.
    """

    tf: FloatArray
    tf_flange_tool: FloatArray
    pulses: FloatArray


def pulses_of(name: str, parameters: Sequence[Source], taught: Sequence[TaughtFrame] = ()) -> Pulses:
    """Return the constants of robot 1.

    Parameters
    ----------
    name : str
        The robot's name in SYSTEM.SYS.
    parameters : sequence of Source
        ALL.PRM, SC.PRM and RC.PRM, those that are there.
    taught : sequence of TaughtFrame
        The user frames that were taught by points.
    """
    m = _MODEL.search(name)
    model = f"yaskawa-{m[1].lower()}" if m else ""
    if model not in list_robots():
        return Pulses(reason=f"the limits of {name or 'the robot'} in degrees are not known")
    robot = load_robot(model)
    sections = [section for source in parameters for section in _sections(source)]
    stored = _stored_lengths(robot, [rows for title, rows in sections if title == _LENGTHS])
    if not stored:
        return Pulses(reason=f"the controller's arm is no {robot.model}: its lengths (RC1G) are not stored")
    differ = {one: one.apart for one in stored if one.apart > _LENGTH_MM}
    shown = ", ".join(f"{one.what} {one.mm:g} mm instead of {one.nominal:g} mm" for one in differ)
    if any(apart > (_CALIBRATED_MM if one.nominal else 0.0) for one, apart in differ.items()):
        return Pulses(reason=f"the controller's arm is no {robot.model}: {shown}")
    a, d = ([math.nan] * robot.dof for _ in range(2))
    for one in stored:
        (a if one.place[0] == "a" else d)[one.place[1]] = one.mm if one.nominal else math.nan
    lengths = OwnLengths(tuple(a), tuple(d))
    limits = [pair for title, rows in sections if title in _LIMITS for pair in pairwise(rows)]
    found = {per_degree for upper, lower in limits if (per_degree := _constants(robot, upper, lower))}
    if not found and taught:
        arm = own_robot(lengths, robot)
        found = {per_degree for pair in limits if (per_degree := _from_frames(arm, *pair, taught))}
    if len(found) == 1:
        return Pulses(found.pop(), "", lengths, shown)
    several = "agree with no limits of the data sheet: one was changed" if not found else "allow several constants"
    return Pulses(reason=f"the limits in ALL.PRM {several}")


def _sections(source: Source) -> Iterator[tuple[str, list[list[float]]]]:
    """Yield the sections of a parameter file with their rows of numbers."""
    title, rows = "", list[list[float]]()
    for _, start, end in source.lines():
        text = source.data[start:end]
        if m := _SECTION.match(text):
            if m[1] != b"CRC":
                if title:
                    yield title, rows
                title, rows = m[1].decode("latin-1").upper(), []
        elif text.strip() and not text.lstrip().startswith(b"/"):
            try:
                rows.append([float(token) for token in text.split(b",") if token.strip()])
            except ValueError:
                rows.append([])
    if title:
        yield title, rows


def _constants(robot: Robot, upper: Sequence[float], lower: Sequence[float]) -> tuple[float, ...]:
    """Return the constants that two rows of limits give; empty where they are no limits of this robot."""
    below, above = _by_limits(robot, upper, lower)
    if not len(above) or not (abs(below - above) < _AGREE * above).all():
        return ()
    return tuple(((below + above) / 2.0).tolist())


def _by_limits(robot: Robot, upper: Sequence[float], lower: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return the constants that two rows give by the lower and the upper limits; nothing where they are no limits."""
    dof = robot.dof
    if robot.limits is None or len(upper) < dof or len(lower) < dof:
        return np.empty(0), np.empty(0)
    limits: FloatArray = np.rad2deg(robot.limits)
    below, above = (np.array(row[:dof]) / limits[:, k] for k, row in enumerate((lower, upper)))
    plausible = [(one > _PLAUSIBLE[0]) & (one < _PLAUSIBLE[1]) for one in (below, above)]
    return (below, above) if np.all(plausible) else (np.empty(0), np.empty(0))


def _from_frames(
    robot: Robot, upper: Sequence[float], lower: Sequence[float], taught: Sequence[TaughtFrame]
) -> tuple[float, ...]:
    """Return the constants by which the points of user frames lie where these are; nothing where none are certain.

    Only axes whose limits disagree with the data sheet are sought, by one of their limits at first.
    """
    below, above = _by_limits(robot, upper, lower)
    open_ = np.flatnonzero(abs(below - above) >= _AGREE * above) if len(above) else np.empty(0, int)
    if not 0 < len(open_) <= _MOST_OPEN or len(taught) * _EQUATIONS < len(open_) + _SPARE:
        return ()
    known = (below + above) / 2.0
    found = []
    for first in product(*zip(below[open_], above[open_], strict=True)):

        def misses(factors: FloatArray, first: tuple[float, ...] = first) -> FloatArray:
            constants = known.copy()
            constants[open_] = np.array(first) * factors
            return _misses(robot, constants, taught)

        fit = least_squares(misses, np.ones(len(open_)), x_scale=1e-3, bounds=_FACTORS)
        weakest = float(np.linalg.svd(np.asarray(fit.jac, float), compute_uv=False).min())
        if abs(fit.fun).max() <= _MISS_MM and _CERTAIN * weakest >= _MISS_MM:
            constants = known.copy()
            constants[open_] = np.array(first) * fit.x
            found.append(constants)
    if not found or any((abs(one - found[0]) > _CERTAIN * found[0]).any() for one in found):
        return ()
    return tuple(found[0].tolist())


def _misses(robot: Robot, constants: FloatArray, taught: Sequence[TaughtFrame]) -> FloatArray:
    """Return how far the points of user frames lie from these [mm]: six numbers for each frame."""
    found = []
    for one in taught:
        tools = robot.forward(np.deg2rad(one.pulses / constants)) @ one.tf_flange_tool
        p = (tools[:, :3, 3] - one.tf[:3, 3]) @ one.tf[:3, :3]
        found.append([*p[0], *p[1, 1:], p[2, 2]])
    return np.concatenate(found)


class _Length(NamedTuple):
    """A length [mm] as the controller stores it, that of the data sheet, and its place among the parameters."""

    what: str
    mm: float
    nominal: float
    place: tuple[str, int]

    @property
    def apart(self) -> float:
        """The distance [mm] from the data sheet."""
        return abs(self.mm - self.nominal)


def _stored_lengths(robot: Robot, sections: Sequence[list[list[float]]]) -> list[_Length]:
    """Return the lengths of the arm; none where they are not stored."""
    if not sections or len(sections[0]) < 2 or len(sections[0][0]) < 9 or len(sections[0][1]) < 3:
        return []
    first, second = sections[0][:2]
    stored = {"S to L": first[1], "upper arm": first[3], "elbow": first[5], "forearm": first[8], "flange": second[2]}
    found = []
    for (what, um), (table, k) in zip(stored.items(), _PLACES, strict=True):
        nominal = abs(float(getattr(robot, table)[k]))
        found.append(_Length(what, round(abs(um) * _UM, 6), nominal, (table, k)))
    return found
