"""Robot cells and the file that describes them: robot, tool, tracker, frames and limits."""

from truepose.cell.cell import Cell, load_cell
from truepose.cell.poses import ANGLE_KEYS, Pose
from truepose.cell.sections import ConditionsSection, Correction, Payload, Tracker, conditions_at_work
from truepose.cell.template import template, write_template
from truepose.cell.text import CellProblem

__all__ = [
    "ANGLE_KEYS",
    "Cell",
    "CellProblem",
    "ConditionsSection",
    "Correction",
    "Payload",
    "Pose",
    "Tracker",
    "conditions_at_work",
    "load_cell",
    "template",
    "write_template",
]
