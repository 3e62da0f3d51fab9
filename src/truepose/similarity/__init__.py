"""Is there structure in the errors? Semivariograms, their models, and the test against chance (method.md §2)."""

from __future__ import annotations

from truepose.similarity.envelope import Envelope, permutation_envelope, verdict
from truepose.similarity.experimental import Direction, ExperimentalVariogram, experimental_variogram
from truepose.similarity.fitting import VariogramFit, fit_variogram
from truepose.similarity.gstools_models import as_variogram
from truepose.similarity.likelihood import LikelihoodFit, fit_likelihood
from truepose.similarity.models import FAMILIES, VariogramModel
from truepose.similarity.plot import draw_variogram, plot_variogram

__all__ = [
    "FAMILIES",
    "Direction",
    "Envelope",
    "ExperimentalVariogram",
    "LikelihoodFit",
    "VariogramFit",
    "VariogramModel",
    "as_variogram",
    "draw_variogram",
    "experimental_variogram",
    "fit_likelihood",
    "fit_variogram",
    "permutation_envelope",
    "plot_variogram",
    "verdict",
]
