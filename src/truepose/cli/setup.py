"""Commands that set up a cell: robots, init, check-point."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.cli.options import CellPath, Force, Json, parse_numbers
from truepose.cli.output import emit_json, overwrite, say, table

if TYPE_CHECKING:
    from truepose.cell import Cell
    from truepose.robots import Robot


def robots(
    name: Annotated[str | None, typer.Argument(help="Name of one robot to show.")] = None, as_json: Json = False
) -> None:
    """List the robots of the library, or show the parameters of one."""
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
    if as_json:
        emit_json(_robot_data(robot))
        return
    limits, alpha, offset = (np.rad2deg(values) for values in (robot.limits, robot.alpha, robot.offset))
    rows = [
        (
            f"{i + 1}",
            f"{alpha[i]:.3f}",
            f"{robot.a[i]:.3f}",
            f"{robot.d[i]:.3f}",
            f"{robot.sign[i]:+.0f}",
            f"{offset[i]:.3f}",
            f"{limits[i, 0]:.1f} … {limits[i, 1]:.1f}",
        )
        for i in range(robot.dof)
    ]
    columns = ["joint", "alpha [deg]", "a [mm]", "d [mm]", "sign", "offset [deg]", "limits [deg]"]
    say(table(f"{robot.maker} {robot.model} ({robot.convention})", columns, rows), f"Source: {robot.source}")


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
    return {**named, "joints": joints}


def init(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the new cell; created if needed.")],
    robot: Annotated[
        str, typer.Option("--robot", help="Library name (see 'truepose robots'), or a .toml or .urdf file.")
    ],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a commented cell.toml as a starting point."""
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
    found = arm_check.check_point(cell, np.deg2rad(q), p, rotation, tool=tool)
    if as_json:
        emit_json(found.to_dict())
    else:
        say(escape(found.words))


def _controller(cell: Cell) -> str:
    from truepose.errors import DataError

    if cell.controller is None:
        raise DataError("the maker of the robot is unknown, and with it the convention of --angles; leave them out")
    return cell.controller
