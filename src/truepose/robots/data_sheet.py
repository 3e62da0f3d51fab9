"""What the maker states about an arm, for display and checks; no computation depends on it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

from truepose.errors import RobotError

REACH_AT: Final = ("wrist", "flange", "unstated")
"""The points to which makers state the reach: the wrist centre, the flange, or not said."""


@dataclass(frozen=True)
class DataSheet:
    """The maker's data of an arm.

    Parameters
    ----------
    reach_mm : float, optional
        The stated reach, measured from axis 1.
    reach_at : {"wrist", "flange", "unstated"}
        The point of the arm to which the reach is stated.
    reach_rounding_mm : float
        The last digit of the stated reach: 100 for 1.2 m, 10 for R1810.
    repeatability_mm : float, optional
        The pose repeatability RP of ISO 9283.
    payload_kg : float, optional
        The rated payload.
    world_height_mm : float, optional
        The height of the controller's world frame above the mounting face. The base of the arm's description is that
        frame; None if it is at the mounting face, or not known.

    Raises
    ------
    RobotError
        If a number is not positive, or `reach_at` is unknown.

    Examples
    --------
    >>> DataSheet(reach_mm=1101, repeatability_mm=0.03).to_dict()["reach_mm"]
    1101
    """

    reach_mm: float | None = None
    reach_at: str = "wrist"
    reach_rounding_mm: float = 1.0
    repeatability_mm: float | None = None
    payload_kg: float | None = None
    world_height_mm: float | None = None

    def __post_init__(self) -> None:
        for key in ("reach_mm", "reach_rounding_mm", "repeatability_mm", "payload_kg", "world_height_mm"):
            value = getattr(self, key)
            if value is not None and not 0 < value < float("inf"):
                raise RobotError(f"data_sheet.{key} must be above 0, got {value}")
        if self.reach_at not in REACH_AT:
            raise RobotError(f'data_sheet.reach_at must be {", ".join(REACH_AT)}; got "{self.reach_at}"')

    def __str__(self) -> str:
        """Return the stated data in one line."""
        point = {"wrist": " (wrist centre)", "flange": " (flange)"}.get(self.reach_at, "")
        stated = (
            (self.reach_mm, f"reach {self.reach_mm:g} mm{point}" if self.reach_mm else ""),
            (self.repeatability_mm, f"repeatability {self.repeatability_mm} mm"),
            (self.payload_kg, f"payload {self.payload_kg:g} kg" if self.payload_kg else ""),
        )
        return ", ".join(text for value, text in stated if value is not None) or "nothing stated"

    def to_dict(self) -> dict[str, Any]:
        """Return the data as plain values."""
        return asdict(self)
