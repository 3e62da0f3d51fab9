"""Error models: predict the positional error with its standard deviation where nothing was measured (theory)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from truepose._lazy import lazy_names

if TYPE_CHECKING:
    from truepose.predictors.base import LeaveOneOut, Predictor
    from truepose.predictors.baselines import GridCell, InverseDistance, Nearest, RadialBasis, RegistrationOnly
    from truepose.predictors.calibration import KinematicCalibration
    from truepose.predictors.folds import block_folds, branch_folds, point_folds, random_folds
    from truepose.predictors.kinematic import KinematicKriging
    from truepose.predictors.kriging.neighbours import LocalKriging
    from truepose.predictors.kriging.ordinary import OrdinaryKriging, SimpleKriging, UniversalKriging
    from truepose.predictors.kriging.vecchia import VecchiaKriging
    from truepose.predictors.kriging.vector import VectorKriging
    from truepose.predictors.orientation import PosePredictor
    from truepose.predictors.registry import (
        FORMER_NAMES,
        LATER_PARAMETERS,
        PREDICTORS,
        ArmContext,
        make_predictor,
        predictor_spec,
    )
    from truepose.predictors.residual_network import ResidualNetwork
    from truepose.predictors.selection.choice import Choice, rank_predictors
    from truepose.predictors.selection.cross_validation import PositionalErrors

_HOME = {
    "FORMER_NAMES": "registry",
    "LATER_PARAMETERS": "registry",
    "ArmContext": "registry",
    "Choice": "selection.choice",
    "GridCell": "baselines",
    "InverseDistance": "baselines",
    "KinematicCalibration": "calibration",
    "KinematicKriging": "kinematic",
    "LeaveOneOut": "base",
    "LocalKriging": "kriging.neighbours",
    "Nearest": "baselines",
    "OrdinaryKriging": "kriging.ordinary",
    "PREDICTORS": "registry",
    "PosePredictor": "orientation",
    "PositionalErrors": "selection.cross_validation",
    "Predictor": "base",
    "RadialBasis": "baselines",
    "RegistrationOnly": "baselines",
    "ResidualNetwork": "residual_network",
    "SimpleKriging": "kriging.ordinary",
    "UniversalKriging": "kriging.ordinary",
    "VecchiaKriging": "kriging.vecchia",
    "VectorKriging": "kriging.vector",
    "block_folds": "folds",
    "branch_folds": "folds",
    "make_predictor": "registry",
    "predictor_spec": "registry",
    "point_folds": "folds",
    "random_folds": "folds",
    "rank_predictors": "selection.choice",
}

__all__ = [
    "FORMER_NAMES",
    "LATER_PARAMETERS",
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


__getattr__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    return __all__
