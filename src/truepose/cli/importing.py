"""``truepose import``: from a measurement file and its plan to samples."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.cli.measurement import Measurement
from truepose.cli.options import AcceptCampaign, CellPath, Force, Json, with_groups
from truepose.cli.output import emit_json, overwrite, say, working
from truepose.cli.summaries import show_campaign
from truepose.cli.tool import show_tool, tool_data

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
    measurement: Measurement = _MEASUREMENT,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Read a measurement file, match it with the plan, register it, report outliers, and write samples."""
    from dataclasses import asdict

    import numpy as np

    from truepose import trackers
    from truepose.cell import load_cell
    from truepose.error_map.campaign import check_campaign
    from truepose.error_map.registration import register_samples, tool_estimate, wrong_tool_named
    from truepose.samples import name_one, write_samples

    overwrite(force, out, *measurement.check())
    cell = load_cell(cell_path)
    with working("Matching the readings with the plan", quiet=as_json):
        samples, understood = trackers.import_readings(
            readings_path,
            trackers.read_plan(plan_path),
            cell=cell,
            **measurement.settings(),
            reorder=reorder,
            missing=missing,
            two_stations=two_stations or accept_campaign,
        )
    if not as_json:
        say(*understood.sentences())
    robot = cell.load_robot()
    with working("Registering", quiet=as_json) as progress:
        registration, tf_flange_tool, _ = register_samples(cell, robot, samples)
        progress("Testing for a moved tracker, a scale error and a drift")
        campaign = check_campaign(cell, robot, samples, registration, tf_flange_tool)
        tool = tool_estimate(cell, robot, samples)
    if not accept_campaign:
        with wrong_tool_named(cell, robot, samples):
            campaign.refuse(samples.source, accepted=("moved", "drift", "reference") if two_stations else ())
    length = np.linalg.norm(registration.residuals, axis=1)
    outliers = [
        {**samples.identify(i), "residual_mm": float(length[i])} for i in np.flatnonzero(registration.outliers).tolist()
    ]
    write_samples(out, samples)
    kept = length[~registration.outliers]
    figures = {"mean_mm": float(kept.mean()), "max_mm": float(kept.max())}
    if as_json:
        data = {"samples": out, "n": len(samples), "understood": understood.sentences(), "summary": asdict(understood)}
        data |= {"registration": figures, "outliers": outliers, "campaign": campaign.to_dict()}
        emit_json({**data, **tool_data(registration, tool)})
        return
    say(f"Error after registration: mean {figures['mean_mm']:.3f} mm, maximum {figures['max_mm']:.3f} mm.")
    show_tool(cell, registration, tool)
    show_campaign(campaign.to_dict())
    for outlier in outliers:
        residual = f"{name_one(outlier)} of {readings_path}, {outlier['residual_mm']:.3f} mm"
        say(f"[yellow]Large residual[/]: {residual}; fits leave it out unless neighbouring samples agree with it.")
    say(f"Wrote {out} ({len(samples)} samples).")
