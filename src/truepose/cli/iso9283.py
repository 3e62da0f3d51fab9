"""``truepose iso9283``: the characteristics of ISO 9283, and its test poses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.cli.options import Force, Json
from truepose.cli.output import emit_json, overwrite, say, table, working

if TYPE_CHECKING:
    from truepose.verification import Iso9283


def iso9283(
    path: Annotated[
        Path, typer.Argument(metavar="FILE", help="Table of samples of repeated poses; with --poses, the cell file.")
    ],
    cell_path: Annotated[
        Path | None,
        typer.Option(
            "--cell", help="The cell file; its tool and tracker station transform the readings to the base frame."
        ),
    ] = None,
    registered: Annotated[
        bool, typer.Option("--registered", help="The readings are already in the robot base frame.")
    ] = False,
    poses: Annotated[
        Path | None,
        typer.Option(
            "--poses",
            help="Write the standard's test poses for the cell FILE to this table, and a measuring program.",
        ),
    ] = None,
    edge: Annotated[float | None, typer.Option("--edge", help="Edge of the test cube in mm.", min=1.0)] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Evaluate pose accuracy and repeatability, drift, distances and paths by ISO 9283; list what is missing for it."""
    from truepose.cell import load_cell
    from truepose.samples import read_samples
    from truepose.studies.performance import iso9283 as evaluate

    if poses is not None:
        overwrite(force, poses)
        _write_poses(path, poses, edge, as_json)
        return
    with working(quiet=as_json) as progress:
        samples = read_samples(path)
        progress("Evaluating")
        found = evaluate(samples, cell=None if cell_path is None else load_cell(cell_path), registered=registered)
    stated = {
        "source": str(path),
        "readings": len(samples),
        "frame": "base" if registered else "registered with the cell" if cell_path else "registered on these poses",
        "load_kg": None if samples.load is None else sorted(set(samples.load.tolist())),
        "temperature_C": None
        if samples.temperature is None
        else [samples.temperature.min(), samples.temperature.max()],
    }
    if as_json:
        emit_json({"stated": stated, **found.to_dict()})
        return
    _show(found, stated)


def _write_poses(cell_path: Path, out: Path, edge: float | None, as_json: bool) -> None:
    from truepose.cell import load_cell
    from truepose.planning import write_measurement
    from truepose.studies.performance import iso9283_poses

    cell = load_cell(cell_path)
    with working("Choosing poses", quiet=as_json):
        made = iso9283_poses(cell, edge_mm=edge)
    written = write_measurement(out, cell, made)
    if as_json:
        emit_json({"poses": out, "n": len(made), "what": made.source, "files": written})
    else:
        files = " and ".join(map(str, written))
        say(f"Wrote {files}: {made.source}, P1 to P5 in turn, {len(made) // 5} cycles.")


def _show(found: Iso9283, stated: dict[str, object]) -> None:
    rows = [(pose.name, pose.n, pose.AP_mm, *pose.AP_xyz_mm, pose.RP_mm) for pose in found.poses]
    say(table("Poses (ISO 9283) [mm]", ["pose", "cycles", "AP", "AP x", "AP y", "AP z", "RP"], rows))
    turned = [
        (pose.name, *(f"{value:.4f}" for value in (*pose.AP_abc_deg, *pose.RP_abc_deg)))
        for pose in found.poses
        if pose.AP_abc_deg is not None and pose.RP_abc_deg is not None
    ]
    if turned:
        columns = [f"{figure} {axis}" for figure in ("AP", "RP") for axis in "abc"]
        say(table("Orientations [deg]", ["pose", *columns], turned))
    between = "" if found.AD_poses is None else f"between {found.AD_poses[0]} and {found.AD_poses[1]}"
    over = "" if found.drift_hours is None else f"at {found.drift_pose} over {found.drift_hours:.2f} h"
    lines = [
        ("AP, pose accuracy", found.AP_mm, "largest of these poses"),
        ("RP, pose repeatability", found.RP_mm, "largest of these poses"),
        (
            "vAP, multi-directional pose accuracy variation",
            found.vAP_mm,
            "" if found.vAP_pose is None else f"at {found.vAP_pose}",
        ),
        ("AD, distance accuracy", found.AD_mm, between),
        ("RD, distance repeatability", found.RD_mm, between),
        ("dAP, drift of pose accuracy", found.dAP_mm, over),
        ("dRP, drift of pose repeatability", found.dRP_mm, over),
        ("AT, path accuracy", found.AT_mm, ""),
        ("RT, path repeatability", found.RT_mm, ""),
    ]
    say(
        table(
            "Characteristics", ["", "[mm]", "at"], [(name, "–" if v is None else v, where) for name, v, where in lines]
        )
    )
    frame = f"Frame: {stated['frame']}. AP depends on the frame; RP, vAP, AD, RD and RT do not."
    say(frame, *(f"[yellow]Missing[/]  {text}." for text in found.missing))
