"""Commands about robot programs: correct."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from truepose.cli.output import Json, emit_json, say


class OnGuard(StrEnum):
    """What to do with a target that a guard objects to."""

    refuse = "refuse"
    skip = "skip"
    clip = "clip"


def correct(
    map_path: Annotated[Path, typer.Argument(metavar="MAP", help="A map that 'truepose fit' wrote.")],
    paths: Annotated[list[Path], typer.Argument(metavar="PROGRAM...", help="KRL: the .src or .dat of a pair.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for the corrected programs.")] = Path("corrected"),
    on_guard: Annotated[OnGuard | None, typer.Option(help="Instead of the cell file's policy.")] = None,
    cell_path: Annotated[
        Path | None, typer.Option("--cell", help="Take frames and limits from this cell file.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would change, and write nothing.")] = False,
    as_json: Json = False,
) -> None:
    """Correct the targets of robot programs; writes the programs and a list of what was done to each target."""
    from truepose.cell import load_cell
    from truepose.error_map import load_map
    from truepose.programs import correct_program

    error_map = load_map(map_path)
    cell = error_map.cell if cell_path is None else load_cell(cell_path)
    policy = on_guard.value if on_guard is not None else cell.correction.on_guard
    # all are corrected before any is written: a refusal leaves nothing half-done
    corrected = [correct_program(path, error_map, cell, on_guard=policy) for path in paths]
    written = [] if dry_run else [file for program in corrected for file in program.write(out)]
    if as_json:
        emit_json({"written": written, "programs": [program.sidecar() for program in corrected]})
        return
    for path, program in zip(paths, corrected, strict=True):
        if dry_run:
            typer.echo(program.diff(), nl=False)
        summary = program.summary()
        say(
            f"[bold]{path}[/]: {summary['corrected']} corrected, {summary['skipped']} skipped, "
            f"{summary['refused']} refused; largest correction "
            f"{summary['largest_correction_mm']:.3f} mm, largest standard deviation {summary['largest_std_mm']:.3f} mm"
        )
        for target in program.targets:
            if target.verdict != "correct":
                say(f"  line {target.line}, {target.name}: {target.verdict}: {target.reason}")
    for file in written:
        say(f"Wrote {file}")
