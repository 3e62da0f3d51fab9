"""The figures of a fitted map as plain values, for JSON and pages."""

from __future__ import annotations

from typing import Any, Final

from truepose.error_map.map import ErrorMap
from truepose.error_map.registration import tool_estimate
from truepose.geometry import Registration, ToolEstimate
from truepose.predictors import KinematicCalibration, KinematicKriging, Predictor
from truepose.verification import summary

_OF_SAMPLES: Final = ("weight", "weights", "fleet")
"""Parameters that are arrays of the samples, or of a fleet."""


def fit_figures(error_map: ErrorMap) -> dict[str, Any]:
    """Return the results of a fit: registration, tool, accuracy, tests, and the choice among predictors."""
    calibration = calibration_of(error_map.predictor)
    estimate = tool_estimate(error_map.cell, error_map.robot, error_map.samples)
    parameters = error_map.predictor.to_dict()
    fleet = fleet_data(error_map.predictor)
    return {
        "hash": error_map.hash,
        "n": len(error_map.samples),
        "predictor": error_map.predictor_name,
        "parameters": {key: value for key, value in parameters.items() if key not in _OF_SAMPLES},
        **tool_data(error_map.registration, estimate),
        "hint": error_map.registration.hint,
        "registered": summary(error_map.e),
        "leave_one_out": summary(error_map.leave_one_out()[0]),
        "ranking": error_map.ranking,
        "expected": error_map.expected,
        "excluded": error_map.excluded,
        "campaign": error_map.campaign,
        "arm_check": error_map.arm_check.to_dict(),
        "facts": facts_data(error_map),
        "worth": error_map.worth.to_dict(),
        **({} if calibration is None else {"calibration": calibration_data(calibration)}),
        **({"fleet": fleet} if fleet else {}),
    }


def facts_data(error_map: ErrorMap) -> list[dict[str, Any]]:
    """Return the facts of a map, each with its effect."""
    return [fact.to_dict() for fact in error_map.facts]


def fleet_data(predictor: Predictor) -> dict[str, Any]:
    """Return what a fit took of the maps of other robots; empty if it got none."""
    return predictor.fleet_ if isinstance(predictor, KinematicKriging) else {}


def calibration_of(predictor: Predictor) -> KinematicCalibration | None:
    """Return the calibration that a predictor is or contains."""
    found = getattr(predictor, "calibration_", predictor)
    return found if isinstance(found, KinematicCalibration) else None


def calibration_data(calibration: KinematicCalibration) -> dict[str, Any]:
    """Return the results of an identification; each row states its unit."""
    seen = calibration.observability_
    return {
        "parameters": calibration.parameters_,
        "rank": seen.rank,
        "condition": seen.condition,
        "observability": seen.indices,
        "misfit_mm": calibration.misfit_std_,
        "method": calibration.method,
        "convention": calibration.convention,
        "prior": calibration.prior,
        "hint": calibration.hint_,
    }


def tool_data(registration: Registration, found: ToolEstimate | None) -> dict[str, Any]:
    """Return the fitted tool and the estimate of a stated one."""
    tool = registration.p_flange_tool
    return {
        "tool_mm": None if tool is None else tool.round(4),
        "tool_estimate": None if found is None else found.to_dict(),
    }
