"""Command watch: correct the programs that are put into a folder."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from truepose.cli.options import Force, Json, MapPath, check_pairs, with_groups
from truepose.cli.output import emit_json, say, working
from truepose.cli.programs import (
    Accept,
    AcceptWeakMap,
    GuardPolicy,
    Orientation,
    OtherMaker,
    OtherRobot,
    Reading,
    Require,
    ThisRobot,
)
from truepose.cli.store_record import RecordIn, ReleasedOnly, map_to_use, recorder

if TYPE_CHECKING:
    from truepose.programs import FolderWatch

_READING = Reading()


@with_groups
def watch(
    map_path: MapPath,
    in_dir: Annotated[Path, typer.Argument(metavar="IN", help="The folder that programs are put into.")],
    out_dir: Annotated[Path, typer.Argument(metavar="OUT", help="The folder for the corrected programs.")],
    on_guard: GuardPolicy = None,
    reading: Reading = _READING,
    orientation: Orientation = False,
    require: Require = None,
    other_maker: OtherMaker = False,
    other_robot: OtherRobot = "",
    this_robot: ThisRobot = False,
    accept_weak_map: AcceptWeakMap = False,
    accept: Accept = None,
    settle: Annotated[
        float,
        typer.Option("--settle", min=0.0, help="Seconds for which a program must be unchanged before it is read."),
    ] = 2.0,
    interval: Annotated[float, typer.Option("--interval", min=0.1, help="Seconds between two looks.")] = 1.0,
    once: Annotated[bool, typer.Option("--once", help="Correct what is there, and end; 1 if a program is refused.")] = (
        False
    ),
    store: RecordIn = None,
    released_only: ReleasedOnly = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Correct programs that are put into a folder, until Ctrl-C; each with the guards and the record of correct."""
    from truepose.cli.store_watch import StoreKeeper
    from truepose.cli.verdicts import show_draft
    from truepose.errors import DataError, RefusedError
    from truepose.programs.watching import FolderWatch

    if as_json and not once:
        raise DataError("--json needs --once, because a watch has no end")
    check_pairs(("--released-only", True if released_only else None, "--store", store))
    cell = reading.cell()
    settings = {
        "on_guard": None if on_guard is None else on_guard.value,
        "orientation": orientation,
        "require": require,
        "other_maker": other_maker,
        "other_robot": other_robot,
        "this_robot": this_robot,
        "accept_weak_map": accept_weak_map,
        "accept": accept or (),
    }
    with ExitStack() as stack:
        record = stack.enter_context(recorder(store, "correct", [out_dir]))
        error_map, row = map_to_use(record, map_path, released_only=released_only)
        if record is not None and row is not None:
            record.check_robot(row, reading.cell_path, cell, other_robot)
        keeper = None if record is None or row is None else StoreKeeper(record, row, released_only)
        frames = reading.frames(cell or error_map.cell)
        options = reading.options(orientation=orientation)
        folder = FolderWatch(in_dir, out_dir, error_map, cell, frames, options, settings, settle, force, keeper)
        if row is not None and not as_json:
            show_draft(row["state"])
        if not once:
            say(f"Watching {in_dir}, results in {out_dir}; Ctrl-C ends")
            _watch(folder, interval)
        stack.enter_context(working("Correcting", quiet=as_json))
        events = folder.once()
    if as_json:
        emit_json({"programs": [event.to_dict() for event in events]})
    else:
        for event in events:
            say(str(event))
        if not events:
            say(f"Nothing to correct in {in_dir}: {folder.n_programs} programs, none of them new or changed")
    if refused := [event for event in events if event.refused]:
        listed = "; ".join(event.refused for event in refused)
        raise RefusedError(f"{len(refused)} of {folder.n_programs} programs are refused: {listed}")


def _watch(folder: FolderWatch, interval: float) -> NoReturn:
    """Correct what comes, without an end; a store that is lost is said once, and again when it is back."""
    from truepose.errors import StoreError

    lost = False
    while True:
        try:
            for event in folder.poll():
                _say(str(event))
            if lost:
                _say("the store is back")
            lost = False
        except StoreError as error:
            if not lost:
                _say(f"{error}; new programs wait until the store is back")
            lost = True
        time.sleep(interval)


def _say(line: str) -> None:
    say(f"{time.strftime('%Y-%m-%d %H:%M:%S')}  {line}")
