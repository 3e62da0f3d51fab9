"""Commands on virtual cells: the demonstration, and the paper's experiment."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from truepose._extras import needed
from truepose.cli.options import Execution, Force, Json, with_groups
from truepose.cli.output import accuracy_table, emit_json, overwrite, say, table, working

Preset = Annotated[str, typer.Option(help="Preset of the virtual cells: paper, hard or ideal.")]


def demo(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for all results.")] = Path("truepose-demo"),
    seed: Annotated[int, typer.Option(help="Seed of the virtual robot, tracker and noise.", min=0)] = 0,
    preset: Preset = "paper",
    predictor: Annotated[str | None, typer.Option(help="Predictor of the map; the preset's own by default.")] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Run the whole workflow on a virtual cell: plan, measure, fit, validate, correct a program, verify, report."""
    from truepose.studies.demo import run_demo

    overwrite(force, directory / "cell.toml")
    with working(quiet=as_json) as progress:
        result = run_demo(directory, preset=preset, seed=seed, predictor=predictor, progress=progress)
    if as_json:
        emit_json(result)
        return
    say(
        f"Virtual {result['robot']}: {result['n_samples']} poses for the fit of {result['predictor']}, "
        f"{result['before']['n']} held-out poses; errors after {result['registration']}.",
        result["similarity"],
        accuracy_table("Held-out poses before and after", result),
        f"Lower limit by noise, for any predictor: mean {result['noise_floor_mm']:.3f} mm.",
        accuracy_table("Program targets, measured again after the correction", result["remeasured"]),
        result["verification"],
        f"Program:  {result['program']}",
        *([] if result["report"] is None else [f"Report:   {result['report']}"]),
    )


_EXECUTION = Execution()


@with_groups
def study(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for results, table and picture.")] = Path(
        "truepose-study"
    ),
    seeds: Annotated[int, typer.Option(help="Number of virtual cells.", min=1)] = 10,
    per_axis: Annotated[int, typer.Option(help="Number of grid nodes per axis; n is its cube.", min=3)] = 5,
    preset: Preset = "paper",
    execution: Execution = _EXECUTION,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Repeat the paper's experiment with its method and ours, on grids and at random, at one and many orientations."""
    with needed("the picture of the study", "report"):
        import matplotlib  # noqa: F401  # missing packages are found before the work
    from truepose.studies.paper import PUBLISHED_REDUCTION, STUDY_FILES, groups, run_study, spread, write_study

    overwrite(force, *(directory / name for name in STUDY_FILES))
    with working(quiet=as_json) as progress, execution.executor("study", pays=False) as executor:
        results = run_study(preset, range(seeds), per_axis=per_axis, executor=executor, progress=progress)
    write_study(directory, results)
    if as_json:
        emit_json({"directory": directory, "results": [asdict(result) for result in results]})
        return
    heads = ["method", "samples", "max [mm]", "mean reduced by", "max reduced by"]
    for wanted in dict.fromkeys(result.orientation for result in results):
        rows = []
        for (orientation, sampling, method), of in groups(results).items():
            if orientation == wanted:
                before, after = spread(of, "max_before")[0], spread(of, "max_after")[0]
                less = (f"{spread(of, f'reduction_{what}')[0]:.1f} %" for what in ("mean", "max"))
                rows.append((method, sampling, f"{before:.2f} → {after:.2f}", *less))
        say(table(f"{wanted.capitalize()} orientation: medians of {seeds} cells, {per_axis**3} samples", heads, rows))
    say(f"Published reduction of the maximum: {PUBLISHED_REDUCTION} %.", f"Wrote {directory}.")
