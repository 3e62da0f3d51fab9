"""From the settings of cells and the samples of a map to the limits in force and the guards that apply them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose.cell import Cell, Correction
from truepose.compensation import Guards, LimitsInForce
from truepose.errors import RobotError
from truepose.robots import Robot, status_turn
from truepose.samples import Samples

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def stated_limits(
    own: Cell | None, cell: Cell | None, options: Mapping[str, Any], space: str = "cartesian"
) -> LimitsInForce:
    """Return the settings that were stated, with their origin: option, else cell file, else map, else default.

    Parameters
    ----------
    own : Cell, optional
        The cell that the map was fitted with.
    cell : Cell, optional
        The cell file that is used instead.
    options : mapping
        Settings of ``[correction]`` that were asked for, by key; None is not stated.
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


def found_limits(limits: LimitsInForce, guards: Guards, space: str) -> LimitsInForce:
    """Return the limits in force with those that the guards found from the samples, where none is stated."""
    distance = guards.region.max_distance
    unit, value = ("mm", distance) if space == "cartesian" else ("deg", float(np.rad2deg(distance)))
    return limits.with_found(
        {
            "max_std_mm": (guards.max_std, "three quarters of the RMS error of the samples"),
            f"max_distance_{unit}": (value, "1.5 times the widest gap between samples"),
        }
    )


def arm_branches(robot: Robot, samples: Samples) -> IntArray | None:
    """Return the arm branch of each sample as KUKA's Status, (n,); None where it is not known."""
    if samples.q is None:
        return None
    try:
        return status_turn(robot, samples.q)[0]
    except RobotError:
        return None  # no KUKA arm: its programs name no Status
