"""``truepose import`` and ``truepose mask``: from a measurement file and its plan to samples; samples to leave out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.cli.measurement import Measurement
from truepose.cli.options import AcceptCampaign, CellPath, Force, Json, with_groups
from truepose.cli.output import emit_json, overwrite, say, working
from truepose.cli.store_record import RecordIn, record_samples, recorder
from truepose.cli.summaries import show_campaign
from truepose.cli.tool import show_tool

_MEASUREMENT = Measurement()


@with_groups
def import_readings(
    cell_path: CellPath,
    readings_path: Annotated[Path, typer.Argument(metavar="READINGS", help="The measurement file of the tracker.")],
    plan_path: Annotated[
        Path, typer.Option("--plan", help="Commanded poses in order: plan.csv, or joint targets of the controller.")
    ],
    out: Annotated[Path, typer.Option("--out", help="The table of samples to write.")] = Path("samples.csv"),
    reorder: Annotated[bool, typer.Option("--reorder", help="Accept readings in another order than the plan.")] = False,
    missing: Annotated[bool, typer.Option("--missing", help="Leave out points of the plan without a reading.")] = False,
    two_stations: Annotated[
        bool, typer.Option("--two-stations", help="Accept readings from a tracker that seems to have moved.")
    ] = False,
    accept_campaign: AcceptCampaign = False,
    mask_path: Annotated[
        Path | None,
        typer.Option("--mask", help="Table of points to leave out (point or row, reason); they stay in the samples."),
    ] = None,
    distances_path: Annotated[
        Path | None,
        typer.Option("--distances", help="Table of distances from fixed points: q1_deg … and distance_mm."),
    ] = None,
    measurement: Measurement = _MEASUREMENT,
    store: RecordIn = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Read a measurement file, match it with the plan, register it, report outliers, and write samples."""
    from truepose.cell import load_cell
    from truepose.error_map.importing import import_samples
    from truepose.samples import name_one, read_distances, read_mask
    from truepose.trackers import read_plan

    overwrite(force, out, *measurement.check())
    cell = load_cell(cell_path)
    with (
        recorder(store, "measure") as record,
        working("Matching the readings with the plan", quiet=as_json) as progress,
    ):
        found = import_samples(
            cell,
            readings_path,
            read_plan(plan_path),
            **measurement.settings(),
            mask=None if mask_path is None else read_mask(mask_path),
            distances=None if distances_path is None else read_distances(distances_path),
            reorder=reorder,
            missing=missing,
            two_stations=two_stations,
            accept_campaign=accept_campaign,
            progress=progress,
            matched=lambda understood: None if as_json else say(*understood.sentences()),
        )
        found.write(out)
        if record is not None:
            record_samples(record, cell_path, out, readings_path, found.samples, found.campaign.to_dict())
    if as_json:
        from truepose.error_map.figures import tool_data

        emit_json({"samples": out, **found.to_dict(), **tool_data(found.registration, found.tool)})
        return
    for masked in found.samples.excluded:
        say(f"[yellow]Left out[/]: {name_one(masked)}, {masked['reason']}.")
    say("Error after registration: mean {mean_mm:.3f} mm, maximum {max_mm:.3f} mm.".format(**found.figures))
    show_tool(cell, found.registration, found.tool)
    show_campaign(found.campaign.to_dict())
    for outlier in found.outliers:
        residual = f"{name_one(outlier)} of {readings_path}, {outlier['residual_mm']:.3f} mm"
        say(f"[yellow]Large residual[/]: {residual}; fits leave it out unless neighbouring samples agree with it.")
    distances = found.samples.distances
    more = "" if distances is None else f" and {len(distances)} distances"
    say(f"Wrote {out} ({len(found.samples)} samples{more}).")


def mask(
    samples_path: Annotated[Path, typer.Argument(metavar="SAMPLES", help="The table of samples.")],
    out: Annotated[Path, typer.Option("--out", help="The table of samples to write.")],
    mask_path: Annotated[
        Path | None,
        typer.Option("--mask", help="Table of points to leave out (point or row, reason); all others count."),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a table of samples anew with other points left out; without --mask, every point counts again."""
    from truepose.samples import mask_table, name_one, read_mask

    overwrite(force, out)
    with working("Masking the samples", quiet=as_json):
        found = mask_table(samples_path, out, None if mask_path is None else read_mask(mask_path))
    if as_json:
        emit_json({"samples": out, "n": len(found), "masked": len(found.excluded)})
        return
    for masked in found.excluded:
        say(f"[yellow]Left out[/]: {name_one(masked)}, {masked['reason']}.")
    say(f"Wrote {out} ({len(found)} samples count).")
