"""A virtual robot whose truth is known, to test on (method.md §7)."""

from truepose.simulation.presets import EFFECTS, PRESETS, Preset
from truepose.simulation.tracker import TrackerNoise
from truepose.simulation.truth import Conditions, JointCurves, Truth
from truepose.simulation.virtual_cell import VirtualCell

__all__ = ["EFFECTS", "PRESETS", "Conditions", "JointCurves", "Preset", "TrackerNoise", "Truth", "VirtualCell"]
