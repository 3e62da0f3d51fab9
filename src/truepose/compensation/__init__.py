"""From a predicted error to a command: solve (15), (16), and guard (method.md §4)."""

from truepose.compensation.guards import Corrections, Limits, Region, apply_policy
from truepose.compensation.solve import Solution, mirror, solve

__all__ = ["Corrections", "Limits", "Region", "Solution", "apply_policy", "mirror", "solve"]
