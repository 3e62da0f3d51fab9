"""Command watch: correct the programs that are put into a folder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from truepose.cli.options import Force, Json, MapPath, with_groups
from truepose.cli.output import emit_json, say, working
from truepose.cli.programs import (
    AcceptWeakMap,
    GuardPolicy,
    Orientation,
    OtherMaker,
    Reading,
    Require,
)

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
    accept_weak_map: AcceptWeakMap = False,
    settle: Annotated[
        float,
        typer.Option("--settle", min=0.0, help="Seconds for which a program must be unchanged before it is read."),
    ] = 2.0,
    interval: Annotated[float, typer.Option("--interval", min=0.1, help="Seconds between two looks.")] = 1.0,
    once: Annotated[bool, typer.Option("--once", help="Correct what is there, and end; 1 if a program is refused.")] = (
        False
    ),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Correct programs that are put into a folder, until Ctrl-C; each with the guards and the record of correct."""
    from truepose.error_map import load_map
    from truepose.errors import DataError, RefusedError
    from truepose.programs.watching import FolderWatch

    if as_json and not once:
        raise DataError("--json needs --once, because a watch has no end")
    error_map = load_map(map_path)
    cell = reading.cell()
    settings = {
        "on_guard": None if on_guard is None else on_guard.value,
        "orientation": orientation,
        "require": require,
        "other_maker": other_maker,
        "accept_weak_map": accept_weak_map,
    }
    frames = reading.frames(cell or error_map.cell)
    options = reading.options(orientation=orientation)
    folder = FolderWatch(in_dir, out_dir, error_map, cell, frames, options, settings, settle, force)
    if not once:
        say(f"Watching {in_dir}, results in {out_dir}; Ctrl-C ends")
        while True:
            for event in folder.poll():
                say(f"{time.strftime('%Y-%m-%d %H:%M:%S')}  {event}")
            time.sleep(interval)
    with working("Correcting", quiet=as_json):
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
