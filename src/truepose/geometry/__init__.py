"""Rigid geometry: transforms, controllers' angles, registration of tracker readings to the robot base."""

from truepose.geometry.angles import ANGLES, AngleConvention, euler
from truepose.geometry.body import register_with_body
from truepose.geometry.registration import Registration, register, register_known, register_with_tool
from truepose.geometry.robust import OUTLIER_LIMIT
from truepose.geometry.tool_estimate import ToolEstimate, estimate_tool, tool_suspected
from truepose.geometry.transforms import apply_transform, check_transforms, invert_transform, make_transform

__all__ = [
    "ANGLES",
    "OUTLIER_LIMIT",
    "AngleConvention",
    "Registration",
    "ToolEstimate",
    "apply_transform",
    "check_transforms",
    "estimate_tool",
    "euler",
    "invert_transform",
    "make_transform",
    "register",
    "register_known",
    "register_with_body",
    "register_with_tool",
    "tool_suspected",
]
