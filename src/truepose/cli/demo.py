"""The main job on an embedded cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.cli.output import Force, Json, accuracy_table, emit_json, overwrite, say, working


def demo(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for everything that is written.")] = Path(
        "truepose-demo"
    ),
    seed: Annotated[int, typer.Option(help="Another robot, another tracker, other noise.", min=0)] = 0,
    preset: Annotated[str, typer.Option(help="The virtual cell: paper, hard or ideal.")] = "paper",
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Plan, measure a virtual robot, find the similarity, fit, validate, correct a program, measure again, report."""
    from truepose.studies.demo import run_demo

    overwrite(force, directory / "cell.toml")
    if as_json:
        emit_json(run_demo(directory, preset=preset, seed=seed, progress=lambda _: None))
        return
    with working() as progress:
        result = run_demo(directory, preset=preset, seed=seed, progress=progress)
    say(
        f"A virtual {result['robot']}: {result['n_samples']} poses to fit by {result['predictor']}, "
        f"{result['before']['n']} held out; errors after {result['registration']}.",
        result["similarity"],
        accuracy_table("Held-out poses, before and after", result),
        f"No predictor can do better than the noise: {result['noise_floor_mm']:.3f} mm in the mean.",
        accuracy_table("Targets of the program, measured again after correction", result["remeasured"]),
        f"Program:  {result['program']}",
        f"Report:   {result['report']}",
    )
