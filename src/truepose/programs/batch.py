"""Correct many programs: all or none, or all but the refused ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from truepose.cell import Cell
from truepose.error_map.map import ErrorMap
from truepose.errors import DataError, RefusedError, TrueposeError
from truepose.numerics.executor import Executor
from truepose.programs.agreement import check_serial, controllers_for
from truepose.programs.backups.backup import Backup, Controller
from truepose.programs.core.outcomes import CorrectedShare
from truepose.programs.core.program import Program, ReadOptions
from truepose.programs.correct import correct_program
from truepose.programs.corrected import CorrectedProgram, Note, names, write, write_in_place
from truepose.programs.corrector import CorrectionContext, Corrector
from truepose.programs.frame_table import FrameTable
from truepose.programs.leftovers import clear_leftovers
from truepose.programs.parallel import correct_in_tasks
from truepose.programs.reading import Reading, read_chosen
from truepose.programs.record import records_read_once

_WORTH_PROCESSES: Final = 40_000
"""Targets from which processes save more time than their start takes, about 2 s."""


@dataclass(frozen=True)
class RefusedProgram:
    """A program, or a module of a project, that is not corrected.

    Attributes
    ----------
    path : Path
        The program, or the file of the module.
    reason : str
        The reason.
    count : int
        The number of programs: those of a project that is refused as a whole, otherwise one.
    """

    path: Path
    reason: str
    count: int = 1

    def to_dict(self) -> dict[str, Any]:
        """Return the path and the reason, for JSON."""
        return {"file": str(self.path), "reason": self.reason}


@dataclass(frozen=True, repr=False)
class CorrectedBatch:
    """Programs that are corrected and not yet written, and those that are refused.

    Attributes
    ----------
    corrected : tuple of CorrectedProgram
        The corrected programs.
    refused : tuple of RefusedProgram
        The others, and refused modules of corrected projects; empty unless the run keeps going.
    """

    corrected: tuple[CorrectedProgram, ...]
    refused: tuple[RefusedProgram, ...] = ()

    def __repr__(self) -> str:
        return f"<CorrectedBatch: {self.n_corrected} programs, {self.n_refused} refused; {self.coverage}>"

    @property
    def n_corrected(self) -> int:
        """The number of corrected programs; each module of a project with targets is one."""
        return sum(max(1, sum(file not in one.refused for file in one.program.modules)) for one in self.corrected)

    @property
    def n_refused(self) -> int:
        """The number of refused programs; the files of a module are one program."""
        return sum({one.path.with_suffix(""): one.count for one in self.refused}.values())

    @property
    def coverage(self) -> CorrectedShare:
        """The number of motion targets of the corrected programs, and of those that are corrected."""
        return CorrectedShare.of(program.targets for program in self.corrected)

    def to_dict(self, *, targets: bool = True) -> dict[str, Any]:
        """Return the records, without their targets if these are not wanted, and the refused programs, for JSON."""
        return {
            "coverage": self.coverage._asdict(),
            "programs": [program.to_dict() if targets else program.head() for program in self.corrected],
            "refused": [one.to_dict() for one in self.refused],
        }

    def write(
        self,
        out_dir: str | Path,
        *,
        force: bool = False,
        workbook: bool = False,
        whole: bool = False,
        note: Note | None = None,
    ) -> list[Path]:
        """Write the corrected programs, all or none; see `CorrectedProgram.write`.

        Of a backup the files that change are written, with ``changed-files.csv``, the list of their hashes. With
        `whole` the whole backup is, as a folder or as a .zip like the one that was given, in which only these differ.

        A warning names files in the folder that an earlier run wrote and this one does not. With `force` they are
        removed, unless they were changed since.
        """
        if whole and not any(one.program.controller for one in self.corrected):
            raise DataError("whole has an effect only on the backup of a controller, and none was given")
        written = write(self.corrected, Path(out_dir), force=force, workbook=workbook, whole=whole, note=note)
        clear_leftovers(Path(out_dir), written, force=force)
        return written

    def write_in_place(self, *, force: bool = False, workbook: bool = False, note: Note | None = None) -> list[Path]:
        """Write over the corrected programs, all or none; see `CorrectedProgram.write_in_place`."""
        return write_in_place(self.corrected, force=force, workbook=workbook, note=note)


def correct_programs(
    paths: Iterable[str | Path],
    error_map: Corrector,
    cell: Cell | None = None,
    *,
    frames: FrameTable | None = None,
    options: ReadOptions | None = None,
    controllers: Sequence[str] = (),
    keep_going: bool = False,
    executor: Executor | None = None,
    **settings: Any,
) -> CorrectedBatch:
    r"""Correct the programs of files and folders. Nothing is written; see `CorrectedBatch.write`.

    Parameters
    ----------
    paths : iterable of str or Path
        The files and folders, as in `read_programs`.
    error_map : Corrector
        The error map, such as `truepose.ErrorMap`.
    cell, frames, options
        The cell, the tools and bases, and the options of reading, as in `correct_program`.
    controllers : sequence of str
        The names of the controllers of a backup that are corrected; by default the only one of the map's maker.
    keep_going : bool
        Whether to correct the other programs if one cannot be read or is refused. In a project (KRL) or a task (RAPID)
        this holds for each module.
    executor : Executor, optional
        Where the programs are corrected; by default one after the other in this process. Results do not depend on it.
    **settings
        The other options of `correct_program`.

    Raises
    ------
    FileError
        If a program cannot be read, unless `keep_going`.
    RefusedError
        If a program is refused, unless `keep_going`; if two programs would be written to one file.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from types import SimpleNamespace
    >>> class Shift:
    ...     def correct(self, poses, **_):  # every error is 0.5 mm along x
    ...         p, n = poses[:, :3, 3], len(poses)
    ...         e = np.tile([0.5, 0.0, 0.0], (n, 1))
    ...         return SimpleNamespace(
    ...             p_target=p, p_command=p - e, e=e, std=np.full((n, 3), 0.05),
    ...             verdict=np.full(n, "correct"), reason=[""] * n)
    >>> folder = Path(tempfile.mkdtemp())
    >>> text = "DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n"
    >>> _ = (folder / "good.src").write_text(text)
    >>> _ = (folder / "bad.src").write_text(text.replace("2", "2.3.4"))
    >>> correct_programs([folder / "good.src", folder / "bad.src"], Shift(), keep_going=True)
    <CorrectedBatch: 1 programs, 1 refused; 1 of 1 motion targets corrected, 0 stay nominal>
    """
    if frames is None and cell is not None:
        frames = FrameTable.from_cell(cell)
    options = replace(options or ReadOptions(), orientation=bool(settings.get("orientation", False)))
    found = read_for(
        error_map,
        paths,
        frames,
        options,
        controllers,
        cell=cell,
        other_maker=settings.get("other_maker", False),
        other_robot=settings.get("other_robot", ""),
    )
    refused = [RefusedProgram(Path(error.path), str(error)) for error in found.unreadable]
    if found.unreadable and not keep_going:
        raise found.unreadable[0]
    corrected, more = correct_read(
        found.programs, error_map, cell, keep_going=keep_going, executor=executor, **settings
    )
    return CorrectedBatch(tuple(corrected), (*refused, *more))


def read_for(
    error_map: Corrector,
    paths: Iterable[str | Path],
    frames: FrameTable | None,
    options: ReadOptions,
    controllers: Sequence[str] = (),
    *,
    cell: Cell | None = None,
    other_maker: bool = False,
    other_robot: str = "",
    executor: Executor | None = None,
) -> Reading:
    """Return the programs that a map is to correct: of a backup, those of the controller of its robot.

    With an executor of this machine, its processes read them.

    Raises
    ------
    RefusedError
        If a backup has no such controller or several, is of another robot than the map, or there is no program.
    """
    known = CorrectionContext.of(error_map)
    cells = [one for one in (known.cell, cell) if one is not None]

    def choose(backup: Backup) -> list[Controller]:
        wanted = controllers_for(backup, known.robot, controllers, other_robot, other_maker=other_maker)
        for one in wanted:
            check_serial(one, cells, other_robot)
        return wanted

    found = read_chosen(paths, frames, options, choose, executor)
    found.check_backups()
    return found


def worth_processes(programs: Sequence[Program]) -> bool:
    """Return whether the correction of programs takes longer than the start of processes."""
    return len(programs) > 1 and sum(len(program.targets) for program in programs) > _WORTH_PROCESSES


def correct_read(
    programs: Iterable[Program],
    error_map: Corrector,
    cell: Cell | None,
    *,
    keep_going: bool,
    executor: Executor | None = None,
    **settings: Any,
) -> tuple[list[CorrectedProgram], list[RefusedProgram]]:
    """Return programs that were read corrected, and those that are refused.

    With an executor, `progress` counts programs instead of targets; the results are the same.
    """
    corrected: list[CorrectedProgram] = []
    refused: list[RefusedProgram] = []
    settings["keep_going"] = keep_going
    if executor is not None and isinstance(error_map, ErrorMap):
        results = correct_in_tasks(list(programs), error_map, cell, executor, **settings)
    else:
        results = ((program, _tried(program, error_map, cell, settings)) for program in programs)
    with records_read_once():
        for program, one in results:
            if isinstance(one, CorrectedProgram):
                corrected.append(one)
                refused += [RefusedProgram(path, reason) for path, reason in one.refused.items()]
            elif not keep_going:
                raise one
            else:
                refused.append(RefusedProgram(program.path, str(one), max(1, len(program.modules))))
    return corrected, refused


def _tried(
    program: Program, error_map: Corrector, cell: Cell | None, settings: Mapping[str, Any]
) -> CorrectedProgram | TrueposeError:
    try:
        return correct_program(program, error_map, cell, **settings)
    except TrueposeError as error:
        return error


def check_names(corrected: Sequence[CorrectedProgram], *, in_place: bool = False) -> None:
    """Refuse programs that would overwrite each other.

    Raises
    ------
    RefusedError
        If two programs would be written to one file.
    """
    taken: dict[str, Path] = {}
    for one in corrected:
        folder = one.program.folder.resolve() if in_place else one.program.place
        for name in names(one.program):
            first = taken.setdefault(str(folder / name).lower(), one.program.path)
            if first is not one.program.path:
                raise RefusedError(
                    f"{first} and {one.program.path} would both be written as {name}; correct them one by one, "
                    "each with its own --out"
                )
