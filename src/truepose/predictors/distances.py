"""Readings of a distance alone: from a known fixed point to the measured point, as of a ball bar or a draw wire."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from truepose._typing import FloatArray


@dataclass(frozen=True, eq=False)
class DistanceRows:
    """Distances at configurations, which may be others than those of the samples.

    Attributes
    ----------
    q : (m, dof) array [rad]
        The joints.
    origin : (m, 3) array [mm], base frame
        The fixed points.
    distance, std : (m,) arrays [mm]
        The distances from there to the tool point, and the standard deviations of their readings.
    conditions : mapping of str to array
        The conditions by name, see `truepose.predictors.conditions`.
    """

    q: FloatArray
    origin: FloatArray
    distance: FloatArray
    std: FloatArray
    conditions: Mapping[str, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.distance)
