"""The tasks of an ABB backup: which modules belong to each, which of them are never corrected, and why."""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Final, TypeVar

from truepose._io.files import read_bytes
from truepose.errors import FileError
from truepose.programs.languages import RAPID
from truepose.programs.rapid.controller import (
    AbbRobot,
    AbbTasks,
    BackupInformation,
    ListedTask,
    backup_information,
    configured_tasks,
    robots,
)
from truepose.programs.rapid.unreadable import is_encoded

TASK: Final = re.compile(r"TASK(\d+)", re.I)
_LISTS: Final = (".pgf", ".pgfx")
_LISTED: Final = re.compile(rb"<Module>([^<]*)</Module>", re.I)
_LOADED: Final = re.compile(
    rb"^[ \t]*(?:Start)?Load\b[^;!\r\n]*?(?:\"HOME:/?([^\"\r\n]*)\"|\bdiskhome\b)"
    rb"(?:[ \t]*\\[ \t]*File[ \t]*:=[ \t]*\"([^\"\r\n]*)\")?",
    re.I | re.M,
)
"""A module that a program loads from HOME by a name that is a constant."""
_IN_HOME: Final = re.compile(r"\(?HOME\)?:/*(.*)", re.I)
_KINDS: Final = {
    "BACKINFO": "backup information",
    "SYSPAR": "machine data",
    "CS": "safety data",
    "HOME": "other data",
    "RAPID": "other data",
}


@dataclass(eq=False)
class BackupTask:
    """A task of a backup.

    Attributes
    ----------
    folder : Path
        The folder TASKn.
    name : str
        The name of the task; that of the folder where it is not stated.
    files : tuple of Path
        The modules that can be read.
    kept : dict of Path to str
        Those that are never corrected, each with the reason.
    unread, hidden : str
        The modules that cannot be read, in words; hidden ones came with an option of the controller.
    robot : AbbRobot, optional
        The robot that it moves.
    """

    SYSTEM: ClassVar = "a system module; system modules are corrected if that is asked for (--system-modules)"

    folder: Path
    name: str
    files: tuple[Path, ...] = ()
    kept: dict[Path, str] = field(default_factory=dict)
    unread: str = ""
    hidden: str = ""
    robot: AbbRobot | None = None


_MODULES: Final = "BACKINFO/BACKINFO.TXT"
_Read = TypeVar("_Read")


class Backup:
    """The files of one controller.

    Parameters
    ----------
    root : Path
        The folder of the controller.
    files : sequence of Path
        The files of the backup.

    Attributes
    ----------
    others : dict of Path to str
        The files that hold no program of a task, with a word for each.
    warnings : list of str
        What the user must know.
    tasks : list of BackupTask
        The tasks by their number.

    Raises
    ------
    FileError
        If there are two files of one name. A configuration file that is broken is among the warnings.
    """

    def __init__(self, root: Path, files: Sequence[Path]) -> None:
        self.root = root
        self.others: dict[Path, str] = {}
        self.warnings: list[str] = []
        self._broken: dict[Path, str] = {}
        self._files = [file for file in files if root in file.parents]
        self._by_name: dict[str, Path] = {}
        for file in self._files:
            name = file.relative_to(root).as_posix().upper()
            if (other := self._by_name.setdefault(name, file)) is not file:
                raise FileError(file, f"{other} differs from it in upper and lower case only; give one of them")
        self._home_used: set[Path] = set()
        folders = {file.relative_to(root).parts[:2] for file in self._files if self._task_folder(file)}
        self.tasks = [self._task(root.joinpath(*parts)) for parts in sorted(folders, key=_number)]
        self._check_tasks()
        self._sort_others()

    @property
    def version(self) -> str:
        """The version of RobotWare; empty if it is not stated."""
        if self._information is not None and self._information.version:
            return self._information.version
        m = re.search(r'name="RobotWare"\s+version="([^"]*)"', self._system)
        return m[1] if m else ""

    @property
    def models(self) -> tuple[str, ...]:
        """The models of the robots."""
        if self._information is not None and self._information.models:
            return self._information.models
        listed = re.findall(r'<Option\s+descr="((?:IRB|CRB)\s?\d[^"]*)"', self._system)
        return tuple(listed) or tuple([robot.model for robot in self.robots if robot.model])

    @property
    def moc(self) -> Path | None:
        """The file with the robots."""
        return self._by_name.get("SYSPAR/MOC.CFG")

    @cached_property
    def robots(self) -> list[AbbRobot]:
        """The robots of the controller; none where `robots_unknown`."""
        return self._read(robots, self.moc, "where its robots stand is not known") or []

    @property
    def robots_unknown(self) -> str:
        """Why the file with the robots cannot be read; empty where it can."""
        return "" if self.robots or self.moc not in self._broken else self._broken[self.moc]

    @cached_property
    def _information(self) -> BackupInformation | None:
        path = self._by_name.get(_MODULES)
        return self._read(backup_information, path, "which modules it loads is not known")

    @cached_property
    def _configured(self) -> AbbTasks:
        path = self._by_name.get("SYSPAR/SYS.CFG")
        return self._read(configured_tasks, path, "which robot each task moves is not known") or AbbTasks({}, [])

    def _read(self, reader: Callable[[Path], _Read], path: Path | None, unknown: str) -> _Read | None:
        """Return what a file of the controller states; None where there is none, or where it is broken."""
        if path is None:
            return None
        try:
            return reader(path)
        except FileError as error:
            self._broken[path] = f"{error}; {unknown}"
            self.warnings.append(self._broken[path])
            return None

    @cached_property
    def _system(self) -> str:
        path = self._by_name.get("SYSTEM.XML")
        return read_bytes(path).decode("latin-1") if path else ""

    def _task_folder(self, file: Path) -> bool:
        parts = file.relative_to(self.root).parts
        return len(parts) > 2 and parts[0].upper() == "RAPID" and bool(TASK.fullmatch(parts[1]))

    def _task(self, folder: Path) -> BackupTask:
        listed = self._information.tasks.get(folder.name.upper()) if self._information else None
        task = BackupTask(folder, listed.name if listed else folder.name)
        unit = self._configured.units.get(task.name, "").lower()
        task.robot = next((robot for robot in self.robots if unit in robot.units), None)
        inside = {file.relative_to(folder).as_posix().upper(): file for file in self._files if folder in file.parents}
        modules = {name: file for name, file in inside.items() if file.suffix.lower() in RAPID}
        hidden = set[str]()
        if listed is not None:
            names = {module.path.upper(): module.hidden for module in listed.modules}
            hidden = {name for name, is_hidden in names.items() if is_hidden}
            for name in set(modules) - set(names):
                self.others[modules.pop(name)] = "not loaded"
            self._missing(task, listed, set(names) - set(modules))
        if (broken := self._broken.get(self._by_name.get(_MODULES, Path()))) is not None:
            self._unread(task, broken, hidden=False)
        self._program_lists(task, inside)
        self._take(task, modules, hidden)
        return task

    def _missing(self, task: BackupTask, listed: ListedTask, missing: set[str]) -> None:
        """Note the modules that backinfo.txt lists and that are not there."""
        for module in listed.modules:
            if module.path.upper() in missing:
                self._unread(task, f"module {module.path} is listed in backinfo.txt and not there", module.hidden)

    @staticmethod
    def _unread(task: BackupTask, text: str, hidden: bool) -> None:
        if hidden:
            task.hidden = task.hidden or text
        else:
            task.unread = task.unread or text

    def _program_lists(self, task: BackupTask, inside: dict[str, Path]) -> None:
        """Note the modules that a program list names and that are not beside it."""
        for file in inside.values():
            if file.suffix.lower() not in _LISTS:
                continue
            self.others[file] = "program list"
            for m in _LISTED.finditer(read_bytes(file)):
                name = html.unescape(m[1].decode("latin-1")).strip().replace("\\", "/")
                beside = (file.parent.relative_to(task.folder) / name).as_posix().upper()
                if beside not in inside:
                    self._unread(task, f"module {name} is listed in {file.name} and not there", hidden=False)

    def _take(self, task: BackupTask, modules: dict[str, Path], hidden: set[str]) -> None:
        """Sort the modules of a task's folder, and add those that it loads from HOME."""
        files = []
        for name, file in modules.items():
            if self._is_encoded(file):
                self.others[file] = "encoded"
                self._unread(task, f"module {_shown(file, task.folder)} is encoded", name in hidden)
                continue
            files.append(file)
            if name in hidden:
                task.kept[file] = "hidden: it came with an option of the controller"
            elif name.startswith("SYSMOD/"):
                task.kept[file] = task.SYSTEM
        names = {file.name.upper() for file in files}
        for file in self._from_home(task, files):
            if file.name.upper() in names:
                self._compare(file, next(one for one in files if one.name.upper() == file.name.upper()))
            elif self._is_encoded(file):
                self._unread(task, f"module {_shown(file, self.root)} is encoded", hidden=False)
            else:
                files.append(file)
                names.add(file.name.upper())
                self._home_used.add(file)
        task.files = tuple(files)

    def _from_home(self, task: BackupTask, files: Sequence[Path]) -> list[Path]:
        """Return the modules of HOME that the controller or the task itself loads."""
        wanted = [
            m[1] for module in self._configured.loaded
            if module.task.upper() in ("", task.name.upper()) and (m := _IN_HOME.fullmatch(module.file))
        ]  # fmt: skip
        for file in files:
            for loaded in _LOADED.finditer(read_bytes(file)):
                wanted.append("/".join(part.decode("latin-1").strip("/") for part in loaded.groups() if part))
        paths = [self._by_name.get(f"HOME/{name.lstrip('/')}".upper()) for name in wanted]
        return list(dict.fromkeys(path for path in paths if path and path.suffix.lower() in RAPID))

    def _compare(self, home: Path, own: Path) -> None:
        """Tell that the controller will load another text than the one in the task, when it is started anew."""
        self.others.setdefault(home, "spare copy")
        if read_bytes(home) != read_bytes(own):
            self._warn(
                f"{_shown(home, self.root)} differs from {_shown(own, self.root)}; the controller loads the former "
                "when it is started anew"
            )

    def _check_tasks(self) -> None:
        """Tell what is not known of the tasks, and keep modules that several tasks load from one file."""
        if self.tasks and self._information is None:
            self._warn("BACKINFO/backinfo.txt is not there: the names of the tasks are not known")
        for task in self.tasks:
            for text in filter(None, (task.unread, task.hidden)):
                self._warn(f"task {task.name}: {text}")
            for file in task.files:
                if sum(file in other.files for other in self.tasks) > 1:
                    task.kept[file] = "several tasks load it"
                elif file in self._home_used and file.suffix.lower() in (".sys", ".sysx"):
                    task.kept[file] = task.SYSTEM
        for robot in self.robots:
            if robot.absolute_accuracy:
                self._warn(f"{robot.name}: Absolute Accuracy seems to be active; the map must be measured with it, too")

    def _warn(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)

    def _sort_others(self) -> None:
        taken = {file for task in self.tasks for file in task.files}
        for file in self._files:
            if file in taken or file in self.others:
                continue
            top = file.relative_to(self.root).parts[0].upper()
            spare = top == "HOME" and file.suffix.lower() in RAPID
            self.others[file] = "spare copy" if spare else _KINDS.get(top, "other data")

    def _is_encoded(self, file: Path) -> bool:
        try:
            return is_encoded(read_bytes(file))
        except FileError:
            return True  # too large, or broken in its .zip


def _number(parts: tuple[str, ...]) -> int:
    m = TASK.fullmatch(parts[1])
    return int(m[1]) if m else 0


def _shown(file: Path, folder: Path) -> str:
    return file.relative_to(folder).as_posix()
