"""Read programs: a file by its ending, a folder as all programs in it."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final

from truepose._io.files import check_regular, path_exists, recover
from truepose._io.folders import files_within
from truepose._io.zips import is_zip, on_disk
from truepose.errors import FileError
from truepose.programs.backups.backup import Backup, Controller, find_backup
from truepose.programs.backups.reading import TASK, chosen, read_controllers, read_rapid_tasks
from truepose.programs.core.program import Program, ReadOptions
from truepose.programs.frame_table import FrameTable
from truepose.programs.languages import KRL, LANGUAGES, RAPID, again_by, all_endings, language_of
from truepose.programs.robot_base import standing

_REFUSED: Final = {
    ".tp": "is a compiled FANUC program; export it as .ls and correct that",
}


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
    """

    programs: list[Program]
    unreadable: list[FileError]
    backups: list[Backup] = field(default_factory=list)


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
    whole = {"folder": folder} if name == "val3" and folder is not None else {}
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
) -> Reading:
    """Read programs, folders of programs and backups of controllers; one that cannot be read does not stop the others.

    A folder or .zip in which a maker's backup is recognised is read controller by controller, with the tools and bases
    that each stores. Of any other folder, all KRL modules are one program, and so are its RAPID modules: one task, or
    one for each folder TASK1, TASK2 … in it. RAPID modules that are named together are one task, too. Links in a folder
    are ignored; its CSV files are read only if it holds nothing else, because most tables are no targets. A KRL module
    that cannot be read is left out of its project, and what it names is not trusted.

    Parameters
    ----------
    paths : iterable of str or Path
        The paths of files, folders and .zip files.
    frames, options
        The tools and bases, and the options, as in `read_program`.
    controllers : sequence of str
        The names of the controllers of a backup that are read, such as ``KRC/R1``; by default all.

    Raises
    ------
    FileError
        If a folder holds no program.
    DataError
        If a backup has no controller of a name in `controllers`.
    """
    return read_chosen(paths, frames, options, partial(chosen, names=controllers))


def read_chosen(
    paths: Iterable[str | Path],
    frames: FrameTable | None,
    options: ReadOptions | None,
    choose: Callable[[Backup], Sequence[Controller]],
) -> Reading:
    """Read what `read_programs` does; `choose` returns the controllers of a backup that are read."""
    programs: list[Program] = []
    unreadable: list[FileError] = []
    backups: list[Backup] = []

    def take(path: Path, root: Path | None = None) -> None:
        try:
            program = read_program(path, frames, options) if root is None else _read_file(path, frames, options, root)
            programs.append(program if root is None else replace(program, root=root))
        except FileError as error:
            unreadable.append(error)

    def take_all(read: Callable[[], list[Program]]) -> None:
        try:
            found = read()
        except FileError as error:
            unreadable.append(error)
        else:
            programs.extend(found)
            unreadable.extend(error for program in found for error in program.unreadable)

    def take_backup(path: Path) -> bool:
        try:
            if (backup := find_backup(path)) is None:
                return False
        except FileError as error:
            unreadable.append(error)
        else:
            wanted = choose(backup)
            found, errors = read_controllers(backup, wanted, known, allowed)
            backups.append(backup)
            programs.extend(found)
            unreadable.extend(errors if len(wanted) < len(backup.controllers) else [*backup.unreadable, *errors])
        return True

    known, allowed = frames or FrameTable(), options or ReadOptions()
    given = [Path(path) for path in paths]
    together = [path for path in given if path.suffix.lower() in RAPID and not _is_folder(path)]
    together = together if len(together) > 1 else []
    places = _places([path for path in given if _is_folder(path) or is_zip(path)])
    for path in given:
        first = len(programs)
        if path in together:
            if path is together[0]:
                take_all(partial(_named_together, together, known, allowed))
        elif path not in places:
            take(path)
        elif not take_backup(path):
            krl, rapid, others = _members(path)
            if krl:
                take_all(partial(_project, path, krl, known, allowed))
            if rapid:
                take_all(partial(_tasks, path, rapid, known, allowed))
            for file in others:
                take(file, path)
        if path in places:
            programs[first:] = [replace(one, place=places[path]) for one in programs[first:]]
    return Reading(programs, unreadable, backups)


def _places(folders: list[Path]) -> dict[Path, Path]:
    """Return the places of folders and .zip files within their common folder; of a single one the place is that."""
    whole = [folder.resolve().with_suffix("") if is_zip(folder) else folder.resolve() for folder in folders]
    common = os.path.commonpath(whole) if whole else ""
    return {folder: path.relative_to(common) for folder, path in zip(folders, whole, strict=True)}


def _named_together(files: list[Path], frames: FrameTable, options: ReadOptions) -> list[Program]:
    """Read the modules of a task that were named one by one; the task is named after the first."""
    root = files[0].parent
    if any(file.parent != root for file in files):
        files = [file.parent.resolve() / file.name for file in files]  # a link stays one
        root = Path(os.path.commonpath([file.parent for file in files]))
    return _rapid([(files[0], files)], root, frames, options)


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
    from truepose.programs.krl.reader import read_project

    def read() -> Program:
        configs = [file for file in files if file.name.lower() == "$config.dat"]
        known = frames.with_config_dat(configs[0]) if configs else frames
        return read_project(folder, files, known, options)

    frames = standing(frames, folder, "krl")
    return [again_by(read, options, "krl")]


def _members(folder: Path) -> tuple[list[Path], list[Path], list[Path]]:
    """Return the KRL and RAPID files of a folder, and its other programs."""
    found = files_within(folder, unpack=False).files
    endings = {file: file.suffix.lower() for file in found}
    sources = {file.stem.lower() for file in found if endings[file] == ".src"}
    krl = [
        file
        for file in found
        if endings[file] in KRL and (file.stem.lower() in sources or endings[file] == ".src" or _is_data_list(file))
    ]
    rapid = [f for f in found if endings[f] in RAPID]
    others = [f for f in found if language_of(f) not in ("", "krl", "rapid", "table")]
    if not (krl or rapid or others):
        others = [f for f in found if endings[f] == ".csv" and ".corrections." not in f.name]
    if not (krl or rapid or others):
        raise FileError(folder, f"holds no robot program; known endings: {all_endings()}")
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
