"""``truepose import``: from a measurement file and its plan to samples."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.cli.options import AcceptCampaign, CellPath, Force, Json
from truepose.cli.output import emit_json, overwrite, say
from truepose.cli.summaries import show_campaign
from truepose.cli.tool import show_tool, tool_data
from truepose.errors import DataError

if TYPE_CHECKING:
    from truepose.trackers import Columns


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
    columns: Annotated[
        str | None,
        typer.Option("--columns", help="Columns of the quantities: 'x=4, y=5, z=6, unit=m', or a saved .toml file."),
    ] = None,
    unit: Annotated[
        str | None, typer.Option("--unit", help="Unit of lengths in a file that states none: mm, m, cm or in.")
    ] = None,
    save_columns: Annotated[
        Path | None, typer.Option("--save-columns", help="Save --columns to this .toml file.")
    ] = None,
    reflectors: Annotated[
        str | None,
        typer.Option(
            "--reflectors", help="Reflectors read per pose: their number, or a file with their positions in mm."
        ),
    ] = None,
    keep: Annotated[int | None, typer.Option("--keep", help="Number of the one reflector to keep, from 1.")] = None,
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

    _check_pairs(("--save-columns", save_columns, "--columns", columns), ("--keep", keep, "--reflectors", reflectors))
    overwrite(force, out, *([] if save_columns is None else [save_columns]))
    cell = load_cell(cell_path)
    samples, understood = trackers.import_readings(
        readings_path,
        trackers.read_plan(plan_path),
        cell=cell,
        columns=None if columns is None else _columns(columns, save_columns),
        unit=unit,
        reflectors=_reflectors(reflectors),
        keep=keep,
        reorder=reorder,
        missing=missing,
        two_stations=two_stations or accept_campaign,
    )
    if not as_json:
        say(*understood.sentences())
    robot = cell.load_robot()
    registration, tf_flange_tool, _ = register_samples(cell, robot, samples)
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
        residual = f"{name_one(outlier)}, {outlier['residual_mm']:.3f} mm"
        say(f"[yellow]Large residual[/]: {residual}; fits leave it out unless neighbouring samples agree with it.")
    say(f"Wrote {out} ({len(samples)} samples).")


def _check_pairs(*pairs: tuple[str, Any, str, Any]) -> None:
    """Refuse an option that is given without the option that it depends on."""
    for option, value, needed, other in pairs:
        if value is not None and other is None:
            raise DataError(f"{option} has no effect without {needed}; give both")


def _columns(text: str, save: Path | None) -> Columns:
    """Return the columns that an option states, or the file that it names; save them on request."""
    from truepose.trackers import Columns

    columns = Columns.parse(text) if "=" in text else Columns.load(text)
    if save is not None:
        columns.save(save)
    return columns


def _reflectors(text: str | None) -> Any:
    """Return the number of reflectors, or their positions on the tool (m, 3) [mm] from a file."""
    from truepose._io.strict import is_whole
    from truepose.trackers import read_readings

    if text is None or is_whole(text):
        return text and int(text)
    return read_readings(text).p
