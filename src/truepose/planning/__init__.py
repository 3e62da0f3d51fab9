"""Plans of measurements: the most informative configurations, their order, and the program (theory, planning)."""

from truepose.planning.designs import METHODS
from truepose.planning.measurement_space import work_region
from truepose.planning.measuring import measuring_program, write_measurement
from truepose.planning.planner import Plan, expected_accuracy, plan

__all__ = [
    "METHODS",
    "Plan",
    "expected_accuracy",
    "measuring_program",
    "plan",
    "work_region",
    "write_measurement",
]
