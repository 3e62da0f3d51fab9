"""Poses in the cell file, and the base class of all its tables."""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from truepose._io.units import parse_share
from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.geometry.angles import euler
from truepose.geometry.transforms import make_transform

LARGEST: Final = 1e6
"""The largest number accepted in a cell file, in any of its units (mm, deg, µm, kg, s)."""
SMALLEST: Final = 1e-6
"""The smallest number accepted where it must be positive."""
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=SMALLEST, le=LARGEST)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=LARGEST)]
Temperature = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-50.0, le=80.0)]
"""A temperature at which arms work [°C]."""
Share = Annotated[float, BeforeValidator(parse_share)]
"""A share between 0 and 1, written as a number or as text such as "95%"."""

ANGLE_KEYS: Final[dict[str, tuple[str, ...]]] = {
    "kuka": ("a_deg", "b_deg", "c_deg"),
    "abb": ("q1", "q2", "q3", "q4"),
    "fanuc": ("w_deg", "p_deg", "r_deg"),
    "ur": ("rx_rad", "ry_rad", "rz_rad"),
    "yaskawa": ("rx_deg", "ry_deg", "rz_deg"),
    "staubli": ("rx_deg", "ry_deg", "rz_deg"),
}
"""The keys of an orientation, by controller; `truepose.geometry.euler` defines their meaning."""
CONTROLLER: Final = {"universal-robots": "ur", "universal robots": "ur", "stäubli": "staubli"}
"""The controllers of makers with another name."""


class CellError(ValueError):
    """An error caused by several keys together; `loc` is the key at which it is reported."""

    def __init__(self, loc: tuple[str | int, ...], message: str) -> None:
        self.loc = loc
        super().__init__(message)


class CellSection(BaseModel):
    """A table of the cell file; it is frozen, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Pose(CellSection):
    """A pose as x_mm, y_mm, z_mm and the controller's angles; omitted values are zero.

    Lengths are in mm. A key such as x_m is refused, but a value in metres under x_mm cannot be distinguished from a
    short tool.
    """

    x_mm: Number = 0.0
    y_mm: Number = 0.0
    z_mm: Number = 0.0
    a_deg: Number | None = None
    b_deg: Number | None = None
    c_deg: Number | None = None
    q1: Number | None = None
    q2: Number | None = None
    q3: Number | None = None
    q4: Number | None = None
    w_deg: Number | None = None
    p_deg: Number | None = None
    r_deg: Number | None = None
    rx_rad: Number | None = None
    ry_rad: Number | None = None
    rz_rad: Number | None = None
    rx_deg: Number | None = None
    ry_deg: Number | None = None
    rz_deg: Number | None = None

    def matrix(self, controller: str | None) -> FloatArray:
        """Return the (4, 4) transform [mm]; with ``controller=None`` (maker unknown) the stated angles decide.

        Raises
        ------
        ValueError
            If the angles are those of another controller, mixed or ambiguous, or a quaternion is not of unit length.
        """
        p = np.array([self.x_mm, self.y_mm, self.z_mm])
        given = {key for keys in ANGLE_KEYS.values() for key in keys if getattr(self, key) is not None}
        if not given:
            return make_transform(translation=p)
        controller = self._controller(given) if controller is None else controller
        keys = ANGLE_KEYS[controller]
        wrong = sorted(given - set(keys))
        if wrong:
            raise CellError((wrong[0],), f"is not an angle of a {controller} controller; expected {', '.join(keys)}")
        values = [getattr(self, key) for key in keys]
        if controller == "abb" and None in values:
            raise CellError((keys[0],), "a quaternion needs all of q1, q2, q3, q4")
        try:
            return make_transform(euler(controller, np.array([value or 0.0 for value in values])), p)
        except DataError as error:
            raise CellError((keys[0],), str(error)) from None

    def _controller(self, given: set[str]) -> str:
        fitting = [name for name, keys in ANGLE_KEYS.items() if given <= set(keys)]
        if len(fitting) != 1:
            cause = f"may be those of {' or '.join(fitting)}" if fitting else "mix controllers"
            remedy = "the robot's maker is unknown; state a_deg, b_deg, c_deg (Rz Ry Rx) or q1 … q4"
            raise CellError((min(given),), f"the angles {cause}; {remedy}")
        return fitting[0]
