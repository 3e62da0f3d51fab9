"""``truepose explain``: what a map knows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.cli.calibration import calibration_of, show_calibration
from truepose.cli.output import Force, Json, emit_json, overwrite, say, table

if TYPE_CHECKING:
    from truepose.report.knowledge import Knowledge


def explain(
    map_path: Annotated[Path, typer.Argument(metavar="MAP")],
    out: Annotated[Path | None, typer.Option("--out", help="A folder for the pictures: joints.svg, sure.svg.")] = None,
    suggestions: Annotated[int, typer.Option(help="How many poses to measure next.", min=0, max=50)] = 5,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Say what a map knows: parameters, joint curves, noise, where it is sure and where not, what to measure next."""
    from truepose.error_map import load_map
    from truepose.report.knowledge import knowledge

    overwrite(force, *([] if out is None else [out / name for name in ("joints.svg", "sure.svg")]))
    found = knowledge(load_map(map_path), suggestions=suggestions)
    pictures = []
    if out is not None:
        pictures = found.save_plots(out)
    if as_json:
        emit_json({"map": map_path, **found.to_dict(), "pictures": pictures})
        return
    _show(found)
    for picture in pictures:
        say(f"Wrote {picture}.")


def _show(found: Knowledge) -> None:
    error_map, std = found.error_map, found.std_mm
    say(
        f"[bold]{error_map.predictor_name}[/] of {len(error_map.samples)} samples. A reading varies by "
        f"{found.noise_mm:.3f} mm in each direction. Within the sampled region the deviation of a corrected position "
        f"has a length of {std['mean']:.3f} mm in the mean, {std['p95']:.3f} mm at 95 %, {std['max']:.3f} mm at most."
    )
    if found.shares_mm:
        rows = [(name, value) for name, value in found.shares_mm.items()]
        say(table("What the errors at the samples are made of", ["", "RMS [mm]"], rows))
    if (calibration := calibration_of(error_map.predictor)) is not None:
        show_calibration(calibration)
    elif found.parameters:
        say(table("Parameters", ["", "estimate", "± std", "unit", ""], map(_parameter, found.parameters)))
    if found.curves:
        say(table("Joint curves, mean and first harmonic left to geometry", _CURVE_COLUMNS, map(_curve, found.curves)))
    simple = {k: v for k, v in found.hyperparameters.items() if k != "hyper" and v is not None}
    say("Settings: " + "; ".join(f"{name} {_short(value)}" for name, value in simple.items()) + ".")
    if found.next_poses:
        columns = list(found.next_poses[0])
        say(table("What to measure next", columns, [[row[c] for c in columns] for row in found.next_poses]))


_CURVE_COLUMNS = ["joint", "from [deg]", "to [deg]", "RMS [mrad]", "mean std [mrad]"]


def _curve(curve: Any) -> tuple[Any, ...]:
    degrees, rms = 57.29577951308232, float((curve.error**2).mean() ** 0.5)
    ends = float(curve.angle[0] * degrees), float(curve.angle[-1] * degrees)
    return (curve.joint + 1, *ends, 1e3 * rms, 1e3 * float(curve.std.mean()))


def _parameter(row: dict[str, Any]) -> tuple[str, ...]:
    factor, unit = (1e3, "mrad" + row["unit"][3:]) if row["unit"].startswith("rad") else (1.0, row["unit"])
    told = "" if row["told"] else "hardly told by the data"
    return row["name"], f"{factor * row['estimate']:.4f}", f"{factor * row['std']:.4f}", unit, told


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return "(" + ", ".join(f"{k} {_short(v)}" for k, v in value.items() if v is not None) + ")"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_short, value)) + "]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
