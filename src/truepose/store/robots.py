"""The robot of a map and that of the cell in which it corrects: a map is of one robot, not of a type.

The names of robots are the ids that cell files state (``[robot] id``, or the serial number); the store knows them for
every version of a cell, also where a map or a cell file at hand is older than its id.
"""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from truepose.cell import Cell
from truepose.errors import DataError
from truepose.programs.agreement import same_robot
from truepose.store import schema
from truepose.store.change import Change


def other_robot(
    connection: sa.Connection, map_id: int, robot_id: str | None, cell_sha256: str | None = None
) -> str | None:
    """Return why a cell is of another robot than a map; None if it is of the same, or the store cannot tell.

    Parameters
    ----------
    connection : Connection
        A transaction.
    map_id : int
        The map.
    robot_id : str or None
        The id that the cell states.
    cell_sha256 : str, optional
        The SHA-256 of the cell file, by which the store may know the cell.
    """
    robot, cell, maps = schema.robot, schema.cell, schema.map
    columns = robot.c.id, robot.c.name, robot.c.serial
    joined = sa.select(*columns).join(cell, cell.c.robot_id == robot.c.id)
    mine = connection.execute(joined.join(maps, maps.c.cell_id == cell.c.id).where(maps.c.id == map_id)).one()
    if robot_id is not None:
        every = connection.execute(sa.select(*columns).where(robot.c.serial.is_not(None))).all()
        theirs = [row for row in every if same_robot(row.serial, robot_id)]
        if mine.serial is None and not theirs:
            return None
    else:
        theirs = list(connection.execute(joined.where(cell.c.sha256 == cell_sha256)).all()) if cell_sha256 else []
        if not theirs:
            return None
    if any(row.id == mine.id for row in theirs) or same_robot(mine.serial, robot_id):
        return None
    if mine.serial is not None and any(same_robot(row.serial, mine.serial) for row in theirs):
        return None
    own = mine.name if mine.serial is None else f"{mine.name} ({mine.serial})"
    other = robot_id or ", ".join(dict.fromkeys(row.name for row in theirs))
    return f"the store has this map as of the robot {own}, the cell is of {other}"


def identify_robot(change: Change, robot_id: int, cell: Cell, name: str) -> None:
    """Keep the id that a cell states for its robot, if the store has none yet.

    Raises
    ------
    DataError
        If the store has another id of it: the robot of the cell was exchanged.
    """
    known: dict[str, Any] = change.row(schema.robot, robot_id)
    stated = [one for one in (cell.robot.id, cell.report.robot_serial) if one]
    if not stated or known["serial"] == cell.robot_id:
        return
    if known["serial"] and not any(same_robot(known["serial"], one) for one in stated):
        raise DataError(
            f"the store has the cell {name} with the robot {known['serial']!r}, its file is of {cell.robot_id!r}: "
            "keep the cell of another robot under another name (of its folder or file)"
        )
    change.update(schema.robot, robot_id, {"serial": cell.robot_id}, "robot.identify")


def state_robot(change: Change, robot_id: int, stated: str) -> None:
    """Keep the id that somebody has stated for the robot of a map, if the store has none."""
    if not change.row(schema.robot, robot_id)["serial"]:
        change.update(schema.robot, robot_id, {"serial": stated}, "robot.identify")
