"""Commands for robot programs: check and correct."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.cli.options import Force, Json, MapPath
from truepose.cli.output import counting, emit_json, overwrite, say

if TYPE_CHECKING:
    from truepose._typing import IntArray
    from truepose.cell import Cell
    from truepose.compensation import Policy
    from truepose.errors import FileError
    from truepose.programs import CorrectedProgram, FrameTable, ReadOptions

_LISTED = 40  # targets that are shown one by one


class OnGuard(StrEnum):
    """The policy for a target that a guard refuses."""

    refuse = "refuse"
    skip = "skip"
    clip = "clip"


class Ambiguous(StrEnum):
    """The policy for a point whose use is ambiguous."""

    refuse = "refuse"
    skip = "skip"


Programs = Annotated[
    list[Path],
    typer.Argument(metavar="PROGRAM...", help="Programs, or folders of programs. KRL: the .src or .dat of a pair."),
]
CellFile = Annotated[
    Path | None, typer.Option("--cell", help="Cell file for frames and limits; by default the map's own.")
]
ConfigDat = Annotated[Path | None, typer.Option("--config-dat", help="KUKA: file with tools and bases.")]
Tool = Annotated[str | None, typer.Option("--tool", help="Tool (number or name) for programs that set none.")]
Base = Annotated[
    str | None, typer.Option("--base", help="Base (number or name) for programs that set none; 0: robot base.")
]
CallsKeepFrames = Annotated[
    bool, typer.Option("--calls-keep-frames", help="State that subprograms in other files do not change tool and base.")
]
AmbiguousPoints = Annotated[
    Ambiguous, typer.Option("--ambiguous", help="Policy for points used in two frames or in arithmetic.")
]
AbsoluteAccuracy = Annotated[
    bool, typer.Option("--absolute-accuracy", help="State that the controller's own compensation is switched off.")
]
ExternalAxes = Annotated[
    bool, typer.Option("--external-axes", help="State that external axes move neither robot nor base.")
]
Offsets = Annotated[
    bool,
    typer.Option("--offsets", help="Use one correction for a point and its constant offsets (RAPID Offs, RelTool)."),
]
WholeTask = Annotated[
    bool,
    typer.Option("--whole-task", help="State that no other file uses the points of a file given alone."),
]
Angles = Annotated[
    str,
    typer.Option(
        "--angles", help="G-code: convention of A B C (kuka, fanuc, staubli, yaskawa). APT: tool axis, z or -z."
    ),
]


def check(
    paths: Programs,
    cell_path: CellFile = None,
    config_dat: ConfigDat = None,
    tool: Tool = None,
    base: Base = None,
    calls_keep_frames: CallsKeepFrames = False,
    ambiguous: AmbiguousPoints = Ambiguous.refuse,
    absolute_accuracy: AbsoluteAccuracy = False,
    external_axes: ExternalAxes = False,
    offsets: Offsets = False,
    angles: Angles = "",
    whole_task: WholeTask = False,
    as_json: Json = False,
) -> None:
    """List which targets of programs can be corrected and which cannot, with the reason; needs no map."""
    import numpy as np
    from rich.markup import escape

    from truepose.cell import load_cell
    from truepose.programs import read_programs

    frames = _frames(None if cell_path is None else load_cell(cell_path), config_dat, tool, base)
    options = _options(
        calls_keep_frames, ambiguous, absolute_accuracy, external_axes, offsets, angles, whole_task=whole_task
    )
    found = read_programs(paths, frames, options)
    if as_json:
        emit_json(
            {
                "programs": [{"file": p.path, **p.counts()} for p in found.programs],
                "targets": [target.to_dict() for program in found.programs for target in program.targets],
                "unreadable": [str(error) for error in found.unreadable],
            }
        )
    else:
        for program in found.programs:
            counts = program.counts()
            verdicts = f"{counts['correct']} to correct, {counts['skip']} to skip, {counts['refuse']} refused"
            say(f"[bold]{escape(str(program.path))}[/]: {verdicts}")
            _say_reasons(program.targets, np.flatnonzero(program.targets.verdicts()))
    if found.unreadable:
        raise _unread(found.unreadable)


def correct(
    map_path: MapPath,
    paths: Programs,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the corrected programs; by default 'corrected'.")
    ] = None,
    on_guard: Annotated[
        OnGuard | None, typer.Option(help="Policy for targets that a guard refuses; by default the cell file's.")
    ] = None,
    cell_path: CellFile = None,
    config_dat: ConfigDat = None,
    tool: Tool = None,
    base: Base = None,
    calls_keep_frames: CallsKeepFrames = False,
    ambiguous: AmbiguousPoints = Ambiguous.refuse,
    absolute_accuracy: AbsoluteAccuracy = False,
    external_axes: ExternalAxes = False,
    offsets: Offsets = False,
    angles: Angles = "",
    whole_task: WholeTask = False,
    orientation: Annotated[
        bool, typer.Option("--orientation", help="Correct orientations, too; the map must contain them.")
    ] = False,
    require: Annotated[
        str | None, typer.Option("--require", help="Share of motion targets that must be corrected, such as 95%.")
    ] = None,
    other_maker: Annotated[
        bool, typer.Option("--other-maker", help="Accept programs for a robot of another maker than the map's.")
    ] = False,
    accept_weak_map: Annotated[
        bool, typer.Option("--accept-weak-map", help="Accept a weak map, or a map of an interpolator.")
    ] = False,
    in_place: Annotated[
        bool, typer.Option("--in-place", help="Overwrite the programs; keep each original as NAME.original.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the changes and write nothing.")] = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Correct the targets of robot programs; write the programs and a record of every target."""
    from truepose.cell import load_cell
    from truepose.error_map import load_map
    from truepose.errors import DataError
    from truepose.programs import CorrectedShare, correct_program, read_programs
    from truepose.programs.corrected import write, write_in_place

    if in_place and out is not None:
        raise DataError("--out has no effect with --in-place; give one of them")
    overwrite(force)
    error_map = load_map(map_path)
    cell = None if cell_path is None else load_cell(cell_path)
    frames = _frames(cell or error_map.cell, config_dat, tool, base)
    options = _options(
        calls_keep_frames,
        ambiguous,
        absolute_accuracy,
        external_axes,
        offsets,
        angles,
        orientation,
        whole_task=whole_task,
    )
    policy: Policy | None = None if on_guard is None else on_guard.value
    # correct all before writing any, so that a refusal leaves no program half done
    found = read_programs(paths, frames, options)
    if found.unreadable:
        raise _unread(found.unreadable)
    with counting("targets") as progress:
        corrected = [
            correct_program(
                program,
                error_map,
                cell,
                on_guard=policy,
                orientation=orientation,
                require=require,
                other_maker=other_maker,
                accept_weak_map=accept_weak_map,
                progress=progress,
            )
            for program in found.programs
        ]
    _check_names(corrected, in_place)
    written: list[Path] = []
    if not dry_run:
        written = (
            write_in_place(corrected, force=force)
            if in_place
            else write(corrected, out or Path("corrected"), force=force)
        )
    coverage = CorrectedShare.of(program.targets for program in corrected)
    if as_json:
        emit_json(
            {
                "written": written,
                "coverage": coverage._asdict(),
                "programs": [program.to_dict() for program in corrected],
            }
        )
        return
    for program in corrected:
        if dry_run:
            typer.echo(program.diff(), nl=False)
        _show(program)
    for file in written:
        say(f"Wrote {file}")
    say(str(coverage))


def _show(program: CorrectedProgram) -> None:
    """Show the counts of a corrected program, its limits and warnings, and the targets that were left unchanged."""
    import numpy as np
    from rich.markup import escape

    summary = program.summary()
    say(
        f"[bold]{escape(str(program.program.path))}[/]: {summary['corrected']} corrected, "
        f"{summary['below_uncertainty']} below uncertainty, {summary['skipped']} skipped, "
        f"{summary['refused']} refused; largest correction "
        f"{summary['largest_correction_mm']:.3f} mm, largest standard deviation {summary['largest_std_mm']:.3f} mm",
        f"  Limits in force: {escape(program.limits.sentence())}",
        *(f"  {escape(warning)}" for warning in program.warnings[:_LISTED]),
    )
    _say_reasons(program.targets, np.flatnonzero(program.targets.code != 1))


def _frames(cell: Cell | None, config_dat: Path | None, tool: str | None, base: str | None) -> FrameTable:
    """Return the frames of the cell file and of a $config.dat; the cell file takes precedence."""
    from truepose.programs import FrameTable

    if cell is not None:
        return FrameTable.from_cell(cell, config_dat, tool, base)
    known = FrameTable() if config_dat is None else FrameTable.from_config_dat(config_dat)
    return replace(known, tool=tool, base=base)


def _options(
    calls_keep_frames: bool,
    ambiguous: Ambiguous,
    absolute_accuracy: bool,
    external_axes: bool,
    offsets: bool,
    angles: str,
    orientation: bool = False,
    *,
    whole_task: bool = False,
) -> ReadOptions:
    from truepose.programs import ReadOptions

    return ReadOptions(
        ambiguous="skip" if ambiguous is Ambiguous.skip else "refuse",
        calls_keep_frames=calls_keep_frames,
        absolute_accuracy=absolute_accuracy,
        external_axes=external_axes,
        offsets=offsets,
        angles=angles,
        orientation=orientation,
        whole_task=whole_task,
    )


def _say_reasons(targets: Sequence[Any], rows: IntArray) -> None:
    """Show why the targets of some rows are not corrected."""
    from rich.markup import escape

    for target in (targets[i] for i in rows[:_LISTED].tolist()):
        say(escape(f"  line {target.line}, {target.name}: {target.verdict}: {target.reason}"))
    if len(rows) > _LISTED:
        say(f"  … and {len(rows) - _LISTED} more (--json lists all)")


def _unread(errors: Sequence[FileError]) -> FileError:
    """Return one error for all unreadable programs."""
    from truepose.errors import FileError

    if len(errors) == 1:
        return errors[0]
    first, *others = map(str, errors)
    return FileError(f"{len(errors)} programs cannot be read", "; ".join([first, *others]))


def _check_names(corrected: Sequence[CorrectedProgram], in_place: bool) -> None:
    """Refuse programs that would overwrite each other."""
    from truepose.errors import RefusedError
    from truepose.programs.corrected import names

    taken: dict[str, Path] = {}
    for one in corrected:
        folder = str(one.program.folder.resolve()) if in_place else ""
        for name in names(one.program):
            first = taken.setdefault(f"{folder}/{str(name).lower()}", one.program.path)
            if first is not one.program.path:
                raise RefusedError(
                    f"{first} and {one.program.path} would both be written as {name}; correct them one by one, "
                    "each with its own --out"
                )
