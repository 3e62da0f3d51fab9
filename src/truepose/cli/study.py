"""The paper's experiment on virtual cells, by one command."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from truepose.cli.output import Force, Json, emit_json, overwrite, say, table, working


def study(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for results, table and picture.")] = Path(
        "truepose-study"
    ),
    seeds: Annotated[int, typer.Option(help="Number of virtual cells.", min=1)] = 10,
    per_axis: Annotated[int, typer.Option(help="Grid nodes along each axis; their cube is n.", min=3)] = 5,
    preset: Annotated[str, typer.Option(help="The virtual cells: paper, hard, ideal.")] = "paper",
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Repeat the paper's experiment: its method and ours, on grids and at random, at one orientation and at many."""
    from truepose.studies.paper import PUBLISHED_REDUCTION, STUDY_FILES, groups, run_study, spread, write_study

    overwrite(force, *(directory / name for name in STUDY_FILES))
    with working() as progress:
        results = run_study(preset, range(seeds), per_axis=per_axis, progress=progress)
    write_study(directory, results)
    if as_json:
        emit_json({"directory": directory, "results": [asdict(result) for result in results]})
        return
    heads = ["method", "samples", "max [mm]", "mean less", "max less"]
    for wanted in dict.fromkeys(result.orientation for result in results):
        rows = []
        for (orientation, sampling, method), of in groups(results).items():
            if orientation == wanted:
                before, after = spread(of, "max_before")[0], spread(of, "max_after")[0]
                less = (f"{spread(of, f'reduction_{what}')[0]:.1f} %" for what in ("mean", "max"))
                rows.append((method, sampling, f"{before:.2f} → {after:.2f}", *less))
        say(table(f"{wanted.capitalize()} orientation: medians of {seeds} cells, {per_axis**3} samples", heads, rows))
    say(f"The paper reports a maximum less by {PUBLISHED_REDUCTION} %.", f"Wrote {directory}.")
