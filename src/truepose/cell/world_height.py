"""Whether the poses of a cell file are relative to the controller's world where it is above the mounting face.

The base of a library arm is the frame in which its controller states positions when all frames are null. Up to version
0.2 it was the mounting face of every arm. A cell file states which of the two its poses are relative to, once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.cell.poses import CellError
from truepose.geometry.transforms import axis_translation
from truepose.robots import Robot

_SAME_MM: Final = 1.0
_KEY: Final = ("robot", "world_height_mm")


def check_world_height(
    robot: Robot, stated: float | None, bases: Mapping[int | str, FloatArray], relative: Sequence[str]
) -> None:
    """Refuse a cell file whose poses may be relative to another base than the robot's.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    stated : float, optional
        The height of the base above the mounting face [mm] that the file states.
    bases : dict of int or str to (4, 4) array [mm]
        The stated bases, robot base to frame; number 0 is the controller's world.
    relative : sequence of str
        The stated tables that are relative to the robot's base.

    Raises
    ------
    CellError
        If tables are relative to a base above the mounting face and the file does not state its height, states another
        height, or states the controller's world at this height once more.
    """
    height = robot.world_height_mm
    if height is None:
        if stated is not None:
            raise CellError(_KEY, f"the base of {robot.name} is where its file puts it; remove this key")
        return
    base = f"the base of {robot.name} is its controller's world, {height:g} mm above the mounting face"
    if stated is not None and abs(stated - height) > _SAME_MM:
        raise CellError(_KEY, f"{base}, not {stated:g} mm; correct it, or describe your arm in a file of its own")
    if 0 in bases and np.allclose(bases[0], axis_translation(2, height), rtol=0.0, atol=_SAME_MM):
        raise CellError(
            ("frames", "bases", 0),
            f"counts the height of {height:g} mm once more: {base} already; remove [frames.bases.0]",
        )
    if stated is None and relative:
        raise CellError(
            _KEY,
            f"is missing: {base} (up to version 0.2 it was the mounting face); check {', '.join(relative)}, which are "
            f"relative to it, and state world_height_mm = {height:g}",
        )
