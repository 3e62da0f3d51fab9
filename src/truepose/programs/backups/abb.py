"""Backups of ABB: BACKINFO, RAPID/TASKn, SYSPAR.

The tasks of a controller are judged together, because PERS data of one name and type are one variable. Each task has
the modules that BACKINFO/backinfo.txt lists, those that SYS.cfg loads from HOME, and those that its own statements
load from there by a constant name. Tools and workobjects are in the modules; the place of each robot is in MOC.cfg.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from truepose.errors import DataError, FileError
from truepose.programs.backups.abb_tasks import TASK, Backup, BackupTask
from truepose.programs.backups.controller import Contents, StoredFrames
from truepose.programs.core.program import Program, ReadOptions
from truepose.programs.core.scales import refuse_off_scale
from truepose.programs.frame_table import FrameTable
from truepose.programs.rapid.controller import AbbRobot
from truepose.programs.rapid.reader import TaskFiles, read_tasks

_SAME_MM: Final = 1e-6


def roots(files: Sequence[Path]) -> list[Path]:
    """Return the folders of the controllers among the files of a backup; those within another one are its copies."""
    found: set[Path] = set()
    for file in files:
        parts = [part.upper() for part in file.parts]
        if parts[-2:] == ["BACKINFO", "BACKINFO.TXT"]:
            found.add(file.parent.parent)
        k = next((k for k, part in enumerate(parts[:-2]) if part == "RAPID" and TASK.fullmatch(parts[k + 1])), -1)
        if k >= 0:
            found.add(Path(*file.parts[:k]))
    return sorted(root for root in found if not any(other in root.parents for other in found))


def contents(root: Path, files: Sequence[Path]) -> Contents:
    """Return the files of one controller, sorted; the modules of a task are one tuple of programs."""
    backup = Backup(root, files)
    return Contents(
        [task.files for task in backup.tasks if task.files],
        backup.others,
        backup.warnings,
        ", ".join(backup.models),
        backup.version,
    )


def stored_frames(root: Path, files: Sequence[Path]) -> StoredFrames:
    """Return the place of the robot; tools and workobjects are in the modules. Several robots may have several places.

    `read_all` gives each task the place of its own robot.
    """
    places = [robot.tf_world_base for robot in Backup(root, files).robots]
    same = places and all(np.allclose(tf, places[0], rtol=0.0, atol=_SAME_MM) for tf in places)
    return StoredFrames(in_world=True, tf_world_base=places[0] if same else None)


def read_all(
    root: Path, files: Sequence[Path], frames: FrameTable, options: ReadOptions
) -> tuple[list[Program], list[FileError]]:
    """Return the programs of one controller, one for each task with modules, and the errors of the others.

    Parameters
    ----------
    root : Path
        The folder of the controller.
    files : sequence of Path
        The files of the backup.
    frames : FrameTable
        The user's tools and bases.
    options : ReadOptions
        The options of reading. `mechanical_unit` names the robot of the map, where there are several.
    """
    backup = Backup(root, files)
    tasks = [_task(backup, task, frames, options) for task in backup.tasks if task.files]
    broken: list[FileError] = []
    programs = read_tasks(tasks, frames, options, every=True, broken=broken)

    def again(path: Path) -> Program:
        found = read_tasks(tasks, frames, options, every=True, broken=[])
        return finished(next(program for program in found if program.path == path))

    def finished(program: Program) -> Program:
        return replace(program, root=root, options=options, again=partial(again, program.path), language="rapid")

    aside = [error for program in programs for error in program.unreadable]
    return [refuse_off_scale(finished(program)) for program in programs], [*broken, *aside]


def _task(backup: Backup, task: BackupTask, frames: FrameTable, options: ReadOptions) -> TaskFiles:
    """Return a task as the reader takes it: with the place of its robot, and what is left of it."""
    kept = {path: why for path, why in task.kept.items() if not (options.system_modules and why == task.SYSTEM)}
    robot = backup.robots[0] if len(backup.robots) == 1 else task.robot
    problem = _problem(backup, task, robot, options)
    if robot is not None and not problem:
        try:
            frames = frames.standing_at(robot.tf_world_base, f"{backup.moc}: {robot.name}")
        except DataError as error:
            problem = str(error)
    return TaskFiles(task.folder, task.files, kept, task.unread, task.hidden, problem, frames)


def _problem(backup: Backup, task: BackupTask, robot: AbbRobot | None, options: ReadOptions) -> str:
    """Return why no target of a task is corrected; empty if nothing is against it."""
    if backup.robots_unknown:
        return f"{backup.robots_unknown}; correct that file, or copy it from the controller again"
    if len(backup.robots) > 1:
        names = ", ".join(f"{one.name} ({_tasks_of(backup, one)})" for one in backup.robots)
        if not options.mechanical_unit:
            return f"the controller has several robots: {names}; name that of the map (--mechanical-unit)"
        if robot is None:
            return f"which of the robots {names} the task moves is not known: backinfo.txt and SYS.cfg state it"
        if options.mechanical_unit.lower() not in {robot.name.lower(), *robot.units}:
            return f"task {task.name} moves {robot.name}, and the map is that of {options.mechanical_unit}"
    if robot is not None and robot.carrier:
        return f"the base of {robot.name} is carried by {robot.carrier}, which has no model"
    return ""


def _tasks_of(backup: Backup, robot: AbbRobot) -> str:
    names = [task.name for task in backup.tasks if task.robot is robot]
    return "task " + " and ".join(names) if names else "no task"
