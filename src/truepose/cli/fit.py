"""``truepose fit``: registration, tool and predictor from samples to a map."""

from __future__ import annotations

from contextlib import ExitStack
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.cli.options import (
    AcceptCampaign,
    Candidates,
    CellPath,
    Execution,
    Force,
    Json,
    PredictorName,
    SamplesPath,
    with_groups,
)
from truepose.cli.output import accuracy_table, emit_json, overwrite, say, working
from truepose.cli.store_record import RecordIn, record_map, recorder
from truepose.cli.summaries import (
    show_better,
    show_calibration,
    show_campaign,
    show_choice,
    show_facts,
    show_fleet,
    show_worth,
)
from truepose.cli.tool import show_tool

if TYPE_CHECKING:
    from truepose.error_map import ErrorMap


_EXECUTION = Execution()


@with_groups
def fit(
    cell_path: CellPath,
    samples_path: SamplesPath,
    predictor: PredictorName = "auto",
    out: Annotated[Path, typer.Option("--out", help="The map to write.")] = Path("map.truepose"),
    candidates: Candidates = "quick",
    splits: Annotated[
        str, typer.Option(help="Cross-validation of auto: points, blocks, branches, separated by commas.")
    ] = "points,blocks",
    execution: Execution = _EXECUTION,
    accept_campaign: AcceptCampaign = False,
    like: Annotated[
        list[Path] | None,
        typer.Option("--like", help="Map of another robot of the same type, as a prior; may be repeated."),
    ] = None,
    parameters: Annotated[bool, typer.Option("--parameters", help="Show also the identified parameters.")] = False,
    store: RecordIn = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Register the samples, fit the tool if the cell file asks for it, fit a predictor, and write a map."""
    from truepose.cell import load_cell
    from truepose.error_map import load_map
    from truepose.error_map.figures import fit_figures
    from truepose.error_map.fit import fit_cell
    from truepose.error_map.rivals import better_predictor
    from truepose.samples import read_samples

    overwrite(force, out)
    with recorder(store, "fit") as record, working(quiet=as_json) as progress, ExitStack() as stack:
        executor = stack.enter_context(execution.executor("cross-validation")) if execution.asked else None
        samples = read_samples(samples_path)
        error_map = fit_cell(
            load_cell(cell_path),
            samples,
            predictor,
            candidates=candidates if candidates in ("quick", "all") else candidates.split(","),
            splits=splits.split(","),
            workers=0,
            executor=executor,
            progress=progress,
            accept_campaign=accept_campaign,
            like=[load_map(path) for path in like or ()],
        )
        error_map.save(out)
        if record is not None:
            record_map(record, cell_path, out, error_map, samples_path, samples)
        progress("Comparing with another predictor")
        better = better_predictor(error_map)
    data = {"map": out, **fit_figures(error_map), "better": None if better is None else better.to_dict()}
    if as_json:
        emit_json(data)
        return
    _show(error_map, parameters=parameters)
    if like and "fleet" not in data:
        say(f"[yellow]Note[/]: {error_map.predictor_name} was chosen, which takes nothing from maps of other robots.")
    title = f"{error_map.predictor_name}: each sample predicted from the others"
    say(accuracy_table(title, {"before": data["registered"], "after": data["leave_one_out"]}), f"Wrote {out}.")
    show_better(better)


def _show(error_map: ErrorMap, *, parameters: bool) -> None:
    from rich.markup import escape

    from truepose.error_map.conditions import models
    from truepose.error_map.figures import calibration_of, fleet_data
    from truepose.error_map.registration import tool_estimate
    from truepose.samples import name_points

    registration, calibration = error_map.registration, calibration_of(error_map.predictor)
    show_tool(error_map.cell, registration, tool_estimate(error_map.cell, error_map.robot, error_map.samples))
    colour = "green" if error_map.arm_check.checked else "yellow"
    say(f"[{colour}]Arm and tool[/]: {escape(error_map.arm_check.words)}")
    show_facts(error_map.facts)
    if registration.hint:
        say(f"[yellow]Note[/]: {registration.hint}.")
    if models(error_map.predictor, "payload") and error_map.samples.p_load is None:
        say(
            "[yellow]Note[/]: the samples state payloads without their centre of mass (x_load_mm …); it is taken to "
            "lie between wrist and tool point."
        )
    show_campaign(error_map.campaign)
    for reason, rows in groupby(error_map.excluded, key=itemgetter("reason")):
        say(f"[yellow]Left out[/]: {name_points(list(rows))}, {reason}.")
    used = getattr(error_map.predictor, "distance_rows", None)
    if used is not None:
        say(f"Distances: {len(used)} from fixed points are fitted together with the positions.")
    if error_map.ranking:
        show_choice(error_map.ranking, error_map.expected)
    if calibration is not None:
        show_calibration(calibration, parameters=parameters)
    show_fleet(fleet_data(error_map.predictor))
    show_worth(error_map.worth)
