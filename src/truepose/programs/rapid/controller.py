"""ABB's configuration files: robots and their base frames (MOC.cfg), tasks and what they load (SYS.cfg).

Lengths are in metres, orientations are quaternions. Keys that have their default are left out of the files.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from truepose._typing import FloatArray
from truepose.errors import DataError, FileError
from truepose.geometry import euler, make_transform
from truepose.programs.core.source import Source, parse_number

_M: Final = 1000.0  # the files are in metres
_HEAD: Final = re.compile(r"[A-Z]+:CFG_[\d.]+:")
_SECTION: Final = re.compile(r"(\w+):\s*")
_CONTINUED: Final = re.compile(r"\\[ \t]*\Z")
_VALUE: Final = re.compile(r"\s*-([A-Za-z]\w*)(?:\s+(\"[^\"]*\"|[^\s\"-][^\s\"]*|-[\d.][^\s\"]*))?(?=\s|\Z)")


_LISTED: Final = re.compile(r">>(\w+):(.*)")
_MODEL: Final = re.compile(r"(?:IRB|CRB)\s?\d")


class Record(NamedTuple):
    """A record of a configuration file: its values by key in lower case, and its line."""

    values: Mapping[str, str]
    line: int

    def get(self, key: str, default: str = "") -> str:
        """Return a value; a flag has an empty one."""
        return self.values.get(key, default)


class Configuration:
    """The sections of a configuration file.

    Parameters
    ----------
    path : Path
        The path of the file.

    Raises
    ------
    FileError
        If it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._source = Source.read(path)
        self._sections: dict[str, list[tuple[int, list[str]]]] = {}
        wanted: list[tuple[int, list[str]]] | None = None
        open_record = goes_on = False
        for line, start, end in self._source.lines():
            text = self._source.data[start:end].decode("latin-1")
            if not goes_on and text.startswith("#"):
                wanted = None
            elif not goes_on and (m := _SECTION.fullmatch(text)) and not _HEAD.match(text):
                wanted, open_record = self._sections.setdefault(m[1].upper(), []), False
            elif wanted is None:
                pass
            elif not text.strip():
                open_record = False
            else:
                if not open_record:
                    wanted.append((line, []))
                wanted[-1][1].append(_CONTINUED.sub("", text))
                open_record = True
            goes_on = bool(_CONTINUED.search(text))

    @property
    def path(self) -> Path:
        """The path of the file."""
        return self._source.path

    def records(self, section: str) -> list[Record]:
        """Return the records of a section; a FileError names the line of one that is broken."""
        return [self._record(line, texts) for line, texts in self._sections.get(section.upper(), [])]

    def error(self, record: Record, message: str) -> FileError:
        """Return an error about a record."""
        return self._source.error(record.line, message)

    def _record(self, line: int, texts: Iterable[str]) -> Record:
        values: dict[str, str] = {}
        text, position = " ".join(texts).rstrip(), 0
        while position < len(text):
            m = _VALUE.match(text, position)
            if m is None:
                raise self._source.error(line, f"is not understood: {text[position:].strip()[:40]}; correct the file")
            key = m[1].lower()
            if key in values:
                raise self._source.error(line, f"gives -{m[1]} twice; keep one")
            values[key] = (m[2] or "").strip('"')
            position = m.end()
        return Record(values, line)


@dataclass(frozen=True, eq=False)
class AbbRobot:
    """A robot of a controller.

    Attributes
    ----------
    name : str
        The name in the configuration.
    tf_world_base : (4, 4) array [mm]
        The transform from the controller's world to the robot's base.
    carrier : str
        The mechanical unit that carries the robot, such as a track; empty where it stands.
    model : str
        The type as the configuration names it.
    absolute_accuracy : bool
        Whether the controller corrects the robot with a calibrated model of its own.
    units : frozenset of str
        The names of the mechanical units that are this robot, in lower case.
    """

    name: str
    tf_world_base: FloatArray
    carrier: str = ""
    model: str = ""
    absolute_accuracy: bool = False
    units: frozenset[str] = frozenset()


def robots(path: Path) -> list[AbbRobot]:
    """Return the robots of a MOC.cfg; a FileError names the line of a number that is broken."""
    configuration = Configuration(path)
    calibrated = any(
        key.startswith(("error_offset", "error_roll"))
        for record in configuration.records("ARM_CALIB")
        for key in record.values
    )
    units = [(r.get("use_robot").lower(), r.get("name").lower()) for r in configuration.records("MECHANICAL_UNIT")]
    found: list[AbbRobot] = []
    for record in configuration.records("ROBOT"):
        name = record.get("name") or f"robot {len(found) + 1}"
        calibration = record.get("use_robot_calib").lower()
        active = calibrated and calibration.endswith("_calib") and not calibration.endswith("_uncalib")
        tf = _base_frame(configuration, record, name)
        carrier, model = record.get("base_frame_coordinated"), record.get("use_robot_type")
        named = frozenset(unit for robot, unit in units if robot == name.lower()) or frozenset([name.lower()])
        found.append(AbbRobot(name, tf, carrier, model, active, named))
    return found


def _base_frame(configuration: Configuration, record: Record, name: str) -> FloatArray:
    def number(key: str, default: float) -> float:
        try:
            return parse_number(record.values[key].encode("latin-1")) if key in record.values else default
        except ValueError as error:
            raise configuration.error(record, f"{name}: {key}: {error}") from None

    p = [_M * number(f"base_frame_pos_{axis}", 0.0) for axis in "xyz"]
    quaternion = [number(f"base_frame_orient_u{k}", float(k == 0)) for k in range(4)]
    try:
        return make_transform(euler("abb", quaternion), p)
    except DataError as error:
        raise configuration.error(record, f"{name}: base_frame_orient: {error}") from None


class LoadedModule(NamedTuple):
    """A module that the controller loads when it starts; `task` is empty where every task has it."""

    file: str
    module: str
    task: str


@dataclass(frozen=True)
class AbbTasks:
    """The tasks of a SYS.cfg.

    Attributes
    ----------
    units : dict of str to str
        The mechanical unit that each task moves; empty where it moves none.
    loaded : list of LoadedModule
        The modules that are loaded at the start.
    """

    units: Mapping[str, str]
    loaded: list[LoadedModule]


def configured_tasks(path: Path) -> AbbTasks:
    """Return the tasks of a SYS.cfg; a FileError names a line that is broken."""
    configuration = Configuration(path)
    groups = {r.get("name").lower(): r.get("robot") for r in configuration.records("MECHANICAL_UNIT_GROUP")}
    units = {}
    for record in configuration.records("CAB_TASKS"):
        group = record.get("usemechanicalunitgroup")
        if group and group.lower() not in groups:
            raise configuration.error(record, f"names the mechanical unit group {group}, which is not there")
        units[record.get("name")] = groups.get(group.lower(), "")
    loaded = [
        LoadedModule(record.get("file"), record.get("modname"), record.get("task"))
        for record in configuration.records("CAB_TASK_MODULES")
        if record.get("file") and "install" not in record.values
    ]
    return AbbTasks(units, loaded)


class ListedModule(NamedTuple):
    """A module that backinfo.txt lists, by its path in the task's folder; hidden ones came with an option."""

    path: str
    hidden: bool


class ListedTask(NamedTuple):
    """A task as backinfo.txt lists it."""

    name: str
    program: str
    modules: tuple[ListedModule, ...]


@dataclass(frozen=True)
class BackupInformation:
    """What backinfo.txt states: the version, the models of the robots, and the tasks by their folder in upper case."""

    version: str
    models: tuple[str, ...]
    tasks: Mapping[str, ListedTask]


def backup_information(path: Path) -> BackupInformation:
    """Return what a backinfo.txt states; a FileError names a line that is broken."""
    source = Source.read(path)
    version, models, section = "", list[str](), ""
    tasks: dict[str, ListedTask] = {}
    for line, start, end in source.lines():
        text = source.data[start:end].decode("latin-1").strip()
        if m := _LISTED.fullmatch(text):
            section = m[1].upper()
            if task := re.fullmatch(r"\(([^,()]*)(?:,([^,()]*))?.*\)", m[2].strip()):
                if section in tasks:
                    raise source.error(line, f"lists {section} twice; give the backup of one controller")
                tasks[section] = ListedTask(task[1].strip(), (task[2] or "").strip(), ())
        elif section == "PRODUCTS_ID":
            version = version or (text.partition(":")[2].strip() if text.startswith("RobotWare Version") else "")
            models += [text] if _MODEL.match(text) else []
        elif section in tasks and text:
            name, mark, flags = text.partition("@")
            if not mark:
                raise source.error(line, f"lists {text[:40]!r} without an @; make the backup again")
            module = ListedModule(name.strip().replace("\\", "/"), "HIDDEN" in flags.upper())
            tasks[section] = tasks[section]._replace(modules=(*tasks[section].modules, module))
    return BackupInformation(version, tuple(models), tasks)
