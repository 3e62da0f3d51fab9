"""Commands that set up the installation and a cell: warm-up, robots, init, check-point."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.cli.options import CellPath, Force, Json, parse_numbers
from truepose.cli.output import emit_json, overwrite, say, table, working

if TYPE_CHECKING:
    from truepose.cell import Cell
    from truepose.robots import Robot


def warm_up(as_json: Json = False) -> None:
    """Compile the numerical kernels, once after an installation, so that no other command has to wait for it."""
    from truepose.numerics.warm_up import GROUPS, warm_up

    made: list[str] = []
    with working("Compiling", quiet=as_json) as progress:
        progress.count(0, len(GROUPS))
        for done, (_, names) in enumerate(warm_up(), start=1):
            made += names
            progress.count(done, len(GROUPS))
    kernels = sorted(set(made))
    if as_json:
        emit_json({"compiled": kernels})
    elif kernels:
        say(f"Compiled {len(kernels)} kernels; commands now start without compiling.")
    else:
        say("All kernels have been compiled before; there is nothing to do.")


def robots(
    name: Annotated[
        str | None, typer.Argument(help="Library name, or a .toml, .csv or .urdf file, of one robot to show.")
    ] = None,
    as_template: Annotated[
        bool, typer.Option("--template", help="Print a commented robot file to fill in: --template > my.toml.")
    ] = False,
    as_toml: Annotated[
        bool, typer.Option("--toml", help="Print the robot as a robot file: dh.csv --toml > my.toml.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List the robots of the library, show the parameters of one, or start a robot file of your own."""
    from truepose.robots import load_robot, robot_template, to_toml

    if as_template:
        typer.echo(robot_template(), nl=False)
    elif name is None:
        _list(as_json)
    elif as_toml:
        typer.echo(to_toml(load_robot(name)), nl=False)
    elif as_json:
        emit_json(_robot_data(load_robot(name)))
    else:
        _show(load_robot(name))


def _list(as_json: bool) -> None:
    """Print the names of the library, by maker."""
    from truepose.robots import list_robots, load_robot

    names = list_robots()
    if as_json:
        emit_json({"robots": names})
        return
    makers: dict[str, list[Robot]] = {}
    for robot in map(load_robot, names):
        makers.setdefault(robot.maker, []).append(robot)
    for maker, arms in sorted(makers.items(), key=lambda item: item[0].lower()):
        say(f"[bold]{maker}[/]")
        say(*(f"  {arm.name:<34} {arm.model:<24} {_reach(arm)}".rstrip() for arm in arms))
    say(f"{len(names)} robots. One of your own: truepose robots --template > my.toml")


def _reach(robot: Robot) -> str:
    sheet = robot.data_sheet
    return "" if sheet is None or sheet.reach_mm is None else f"{sheet.reach_mm:6.0f} mm"


def _show(robot: Robot) -> None:
    """Print the parameters of a robot."""
    import numpy as np

    limits, alpha, offset = (np.rad2deg(values) for values in (robot.limits, robot.alpha, robot.offset))
    rows = [
        (
            f"{i + 1}",
            f"{alpha[i]:.3f}",
            f"{robot.a[i]:.3f}",
            f"{robot.d[i]:.3f}",
            f"{robot.sign[i]:+.0f}",
            f"{offset[i]:.3f}",
            f"{limits[i, 0]:.1f} … {limits[i, 1]:.1f}" if np.isfinite(limits[i]).any() else "none",
        )
        for i in range(robot.dof)
    ]
    columns = ["joint", "alpha [deg]", "a [mm]", "d [mm]", "sign", "offset [deg]", "limits [deg]"]
    plate = f"{robot.maker} {robot.model}".strip() or robot.name
    say(table(f"{plate} ({robot.convention})", columns, rows), f"Source: {robot.source or 'not stated'}")
    if robot.data_sheet is not None:
        say(f"Data sheet: {robot.data_sheet}")
    for joint, other, factor in _coupling(robot):
        say(f"Joint {joint} of the model: J{joint} + {factor:g} x J{other} of the controller's display")
    if robot.world_height_mm is not None:
        say(f"Base: the controller's world frame, {robot.world_height_mm:g} mm above the mounting face")


def _robot_data(robot: Robot) -> dict[str, Any]:
    """Return the parameters of a robot as plain values, for JSON."""
    import numpy as np

    limits = np.rad2deg(robot.limits)
    joints = [
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
    ]
    named = {key: getattr(robot, key) for key in ("name", "maker", "model", "source", "convention")}
    sheet = None if robot.data_sheet is None else robot.data_sheet.to_dict()
    return {**named, "joints": joints, "coupling": _coupling(robot), "data_sheet": sheet}


def _coupling(robot: Robot) -> list[tuple[int, int, float]]:
    """Return the coupling of a robot, its own or that of its maker; empty where that is not known."""
    from truepose.errors import RobotError
    from truepose.robots import shown_joints

    try:
        return list(shown_joints(robot).coupling)
    except RobotError:
        return []


def init(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the new cell; created if needed.")],
    robot: Annotated[
        str, typer.Option("--robot", help="Library name (see 'truepose robots'), or a .toml, .csv or .urdf file.")
    ],
    robot_id: Annotated[
        str | None, typer.Option("--id", help="Serial number or name of this very robot; made up if it is left out.")
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a commented cell.toml as a starting point."""
    from truepose.cell import write_template

    overwrite(force)
    path = write_template(directory, robot, robot_id)
    if as_json:
        emit_json({"cell": path})
    else:
        say(f"Wrote {path}: enter the tool, the tracker and the limits there, then run 'truepose plan'.")


def check_point(
    cell_path: CellPath,
    joints: Annotated[str, typer.Option("--joints", help="Joint angles of the point in degrees: '10 -90 90 0 45 0'.")],
    position: Annotated[
        str, typer.Option("--position", help="Position on the controller's display in mm: '1500 0 900'.")
    ],
    angles: Annotated[
        str | None, typer.Option("--angles", help="Orientation on the display, in the controller's angles in degrees.")
    ] = None,
    tool: Annotated[
        str | None,
        typer.Option("--tool", help="Active tool, from frames.tools of the cell file; by default its \\[tool] table."),
    ] = None,
    shown: Annotated[
        bool, typer.Option("--shown", help="The joints are as the controller shows them: J3 of FANUC from the ground.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Compare one taught point with the robot model and the tool; the active base must be the robot base."""
    import numpy as np
    from rich.markup import escape

    from truepose.cell import load_cell
    from truepose.error_map import arm_check
    from truepose.geometry import euler

    cell = load_cell(cell_path)
    q, p = parse_numbers(joints, "--joints"), parse_numbers(position, "--position")
    rotation = None if angles is None else euler(_controller(cell), np.array(parse_numbers(angles, "--angles")))
    found = arm_check.check_point(cell, np.deg2rad(q), p, rotation, tool=tool, shown=shown)
    if as_json:
        emit_json(found.to_dict())
    else:
        say(escape(found.words))


def _controller(cell: Cell) -> str:
    from truepose.errors import DataError

    if cell.controller is None:
        raise DataError("the maker of the robot is unknown, and with it the convention of --angles; leave them out")
    return cell.controller
