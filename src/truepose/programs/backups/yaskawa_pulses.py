"""The pulses of one degree of each joint of a Yaskawa robot, from the limits that its controller stores.

A limit in pulses, divided by that of the data sheet in degrees, is the constant of an axis. The upper and the lower
limit must give the same constant, and the lengths of the arm must be those of the robot; otherwise nothing is said.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from truepose._typing import FloatArray
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


class Pulses(NamedTuple):
    """The constants of a robot's axes.

    Attributes
    ----------
    per_degree : tuple of 6 float
        The pulses of one degree; empty where they are not known.
    reason : str
        The reason why they are not known.
    """

    per_degree: tuple[float, ...] = ()
    reason: str = ""


def pulses_of(name: str, parameters: Sequence[Source]) -> Pulses:
    """Return the constants of robot 1.

    Parameters
    ----------
    name : str
        The robot's name in SYSTEM.SYS.
    parameters : sequence of Source
        ALL.PRM, SC.PRM and RC.PRM, those that are there.
    """
    m = _MODEL.search(name)
    model = f"yaskawa-{m[1].lower()}" if m else ""
    if model not in list_robots():
        return Pulses(reason=f"the limits of {name or 'the robot'} in degrees are not known")
    robot = load_robot(model)
    sections = [section for source in parameters for section in _sections(source)]
    if wrong := _other_lengths(robot, [rows for title, rows in sections if title == _LENGTHS]):
        return Pulses(reason=f"the controller's arm is no {robot.model}: {wrong}")
    found = {
        per_degree
        for title, rows in sections
        if title in _LIMITS
        for upper, lower in pairwise(rows)
        if (per_degree := _constants(robot, upper, lower))
    }
    if len(found) == 1:
        return Pulses(found.pop())
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
    dof = robot.dof
    if robot.limits is None or len(upper) < dof or len(lower) < dof:
        return ()
    limits: FloatArray = np.rad2deg(robot.limits)
    below, above = (np.array(row[:dof]) / limits[:, k] for k, row in enumerate((lower, upper)))
    plausible = (above > _PLAUSIBLE[0]) & (above < _PLAUSIBLE[1])
    if not (plausible & (abs(below - above) < _AGREE * above)).all():
        return ()
    return tuple(((below + above) / 2.0).tolist())


def _other_lengths(robot: Robot, sections: Sequence[list[list[float]]]) -> str:
    """Return a length of the arm that differs from the robot's; empty where all agree."""
    if not sections or len(sections[0]) < 2 or len(sections[0][0]) < 9 or len(sections[0][1]) < 3:
        return "its lengths (RC1G) are not stored"
    first, second = sections[0][:2]
    stored = {"S to L": first[1], "upper arm": first[3], "elbow": first[5], "forearm": first[8], "flange": second[2]}
    lengths = (robot.a[1], robot.a[2], robot.a[3], robot.d[3], robot.d[5])
    for (what, um), own in zip(stored.items(), lengths, strict=True):
        if abs(abs(um) * _UM - abs(float(own))) > _LENGTH_MM:
            return f"{what} {um * _UM:g} mm instead of {abs(float(own)):g} mm"
    return ""
