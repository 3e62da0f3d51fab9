"""Is there structure in the errors? Semivariograms, their models, and the test against chance (theory, similarity)."""

from __future__ import annotations

from truepose.similarity.coordinates import equal_count_bins, joint_coordinates, lever_arm_weights
from truepose.similarity.envelope import Envelope, permutation_envelope, verdict
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
from truepose.similarity.model import FAMILIES, VariogramModel
from truepose.similarity.sampled import Sampled, sampled
from truepose.similarity.theory import model_based_variogram
from truepose.similarity.trend import Trend, remove_drift

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
