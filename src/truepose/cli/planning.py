"""`truepose plan`: where to measure, what accuracy to expect, and the measuring program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.cli.output import Force, Json, counting, emit_json, overwrite, say, table


def plan(
    cell_path: Annotated[Path, typer.Argument(metavar="CELL", help="The cell file, with its \\[region].")],
    n: Annotated[int, typer.Option("--n", min=1, help="How many poses.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for plan.csv and the measuring program.")],
    method: Annotated[
        str,
        typer.Option(
            "--method",
            help="posterior, posterior-largest, d-optimal, o2 … o5 (observability), grid, latin-hypercube or sobol.",
        ),
    ] = "posterior",
    candidates: Annotated[
        Path | None,
        typer.Option("--candidates", help="Choose among these configurations (q1_deg …), not in the \\[region]."),
    ] = None,
    after: Annotated[
        Path | None, typer.Option("--after", help="Map of a first series: choose what to measure next.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Of candidates and random methods.")] = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Choose where to measure, and write the measuring program and the list to match the readings to."""
    from truepose.cell import load_cell
    from truepose.error_map import load_map
    from truepose.errors import FileError
    from truepose.planning import plan as make_plan
    from truepose.samples import read_poses

    overwrite(force, out / "plan.csv")
    cell = load_cell(cell_path)
    known = None if after is None else load_map(after)
    offered = None if candidates is None else read_poses(candidates).q
    if candidates is not None and offered is None:
        raise FileError(candidates, "has no joints (q1_deg …) to choose among")
    with counting("Choosing poses") as progress:
        found = make_plan(cell, n, method, candidates=offered, after=known, rng=seed, progress=progress)
    written = found.write(out)
    if as_json:
        emit_json({**found.to_dict(), "files": written})
        return
    say(f"{found.reach.describe()}.")
    say(
        table(
            "Accuracy to expect in the work region, noise included",
            ["poses", "mean [mm]"],
            [(f"{row['n']:.0f}{' (this plan)' if row['n'] == n else ''}", row["mean_mm"]) for row in found.expected],
        )
    )
    if told := found.observability.describe():
        say(f"Such poses cannot tell apart, which predictions do not mind: {told}.")
    if by_home := sum(box != "" for box in found.way):
        say(f"[yellow]{by_home} motions go by home[/]: the straight way would touch a box.")
    if len(written) == 1:
        say(f"[yellow]No measuring program[/] is written for {cell.load_robot().maker}: take the joints of plan.csv.")
    say(f"Wrote {', '.join(map(str, written))}.")
    say("Run the program slowly the first time: only the boxes of the cell file are known.")
