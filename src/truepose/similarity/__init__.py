"""Is there structure in the errors? Semivariograms, their models, and the test against chance (theory, similarity)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from truepose._lazy import lazy_names

if TYPE_CHECKING:
    from truepose.similarity.coordinates import equal_count_bins, joint_coordinates, lever_arm_weights
    from truepose.similarity.envelope import Envelope, Sampled, permutation_envelope, sampled, verdict
    from truepose.similarity.experimental import (
        Direction,
        ExperimentalVariogram,
        VariogramCloud,
        experimental_variogram,
        variogram_cloud,
    )
    from truepose.similarity.fit import VariogramFit, fit_variogram
    from truepose.similarity.gstools_models import as_variogram
    from truepose.similarity.likelihood import LikelihoodFit, fit_likelihood
    from truepose.similarity.model import VariogramModel
    from truepose.similarity.structure import FAMILIES
    from truepose.similarity.theory import model_based_variogram
    from truepose.similarity.trend import Trend, remove_drift

_HOME = {
    "Direction": "experimental",
    "Envelope": "envelope",
    "ExperimentalVariogram": "experimental",
    "FAMILIES": "structure",
    "LikelihoodFit": "likelihood",
    "Sampled": "envelope",
    "Trend": "trend",
    "VariogramCloud": "experimental",
    "VariogramFit": "fit",
    "VariogramModel": "model",
    "as_variogram": "gstools_models",
    "equal_count_bins": "coordinates",
    "experimental_variogram": "experimental",
    "fit_likelihood": "likelihood",
    "fit_variogram": "fit",
    "joint_coordinates": "coordinates",
    "lever_arm_weights": "coordinates",
    "model_based_variogram": "theory",
    "permutation_envelope": "envelope",
    "remove_drift": "trend",
    "sampled": "envelope",
    "variogram_cloud": "experimental",
    "verdict": "envelope",
}

__all__ = [
    "FAMILIES",
    "Direction",
    "Envelope",
    "ExperimentalVariogram",
    "LikelihoodFit",
    "Sampled",
    "Trend",
    "VariogramCloud",
    "VariogramFit",
    "VariogramModel",
    "as_variogram",
    "equal_count_bins",
    "experimental_variogram",
    "fit_likelihood",
    "fit_variogram",
    "joint_coordinates",
    "lever_arm_weights",
    "model_based_variogram",
    "permutation_envelope",
    "remove_drift",
    "sampled",
    "variogram_cloud",
    "verdict",
]


__getattr__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    return __all__
