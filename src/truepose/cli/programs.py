"""Commands about robot programs: check and correct."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.cli.output import Force, Json, counting, emit_json, overwrite, say

if TYPE_CHECKING:
    from truepose._typing import IntArray
    from truepose.cell import Cell
    from truepose.compensation import Policy
    from truepose.errors import FileError
    from truepose.programs import CorrectedProgram, FrameTable, Program, ReadOptions

_LISTED = 40  # targets that a person is shown one by one


class OnGuard(StrEnum):
    """What to do with a target that a guard objects to."""

    refuse = "refuse"
    skip = "skip"
    clip = "clip"


class Ambiguous(StrEnum):
    """What to do with a point whose use is ambiguous."""

    refuse = "refuse"
    skip = "skip"


Programs = Annotated[
    list[Path],
    typer.Argument(metavar="PROGRAM...", help="Programs or folders of them; KRL: the .src or .dat of a pair."),
]
CellPath = Annotated[
    Path | None, typer.Option("--cell", help="Take frames and limits from this cell file; by default the map's own.")
]
ConfigDat = Annotated[Path | None, typer.Option("--config-dat", help="KUKA: take tools and bases from this file.")]
Tool = Annotated[
    str | None, typer.Option("--tool", help="Number or name of the tool in force where a program sets none.")
]
Base = Annotated[
    str | None, typer.Option("--base", help="Number or name of the base in force where a program sets none; 0: robot.")
]
CallsKeepFrames = Annotated[
    bool, typer.Option("--calls-keep-frames", help="Subprograms in other files leave tool and base as they are.")
]
AmbiguousPoints = Annotated[
    Ambiguous, typer.Option("--ambiguous", help="Points moved to under two frames, or also read by arithmetic.")
]
AbsoluteAccuracy = Annotated[
    bool, typer.Option("--absolute-accuracy", help="The controller's own compensation is off now: correct its points.")
]
ExternalAxes = Annotated[
    bool, typer.Option("--external-axes", help="External axes move neither robot nor base: correct their points.")
]
Offsets = Annotated[
    bool, typer.Option("--offsets", help="One correction for a point and its constant offsets (RAPID Offs, RelTool).")
]
WholeTask = Annotated[
    bool,
    typer.Option("--whole-task", help="A file given alone is the whole task or project: no other uses its points."),
]
Angles = Annotated[
    str,
    typer.Option(
        "--angles", help="G-code: whose angles A B C are (kuka, fanuc, staubli, yaskawa). APT: tool axis, z or -z."
    ),
]


def check(
    paths: Programs,
    cell_path: CellPath = None,
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
    """Tell which targets of programs could be corrected and which not, and why; needs no map."""
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
                "targets": [row for program in found.programs for row in _rows(program)],
                "unreadable": [str(error) for error in found.unreadable],
            }
        )
    else:
        for program in found.programs:
            counts = program.counts()
            told = f"{counts['correct']} to correct, {counts['skip']} to skip, {counts['refuse']} refused"
            say(f"[bold]{escape(str(program.path))}[/]: {told}")
            _say_reasons(program.targets, np.flatnonzero(program.targets.verdicts()))
    if found.unreadable:
        raise unread(found.unreadable)


def correct(
    map_path: Annotated[Path, typer.Argument(metavar="MAP", help="A map that 'truepose fit' wrote.")],
    paths: Programs,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the corrected programs; by default 'corrected'.")
    ] = None,
    on_guard: Annotated[OnGuard | None, typer.Option(help="Instead of the cell file's policy.")] = None,
    cell_path: CellPath = None,
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
        bool, typer.Option("--orientation", help="Correct orientations, too; the map must know them.")
    ] = False,
    require: Annotated[
        str | None, typer.Option("--require", help="Share of motion targets that must be corrected, such as 95%.")
    ] = None,
    other_maker: Annotated[
        bool, typer.Option("--other-maker", help="Correct programs of another maker than that of the map's robot.")
    ] = False,
    accept_weak_map: Annotated[
        bool, typer.Option("--accept-weak-map", help="Use a weak map, or one of an interpolator.")
    ] = False,
    in_place: Annotated[
        bool, typer.Option("--in-place", help="Write over the programs, and keep each as it was as NAME.original.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would change, and write nothing.")] = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Correct the targets of robot programs; writes the programs and a list of what was done to each target."""
    import numpy as np
    from rich.markup import escape

    from truepose.cell import load_cell
    from truepose.error_map import load_map
    from truepose.errors import DataError
    from truepose.programs import Coverage, correct_program, read_programs
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
    # all are corrected before any is written: a refusal leaves nothing half-done
    found = read_programs(paths, frames, options)
    if found.unreadable:
        raise unread(found.unreadable)
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
    coverage = Coverage.of(program.targets for program in corrected)
    if as_json:
        emit_json(
            {
                "written": written,
                "coverage": coverage._asdict(),
                "programs": [program.sidecar() for program in corrected],
            }
        )
        return
    for program in corrected:
        if dry_run:
            typer.echo(program.diff(), nl=False)
        summary = program.summary()
        say(
            f"[bold]{escape(str(program.program.path))}[/]: {summary['corrected']} corrected, "
            f"{summary['below_uncertainty']} below uncertainty, {summary['skipped']} skipped, "
            f"{summary['refused']} refused; largest correction "
            f"{summary['largest_correction_mm']:.3f} mm, largest standard deviation {summary['largest_std_mm']:.3f} mm"
        )
        say(f"  Limits in force: {escape(program.limits.sentence())}")
        for warning in program.warnings[:_LISTED]:
            say(f"  {escape(warning)}")
        _say_reasons(program.targets, np.flatnonzero(program.targets.code != 1))
    for file in written:
        say(f"Wrote {file}")
    say(str(coverage))


def _frames(cell: Cell | None, config_dat: Path | None, tool: str | None, base: str | None) -> FrameTable:
    """Return the frames that the cell and a $config.dat give; those of the cell file itself win."""
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


def _rows(program: Program) -> list[dict[str, Any]]:
    return [
        {
            "file": target.path,
            "line": target.line,
            "name": target.name,
            "verdict": target.verdict,
            "reason": target.reason,
            "frame": target.frame,
            "tool": target.tool,
            "motion": target.motion,
        }
        for target in program.targets
    ]


def _say_reasons(targets: Sequence[Any], rows: IntArray) -> None:
    """Tell why the targets of some rows are not corrected."""
    from rich.markup import escape

    for target in (targets[i] for i in rows[:_LISTED].tolist()):
        say(escape(f"  line {target.line}, {target.name}: {target.verdict}: {target.reason}"))
    if len(rows) > _LISTED:
        say(f"  … and {len(rows) - _LISTED} more (--json lists all)")


def unread(errors: Sequence[FileError]) -> FileError:
    """Return one error for all programs that cannot be read."""
    from truepose.errors import FileError

    if len(errors) == 1:
        return errors[0]
    first, *others = map(str, errors)
    return FileError(f"{len(errors)} programs cannot be read", "; ".join([first, *others]))


def _check_names(corrected: Sequence[CorrectedProgram], in_place: bool) -> None:
    """Refuse programs that would be written over each other."""
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
