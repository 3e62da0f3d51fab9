"""The limits of corrections in force, from the settings of cells and the samples of a map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from truepose._typing import IntArray
from truepose.cell import Cell, Correction
from truepose.compensation import Guards, LimitsInForce
from truepose.error_map.repeatability import USUAL_RP_MM, Repeatability
from truepose.errors import RobotError
from truepose.robots import Robot, status_turn
from truepose.samples import Samples

STD_PER_TOLERANCE: Final = 0.5
"""Largest standard deviation as a share of the tolerance: an error of twice that is still within the tolerance."""
STD_PER_RP: Final = 4.0
"""Largest standard deviation as a multiple of RP: errors of arms are ten RP and more; half of that is no gain."""


def stated_limits(
    own: Cell | None, cell: Cell | None, options: Mapping[str, Any], space: str = "cartesian"
) -> LimitsInForce:
    """Return the stated settings with their origin: option, else cell file, else map, else default.

    Parameters
    ----------
    own : Cell, optional
        The cell that the map was fitted with.
    cell : Cell, optional
        The cell file that is used instead.
    options : mapping
        The settings of ``[correction]`` by key; None is not stated.
    space : {"cartesian", "joint"}
        The space of the map.

    Raises
    ------
    DataError
        If a stated limit can have no effect on a map in this space.
    """

    def of(stating: Cell | None) -> dict[str, Any]:
        return {} if stating is None else stating.correction.model_dump(exclude_unset=True)

    default = Correction().model_dump()
    return LimitsInForce.of(
        ("default", default), ("map", of(own)), ("cell file", of(cell)), ("option", options), space=space
    )


def found_limits(limits: LimitsInForce, guards: Guards, space: str, repeatability: Repeatability) -> LimitsInForce:
    """Return the limits in force, completed by those that follow from the cell or from the samples."""
    distance = guards.region.max_distance
    unit, value = ("mm", distance) if space == "cartesian" else ("deg", float(np.rad2deg(distance)))
    return limits.with_found(
        {
            "max_std_mm": _largest_std(limits.values.get("tolerance_mm"), repeatability),
            f"max_distance_{unit}": (value, "1.5 times the widest gap between samples"),
        }
    )


def _largest_std(tolerance_mm: float | None, repeatability: Repeatability) -> tuple[float, str]:
    """Return the default of the largest standard deviation [mm] and its origin; it does not depend on the samples."""
    if tolerance_mm is not None:
        return STD_PER_TOLERANCE * tolerance_mm, "half of tolerance_mm"
    if repeatability.known is not None:
        whose = "the usual repeatability" if repeatability.doubt else "the robot's repeatability_mm"
        return STD_PER_RP * repeatability.known, f"{STD_PER_RP:g} times {whose}"
    return STD_PER_RP * USUAL_RP_MM, f"{STD_PER_RP:g} times {USUAL_RP_MM} mm, since no repeatability_mm is stated"


def arm_branches(robot: Robot, samples: Samples) -> IntArray | None:
    """Return the arm branch of each sample as KUKA's Status, (n,); None where it is unknown."""
    if samples.q is None:
        return None
    try:
        return status_turn(robot, samples.q)[0]
    except RobotError:
        return None  # no KUKA arm: its programs name no Status
