"""The repeatability of a robot that a map counts on: as stated, unless no such robot repeats so badly.

The known part of the repeatability is subtracted from what a predictor leaves unexplained, and sets limits. A slip in
the cell file (0.3 for 0.03, micrometres) would therefore make a map too sure of itself. The maker's value is a limit of
its own: RP is stated for the worst pose at full load and speed.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from truepose.cell import Cell
from truepose.robots import Robot

USUAL_RP_MM: Final = 0.06
"""RP of an arm where nothing is stated, that of large arms [mm]."""
_CREDIBLE: Final = 3.0  # times the maker's value


class Repeatability(NamedTuple):
    """A stated repeatability, and what is believed of it.

    Attributes
    ----------
    stated, usual : float, optional [mm]
        RP as the cell file states it, and RP of the data sheet of the robot's model.
    """

    stated: float | None
    usual: float | None

    @classmethod
    def of(cls, cell: Cell, robot: Robot) -> Repeatability:
        """Return RP [mm] as a cell states it, beside RP [mm] of the data sheet of its robot's model."""
        return cls(cell.robot.repeatability_mm, robot.data_sheet.repeatability_mm if robot.data_sheet else None)

    @property
    def known(self) -> float | None:
        """RP that a map counts on [mm]: the stated one, or the usual one where the stated one is not credible.

        Examples
        --------
        >>> Repeatability(0.05, 0.06).known, Repeatability(0.6, 0.06).known, Repeatability(None, 0.06).known
        (0.05, 0.06, None)
        """
        return (self.usual or USUAL_RP_MM) if self.doubt else self.stated

    @property
    def doubt(self) -> str:
        """Why the stated value is not believed, a sentence without a full stop; empty where it is."""
        limit = _CREDIBLE * (self.usual or USUAL_RP_MM)
        if self.stated is None or self.stated <= limit:
            return ""
        known = f"the data sheet of this robot says {self.usual:g} mm" if self.usual else "arms repeat far better"
        return (
            f"repeatability_mm = {self.stated:g} is not believed: {known}; {self.usual or USUAL_RP_MM:g} mm is used, "
            "so that a slip makes no map too sure of itself; correct the cell file, or if this robot was measured, "
            "state repeatability_mm in the file of the robot"
        )
