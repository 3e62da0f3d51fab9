"""``truepose frames``: the tools and bases of programs and backups."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from truepose.cli.options import Json, with_groups
from truepose.cli.output import emit_json, say, table, working
from truepose.cli.programs import Programs, Reading, unread
from truepose.cli.verdicts import show_missing

if TYPE_CHECKING:
    from truepose.programs.used_frames import UsedFrame

_READING = Reading()
_STATES: Final = {"unknown": "not known", "zero": "zeros, no name", "unusable": "not usable", "known": ""}


@with_groups
def frames(paths: Programs, reading: Reading = _READING, as_json: Json = False) -> None:
    """List the tools and bases of programs or of a backup, those first that are used and not known."""
    from truepose.programs import read_programs
    from truepose.programs.used_frames import by_controller

    with working("Reading the programs", quiet=as_json):
        given = reading.frames(reading.cell())
        found = read_programs(paths, given, reading.options(), controllers=reading.controllers or ())
        controllers = by_controller(found.programs, found.backups, given)
    if as_json:
        emit_json(
            {
                "controllers": [
                    {
                        "backup": None if backup is None else backup.path,
                        "controller": None if one is None else one.name,
                        "frames": [frame.to_dict() for frame in rows],
                    }
                    for backup, one, rows in controllers
                ],
                "unreadable": [str(error) for error in found.unreadable],
            }
        )
    else:
        for backup, one, rows in controllers:
            _show(rows, "" if one is None or backup is None else f" of {backup.path}, {one.name}")
    if found.unreadable:
        raise unread(found.unreadable)


def _show(rows: Sequence[UsedFrame], where: str) -> None:
    """Show the frames of a controller, and the lines for those that are not known."""
    shown = [one for one in rows if one.targets or (one.state != "zero" and one.name)]
    cells = []
    for one in shown:
        numbers = "" if one.numbers is None else " ".join(f"{x:g}" for x in one.numbers)
        what = f"{one.which} {one.key}" + (f" {one.name}" if one.name else "")
        cells.append((what, one.targets, _STATES[one.state], numbers, one.place))
    say(table(f"Tools and bases{where}", ["frame", "targets", "state", "x y z [mm], orientation", "from"], cells))
    if len(rows) > len(shown):
        say(f"{len(rows) - len(shown)} more are not used and have no name (--json lists all)")
    for one in shown:
        if one.targets and one.state == "unusable":
            why = one.reason or "not determined: its targets are not corrected for reasons of their own"
            say(f"{one.which} {one.key}: {why}")
    show_missing(rows)
