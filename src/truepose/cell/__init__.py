"""Robot cells and the file that describes them: robot, tool, tracker, frames and limits."""

from truepose.cell.cell import Cell, load_cell
from truepose.cell.poses import ANGLE_KEYS, Pose
from truepose.cell.sections import Correction, Tracker
from truepose.cell.template import template

__all__ = ["ANGLE_KEYS", "Cell", "Correction", "Pose", "Tracker", "load_cell", "template"]
