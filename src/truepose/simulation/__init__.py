"""Virtual robot cells with known true errors, for tests and studies (docs/virtual-cell.md)."""

from truepose.simulation.fleet import VirtualFleet
from truepose.simulation.presets import EFFECTS, PRESETS, TROUBLES, Preset
from truepose.simulation.tracker import TrackerNoise
from truepose.simulation.troubles import Troubles
from truepose.simulation.truth import Conditions, JointCurves, Truth
from truepose.simulation.virtual_cell import VirtualCell

__all__ = [
    "EFFECTS",
    "PRESETS",
    "TROUBLES",
    "Conditions",
    "JointCurves",
    "Preset",
    "TrackerNoise",
    "Troubles",
    "Truth",
    "VirtualCell",
    "VirtualFleet",
]
