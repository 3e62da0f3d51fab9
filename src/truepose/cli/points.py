"""The check of one taught point against the arm's model and the tool."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.cli.output import Json, emit_json, say

if TYPE_CHECKING:
    from truepose.cell import Cell


def check_point(
    cell_path: Annotated[Path, typer.Argument(metavar="CELL", help="The cell file.")],
    joints: Annotated[str, typer.Option("--joints", help="Joints of the point in degrees: '10 -90 90 0 45 0'.")],
    position: Annotated[
        str, typer.Option("--position", help="Position in mm that the controller shows there: '1500 0 900'.")
    ],
    angles: Annotated[
        str | None, typer.Option("--angles", help="Orientation that it shows, in the controller's own angles.")
    ] = None,
    tool: Annotated[
        str | None,
        typer.Option("--tool", help="The active tool, from frames.tools of the cell file; by default its tool table."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Compare one taught point with the arm's model and the tool; the controller's base must be that of the robot."""
    import numpy as np
    from rich.markup import escape

    from truepose.cell import load_cell
    from truepose.error_map import arm_check
    from truepose.geometry import euler

    cell = load_cell(cell_path)
    q, p = _numbers("--joints", joints), _numbers("--position", position)
    rotation = None if angles is None else euler(_controller(cell), np.array(_numbers("--angles", angles)))
    found = arm_check.check_point(cell, np.deg2rad(q), p, rotation, tool=tool)
    if as_json:
        emit_json(found.to_dict())
    else:
        say(escape(found.words))


def _controller(cell: Cell) -> str:
    from truepose.errors import DataError

    if cell.controller is None:
        raise DataError("the robot's maker is unknown, so the meaning of --angles is, too; leave them out")
    return cell.controller


def _numbers(option: str, text: str) -> list[float]:
    """Return the numbers of an option, with blanks or commas between them."""
    from truepose.errors import DataError
    from truepose.programs.core.source import parse_number

    try:
        return [parse_number(word.encode()) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise DataError(f"{option}: {error}; write numbers with blanks between them") from None
