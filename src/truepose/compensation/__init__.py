"""Turn predicted errors into commands: solve (15), (16), and guard them (theory, compensation)."""

from truepose.compensation.guards import BELOW, Corrections, Guards, Limits, Policy, Region, Verdicts, apply_policy
from truepose.compensation.in_force import LimitsInForce
from truepose.compensation.joint_coverage import Gap, JointCoverage
from truepose.compensation.orientations import supported_angle
from truepose.compensation.solve import Solution, solve
from truepose.compensation.starts import Starts

__all__ = [
    "BELOW",
    "Corrections",
    "Gap",
    "Guards",
    "JointCoverage",
    "Limits",
    "LimitsInForce",
    "Policy",
    "Region",
    "Solution",
    "Starts",
    "Verdicts",
    "apply_policy",
    "solve",
    "supported_angle",
]
