"""The virtual cells that have a name, and the sizes of their errors (method.md §7)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TrackerNoise:
    """Standard deviations of a laser tracker's reading.

    Attributes
    ----------
    range_std : float [mm]
    range_std_per_mm : float
        Along the beam: range_std + range_std_per_mm · distance.
    cross_std : float [mm]
    cross_std_per_mm : float
        In each direction across it.

    Notes
    -----
    The defaults are a tracker of 5 µm + 0.5 µm/m along the beam and (15 µm + 6 µm/m)/2 across it.
    """

    range_std: float = 0.005
    range_std_per_mm: float = 0.5e-6
    cross_std: float = 0.0075
    cross_std_per_mm: float = 3e-6

    def covariance(self, p_tracker: FloatArray) -> FloatArray:
        """Return the covariance of readings at (n, 3) positions [mm] in the tracker frame, (n, 3, 3) [mm²]."""
        distance = np.linalg.norm(p_tracker, axis=1)
        beam = p_tracker / distance[:, None]
        along = (self.range_std + self.range_std_per_mm * distance) ** 2
        across = (self.cross_std + self.cross_std_per_mm * distance) ** 2
        outer = beam[:, :, None] * beam[:, None, :]
        covariance: FloatArray = across[:, None, None] * np.eye(3) + (along - across)[:, None, None] * outer
        return covariance


@dataclass(frozen=True)
class Preset:
    """What a virtual cell is made of.

    Attributes
    ----------
    robot : str
        Library name.
    tool_mm, tool_abc_deg : tuple of 3
        The tool as the cell file states it, flange to the reflector, KUKA angles.
    centre_mm, size_mm : tuple of 3
        The work region: a box in the base frame.
    abc_deg : tuple of 3
        Orientation of the tool in the work region, KUKA angles.
    home_deg : tuple of 6
        A joint vector on the branch that the work is done on.
    length_std : float [mm]
        Of the errors of every a and d.
    angle_std : float [rad]
        Of the errors of every joint offset, alpha and beta.
    repeatability_std : float [mm]
        Of the TCP, in each direction; RP of ISO 9283 is about 3.6 times that.
    tracker : TrackerNoise
    tool_std : float [mm]
        Of the difference between the stated tool point and the real one.
    largest_error : float [mm], optional
        Parameter errors are scaled so that the largest error over the work region, after rigid registration, is this.
    """

    robot: str
    tool_mm: tuple[float, float, float]
    tool_abc_deg: tuple[float, float, float]
    centre_mm: tuple[float, float, float]
    size_mm: tuple[float, float, float]
    abc_deg: tuple[float, float, float]
    home_deg: tuple[float, ...]
    length_std: float
    angle_std: float
    repeatability_std: float
    tracker: TrackerNoise = field(default_factory=TrackerNoise)
    tool_std: float = 0.0
    largest_error: float | None = None


PRESETS: Final[dict[str, Preset]] = {
    # The paper's experiment: positions in a box at one orientation, 1.2912 mm at most before compensation.
    "paper": Preset(
        robot="kuka-kr210-r2700-extra",
        tool_mm=(110.0, 0.0, 360.0),
        tool_abc_deg=(0.0, 0.0, 0.0),
        centre_mm=(1700.0, 0.0, 900.0),
        size_mm=(900.0, 1600.0, 900.0),
        abc_deg=(180.0, 20.0, 180.0),
        home_deg=(0.0, -75.0, 95.0, 0.0, 50.0, 0.0),
        length_std=0.35,
        angle_std=0.35e-3,
        repeatability_std=0.014,
        tool_std=2.0,
        largest_error=1.29,
    ),
}
