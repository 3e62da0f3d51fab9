"""Kinematic Kriging (10): geometry as a drift with priors, similarity in each joint's own angle."""

from truepose.predictors.kinematic.kriging import EXACT_UP_TO, KinematicKriging
from truepose.predictors.kinematic.summary import JointCurve

__all__ = ["EXACT_UP_TO", "JointCurve", "KinematicKriging"]
