"""Estimate the tool from readings, to find a wrong tool in a cell file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError, IdentifiabilityError
from truepose.geometry.registration import Registration, register, register_with_tool
from truepose.geometry.transforms import apply_transform

_FEWEST: Final = 10  # poses
_LEAST_MM: Final = 2.0  # that errors of an arm can shift the tool
_SIGMAS: Final = 5.0
_BETTER: Final = 0.5  # of the median residual with the stated tool


@dataclass(frozen=True)
class ToolEstimate:
    """The tool that readings imply, beside the stated one; made by `estimate_tool`.

    Attributes
    ----------
    p_flange_tool_mm, std_mm, stated_mm : tuple of 3 float [mm], flange frame
        The tool that fits the readings best, its standard deviations, and the stated tool.
    distance_mm : float [mm]
        The distance between the two tools.
    residual_mm, residual_stated_mm : float [mm]
        The median residuals of the readings with the tool found, and with the stated one.
    """

    p_flange_tool_mm: tuple[float, float, float]
    std_mm: tuple[float, float, float]
    stated_mm: tuple[float, float, float]
    distance_mm: float
    residual_mm: float
    residual_stated_mm: float

    @property
    def suspect(self) -> bool:
        """Whether the stated tool is probably wrong: far from the one found, with residuals twice as large or more."""
        far = self.distance_mm > _LEAST_MM + _SIGMAS * float(np.linalg.norm(self.std_mm))
        return far and self.residual_mm < _BETTER * self.residual_stated_mm

    @property
    def words(self) -> str:
        """The tools and their distance in one sentence, without a full stop."""
        found, stated = (_point(p) for p in (self.p_flange_tool_mm, self.stated_mm))
        std = max(self.std_mm)
        return (
            f"the readings fit the tool {found} ± {std:.2f} mm best, {self.distance_mm:.2f} mm from the stated {stated}"
        )

    @property
    def suspicion(self) -> str:
        """The suspicion and its remedy, without a full stop; empty if the stated tool is not suspect."""
        if not self.suspect:
            return ""
        worse = f"{self.residual_stated_mm:.3g} mm" if np.isfinite(self.residual_stated_mm) else "no fit at all"
        residuals = f"median residual {self.residual_mm:.3g} mm instead of {worse}"
        return (
            f"the tool in the cell file is probably wrong by {self.distance_mm:.1f} mm: {self.words} ({residuals}); "
            'correct [tool]; with fit = "position" these values are where its fit starts'
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the estimate as plain values."""
        return {**vars(self), "suspect": self.suspect}


def estimate_tool(tf_base_flange: FloatArray, p_measured: FloatArray, stated: FloatArray) -> ToolEstimate | None:
    """Fit station and tool together, and compare the tool with the stated one.

    Parameters
    ----------
    tf_base_flange : (n, 4, 4) array [mm]
        The commanded poses of the flange.
    p_measured : (n, 3) array [mm], tracker frame
        The reading of each pose.
    stated : (3,) array [mm], flange frame
        The stated tool.

    Returns
    -------
    ToolEstimate or None
        None if the poses are fewer than ten, cannot separate the tool from the station, or do not fit the readings.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.spatial.transform import Rotation
    >>> from truepose.geometry import make_transform
    >>> rng = np.random.default_rng(0)
    >>> flange = make_transform(Rotation.random(12, rng=rng), rng.uniform(-500, 500, (12, 3)))
    >>> reading = apply_transform(flange, np.array([10.0, 20.0, 150.0]))
    >>> found = estimate_tool(flange, reading, np.array([10.0, 20.0, 308.0]))
    >>> found.suspect, round(found.distance_mm)
    (True, 158)
    """
    if len(p_measured) < _FEWEST:
        return None
    try:
        found = register_with_tool(tf_base_flange, p_measured, stated)
    except (DataError, IdentifiabilityError):
        return None
    tool = found.p_flange_tool
    assert tool is not None
    at_stated = apply_transform(tf_base_flange, stated)
    return ToolEstimate(
        _three(tool),
        _three(np.sqrt(np.diag(found.covariance)[6:9])),
        _three(stated),
        float(np.linalg.norm(tool - stated)),
        _median(found),
        _median_of_rigid(at_stated, p_measured),
    )


@contextmanager
def tool_suspected(
    pairs: Callable[[], tuple[FloatArray, FloatArray] | None], stated: FloatArray, source: str
) -> Iterator[None]:
    """Put a suspicion of the stated tool in front of an error of readings, if a free tool explains them.

    Parameters
    ----------
    pairs : callable
        A function that returns the flange poses (n, 4, 4) and the reading of each (n, 3) [mm], or None; called only
        after an error.
    stated : (3,) array [mm], flange frame
        The stated tool.
    source : str
        The file of the readings, for the message.
    """
    try:
        yield
    except DataError as error:
        known = pairs()
        found = None if known is None else estimate_tool(*known, stated)
        if found is None or not found.suspect:
            raise
        raise DataError(f"{source}: {found.suspicion}. With the stated tool: {error}") from None


def _median_of_rigid(p_commanded: FloatArray, p_measured: FloatArray) -> float:
    try:
        return _median(register(p_commanded, p_measured))
    except (DataError, IdentifiabilityError):  # the residuals are larger than those of any robot
        return float("inf")


def _median(found: Registration) -> float:
    return float(np.median(np.linalg.norm(found.residuals, axis=1)))


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = np.round(values, 4).tolist()
    return x, y, z


def _point(p: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in p) + ") mm"
