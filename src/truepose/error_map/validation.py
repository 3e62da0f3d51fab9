"""The accuracy of a map on samples that took no part in its fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map.prediction import PredictingMap
from truepose.error_map.registration import reading_noise
from truepose.error_map.worth import Worth
from truepose.samples import Samples
from truepose.verification import RP_PER_STD, HeldOut, held_out, usual_groups


@dataclass(frozen=True, eq=False, repr=False)
class Validation:
    """Errors before and after on held-out samples; made by `ErrorMap.validate`.

    Its values are also available by the keys of `to_dict`, as in ``validation["after"]["mean_mm"]``.

    Attributes
    ----------
    figures : HeldOut
        The accuracy before and after, the coverage of the intervals, and the noise floor.
    seen : int
        The number of the samples that took part in the fit; the figures are too good if it is not 0.
    worth : Worth
        The comparison of the map itself with no map.
    """

    figures: HeldOut
    seen: int
    worth: Worth

    def __repr__(self) -> str:
        seen = f"\n{self.seen} of the samples took part in the fit: the figures are too good" if self.seen else ""
        return f"{self.figures!r}\nmap: {self.worth.brief}{seen}"

    def __getitem__(self, key: str) -> Any:
        return self.to_dict()[key]

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        return {**self.figures.to_dict(), "seen": self.seen, "worth": self.worth.to_dict()}


def validate(error_map: PredictingMap, samples: Samples) -> Validation:
    """Compare errors before and after on held-out samples; see `truepose.ErrorMap.validate`."""
    e = error_map.errors(samples)
    expected, std = error_map.predict_reading(samples)
    p_cmd = error_map.commanded_positions(samples)
    groups = usual_groups(p_cmd, q=samples.q, robot=error_map.robot, time=samples.time)
    known = {row.tobytes() for row in error_map.samples.p_meas}
    return Validation(
        held_out(e, e - expected, std, noise=motion_noise(error_map, samples), groups=groups),
        sum(row.tobytes() in known for row in samples.p_meas),
        error_map.worth,
    )


def motion_noise(error_map: PredictingMap, samples: Samples) -> FloatArray | None:
    """Return the std of repeatability and reading together, (n, 3) [mm], base frame; None unless both are known."""
    reading = reading_noise(error_map.cell, samples, error_map.registration)
    repeatability = error_map.cell.robot.repeatability_mm
    if reading is None or repeatability is None:
        return None
    return np.asarray(np.sqrt(reading**2 + (repeatability / RP_PER_STD) ** 2))
