"""``truepose plan``: the poses to measure, the accuracy to expect, and the measuring program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from truepose.cli.options import CellPath, Force, Json
from truepose.cli.output import emit_json, overwrite, say, table, working

_FIGURES: Final = ("mean", "low", "high")


def plan(
    cell_path: CellPath,
    n: Annotated[int, typer.Option("--n", min=1, help="Number of poses.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for plan.csv and the measuring program.")],
    method: Annotated[
        str,
        typer.Option(
            "--method",
            help="Criterion or design: posterior, posterior-largest, d-optimal, o2 … o5 (observability), grid, "
            "latin-hypercube or sobol.",
        ),
    ] = "posterior",
    candidates: Annotated[
        Path | None,
        typer.Option(
            "--candidates", help="Table of configurations (q1_deg …) to choose from instead of the cell's region."
        ),
    ] = None,
    after: Annotated[
        Path | None, typer.Option("--after", help="Map of an earlier series; choose the poses that add most to it.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the candidates and of the random methods.")] = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Choose poses in the cell's region; write the measuring program, and plan.csv to match the readings with."""
    from truepose.cell import load_cell
    from truepose.error_map import load_map
    from truepose.errors import FileError
    from truepose.planning import plan as make_plan
    from truepose.samples import on_arm, read_poses

    overwrite(force, out / "plan.csv")
    cell = load_cell(cell_path)
    known = None if after is None else load_map(after)
    offered = None if candidates is None else on_arm(read_poses(candidates), cell.load_robot()).q
    if candidates is not None and offered is None:
        raise FileError(candidates, "has no joints (q1_deg …) to choose from")
    with working("Choosing poses", quiet=as_json) as progress:
        found = make_plan(cell, n, method, candidates=offered, after=known, rng=seed, progress=progress.count)
    written = found.write(out)
    if as_json:
        emit_json({**found.to_dict(), "files": written})
        return
    say(f"{found.reach.describe()}.")
    say(
        table(
            "Expected accuracy in the work region, noise included",
            ["poses", "mean [mm]", "10 %", "90 %"],
            [
                (f"{row['n']:.0f}{' (this plan)' if row['n'] == n else ''}", *(row[f"{k}_mm"] for k in _FIGURES))
                for row in found.expected
            ],
        )
    )
    if inseparable := found.observability.describe():
        say(f"This plan cannot separate these parameters: {inseparable}. Predictions are not affected.")
    if by_home := sum(box != "" for box in found.way):
        say(f"[yellow]{by_home} motions go through home[/]: the direct path would touch a box.")
    if len(written) == 1:
        maker = cell.load_robot().maker or "an arm without a maker"
        say(f"[yellow]No measuring program[/] for {maker}: use the joints in plan.csv.")
    say(f"Wrote {', '.join(map(str, written))}.")
    say("Run the program slowly the first time: it avoids only the boxes in the cell file.")
