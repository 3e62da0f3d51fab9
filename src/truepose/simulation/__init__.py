"""A virtual robot whose truth is known, to test on (method.md §7)."""

from truepose.simulation.presets import PRESETS, Preset, TrackerNoise
from truepose.simulation.virtual_cell import Truth, VirtualCell

__all__ = ["PRESETS", "Preset", "TrackerNoise", "Truth", "VirtualCell"]
