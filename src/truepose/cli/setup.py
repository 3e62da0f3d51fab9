"""Commands before a map: robots, init, import."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from truepose.cli.output import Force, Json, emit_json, overwrite, say, table


def robots(name: Annotated[str | None, typer.Argument(help="Show this one.")] = None, as_json: Json = False) -> None:
    """List the robots of the library, or show one."""
    import numpy as np

    from truepose.robots import list_robots, load_robot

    if name is None:
        names = list_robots()
        if as_json:
            emit_json({"robots": names})
        else:
            say(*names)
        return
    robot = load_robot(name)
    limits = np.rad2deg(robot.limits)
    if as_json:
        emit_json(
            {
                "name": robot.name,
                "maker": robot.maker,
                "model": robot.model,
                "source": robot.source,
                "convention": robot.convention,
                "joints": [
                    {
                        "sign": robot.sign[i],
                        "offset_deg": np.rad2deg(robot.offset[i]),
                        "alpha_deg": np.rad2deg(robot.alpha[i]),
                        "a_mm": robot.a[i],
                        "d_mm": robot.d[i],
                        "min_deg": limits[i, 0],
                        "max_deg": limits[i, 1],
                    }
                    for i in range(robot.dof)
                ],
            }
        )
        return
    rows = [
        (
            f"{i + 1}",
            f"{np.rad2deg(robot.alpha[i]):.3f}",
            f"{robot.a[i]:.3f}",
            f"{robot.d[i]:.3f}",
            f"{robot.sign[i]:+.0f}",
            f"{np.rad2deg(robot.offset[i]):.3f}",
            f"{limits[i, 0]:.1f} … {limits[i, 1]:.1f}",
        )
        for i in range(robot.dof)
    ]
    columns = ["joint", "alpha [deg]", "a [mm]", "d [mm]", "sign", "offset [deg]", "limits [deg]"]
    say(table(f"{robot.maker} {robot.model} ({robot.convention})", columns, rows), f"Source: {robot.source}")


def init(
    directory: Annotated[Path, typer.Argument(help="Folder of the new cell; made when it is not there.")],
    robot: Annotated[
        str, typer.Option("--robot", help="A library name (see 'truepose robots') or a .toml/.urdf file.")
    ],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a commented cell.toml to start from."""
    from truepose._io.files import write_atomic
    from truepose.cell import template
    from truepose.robots import load_robot

    load_robot(robot)
    path = directory / "cell.toml"
    overwrite(force, path)
    write_atomic(path, template(robot))
    if as_json:
        emit_json({"cell": path})
    else:
        say(f"Wrote {path}: state the tool, the tracker and the limits there, then 'truepose import' your readings.")


def import_readings(
    cell_path: Annotated[Path, typer.Argument(metavar="CELL", help="The cell file.")],
    readings_path: Annotated[Path, typer.Argument(metavar="READINGS", help="The tracker's file.")],
    plan_path: Annotated[
        Path, typer.Option("--plan", help="What was commanded, in order: plan.csv, or the controller's joint targets.")
    ],
    out: Annotated[Path, typer.Option("--out", help="The table of samples to write.")] = Path("samples.csv"),
    reorder: Annotated[
        bool, typer.Option("--reorder", help="Accept rows that were found to be swapped, in the order found.")
    ] = False,
    missing: Annotated[bool, typer.Option("--missing", help="Accept rows of the plan without a reading.")] = False,
    two_stations: Annotated[
        bool, typer.Option("--two-stations", help="Accept readings that look as if the tracker had been moved.")
    ] = False,
    accept_campaign: Annotated[
        bool,
        typer.Option(
            "--accept-campaign", help="Accept also a scale, a drift, or reference points that do not come back."
        ),
    ] = False,
    columns: Annotated[
        str | None,
        typer.Option(
            "--columns", help="Where the quantities stand: 'x=4, y=5, z=6, unit=m', or a file that was saved."
        ),
    ] = None,
    save_columns: Annotated[
        Path | None, typer.Option("--save-columns", help="Write what --columns says to a .toml file.")
    ] = None,
    reflectors: Annotated[
        str | None,
        typer.Option("--reflectors", help="Several read at each pose: how many, or a file of where they sit [mm]."),
    ] = None,
    keep: Annotated[int | None, typer.Option("--keep", help="Of several reflectors keep this one, from 1.")] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Read a tracker's file, match it to the plan, register it and name the outliers."""
    from dataclasses import asdict

    import numpy as np

    from truepose import trackers
    from truepose.cell import load_cell
    from truepose.cli.campaign import show_campaign
    from truepose.error_map.campaign import check_campaign
    from truepose.error_map.registration import register_samples
    from truepose.errors import DataError
    from truepose.samples import write_samples

    for option, value, needed, other in (
        ("--save-columns", save_columns, "--columns", columns),
        ("--keep", keep, "--reflectors", reflectors),
    ):
        if value is not None and other is None:
            raise DataError(f"{option} has no effect without {needed}; give both")
    overwrite(force, out, *([] if save_columns is None else [save_columns]))
    cell = load_cell(cell_path)
    told = None
    if columns is not None:
        told = trackers.Columns.parse(columns) if "=" in columns else trackers.Columns.load(columns)
        if save_columns is not None:
            told.save(save_columns)
    samples, understood = trackers.import_readings(
        readings_path,
        trackers.read_plan(plan_path),
        cell=cell,
        columns=told,
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
    if not accept_campaign:
        campaign.refuse(samples.source, accepted=("moved", "drift", "reference") if two_stations else ())
    length = np.linalg.norm(registration.residuals, axis=1)
    assert samples.row is not None
    outliers = [
        {"row": int(samples.row[i]), "residual_mm": float(length[i])} for i in np.flatnonzero(registration.outliers)
    ]
    write_samples(out, samples)
    kept = length[~registration.outliers]
    figures = {"mean_mm": float(kept.mean()), "max_mm": float(kept.max())}
    if as_json:
        emit_json(
            {
                "samples": out,
                "n": len(samples),
                "understood": understood.sentences(),
                "summary": asdict(understood),
                "registration": figures,
                "outliers": outliers,
                "campaign": campaign.to_dict(),
            }
        )
        return
    say(f"After registration the error is {figures['mean_mm']:.3f} mm in the mean, {figures['max_mm']:.3f} mm at most.")
    show_campaign(campaign.to_dict())
    for outlier in outliers:
        say(
            f"[yellow]Large residual[/]: row {outlier['row']}, {outlier['residual_mm']:.3f} mm; "
            "it stays in the file, and fits leave it out unless its neighbours agree."
        )
    say(f"Wrote {out} ({len(samples)} samples).")


def _reflectors(told: str | None) -> Any:
    """Return how many reflectors there are, or where they sit on the tool as read from a file (m, 3) [mm]."""
    from truepose._io.strict import is_whole
    from truepose.trackers import read_readings

    if told is None or is_whole(told):
        return told and int(told)
    return read_readings(told).p
