"""Read programs: a file by its ending, a folder as all programs in it."""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from truepose._io.files import check_regular, path_exists, recover
from truepose.errors import FileError
from truepose.programs.core.program import Program, ReadOptions
from truepose.programs.frame_table import FrameTable
from truepose.programs.languages import KRL, LANGUAGES, RAPID, again_by, all_endings, language_of
from truepose.programs.robot_base import standing

_TASK: Final = re.compile(r"TASK\d+", re.I)
_REFUSED: Final = {
    ".urp": "is a program of Universal Robots' own editor (packed XML); save it as .script and correct that",
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
    """

    programs: list[Program]
    unreadable: list[FileError]


def read_program(path: str | Path, frames: FrameTable | None = None, options: ReadOptions | None = None) -> Program:
    r"""Read a robot program; the ending of the file determines the language.

    Parameters
    ----------
    path : str or Path
        The path of the program. KUKA: the .src, or the .dat beside it, or the folder of a project. docs/programs.md
        lists the other languages.
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
    if not (path_exists(path) and path.is_dir()):
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
    paths: Iterable[str | Path], frames: FrameTable | None = None, options: ReadOptions | None = None
) -> Reading:
    """Read programs and folders of programs; one that cannot be read does not stop the others.

    All KRL modules of a folder are one program, and so are its RAPID modules: one task, or one for each folder TASK1,
    TASK2 … of a controller's backup. RAPID modules that are named together are one task, too. Links in a folder are
    ignored; its CSV files are read only if it holds nothing else, because most tables are no targets. A KRL module that
    cannot be read is left out of its project if it names nothing of the other modules.

    Parameters
    ----------
    paths : iterable of str or Path
        The paths of files and folders.
    frames, options
        The tools and bases, and the options, as in `read_program`.

    Raises
    ------
    FileError
        If a folder holds no program.
    """
    programs: list[Program] = []
    unreadable: list[FileError] = []

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

    known, allowed = frames or FrameTable(), options or ReadOptions()
    given = [Path(path) for path in paths]
    together = [path for path in given if path.suffix.lower() in RAPID and not _is_folder(path)]
    together = together if len(together) > 1 else []
    places = _places([path for path in given if _is_folder(path)])
    for path in given:
        first = len(programs)
        if path in together:
            if path is together[0]:
                take_all(partial(_named_together, together, known, allowed))
        elif not _is_folder(path):
            take(path)
        else:
            krl, rapid, others = _members(path)
            if krl:
                take_all(partial(_project, path, krl, known, allowed))
            if rapid:
                take_all(partial(_tasks, path, rapid, known, allowed))
            for file in others:
                take(file, path)
            programs[first:] = [replace(one, place=places[path]) for one in programs[first:]]
    return Reading(programs, unreadable)


def _places(folders: list[Path]) -> dict[Path, Path]:
    """Return the places of folders within their common one; of a single folder the place is that itself."""
    whole = [folder.resolve() for folder in folders]
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
        k = next((i for i, part in enumerate(parts, 1) if _TASK.fullmatch(part)), 0)
        tasks.setdefault(folder.joinpath(*parts[:k]), []).append(file)
    return _rapid(list(tasks.items()), folder, frames, options)


def _rapid(tasks: list[tuple[Path, list[Path]]], root: Path, frames: FrameTable, options: ReadOptions) -> list[Program]:
    """Read RAPID tasks that know how to read themselves again."""
    from truepose.programs.rapid.reader import read_tasks

    def again(k: int) -> Program:
        return replace(read_tasks(tasks, frames, options)[k], root=root, options=options)

    frames = standing(frames, root, "rapid")
    programs = read_tasks(tasks, frames, options)
    return [
        replace(one, root=root, options=options, again=partial(again, k), language="rapid")
        for k, one in enumerate(programs)
    ]


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
    found: list[Path] = []

    def fail(error: OSError) -> None:
        raise FileError(error.filename or folder, f"cannot be read: {error.strerror or error}")

    for place, folders, names in os.walk(folder, onerror=fail):
        recover(Path(place))
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        files = [Path(place) / name for name in sorted(names) if not name.startswith(".")]
        found += [file for file in files if file.is_file() and not file.is_symlink()]
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
