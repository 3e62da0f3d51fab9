"""Read programs: a file by its ending, a folder as all programs in it."""

from __future__ import annotations

import importlib
import os
import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Final

from truepose._io.files import check_regular, note_read, path_exists, reads_noted, recover
from truepose._io.folders import files_within
from truepose._io.zips import is_zip, nested_within, on_disk
from truepose.errors import FileError, RefusedError, TrueposeError
from truepose.numerics.executor import AHEAD, Executor, Inputs, Task, run_in_order
from truepose.programs.backups.backup import Backup, Controller, find_backup
from truepose.programs.backups.reading import TASK, chosen, read_controllers, read_rapid_tasks
from truepose.programs.backups.yaskawa import jobs_beside
from truepose.programs.core.program import Program, ReadOptions
from truepose.programs.core.source import NotAProgramError
from truepose.programs.frame_table import FrameTable
from truepose.programs.languages import KRL, LANGUAGES, RAPID, again_by, all_endings, language_of, without_blank
from truepose.programs.robot_base import standing

_REFUSED: Final = {
    ".tp": "is a compiled FANUC program; export it as .ls and correct that",
}

_SHOWN: Final = 3  # warnings that a message repeats
_TOGETHER: Final = 16
"""The largest number of files that one task reads."""


@dataclass(frozen=True, eq=False)
class Reading:
    """The programs of several files and folders.

    Attributes
    ----------
    programs : list of Program
        The programs that were read.
    unreadable : list of FileError
        The errors of the others.
    backups : list of Backup
        The backups of controllers among the folders and .zip files.
    left_out : list of str
        What in a folder is no program, although its ending is that of one: logs, includes, empty files; and what is no
        .zip that can be read.
    """

    programs: list[Program]
    unreadable: list[FileError]
    backups: list[Backup] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def check_backups(self) -> None:
        """Require that each backup has a program that can be read, where no error says why there is none.

        Raises
        ------
        RefusedError
            If one has none, such as a backup with compiled programs alone.
        """
        for backup in self.backups if not self.unreadable else ():
            if not any(one.root == backup.path for one in self.programs):
                told = [text for one in backup.controllers for text in one.contents.warnings]
                raise RefusedError("; ".join([f"{backup.path}: has no program that can be read", *told[:_SHOWN]]))


def read_program(path: str | Path, frames: FrameTable | None = None, options: ReadOptions | None = None) -> Program:
    r"""Read a robot program; the ending of the file determines the language.

    Parameters
    ----------
    path : str or Path
        The path of the program. KUKA: the .src, or the .dat beside it, or the folder of a project. docs/programs.md
        lists the other languages. A backup of a controller, as a folder or .zip, if it holds one program.
    frames : FrameTable, optional
        The controller's tools and bases. Without it only number 0 is known.
    options : ReadOptions, optional
        The options of reading.

    Returns
    -------
    Program
        The program, with a verdict on each target.

    Raises
    ------
    FileError
        If the file is missing, broken, or of no known language; with its line.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.src"
    >>> _ = path.write_text("DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n")
    >>> program = read_program(path)
    >>> program.counts()
    {'correct': 1, 'skip': 0, 'refuse': 0}
    >>> program.positions_base()
    array([[1., 2., 3.]])
    """
    path = Path(path)
    if (outer := on_disk(path)) != path and is_zip(outer):
        raise FileError(path, f"lies in a .zip; give {outer.name} itself, in which its frames and shared data are")
    if not (is_zip(path) or (path_exists(path) and path.is_dir())):
        recover(path.parent)
        return _read_file(path, frames, options)
    found = read_programs([path], frames, options)
    if found.unreadable:
        raise found.unreadable[0]
    if len(found.programs) > 1:
        raise FileError(path, f"holds {len(found.programs)} programs; name one of them")
    return found.programs[0]


def _read_file(
    path: Path, frames: FrameTable | None, options: ReadOptions | None, folder: Path | None = None
) -> Program:
    if path_exists(path):
        check_regular(path)
    name = language_of(path)
    if not name:
        if not path.exists():
            raise FileError(path, "no such file")
        if why := _REFUSED.get(path.suffix.lower()):
            raise FileError(path, why)
        raise FileError(path, f"is not a robot program in a known language; known endings: {all_endings()}")
    module = importlib.import_module(LANGUAGES[name].reader)
    if name == "krl" and path.is_file() and not path.stat().st_size:  # an empty text is no error in KRL
        raise FileError(path, "is empty; name a program")
    options = options or ReadOptions()
    frames = standing(frames or FrameTable(), path, name)
    whole: dict[str, Any] = {"folder": folder} if name == "val3" and folder is not None else {}
    if name == "inform":
        whole = {"beside": jobs_beside(path, folder)}
    return again_by(partial(module.read, path, frames, options, **whole), options, name)


def _is_folder(path: Path) -> bool:
    """Return whether a path is a folder; False where it cannot be followed, where `Path.is_dir` raises."""
    return os.path.isdir(path)  # noqa: PTH112


def read_programs(
    paths: Iterable[str | Path],
    frames: FrameTable | None = None,
    options: ReadOptions | None = None,
    *,
    controllers: Sequence[str] = (),
    executor: Executor | None = None,
) -> Reading:
    """Read programs, folders of programs and backups of controllers; one that cannot be read does not stop the others.

    A folder or .zip in which a maker's backup is recognised is read controller by controller, with the tools and bases
    that each stores; programs in the folder that belong to no controller are read as those of any other folder. In
    such a one all KRL modules are one program, and so are its RAPID modules: one task, or one for each folder TASK1,
    TASK2 … in it. RAPID modules that are named together are one task, too. Links in a folder are ignored; its CSV files
    are read only if it holds nothing else, because most tables are no targets. A KRL or RAPID module that cannot be
    read is left out, and what it names is not trusted.

    Parameters
    ----------
    paths : iterable of str or Path
        The paths of files, folders and .zip files.
    frames, options
        The tools and bases, and the options, as in `read_program`.
    controllers : sequence of str
        The names of the controllers of a backup that are read, such as ``KRC/R1``; by default all.
    executor : Executor, optional
        Where they are read: in this process by default, or in processes of this machine, which has the files.

    Raises
    ------
    FileError
        If a folder holds no program.
    DataError
        If a backup has no controller of a name in `controllers`.
    """
    return read_chosen(paths, frames, options, partial(chosen, names=controllers), executor)


def read_chosen(
    paths: Iterable[str | Path],
    frames: FrameTable | None,
    options: ReadOptions | None,
    choose: Callable[[Backup], Sequence[Controller]],
    executor: Executor | None = None,
) -> Reading:
    """Read what `read_programs` does; `choose` returns the controllers of a backup that are read."""
    given = [Path(path) for path in paths]
    together = [path for path in given if path.suffix.lower() in RAPID and not _is_folder(path)]
    together = together if len(together) > 1 else []
    places = _places([path for path in given if _is_folder(path) or is_zip(path)])
    parts: list[_Part] = []
    for path in given:
        if path in together:
            parts += [partial(_named_together, together)] if path is together[0] else []
        else:
            parts.append(partial(_folder, path, choose) if path in places else partial(_file, None, path))
    read = _reader(executor, frames or FrameTable(), options or ReadOptions())
    found = list(read(parts))
    others = read([partial(_file, one.folder, file) for one in found for file in one.others])
    for one in found:
        for more in islice(others, len(one.others)):
            one.programs.extend(more.programs)
            one.unreadable.extend(more.unreadable)
            one.left_out.extend(more.left_out)
        if one.folder is not None:
            one.programs[:] = [replace(program, place=places[one.folder]) for program in one.programs]
    errors = [error for one in found for error in one.unreadable]
    none = [error for error in errors if isinstance(error, NotAProgramError) and error.path not in given]
    return Reading(
        [program for one in found for program in one.programs],
        [error for error in errors if error not in none],
        [backup for one in found for backup in one.backups],
        [*(text for one in found for text in one.left_out), *(f"{error}; it is left out" for error in none)],
    )


@dataclass(eq=False)
class _Found:
    """What a part of the given paths holds: programs, or files of a folder that are still to be read."""

    programs: list[Program] = field(default_factory=list)
    unreadable: list[FileError] = field(default_factory=list)
    backups: list[Backup] = field(default_factory=list)
    folder: Path | None = None
    others: list[Path] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def take(self, read: Callable[[], list[Program]]) -> None:
        """Add programs, or the error that says why they cannot be read."""
        try:
            found = read()
        except FileError as error:
            self.unreadable.append(error)
        else:
            self.programs.extend(found)
            self.unreadable.extend(error for program in found for error in program.unreadable)


_Part = Callable[[FrameTable, ReadOptions], _Found]


def _reader(
    executor: Executor | None, frames: FrameTable, options: ReadOptions
) -> Callable[[Sequence[_Part]], Iterator[_Found]]:
    """Return a function that yields what parts hold, in their order; the first error in this order is raised."""
    if executor is None:
        return lambda parts: (part(frames, options) for part in parts)
    known = frames, options
    return partial(_read_by, executor, executor.share(partial(pickle.dumps, known), known))


def _read_by(executor: Executor, key: str, parts: Sequence[_Part]) -> Iterator[_Found]:
    size = max(1, min(_TOGETHER, len(parts) // (AHEAD * executor.workers)))
    tasks = ((None, Task((key,), tuple(some))) for some in _groups(parts, size))
    for _, (found, identities) in run_in_order(executor, read_task, tasks, ahead=AHEAD):
        note_read(identities)
        for one in found:
            if isinstance(one, TrueposeError):
                raise one
            yield one


def _groups(parts: Sequence[_Part], size: int) -> Iterator[Sequence[_Part]]:
    return (parts[start : start + size] for start in range(0, len(parts), size))


def read_task(inputs: Inputs, task: Task) -> tuple[list[_Found | TrueposeError], set[tuple[int, int]]]:
    """Read parts; return what they hold, up to the first error, and the identities of the files that were read."""
    frames, options = inputs.get(task.inputs[0], pickle.loads)
    found: list[_Found | TrueposeError] = []
    with reads_noted() as identities:
        for part in task.values:
            try:
                found.append(part(frames, options))
            except TrueposeError as error:
                found.append(error)
                break
    return found, identities


def _file(root: Path | None, path: Path, frames: FrameTable, options: ReadOptions) -> _Found:
    """Read a file, or one in a folder that was given."""
    found = _Found()
    try:
        program = read_program(path, frames, options) if root is None else _read_file(path, frames, options, root)
        found.programs.append(program if root is None else replace(program, root=root))
    except FileError as error:
        found.unreadable.append(error)
    return found


def _folder(
    path: Path, choose: Callable[[Backup], Sequence[Controller]], frames: FrameTable, options: ReadOptions
) -> _Found:
    """Read a backup, or the projects and tasks of another folder."""
    found = _Found(folder=path)
    try:
        backup = find_backup(path)
    except FileError as error:
        found.unreadable.append(error)
        return found
    if backup is not None:
        wanted = choose(backup)
        found.programs, errors = read_controllers(backup, wanted, frames, options)
        found.backups.append(backup)
        found.unreadable += errors if len(wanted) < len(backup.controllers) else [*backup.unreadable, *errors]
        if is_zip(path) or not backup.outside:
            return found
        if len(wanted) < len(backup.controllers):
            found.left_out = [f"{file}: belongs to no controller and is left out" for file in backup.outside]
            return found
        krl, rapid, found.others = _by_language(backup.outside)
    else:
        krl, rapid, found.others, found.left_out = _members(path)
    if krl:
        found.take(partial(_project, path, krl, frames, options))
    if rapid:
        found.take(partial(_tasks, path, rapid, frames, options))
    return found


def _places(folders: list[Path]) -> dict[Path, Path]:
    """Return the places of folders and .zip files within their common folder; of a single one the place is that."""
    whole = [folder.resolve().with_suffix("") if is_zip(folder) else folder.resolve() for folder in folders]
    common = os.path.commonpath(whole) if whole else ""
    return {folder: path.relative_to(common) for folder, path in zip(folders, whole, strict=True)}


def _named_together(files: list[Path], frames: FrameTable, options: ReadOptions) -> _Found:
    """Read the modules of a task that were named one by one; the task is named after the first."""
    root = files[0].parent
    if any(file.parent != root for file in files):
        files = [file.parent.resolve() / file.name for file in files]  # a link stays one
        root = Path(os.path.commonpath([file.parent for file in files]))
    found = _Found()
    found.take(partial(_rapid, [(files[0], files)], root, frames, options))
    return found


def _tasks(folder: Path, files: list[Path], frames: FrameTable, options: ReadOptions) -> list[Program]:
    """Read the RAPID modules of a folder: one task, or one for each TASKn of a backup."""
    tasks: dict[Path, list[Path]] = {}
    for file in files:
        parts = file.relative_to(folder).parts[:-1]
        k = next((i for i, part in enumerate(parts, 1) if TASK.fullmatch(part)), 0)
        tasks.setdefault(folder.joinpath(*parts[:k]), []).append(file)
    return _rapid(list(tasks.items()), folder, frames, options)


def _rapid(tasks: list[tuple[Path, list[Path]]], root: Path, frames: FrameTable, options: ReadOptions) -> list[Program]:
    """Read the RAPID tasks of a folder."""
    programs = read_rapid_tasks(tasks, standing(frames, root, "rapid"), options)
    return [replace(one, root=root) for one in programs]


def _project(folder: Path, files: list[Path], frames: FrameTable, options: ReadOptions) -> list[Program]:
    """Read the KRL modules of a folder; a ``$config.dat`` among them gives tools and bases, too."""
    return [again_by(partial(_read_project, folder, files, standing(frames, folder, "krl"), options), options, "krl")]


def _read_project(folder: Path, files: list[Path], frames: FrameTable, options: ReadOptions) -> Program:
    from truepose.programs.krl.reader import read_project

    configs = [file for file in files if file.name.lower() == "$config.dat"]
    return read_project(folder, files, frames.with_config_dat(configs[0]) if configs else frames, options)


def _members(folder: Path) -> tuple[list[Path], list[Path], list[Path], list[str]]:
    """Return the KRL and RAPID files of a folder, its other programs, and what is left out."""
    found, told = without_blank(files_within(folder, unpack=False).files)
    told += [text for file in found if is_zip(file) for text in nested_within(file)[1]]
    krl, rapid, others = _by_language(found)
    if not (krl or rapid or others):
        others = [f for f in found if f.suffix.lower() == ".csv" and ".corrections." not in f.name]
    if not (krl or rapid or others):
        raise FileError(folder, f"holds no robot program; known endings: {all_endings()}")
    read = {(file.parent, file.stem.upper()) for file in others}
    compiled = [f for f in found if f.suffix.lower() in _REFUSED and (f.parent, f.stem.upper()) not in read]
    told += [f"{file} {_REFUSED[file.suffix.lower()]}" for file in compiled]
    return krl, rapid, others, told


def _by_language(found: Iterable[Path]) -> tuple[list[Path], list[Path], list[Path]]:
    """Return the KRL and RAPID files among files, and their other programs."""
    found = list(found)
    endings = {file: file.suffix.lower() for file in found}
    sources = {file.stem.lower() for file in found if endings[file] == ".src"}
    krl = [
        file
        for file in found
        if endings[file] in KRL and (file.stem.lower() in sources or endings[file] == ".src" or _is_data_list(file))
    ]
    rapid = [f for f in found if endings[f] in RAPID]
    others = [f for f in found if language_of(f) not in ("", "krl", "rapid", "table")]
    return krl, rapid, others


def _is_data_list(file: Path) -> bool:
    """Return whether a .dat is one of KRL: many other programs write files of that ending."""
    if file.name.lower() == "$config.dat":
        return True
    try:
        with file.open("rb") as head:
            return b"DEFDAT" in head.read(1 << 16).upper()
    except OSError:
        return True  # reading it will give the reason
