"""Readings that belong to another run than the program: of the original, or of the corrected one."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map import ErrorMap
from truepose.errors import TrueposeError
from truepose.geometry import invert_transform
from truepose.programs.nominal import NominalTargets
from truepose.programs.remeasured import Remeasured
from truepose.programs.verified import OtherRun

_CLEARLY: Final = 0.5
"""The largest ratio of the RMS differences of readings from what one run gives, and from what the other one gives."""
_CERTAIN: Final = 10.0
"""The least logarithm of the likelihood ratio of both runs."""
_FEWEST: Final = 3


def other_run(nominal: NominalTargets, measured: Remeasured, p: FloatArray, error_map: ErrorMap) -> OtherRun:
    """Return of which run readings are, if they are clearly not those of the program; empty otherwise.

    After a correction the errors at its targets are small; without it they are those that the map predicts. Where the
    map predicts little, or reduced little, both are alike and nothing is said.

    Parameters
    ----------
    nominal : NominalTargets
        The n targets of the program, original or corrected.
    measured : Remeasured
        The readings.
    p : (n, 3) array [mm], base frame
        The nominal positions of the measured point.
    error_map : ErrorMap
        The map.
    """
    corrected = nominal.record is not None
    predicted = nominal.predicted if corrected else _predicted(nominal, error_map)
    changed = np.array([outcome in ("correct", "clip", "original") for outcome in nominal.outcomes])[measured.target]
    known = changed & np.isfinite(predicted[measured.target]).all(axis=1)
    if known.sum() < _FEWEST:
        return ""
    row = measured.target[known]
    error, e = measured.p_base[known] - p[row], predicted[row]
    from_nominal, from_predicted = (np.einsum("ij,ij->i", d, d) for d in (error, error - e))
    own, other = (from_nominal, from_predicted) if corrected else (from_predicted, from_nominal)
    least = 3.0 * measured.std[known] ** 2  # what neither run explains counts as scatter of both
    scatter = np.maximum(least, np.median(np.minimum(own, other)))
    clear = bool(np.sqrt(other.mean()) < _CLEARLY * np.sqrt(own.mean()))
    if not clear or 1.5 * float(((own - other) / scatter).sum()) < _CERTAIN:
        return ""
    return "original" if corrected else "corrected"


def _predicted(nominal: NominalTargets, error_map: ErrorMap) -> FloatArray:
    """Return the errors of an original program that a map predicts, (n, 3) [mm], base frame; NaN where it does not."""
    poses = nominal.tf_base_tool @ invert_transform(nominal.tf_flange_tool) @ error_map.tf_flange_tool
    try:
        return np.asarray(error_map.correct(poses, on_guard="skip", accept_weak_map=True).e)
    except TrueposeError:  # the map is not used: a fact refuses, or the arm has no inverse kinematics
        return np.full((len(nominal), 3), np.nan)
