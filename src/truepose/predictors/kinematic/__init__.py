"""Kinematic Kriging: the error model as drift and prior, similarity where it arises, in each joint's own angle (10)."""

from truepose.predictors.kinematic.kriging import EXACT_UP_TO, JointCurve, KinematicKriging

__all__ = ["EXACT_UP_TO", "JointCurve", "KinematicKriging"]
