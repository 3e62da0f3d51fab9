"""``truepose explain``: what a map contains, where it is certain, and what to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.cli.options import Force, Json, MapPath
from truepose.cli.output import emit_json, overwrite, say, table, working
from truepose.cli.summaries import OFF, show_calibration, show_facts, show_fleet

if TYPE_CHECKING:
    from truepose.compensation import Gap
    from truepose.report.knowledge import Knowledge

_COLUMNS = ["", "estimate", "95 % from", "to", "unit"]
_DEGREES = 57.29577951308232


def explain(
    map_path: MapPath,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the pictures joints.svg and sure.svg.")] = None,
    parameters: Annotated[
        bool, typer.Option("--parameters", help="Show also the parameters, joint errors and settings.")
    ] = False,
    suggestions: Annotated[int, typer.Option(help="Number of poses to suggest for measurement.", min=0, max=50)] = 5,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Show the noise and uncertainty of a map, what contributes to its errors, and what to measure next."""
    from truepose.error_map import load_map
    from truepose.report.knowledge import knowledge

    if out is not None:
        from truepose.report.plots.knowledge import PICTURES, save_plots

    overwrite(force, *([] if out is None else [out / name for name in PICTURES]))
    with working("Reading the map", quiet=as_json) as progress:
        error_map = load_map(map_path)
        progress("Predicting in the work region")
        found = knowledge(error_map, suggestions=suggestions)
        progress("Drawing the pictures")
        pictures = [] if out is None else save_plots(found, out)
    if as_json:
        emit_json({"map": map_path, **found.to_dict(), "pictures": pictures})
        return
    _show(found)
    if parameters:
        _show_parameters(found)
    else:
        say("Parameters, joint errors and settings: --parameters.")
    for picture in pictures:
        say(f"Wrote {picture}.")


def _show(found: Knowledge) -> None:
    std, left_out = found.std_mm, len(found.error_map.excluded)
    show_facts(found.error_map.facts, told=True)
    say(
        f"[bold]{found.error_map.predictor_name}[/] of {len(found.error_map.samples)} samples, {left_out} left out.",
        f"Standard deviation of a reading: {found.noise_mm:.3f} mm per axis.",
        f"Standard deviation of a corrected position {found.where}:",
        f"  mean {std['mean']:.3f} mm, P95 {std['p95']:.3f} mm, maximum {std['max']:.3f} mm (length of the vector).",
    )
    if found.std_unknown_approach_mm is not None:
        say(f"  Where the direction of approach is not known: mean {found.std_unknown_approach_mm:.3f} mm.")
    if found.effects:
        say(
            table(
                "Backlash (half of the lost motion), expansion, gears",
                _COLUMNS,
                map(_effect, found.effects),
            )
        )
    if found.shares_mm:
        say(table("Contributions to the errors at the samples", ["", "RMS [mm]"], list(found.shares_mm.items())))
    show_fleet(found.fleet)
    if found.gaps:
        columns = ["joint", "from [deg]", "to [deg]", "measure near [deg]"]
        say(table("Angles that no sample covers: targets there are refused", columns, map(_gap, found.gaps)))
    if found.next_poses:
        columns = list(found.next_poses[0])
        rows = [[f"{row[c]:.3f}" if c == "std_mm" else f"{row[c]:.2f}" for c in columns] for row in found.next_poses]
        say(table(f"What to measure next, {found.where}", columns, rows))


def _show_parameters(found: Knowledge) -> None:
    from truepose.error_map.figures import calibration_of

    if (calibration := calibration_of(found.error_map.predictor)) is not None:
        show_calibration(calibration)
    elif found.parameters:
        say(table("Parameters", ["", "estimate", "± std", "unit", OFF, ""], map(_parameter, found.parameters)))
    if found.curves:
        columns = ["joint", "from [deg]", "to [deg]", "RMS [mrad]", "mean std [mrad]"]
        say(table("Joint curves, without the mean and first harmonic (geometry)", columns, map(_curve, found.curves)))
    simple = {k: v for k, v in found.hyperparameters.items() if k != "hyper" and v is not None}
    say("Settings:", *(f"  {name}: {_short(value)}" for name, value in simple.items()))


def _curve(curve: Any) -> tuple[Any, ...]:
    rms = float((curve.error**2).mean() ** 0.5)
    ends = float(curve.angle[0] * _DEGREES), float(curve.angle[-1] * _DEGREES)
    return (curve.joint + 1, *ends, 1e3 * rms, 1e3 * float(curve.std.mean()))


def _gap(gap: Gap) -> tuple[Any, ...]:
    angles = gap.uncovered_low, gap.uncovered_high, gap.measure
    return gap.joint + 1, *(f"{angle * _DEGREES:.1f}" for angle in angles)


def _effect(row: dict[str, Any]) -> tuple[str, ...]:
    factor, unit = (1e6, "µrad") if row["unit"] == "rad" else (1e6, "µm/m/K")
    low, high = (row["estimate"] + side * 1.96 * row["std"] for side in (-1.0, 1.0))
    low = max(low, 0.0) if row["group"] in ("gear", "backlash shape") else low  # an amplitude
    return row["name"], *(f"{factor * value:.1f}" for value in (row["estimate"], low, high)), unit


def _parameter(row: dict[str, Any]) -> tuple[str, ...]:
    factor, unit = (1e3, "mrad" + row["unit"][3:]) if row["unit"].startswith("rad") else (1.0, row["unit"])
    note = "" if row["told"] else "poorly determined"
    off = f"{row['off']:+.1f}"
    return row["name"], f"{factor * row['estimate']:.4f}", f"{factor * row['std']:.4f}", unit, off, note


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return "(" + ", ".join(f"{k} {_short(v)}" for k, v in value.items() if v is not None) + ")"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_short, value)) + "]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
