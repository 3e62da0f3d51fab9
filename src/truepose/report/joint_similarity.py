"""Joint-wise similarity: semivariograms of each joint's own error over its angle (theory (10)).

A joint's own error cannot be measured alone. Kinematic Kriging estimates its variance s_j² and range l_j by restricted
likelihood, and the error curve itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map import ErrorMap
from truepose.errors import DataError
from truepose.predictors import KinematicKriging
from truepose.similarity import VariogramModel

FARTHEST: Final = np.radians(60.0)
LAGS: Final = 61


@dataclass(frozen=True, eq=False)
class JointSimilarity:
    """The semivariogram of one joint's own error; m lags.

    Attributes
    ----------
    joint : int
        The joint, from 0.
    model : VariogramModel
        The model of the error [mrad²] over the chord between two angles.
    lag : (m,) array [rad]
        The angle between two positions of the joint.
    found : (m,) array [mrad²]
        The semivariance of the estimated curve, which is smoother than the error itself.
    """

    joint: int
    model: VariogramModel
    lag: FloatArray
    found: FloatArray

    @property
    def semivariance(self) -> FloatArray:
        """The semivariance γ_j(Δ) of the model, (m,) [mrad²]."""
        return self.model.semivariance(2 * np.sin(self.lag / 2))

    @property
    def std_mrad(self) -> float:
        """The standard deviation of the joint's own error [mrad]."""
        return float(np.sqrt(self.model.sill))

    @property
    def reach(self) -> float:
        """The angle at which the semivariance reaches 95 % of the sill [rad]."""
        return float(2 * np.arcsin(min(self.model.practical_range / 2, 1.0)))

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        return {
            "joint": self.joint + 1,
            "std_mrad": self.std_mrad,
            "reach_deg": np.degrees(self.reach),
            "lag_deg": np.degrees(self.lag),
            "semivariance_mrad2": self.semivariance,
            "found_mrad2": self.found,
        }


def joint_similarity(error_map: ErrorMap) -> list[JointSimilarity]:
    """Return the similarity of each joint's own error.

    Parameters
    ----------
    error_map : ErrorMap
        A map with the predictor kinematic-kriging.

    Raises
    ------
    DataError
        If the map has another predictor.
    """
    predictor = error_map.predictor
    if not isinstance(predictor, KinematicKriging):
        raise DataError(f"joint-wise similarity requires a map with kinematic-kriging, got {error_map.predictor_name}")
    hyper = predictor.hyper_
    return [
        JointSimilarity(
            curve.joint,
            VariogramModel("matern32", sill=1e6 * float(std) ** 2, range=float(length)),
            *_of_curve(curve.angle, 1e3 * curve.error),
        )
        for curve, std, length in zip(predictor.joint_curves(), hyper.joint_std, hyper.joint_length, strict=True)
    ]


def _of_curve(angle: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lags, up to 60° or half the curve, and the semivariance of a curve at equally spaced angles."""
    step = float(angle[1] - angle[0])
    most = max(2, min(int(FARTHEST / step), len(angle) // 2) + 1)
    shifts = np.unique(np.linspace(0, most - 1, min(most, LAGS)).astype(int))
    return shifts * step, np.array([np.mean((error[k:] - error[: len(error) - k]) ** 2) / 2 for k in shifts])
