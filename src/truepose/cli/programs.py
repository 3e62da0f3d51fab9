"""Commands for robot programs: check and correct."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from truepose.cli.options import Execution, Force, Json, MapPath, check_pairs, with_groups
from truepose.cli.output import emit_json, overwrite, say, working
from truepose.cli.store_record import RecordIn, ReleasedOnly, map_to_use, record_corrections, recorder

if TYPE_CHECKING:
    from truepose.cell import Cell
    from truepose.cli.output import Steps
    from truepose.compensation import Policy
    from truepose.errors import FileError
    from truepose.numerics.executor import Executor
    from truepose.programs import CorrectedBatch, Coverage, FrameTable, Program, ReadOptions


_WRITTEN: Final = 12  # files that are listed one by one


class OnGuard(StrEnum):
    """The policy for a target that a guard refuses."""

    refuse = "refuse"
    skip = "skip"
    clip = "clip"


GuardPolicy = Annotated[
    OnGuard | None,
    typer.Option("--on-guard", help="Policy for targets that a guard refuses; by default the cell file's."),
]
Orientation = Annotated[
    bool, typer.Option("--orientation", help="Correct orientations, too; the map must contain them.")
]
Require = Annotated[
    str | None, typer.Option("--require", help="Share of motion targets that must be corrected, such as 95%.")
]
OtherMaker = Annotated[
    bool, typer.Option("--other-maker", help="Accept programs for a robot of another maker than the map's.")
]
OtherRobot = Annotated[
    str, typer.Option("--other-robot", help="Reason for using the map of another robot of the same type; recorded.")
]
ThisRobot = Annotated[
    bool, typer.Option("--this-robot", help="A map that names no robot is of the robot that --cell names; stated once.")
]
AcceptWeakMap = Annotated[
    bool, typer.Option("--accept-weak-map", help="Accept a weak map, or a map of an interpolator.")
]
Accept = Annotated[
    list[str] | None,
    typer.Option("--accept", help="Accept a fact of the map that refuses corrections, by its code; may be repeated."),
]


ReportPath = Annotated[
    Path | None,
    typer.Option("--report", help="Write how much is corrected, and what would allow more (.html or .csv)."),
]


NoTargets = Annotated[
    bool, typer.Option("--no-targets", help="With --json: leave out the targets, of which there may be a million.")
]


TargetsPath = Annotated[
    Path | None,
    typer.Option("--targets", help="Write every target with its verdict, reason and position (.json)."),
]


class Ambiguous(StrEnum):
    """The policy for a point whose use is ambiguous."""

    refuse = "refuse"
    skip = "skip"


Programs = Annotated[
    list[Path],
    typer.Argument(
        metavar="PROGRAM...",
        help="Programs, folders of them, or backups of controllers (folder or .zip). KRL: the .src or .dat of a pair.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class Reading:
    """The options of how programs are read, shared by check and correct; see `with_groups`."""

    cell_path: Annotated[
        Path | None, typer.Option("--cell", help="Cell file for frames and limits; by default the map's own.")
    ] = None
    config_dat: Annotated[Path | None, typer.Option("--config-dat", help="KUKA: file with tools and bases.")] = None
    tool: Annotated[
        str | None,
        typer.Option("--tool", help="Tool (number or name) for programs that set none; map: that of the map."),
    ] = None
    base: Annotated[
        str | None, typer.Option("--base", help="Base (number or name) for programs that set none; 0: robot base.")
    ] = None
    calls_keep_frames: Annotated[
        bool,
        typer.Option("--calls-keep-frames", help="State that subprograms in other files do not change tool and base."),
    ] = False
    ambiguous: Annotated[
        Ambiguous, typer.Option("--ambiguous", help="Policy for points used in two frames or in arithmetic.")
    ] = Ambiguous.refuse
    absolute_accuracy: Annotated[
        bool, typer.Option("--absolute-accuracy", help="State that the controller's own compensation is switched off.")
    ] = False
    external_axes: Annotated[
        bool, typer.Option("--external-axes", help="State that external axes move neither robot nor base.")
    ] = False
    offsets: Annotated[
        bool,
        typer.Option(
            "--offsets", help="Use one correction for a point and its constant offsets (RAPID Offs, RelTool)."
        ),
    ] = False
    derived: Annotated[
        bool,
        typer.Option("--derived", help="Correct points and the positions that constant shifts derive from them alike."),
    ] = False
    frame_tolerance: Annotated[
        str | None,
        typer.Option(
            "--frame-tolerance",
            help="Use stored frames that the program sets at run time within this distance and angle: 5mm,0.5deg.",
        ),
    ] = None
    tool_tolerance: Annotated[
        str | None,
        typer.Option(
            "--tool-tolerance",
            help="Use stored tools that the program sets at run time within this distance and angle: 1mm,0.2deg.",
        ),
    ] = None
    angles: Annotated[
        str,
        typer.Option(
            "--angles", help="G-code: convention of A B C (kuka, fanuc, staubli, yaskawa). APT: tool axis, z or -z."
        ),
    ] = ""
    joint_targets: Annotated[
        bool, typer.Option("--joint-targets", help="Correct joint targets, too, by the arm of the map.")
    ] = False
    controller_kinematics: Annotated[
        bool,
        typer.Option(
            "--controller-kinematics",
            help="UR .urp, Yaskawa pulses: the map was measured with commands of this controller.",
        ),
    ] = False
    whole_task: Annotated[
        bool,
        typer.Option("--whole-task", help="State that no other file uses the points of a file given alone."),
    ] = False
    system_modules: Annotated[
        bool, typer.Option("--system-modules", help="ABB backup: correct its system modules, too.")
    ] = False
    mechanical_unit: Annotated[
        str, typer.Option("--mechanical-unit", help="ABB backup with several robots: the robot of the map (ROB_1).")
    ] = ""
    controllers: Annotated[
        list[str] | None,
        typer.Option("--controller", help="Controller of a backup with several, such as KRC/R1; may be repeated."),
    ] = None

    def cell(self) -> Cell | None:
        """Return the cell of --cell."""
        from truepose.cell import load_cell

        return None if self.cell_path is None else load_cell(self.cell_path)

    def frames(self, cell: Cell | None) -> FrameTable:
        """Return the frames of a cell and of a $config.dat; the cell takes precedence."""
        from truepose.programs import FrameTable

        if cell is not None:
            return FrameTable.from_cell(cell, self.config_dat, self.tool, self.base)
        known = FrameTable() if self.config_dat is None else FrameTable.from_config_dat(self.config_dat)
        return replace(known, tool=self.tool, base=self.base)

    def options(self, *, orientation: bool = False) -> ReadOptions:
        """Return the options of `truepose.programs.read_programs`."""
        from truepose.programs import FrameTolerance, ReadOptions

        return ReadOptions(
            ambiguous="skip" if self.ambiguous is Ambiguous.skip else "refuse",
            calls_keep_frames=self.calls_keep_frames,
            absolute_accuracy=self.absolute_accuracy,
            external_axes=self.external_axes,
            offsets=self.offsets,
            derived=self.derived,
            frame_tolerance=None if self.frame_tolerance is None else FrameTolerance.parse(self.frame_tolerance),
            tool_tolerance=None if self.tool_tolerance is None else FrameTolerance.parse(self.tool_tolerance),
            angles=self.angles,
            orientation=orientation,
            joint_targets=self.joint_targets,
            controller_kinematics=self.controller_kinematics,
            whole_task=self.whole_task,
            system_modules=self.system_modules,
            mechanical_unit=self.mechanical_unit,
        )


_READING = Reading()
_EXECUTION = Execution()


@with_groups
def check(
    paths: Programs,
    reading: Reading = _READING,
    report: ReportPath = None,
    targets: TargetsPath = None,
    workers: Annotated[
        int, typer.Option("--workers", help="Number of processes of this machine that read programs.", min=1)
    ] = 1,
    force: Force = False,
    no_targets: NoTargets = False,
    as_json: Json = False,
) -> None:
    """List which targets of programs can be corrected and which cannot, with the reason; needs no map."""
    from truepose.cli.verdicts import say_total, show_backups, show_checked, show_left_out, show_missing, show_options
    from truepose.programs import Coverage, read_programs
    from truepose.programs.listing import write_checked
    from truepose.programs.used_frames import by_controller, missing_lines

    _allow_files(report, targets, force)
    with working("Reading the programs", quiet=as_json) as progress:
        given = reading.frames(reading.cell())
        options, names = reading.options(), reading.controllers or ()
        with _readers(workers) as executor:
            found = read_programs(paths, given, options, controllers=names, executor=executor)
        coverage = Coverage.of_programs(found.programs, found.unreadable)
        _write_report(coverage, report)
        if targets is not None:
            progress("Writing the targets")
            write_checked(targets, found.programs)
        used = [rows for _, _, rows in by_controller(found.programs, found.backups, given)]
    if as_json:
        emit_json(
            {
                "backups": [backup.to_dict() for backup in found.backups],
                "coverage": coverage.total.to_dict(),
                "programs": [_checked(program) for program in found.programs],
                "missing_frames": [line for rows in used for line in missing_lines(rows)],
                **({} if no_targets else {"targets": [t.to_dict() for one in found.programs for t in one.targets]}),
                "unreadable": [str(error) for error in found.unreadable],
                "left_out": found.left_out,
            }
        )
    else:
        show_backups(found.backups)
        show_left_out(found.left_out)
        for program in found.programs:
            show_checked(program)
        for rows in used:
            show_missing(rows)
        show_options(coverage)
        say_total(found.programs, len(found.unreadable))
        for path in (report, targets):
            if path is not None:
                say(f"Wrote {path}")
    if found.unreadable:
        raise unread(found.unreadable)
    found.check_backups()


def _checked(program: Program) -> dict[str, Any]:
    from truepose.programs.unnamed_tools import with_measured_tool

    unnamed = with_measured_tool(program)
    more = {"following": program.following, "without_tool": unnamed}
    return {"file": program.path, **dict(program.counts().items()), **more}


def _readers(workers: int) -> AbstractContextManager[Executor | None]:
    """Return the executor that reads programs; None for this process."""
    if workers == 1:
        return nullcontext()
    from truepose.numerics.processes import local

    return local(workers, "reading")


@with_groups
def correct(
    map_path: MapPath,
    paths: Programs,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the corrected programs; by default 'corrected'.")
    ] = None,
    on_guard: GuardPolicy = None,
    reading: Reading = _READING,
    orientation: Orientation = False,
    require: Require = None,
    other_maker: OtherMaker = False,
    other_robot: OtherRobot = "",
    this_robot: ThisRobot = False,
    accept_weak_map: AcceptWeakMap = False,
    accept: Accept = None,
    in_place: Annotated[
        bool, typer.Option("--in-place", help="Overwrite the programs; keep each original as NAME.original.")
    ] = False,
    whole: Annotated[
        bool, typer.Option("--whole", help="Of a backup write all files, as a folder or .zip like the one given.")
    ] = False,
    keep_going: Annotated[
        bool, typer.Option("--keep-going", help="Correct the others if a program is refused; then exit with 1.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the changes and write nothing.")] = False,
    xlsx: Annotated[bool, typer.Option("--xlsx", help="Write each record as a workbook, too.")] = False,
    report: ReportPath = None,
    targets: TargetsPath = None,
    execution: Execution = _EXECUTION,
    store: RecordIn = None,
    released_only: ReleasedOnly = False,
    force: Force = False,
    no_targets: NoTargets = False,
    as_json: Json = False,
) -> None:
    """Correct the targets of robot programs; write the programs and a record of every target."""
    from truepose.cli.verdicts import show_backups
    from truepose.errors import DataError, RefusedError
    from truepose.programs import CorrectedBatch, Coverage, RefusedProgram
    from truepose.programs.batch import check_names, correct_read, read_for, worth_processes
    from truepose.programs.listing import write_corrected

    if in_place and (out is not None or whole):
        raise DataError(f"{'--whole' if whole else '--out'} has no effect with --in-place; give one of them")
    check_pairs(("--released-only", True if released_only else None, "--store", store))
    out = out or Path("corrected")
    _allow_files(report, targets, force)
    policy: Policy | None = None if on_guard is None else on_guard.value
    with ExitStack() as stack:
        record = stack.enter_context(recorder(store, "correct", _folders(paths) if in_place else [out]))
        progress = stack.enter_context(working("Reading the map", quiet=as_json))
        error_map, row = map_to_use(record, map_path, released_only=released_only)
        cell = reading.cell()
        if record is not None and row is not None:
            record.check_robot(row, reading.cell_path, cell, other_robot)
        frames = reading.frames(cell or error_map.cell)
        progress("Reading the programs")
        # correct all before writing any, so that a refusal leaves no program half done
        options = reading.options(orientation=orientation)
        executor = stack.enter_context(execution.executor("correction")) if execution.asked else None
        here = None if execution.cluster else executor  # workers of a cluster do not have the files
        names = reading.controllers or ()
        found = read_for(
            error_map,
            paths,
            frames,
            options,
            names,
            cell=cell,
            other_maker=other_maker,
            other_robot=other_robot,
            executor=here,
        )
        with _others_named(len(found.programs) + len(found.unreadable)):
            if found.unreadable and not keep_going:
                raise unread(found.unreadable)
            earlier = None if record is None else record.corrected_already(found.programs)
            again = {} if earlier is None else earlier.refused
            if again and not keep_going:
                raise RefusedError(next(iter(again.values())))
            originals = [program for program in found.programs if program not in again]
            if executor is None and worth_processes(originals):
                executor = stack.enter_context(execution.executor("correction"))
            corrected, refused = correct_read(
                _announced(originals, progress, together=executor is not None),
                error_map,
                cell,
                keep_going=keep_going,
                executor=executor,
                on_guard=policy,
                orientation=orientation,
                require=require,
                other_maker=other_maker,
                other_robot=other_robot,
                this_robot=this_robot,
                accept_weak_map=accept_weak_map,
                accept=accept or (),
                progress=progress.count,
            )
        if row is not None:
            beside = map_path if map_path.is_file() else None  # the list of corrected programs lies beside a file
            corrected = [replace(one, map_state=row["state"], map_path=beside) for one in corrected]
        if earlier is not None:
            told = earlier.warnings
            corrected = [
                replace(one, warnings=(*one.warnings, told[one.program])) if one.program in told else one
                for one in corrected
            ]
        before = {error.path: str(error) for error in found.unreadable}
        before |= {program.path: reason for program, reason in again.items()}
        batch = CorrectedBatch(tuple(corrected), (*starmap(RefusedProgram, before.items()), *refused))
        progress("Writing")
        check_names(corrected, in_place=in_place)
        written: list[Path] = []
        if corrected and not dry_run:
            if record is not None and row is not None:
                record.check_map(row, released_only=released_only)
            note = None if record is None else record.prepare(corrected)
            how: Any = {"force": force, "workbook": xlsx, "note": note}
            written = batch.write_in_place(**how) if in_place else batch.write(out, whole=whole, **how)
            if record is not None and note is not None:
                record_corrections(record, corrected, written)
                note.remove()
        refusals = [one.reason for one in batch.refused]
        _write_report(Coverage.of_outcomes([one.targets for one in corrected], refusals), report)
        if targets is not None:
            write_corrected(targets, corrected)
        written += [path for path in (report, targets) if path is not None]
    if as_json:
        backups = [backup.to_dict() for backup in found.backups]
        emit_json({"written": written, "backups": backups, **batch.to_dict(targets=not no_targets)})
    else:
        show_backups(found.backups)
        _show_batch(batch, written, "" if in_place else f" into {out}", dry_run=dry_run)
    if batch.refused:
        raise RefusedError(_refusals(batch))


def _folders(paths: Sequence[Path]) -> list[Path]:
    """Return the folders of the programs of a command."""
    return list(dict.fromkeys(path if path.is_dir() else path.parent for path in paths))


def _allow_files(report: Path | None, targets: Path | None, force: bool) -> None:
    """Refuse a report or a list of targets early that must not be written."""
    if report is not None:
        from truepose.report.coverage import check_path

        check_path(report)
    overwrite(force, *(path for path in (report, targets) if path is not None))


def _write_report(coverage: Coverage, report: Path | None) -> None:
    if report is not None:
        from truepose.report.coverage import write_coverage

        write_coverage(coverage, report)


@contextmanager
def _others_named(programs: int) -> Iterator[None]:
    """Say how the other programs are corrected if one of several is refused."""
    from truepose.errors import TrueposeError

    try:
        yield
    except TrueposeError as error:
        if programs > 1:
            error.add_note("--keep-going corrects the other programs")
        raise


def _announced(programs: Sequence[Program], progress: Steps, *, together: bool) -> Iterator[Program]:
    """Yield programs, and show which one is corrected if it is one after the other."""
    if together:
        progress(f"Correcting {len(programs)} programs")
        yield from programs
        return
    for number, program in enumerate(programs, 1):
        progress(f"Correcting {program.path.name}" + (f" ({number} of {len(programs)})" if len(programs) > 1 else ""))
        yield program


def _show_batch(batch: CorrectedBatch, written: Sequence[Path], place: str, *, dry_run: bool) -> None:
    """Show each program in one line with its reasons, the files that were written, and the total."""
    from truepose.cli.verdicts import show_corrected, show_limits

    for program in batch.corrected:
        if dry_run:
            typer.echo(program.diff(), nl=False)
        show_corrected(program)
    show_limits(batch.corrected)
    if len(written) > _WRITTEN:
        say(f"Wrote {len(written)} files{place}")
    else:
        say(*(f"Wrote {file}" for file in written))
    if batch.n_corrected + batch.n_refused > 1:
        outcome = "corrected" if batch.coverage.corrected else "without a corrected target"
        say(f"{_count(batch.n_corrected)} {outcome}, {batch.n_refused} refused")
    say(str(batch.coverage))


def _refusals(batch: CorrectedBatch) -> str:
    """Return the list of refused programs."""
    listed = "; ".join(dict.fromkeys(one.reason for one in batch.refused))  # the files of a module have one reason
    return f"{_count(batch.n_refused)} {'is' if batch.n_refused == 1 else 'are'} refused: {listed}"


def _count(n: int) -> str:
    return f"{n} {'program' if n == 1 else 'programs'}"


def unread(errors: Sequence[FileError]) -> FileError:
    """Return one error for all unreadable programs."""
    from truepose.errors import FileError

    if len(errors) == 1:
        return errors[0]
    first, *others = map(str, errors)
    return FileError(f"{len(errors)} programs cannot be read", "; ".join([first, *others]))
