"""What a maker's module finds in a backup: controllers, their programs, and the tools and bases that they store.

Each maker's module has three functions; docs/programs.md says what each format is taken from.

- ``roots(files)`` returns the folders of the controllers among the files of a backup.
- ``contents(root, files)`` sorts the files of one controller into programs and others.
- ``stored_frames(root, files)`` returns the tools and bases that the controller stores outside of programs.

Where the language's reader needs more of the backup than frames, such as position variables or pulse constants, the
module has a fourth one. ``for_reader(root, files)`` returns that as keyword arguments of the reader's ``read``
(``read_project`` of KRL), the same for every program of the controller.

Where the programs of a controller are judged together (the tasks of ABB, which share PERS data and may move several
robots), the module has ``read_all(root, files, frames, options)``. It returns the programs, complete with the function
that reads them again, and the errors of those that cannot be read, and takes the place of the reader's ``read``.
`frames` are those of the user; the function adds what the backup stores.

`files` are all regular files of the backup, in order; `roots` may be called with those of any folder, and returns
nothing where the folder is no backup of the maker. File names are compared without regard to case.

A file may lie in a .zip, and then has a path that leads into it: ``backup.zip/KRC/R1/Program/a.src``. So the modules
read files with `Source.read` or `truepose._io.files.read_bytes`, which follow such a path, and never with the methods
of `Path`; what exists, `files` says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from truepose._typing import FloatArray
from truepose.programs.core.program import Key


class StoredFrame(NamedTuple):
    """A tool or base as a controller stores it.

    Attributes
    ----------
    tf : (4, 4) array [mm]
        The transform from the flange to a tool, or to a base from the robot's base; see `StoredFrames.in_world`.
    name : str
        The name that the operator gave it.
    place : str
        The file and line, such as ``SYSFRAME.VA, line 12``.
    problem : str
        The reason why no target can be corrected in it, such as a base that moves; empty where there is none.
    of_held_part : bool, optional
        Whether it is a part in the gripper or, of a base, a tool that stands; None where the controller does not say.
    """

    tf: FloatArray
    name: str = ""
    place: str = ""
    problem: str = ""
    of_held_part: bool | None = None


@dataclass(frozen=True, eq=False)
class StoredFrames:
    """The tools and bases that a controller stores outside of its programs.

    Attributes
    ----------
    tools, bases : mapping of int or str to StoredFrame
        The frames by number or name. Those that are not set are left out.
    in_world : bool
        Whether the bases are given in the controller's world, not in the robot's base.
    tf_world_base : (4, 4) array [mm], optional
        The transform from that world to the robot's base; None where the backup does not state it.
    """

    tools: Mapping[Key, StoredFrame] = field(default_factory=dict)
    bases: Mapping[Key, StoredFrame] = field(default_factory=dict)
    in_world: bool = False
    tf_world_base: FloatArray | None = None


@dataclass(frozen=True)
class Contents:
    """The files of one controller.

    Attributes
    ----------
    programs : sequence of tuple of Path
        Files with programs; those of one tuple share their data, and one reader judges them together.
    others : mapping of Path to str
        The files that hold no program, such as logs, with a word for each: "log", "encoded", "machine data".
    warnings : sequence of str
        What the user must know, such as programs that are there in a form that cannot be read.
    robot, version : str
        The robot and the version of the controller's software, as the backup names them; empty where it does not.
    serial : str
        The serial number of the robot, if the backup names one.
    """

    programs: Sequence[tuple[Path, ...]]
    others: Mapping[Path, str] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    robot: str = ""
    version: str = ""
    serial: str = ""


class BackupFormat(Protocol):
    """The functions of a maker's module."""

    def roots(self, files: Sequence[Path]) -> list[Path]:
        """Return the folders of the controllers among the files of a backup."""

    def contents(self, root: Path, files: Sequence[Path]) -> Contents:
        """Return the files of one controller, sorted; a FileError names a file that cannot be understood."""

    def stored_frames(self, root: Path, files: Sequence[Path]) -> StoredFrames:
        """Return the tools and bases of one controller; a FileError names the file and line that is broken."""


FORMATS: Final = {
    "KUKA": "truepose.programs.backups.kuka",
    "ABB": "truepose.programs.backups.abb",
    "FANUC": "truepose.programs.backups.fanuc",
    "Yaskawa": "truepose.programs.backups.yaskawa",
    "Universal Robots": "truepose.programs.backups.universal_robots",
    "Stäubli": "truepose.programs.backups.staubli",
}
"""The module of each maker."""
