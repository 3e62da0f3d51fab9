"""Identified parameters on a screen: the table that `truepose fit --predictor calibration` shows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from truepose.cli.output import say, table

if TYPE_CHECKING:
    from truepose.predictors import KinematicCalibration, Predictor

_SHOWN: Final = {"rad": ("deg", 57.29577951308232, 4), "rad/Nm": ("µrad/Nm", 1e6, 3), "mm": ("mm", 1.0, 3)}
_SMALL: Final = ("mrad", 1e3, 4)  # deviations of joints
_COLUMNS: Final = ("parameter", "nominal", "identified", "± std", "unit", "")


def calibration_of(predictor: Predictor) -> KinematicCalibration | None:
    """Return the calibration that a predictor is, or stands on."""
    from truepose.predictors import KinematicCalibration

    found = getattr(predictor, "calibration_", predictor)
    return found if isinstance(found, KinematicCalibration) else None


def calibration_data(calibration: KinematicCalibration) -> dict[str, Any]:
    """Return all that was identified, for machines: units are those of each row."""
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


def show_calibration(calibration: KinematicCalibration) -> None:
    """Show the table, and what the poses cannot tell."""
    seen = calibration.observability_
    title = f"Identified parameters ({calibration.convention}, method {calibration.method})"
    say(table(title, _COLUMNS, [_cells(row) for row in calibration.parameters_]))
    p = len(calibration.parameters_)
    unknown = f"; {p - seen.rank} combinations come from {_SOURCE[calibration.prior]}" if seen.rank < p else ""
    say(
        f"Rank {seen.rank} of {p} parameters, condition number {seen.condition:.0f}{unknown}. "
        f"Left unexplained: {calibration.misfit_std_:.3f} mm in each direction."
    )
    if calibration.hint_:
        say(f"[yellow]Note[/]: {calibration.hint_}.")


_SOURCE: Final = {"tolerance": "tolerances alone", "subset": "keeping nominal values"}


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    unit, factor, digits = _SHOWN.get(row["unit"], (row["unit"], 1.0, 6))
    if row["unit"] == "rad" and " q" in row["parameter"]:
        unit, factor, digits = _SMALL
    nominal, identified = (f"{factor * row[key]:.{digits}f}" for key in ("nominal", "identified"))
    std = "–" if row["std"] is None else f"{factor * row['std']:.{digits}f}"
    return row["parameter"], nominal, identified, std, unit, row["note"]
