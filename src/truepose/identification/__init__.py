"""Identification of an arm's parameters from measurements: theory (3) and theory (11)."""

from truepose.identification.arm import ParametricArm, tolerance
from truepose.identification.batch import Identification, finish, least_squares, levenberg_marquardt, minimal_subset
from truepose.identification.kalman import KalmanFilter, filtered
from truepose.identification.observability import Observability, observability, poses_to_add
from truepose.identification.observations import Distances, Observations, PoseObservations, Positions
from truepose.identification.table import parameter_table

__all__ = [
    "Distances",
    "Identification",
    "KalmanFilter",
    "Observability",
    "Observations",
    "ParametricArm",
    "PoseObservations",
    "Positions",
    "filtered",
    "finish",
    "least_squares",
    "levenberg_marquardt",
    "minimal_subset",
    "observability",
    "parameter_table",
    "poses_to_add",
    "tolerance",
]
