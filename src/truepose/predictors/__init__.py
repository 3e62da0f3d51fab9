"""Error models: predict the positional error with its standard deviation where nothing was measured (theory)."""

from __future__ import annotations

from truepose.predictors.base import LeaveOneOut, Predictor
from truepose.predictors.baselines.inverse_distance import InverseDistance
from truepose.predictors.baselines.nearest import GridCell, Nearest
from truepose.predictors.baselines.radial_basis import RadialBasis
from truepose.predictors.baselines.registration_only import RegistrationOnly
from truepose.predictors.calibration import KinematicCalibration
from truepose.predictors.folds import block_folds, branch_folds, point_folds, random_folds
from truepose.predictors.kinematic import KinematicKriging
from truepose.predictors.kriging.local import LocalKriging
from truepose.predictors.kriging.ordinary import OrdinaryKriging, SimpleKriging, UniversalKriging
from truepose.predictors.kriging.vecchia import VecchiaKriging
from truepose.predictors.kriging.vector import VectorKriging
from truepose.predictors.orientation import PosePredictor
from truepose.predictors.registry import FORMER_NAMES, PREDICTORS, ArmContext, make_predictor, predictor_spec
from truepose.predictors.residual_network import ResidualNetwork
from truepose.predictors.selection.choice import Choice, rank_predictors
from truepose.predictors.selection.cross_validation import PositionalErrors

__all__ = [
    "FORMER_NAMES",
    "PREDICTORS",
    "ArmContext",
    "Choice",
    "GridCell",
    "InverseDistance",
    "KinematicCalibration",
    "KinematicKriging",
    "LeaveOneOut",
    "LocalKriging",
    "Nearest",
    "OrdinaryKriging",
    "PosePredictor",
    "PositionalErrors",
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
    "make_predictor",
    "point_folds",
    "predictor_spec",
    "random_folds",
    "rank_predictors",
]
