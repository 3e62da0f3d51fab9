"""Error maps of cells, from samples to corrections: registration, tool and predictor."""

from truepose.error_map.arm_check import ArmCheck, check_point
from truepose.error_map.fit import fit_cell
from truepose.error_map.frozen import FrozenMap
from truepose.error_map.map import ErrorMap, load_map
from truepose.error_map.prediction import Prediction
from truepose.error_map.selection import choose
from truepose.error_map.update import Recheck, recheck, update_map
from truepose.error_map.validation import Validation

__all__ = [
    "ArmCheck",
    "ErrorMap",
    "FrozenMap",
    "Prediction",
    "Recheck",
    "Validation",
    "check_point",
    "choose",
    "fit_cell",
    "load_map",
    "recheck",
    "update_map",
]
