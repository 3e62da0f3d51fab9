"""Error models: predict the positional error, with a standard deviation, where nothing was measured (method.md §3)."""

from __future__ import annotations

from truepose.predictors.base import LeaveOneOut, Predictor
from truepose.predictors.calibration import KinematicCalibration
from truepose.predictors.choose import Choice, choose
from truepose.predictors.cross_validation import Errors
from truepose.predictors.folds import block_folds, branch_folds, point_folds, random_folds
from truepose.predictors.inverse_distance import InverseDistance
from truepose.predictors.kinematic import KinematicKriging
from truepose.predictors.kriging import OrdinaryKriging, SimpleKriging, UniversalKriging
from truepose.predictors.local_kriging import LocalKriging
from truepose.predictors.named import PREDICTORS, Arm, make_predictor
from truepose.predictors.nearest import GridCell, Nearest
from truepose.predictors.orientation import PosePredictor
from truepose.predictors.radial_basis import RadialBasis
from truepose.predictors.registration_only import RegistrationOnly
from truepose.predictors.residual_network import ResidualNetwork
from truepose.predictors.vecchia import VecchiaKriging
from truepose.predictors.vector_kriging import VectorKriging

__all__ = [
    "PREDICTORS",
    "Arm",
    "Choice",
    "Errors",
    "GridCell",
    "InverseDistance",
    "KinematicCalibration",
    "KinematicKriging",
    "LeaveOneOut",
    "LocalKriging",
    "Nearest",
    "OrdinaryKriging",
    "PosePredictor",
    "Predictor",
    "RadialBasis",
    "RegistrationOnly",
    "ResidualNetwork",
    "SimpleKriging",
    "UniversalKriging",
    "VecchiaKriging",
    "VectorKriging",
    "block_folds",
    "branch_folds",
    "choose",
    "make_predictor",
    "point_folds",
    "random_folds",
]
