"""Error models: predict the positional error, with a standard deviation, where nothing was measured (method.md §3)."""

from __future__ import annotations

from truepose.predictors.base import LeaveOneOut, Predictor
from truepose.predictors.choose import choose
from truepose.predictors.folds import block_folds, random_folds
from truepose.predictors.inverse_distance import InverseDistance
from truepose.predictors.kriging import OrdinaryKriging, SimpleKriging, UniversalKriging
from truepose.predictors.local_kriging import LocalKriging
from truepose.predictors.named import PREDICTORS, make_predictor
from truepose.predictors.registration_only import RegistrationOnly
from truepose.predictors.vecchia import VecchiaKriging

__all__ = [
    "PREDICTORS",
    "InverseDistance",
    "LeaveOneOut",
    "LocalKriging",
    "OrdinaryKriging",
    "Predictor",
    "RegistrationOnly",
    "SimpleKriging",
    "UniversalKriging",
    "VecchiaKriging",
    "block_folds",
    "choose",
    "make_predictor",
    "random_folds",
]
