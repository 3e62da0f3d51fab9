"""Read the programs of a controller in a backup, with the frames that it stores."""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from truepose.errors import DataError, FileError
from truepose.programs.backups.backup import Backup, Controller, format_of
from truepose.programs.backups.frames import joined_frames
from truepose.programs.core.program import Program, ReadOptions
from truepose.programs.core.scales import refuse_off_scale
from truepose.programs.frame_table import FrameTable
from truepose.programs.languages import LANGUAGES, again_by, language_of
from truepose.programs.robot_base import standing

TASK: Final = re.compile(r"TASK\d+", re.I)
"""The folder of a task in a backup of ABB."""
_Found = tuple[list[Program], list[FileError]]


def chosen(backup: Backup, names: Sequence[str]) -> list[Controller]:
    """Return the controllers of some names, without regard to case; without names all of them.

    Raises
    ------
    DataError
        If there is no controller of a name.
    """
    known = {one.name.casefold(): one for one in backup.controllers}
    wanted = [name.replace("\\", "/").strip("/").casefold() or "." for name in names]
    if not wanted:
        return list(backup.controllers)
    for name, key in zip(names, wanted, strict=True):
        if key not in known:
            shown = ", ".join(one.name for one in backup.controllers)
            raise DataError(f"{backup.path}: has no controller {name}; name one of: {shown}")
    return [one for one in backup.controllers if one.name.casefold() in wanted]


def read_controllers(
    backup: Backup, controllers: Sequence[Controller], frames: FrameTable, options: ReadOptions
) -> tuple[list[Program], list[FileError]]:
    """Read the programs of controllers of a backup; return them, and the errors of those that cannot be read.

    `frames` are those that the user gives.
    """
    programs: list[Program] = []
    errors: list[FileError] = []
    for one in controllers:
        found, more = _read_controller(one, frames, options)
        programs += [replace(program, root=backup.path, controller=one.root) for program in found]
        errors += more
    return programs, errors


def _read_controller(controller: Controller, frames: FrameTable, options: ReadOptions) -> _Found:
    first = next((file for files in controller.contents.programs for file in files), None)
    if first is None:
        return [], []
    module = format_of(controller.maker)
    try:
        if (read_all := getattr(module, "read_all", None)) is not None:
            programs, errors = read_all(controller.root, controller.files, frames, options)
            return list(programs), list(errors)
        known = joined_frames(frames, controller.frames, str(controller.root))
        if controller.frames.tf_world_base is None:
            known = standing(known, controller.root, language_of(first))
        for_reader = getattr(module, "for_reader", None)
        more = {} if for_reader is None else for_reader(controller.root, controller.files)
    except FileError as error:
        return [], [error]
    except DataError as error:
        return [], [FileError(controller.root, str(error))]
    read = {"KUKA": _projects, "ABB": _tasks}.get(controller.maker, _single_files)
    return read(controller, known, options, more)


def _projects(controller: Controller, frames: FrameTable, options: ReadOptions, more: Mapping[str, Any]) -> _Found:
    """Read the KRL projects of a controller."""
    from truepose.programs.krl.reader import read_project

    programs: list[Program] = []
    errors: list[FileError] = []
    several = len(controller.contents.programs) > 1
    for files in controller.contents.programs:
        folder = _common(files) if several else controller.root
        reader = partial(read_project, folder, files, frames, options, **more)
        _take(partial(again_by, reader, options, "krl"), programs, errors)
    return programs, [*errors, *(error for program in programs for error in program.unreadable)]


def _tasks(controller: Controller, frames: FrameTable, options: ReadOptions, more: Mapping[str, Any]) -> _Found:
    """Read the RAPID tasks of a controller; they share PERS data, so that all are read or none."""
    tasks = [(_task_folder(files), files) for files in controller.contents.programs]
    try:
        return read_rapid_tasks(tasks, frames, options, **more), []
    except FileError as error:
        return [], [error]


def read_rapid_tasks(
    tasks: Sequence[tuple[Path, Sequence[Path]]], frames: FrameTable, options: ReadOptions, **more: Any
) -> list[Program]:
    """Read RAPID tasks, each from its path and its modules, that know how to read themselves again."""
    from truepose.programs.rapid.reader import read_tasks

    def again(k: int) -> Program:
        return replace(read_tasks(tasks, frames, options, **more)[k], options=options)

    programs = read_tasks(tasks, frames, options, **more)
    found = [replace(one, options=options, again=partial(again, k), language="rapid") for k, one in enumerate(programs)]
    return [refuse_off_scale(program) for program in found]


def _single_files(controller: Controller, frames: FrameTable, options: ReadOptions, more: Mapping[str, Any]) -> _Found:
    """Read the programs of a controller whose programs are one file each."""
    programs: list[Program] = []
    errors: list[FileError] = []
    for file in (file for files in controller.contents.programs for file in files):
        if not (name := language_of(file)):
            errors.append(FileError(file, "is not a robot program in a known language"))
            continue
        module = importlib.import_module(LANGUAGES[name].reader)
        whole = {"folder": controller.root} if name == "val3" else {}
        reader = partial(module.read, file, frames, options, **{**whole, **more})
        _take(partial(again_by, reader, options, name), programs, errors)
    return programs, errors


def _take(read: Callable[[], Program], programs: list[Program], errors: list[FileError]) -> None:
    try:
        programs.append(read())
    except FileError as error:
        errors.append(error)


def _common(files: Sequence[Path]) -> Path:
    return Path(os.path.commonpath([file.parent for file in files]))


def _task_folder(files: Sequence[Path]) -> Path:
    """Return the folder TASKn of modules; without one, the folder that holds all of them."""
    folder = _common(files)
    return next((one for one in (folder, *folder.parents) if TASK.fullmatch(one.name)), folder)
