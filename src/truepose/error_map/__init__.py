"""Error maps of cells, from samples to corrections: registration, tool and predictor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from truepose._lazy import lazy_names

if TYPE_CHECKING:
    from truepose.error_map.arm_check import ArmCheck, check_point
    from truepose.error_map.fit import fit_cell
    from truepose.error_map.frozen import FrozenMap
    from truepose.error_map.map import ErrorMap, load_map
    from truepose.error_map.prediction import Prediction
    from truepose.error_map.selection import choose
    from truepose.error_map.update import Recheck, recheck, update_map
    from truepose.error_map.validation import Validation

_HOME = {
    "ArmCheck": "arm_check",
    "ErrorMap": "map",
    "FrozenMap": "frozen",
    "Prediction": "prediction",
    "Recheck": "update",
    "Validation": "validation",
    "check_point": "arm_check",
    "choose": "selection",
    "fit_cell": "fit",
    "load_map": "map",
    "recheck": "update",
    "update_map": "update",
}

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

__getattr__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    return __all__
