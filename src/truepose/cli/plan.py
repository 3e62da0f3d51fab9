"""``truepose plan``: the poses to measure, the accuracy to expect, and the measuring program."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Final

import typer

from truepose.cli.options import CellPath, Force, Json
from truepose.cli.output import emit_json, overwrite, say, table, working

_FIGURES: Final = ("mean", "low", "high")


def plan(
    cell_path: CellPath,
    n: Annotated[int, typer.Option("--n", min=1, help="Number of poses; with --until, the largest number.")],
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
        Path | None,
        typer.Option("--after", help="Samples or map of an earlier series; choose the poses that add most to it."),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option("--until", metavar="LENGTH", help="Expected accuracy, as 0.1mm; fewer poses than --n may do."),
    ] = None,
    one_side: Annotated[
        bool,
        typer.Option(
            "--one-side", help="Come to all poses from below in every joint; their lost motion is not measured then."
        ),
    ] = False,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the candidates and of the random methods.")] = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Choose poses in the cell's region; write the measuring program, and plan.csv to match the readings with."""
    from truepose.cell import load_cell
    from truepose.error_map import load_map
    from truepose.errors import FileError
    from truepose.planning import plan as make_plan
    from truepose.samples import on_arm, read_poses, read_samples

    mark = None if until is None else _millimetres(until)
    overwrite(force, out / "plan.csv")
    cell = load_cell(cell_path)
    if one_side:
        below = cell.measuring.model_copy(update={"approach": "below"})
        cell = cell.model_copy(update={"measuring": below})
    known = None if after is None else load_map(after) if after.suffix == ".truepose" else read_samples(after)
    offered = None if candidates is None else on_arm(read_poses(candidates), cell.load_robot()).q
    if candidates is not None and offered is None:
        raise FileError(candidates, "has no joints (q1_deg …) to choose from")
    with working("Choosing poses", quiet=as_json) as progress:
        found = make_plan(
            cell, n, method, candidates=offered, after=known, until=mark, rng=seed, progress=progress.count
        )
    written = found.write(out) if len(found.q) else []
    if as_json:
        emit_json({**found.to_dict(), "files": written})
        return
    say(f"{found.reach.describe()}.")
    say(
        table(
            "Expected accuracy in the work region, noise included",
            ["poses", "mean [mm]", "10 %", "90 %"],
            [(_count(row["n"], len(found.q)), *(row[f"{k}_mm"] for k in _FIGURES)) for row in found.expected],
        )
    )
    if not len(found.q):
        say(f"[green]No more poses are needed[/]: the samples reach {mark:g} mm. Nothing was written.")
        return
    if found.reaches is False:
        say(f"[yellow]{mark:g} mm is not expected[/] with {len(found.q)} poses: allow more by --n.")
    if inseparable := found.observability.describe():
        say(f"This plan cannot separate these parameters: {inseparable}. Predictions are not affected.")
    if by_home := sum(box != "" for box in found.way):
        say(f"[yellow]{by_home} motions go through home[/]: the direct path would touch a box.")
    if len(written) == 1:
        maker = cell.load_robot().maker or "an arm without a maker"
        say(f"[yellow]No measuring program[/] for {maker}: use the joints in plan.csv.")
    say(f"Wrote {', '.join(map(str, written))}.")
    if cell.measuring.approach == "both":
        say("Each joint comes from either side in about half of the poses, which measures its lost motion.")
    else:
        say(
            "[yellow]Every joint comes from below[/]: its lost motion is not measured, and corrections of targets that "
            "come from the other side are refused where it is too uncertain."
        )
    say("Run the program slowly the first time: it avoids only the boxes in the cell file.")


def _millimetres(text: str) -> float:
    """Return a positive length [mm], as 0.1mm or 0.1."""
    try:
        value = float(text.strip().removesuffix("mm"))
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise typer.BadParameter(f"expected a length such as 0.1mm, got {text!r}", param_hint="--until")
    return value


def _count(n: float, planned: int) -> str:
    if not n:
        return "0 (the samples alone)"
    return f"{n:.0f} (this plan)" if n == planned else f"{n:.0f}"
