"""Units of a robot file that contradict its numbers: radians under degrees, metres under millimetres."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from truepose.errors import FileError
from truepose.robots.chain import Chain

_SMALLEST_ARM: Final = 10.0  # sum of all lengths [mm]; an arm in metres under mm has less
_LARGEST_ARM: Final = 1e5
_ROUNDED: Final = 3e-3  # 1.57 for half of pi


def check_units(robot: Chain, path: str | Path) -> None:
    """Raise a FileError if angles in degrees look like radians, or lengths in mm like metres or micrometres.

    A column of angles is taken for radians if none is above 2 pi and one is a multiple of pi/2, except 0. A column of
    limits is, if none is above 2 pi.

    Parameters
    ----------
    robot : Chain
        The robot that was read.
    path : str or Path
        The file, for messages.

    Examples
    --------
    >>> from truepose.robots import Robot
    >>> try:
    ...     check_units(Robot("one", alpha=[np.deg2rad(1.5708)], a=[250.0], d=[0], offset=[0]), "arm.toml")
    ... except FileError as error:
    ...     str(error)[:70]
    'arm.toml: alpha of joint 1 is 1.5708 degrees; is it in radians? Conver'
    """
    for name, angles in (("alpha", robot.alpha), ("offset", robot.offset)):
        degrees = np.rad2deg(angles)
        quarters = np.round(degrees / (np.pi / 2))
        found = np.flatnonzero((quarters != 0) & (np.abs(degrees - quarters * np.pi / 2) < _ROUNDED))
        if len(found) and np.abs(degrees).max() < 7.0:
            message = f"{name} of joint {found[0] + 1} is {degrees[found[0]]:g} degrees; is it in radians?"
            raise FileError(path, f"{message} Convert it, or name the column of a table {name}_rad")
    limits = np.rad2deg(robot.limits)
    if np.isfinite(limits).all() and np.abs(limits).max() < 7.0:
        message = f"no joint moves farther than {np.abs(limits).max():g} degrees; are the limits in radians?"
        raise FileError(path, f"{message} Convert them, or name the columns of a table lower_rad and upper_rad")
    length = float(np.abs(robot.a).sum() + np.abs(robot.d).sum())
    if 0.0 < length < _SMALLEST_ARM:
        message = f"all links together are {length:g} mm long; are they in metres?"
        raise FileError(path, f"{message} Convert them, or name the columns of a table a_m and d_m")
    if length > _LARGEST_ARM:
        raise FileError(path, f"all links together are {length / 1000:g} m long; are they in another unit?")
