"""A program as a reader understood it, the options of reading, and the frames that readers use."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, Protocol, Self

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import DataError, FileError
from truepose.programs.core.blending import blended
from truepose.programs.core.columns import ProgramTargets, TargetColumns
from truepose.programs.core.source import Source
from truepose.programs.core.target import Verdict

Key = int | str
"""The number or name of a tool or base."""
IDENTITY: Final = np.eye(4)
IDENTITY.flags.writeable = False


_TOLERANCE: Final = re.compile(r"\s*([0-9.]{1,12})\s*mm\s*(?:[,;]\s*([0-9.]{1,12})\s*(?:deg|°)\s*)?")


class FrameTolerance(NamedTuple):
    """How far a frame that a program sets at run time may lie from its stored value, along and about each axis.

    Attributes
    ----------
    mm : float [mm]
        Along each axis.
    deg : float [deg]
        About each axis.
    """

    mm: float
    deg: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the tolerance that a text such as ``"5mm"`` or ``"5mm,0.5deg"`` states.

        Raises
        ------
        DataError
            If it states none.

        Examples
        --------
        >>> FrameTolerance.parse("5mm,0.5deg")
        FrameTolerance(mm=5.0, deg=0.5)
        """
        try:
            if (m := _TOLERANCE.fullmatch(text)) is None:
                raise ValueError
            found = cls(float(m[1]), float(m[2] or 0.0))
        except ValueError:
            raise DataError(f'expected a tolerance such as "5mm" or "5mm,0.5deg", got {text!r}') from None
        return found.checked()

    def checked(self) -> Self:
        """Return the tolerance if it is one; a DataError says what is wrong with it."""
        if not (0.0 < self.mm <= 1000.0 and 0.0 <= self.deg <= 45.0):
            raise DataError(f"a tolerance of {self.mm:g} mm and {self.deg:g}° is none; expected up to 1000 mm and 45°")
        return self

    def holds(self, stored: FloatArray, tf: FloatArray) -> bool:
        """Return whether a frame is within the tolerance of the stored one, (4, 4) arrays [mm]."""
        deviation = np.linalg.inv(stored) @ tf
        turn = Rotation.from_matrix(deviation[:3, :3]).as_rotvec(degrees=True)
        return bool((np.abs(deviation[:3, 3]) <= self.mm).all() and (np.abs(turn) <= self.deg + 1e-6).all())


@dataclass(frozen=True)
class ReadOptions:
    """Facts about a program that only the user knows, and that the readers do not assume.

    Attributes
    ----------
    ambiguous : {"refuse", "skip"}
        The verdict on a point that is moved to and also read by arithmetic, or used under several frames or tools.
    calls_keep_frames : bool
        Whether subprograms in other files leave tool and base unchanged. By default both are unknown after a call.
    absolute_accuracy : bool
        Whether to correct targets taught on an absolutely accurate robot (KUKA Status bit 4). Allow it only if that
        option of the controller is off now.
    external_axes : bool
        Whether to correct targets with an external axis away from zero. Allow it only if the axis moves neither the
        robot nor the base.
    offsets : bool
        As `derived`, for RAPID alone.
    derived : bool
        Whether to correct points from which the program derives others by constant shifts; all get one correction, if
        the map says that theirs differ by less than ``max_difference_mm``.
    frame_tolerance : FrameTolerance, optional
        How far a frame that the program sets at run time may lie from its stored value. Its targets are corrected with
        the stored value, if the map says that corrections differ by less than ``max_difference_mm`` over the tolerance.
    tool_tolerance : FrameTolerance, optional
        The same for a tool that the program sets at run time.
    angles : str
        The convention of the angles A, B, C in G-code ("kuka", "fanuc", "staubli", "yaskawa"), of the angles in a
        table ("yaskawa", "staubli"), or of the tool axis i, j, k in APT: "z" along the tool's z, "-z" against it.
    orientation : bool
        Whether orientations are corrected, too. Targets whose orientation is written in another line are left out.
    joint_targets : bool
        Whether to correct joint targets: forward with the arm of the map, corrected, and back to the nearest joints.
    controller_kinematics : bool
        Whether the map was measured with commands of the controller that the program is for, whose own arm model may
        differ from the map's robot (Universal Robots, .urp; Yaskawa, positions in pulses).
    whole_task : bool
        Whether a file that is read alone is the whole task (RAPID), project (KRL) or application (VAL3), so that no
        other file uses its points.
    system_modules : bool
        Whether system modules of a controller's backup are corrected, too (ABB, SYSMOD).
    mechanical_unit : str
        The mechanical unit of the map's robot, where the backup of a controller has several robots (ABB).

    Examples
    --------
    >>> ReadOptions(calls_keep_frames=True).ambiguous
    'refuse'
    """

    ambiguous: Literal["refuse", "skip"] = "refuse"
    calls_keep_frames: bool = False
    absolute_accuracy: bool = False
    external_axes: bool = False
    offsets: bool = False
    derived: bool = False
    frame_tolerance: FrameTolerance | None = None
    tool_tolerance: FrameTolerance | None = None
    angles: str = ""
    orientation: bool = False
    joint_targets: bool = False
    controller_kinematics: bool = False
    whole_task: bool = False
    system_modules: bool = False
    mechanical_unit: str = ""

    def __post_init__(self) -> None:
        for tolerance in (self.frame_tolerance, self.tool_tolerance):
            if tolerance is not None:
                tolerance.checked()


class MotionGroups(NamedTuple):
    """Motion groups of a controller that moves several robots or positioners (FANUC).

    Attributes
    ----------
    robot : int
        The group of the robot that the map belongs to.
    independent : frozenset of int
        The groups that carry neither this robot nor a user frame of its targets.
    """

    robot: int = 1
    independent: frozenset[int] = frozenset()


MEASURED_TOOL: Final = "map"
"""The name by which the user states that the tool in force is the one that the map was measured with."""


class KnownFrames(Protocol):
    """The controller's tools and bases as readers use them; see `truepose.FrameTable`."""

    @property
    def tools(self) -> Mapping[Key, FloatArray]:
        """Transforms from flange to tool, (4, 4) [mm], by number or name."""

    @property
    def bases(self) -> Mapping[Key, FloatArray]:
        """Transforms from the robot's base to each frame, (4, 4) [mm], by number or name; 0 is the world."""

    @property
    def tool(self) -> Key | None:
        """The tool in force where a program sets none."""

    @property
    def base(self) -> Key | None:
        """The base in force where a program sets none."""

    @property
    def groups(self) -> MotionGroups:
        """The motion groups."""

    @property
    def of_held_parts(self) -> Mapping[tuple[str, Key], bool]:
        """Whether a "tool" is a part in the gripper, or a "base" a tool that stands, where the controller says it."""

    @property
    def problems(self) -> Mapping[tuple[str, Key], str]:
        """The reasons why a "tool" or "base" of some number or name cannot be used, although the controller has it."""


@dataclass(frozen=True, eq=False, repr=False)
class Program:
    """A robot program and its targets, as the reader of its language understood it.

    Attributes
    ----------
    path : Path
        The path as the user gave it.
    sources : tuple of Source
        The files of the program.
    targets : ProgramTargets
        The targets in the order of the text, file by file.
    circles : tuple of tuple of int
        Indices of targets that are corrected together or not at all.
    lexer : compiled pattern
        The words of the language, for the proof.
    finest : float [mm]
        The smallest step of a position that the controller keeps.
    root : Path, optional
        The folder that the user gave; without it, that of the file.
    options : ReadOptions, optional
        The options that it was read with.
    again : callable, optional
        A function that reads the program once more, with the same frames and options, for the proof.
    language : str
        The name of the language's reader, such as "krl".
    place : Path
        The folder of its results within the output folder, if the user gave several folders.
    unreadable : tuple of FileError
        The errors of modules of a project that cannot be read and are left out.
    controller : Path, optional
        The folder of its controller, if the user gave a backup of one; `root` is then that backup.
    """

    path: Path
    sources: tuple[Source, ...]
    targets: ProgramTargets
    circles: tuple[tuple[int, ...], ...]
    lexer: re.Pattern[bytes]
    finest: float = 0.0
    root: Path | None = None
    options: ReadOptions | None = None
    again: Callable[[], Program] | None = None
    language: str = ""
    place: Path = Path()
    unreadable: tuple[FileError, ...] = ()
    controller: Path | None = None

    def __repr__(self) -> str:
        counts = ", ".join(f"{n} {verdict}" for verdict, n in self.counts().items())
        return f"<Program {self.path} ({self.language or 'unknown language'}): {len(self.targets)} targets: {counts}>"

    def to_dict(self) -> dict[str, Any]:
        """Return the path, the language, the counts and the targets with their verdicts, for JSON."""
        found: dict[str, Any] = {"file": str(self.path), "language": self.language, "blended": self.blended}
        found |= {str(verdict): n for verdict, n in self.counts().items()} | {"following": self.following}
        return {**found, "targets": [target.to_dict() for target in self.targets]}

    @property
    def blended(self) -> dict[str, int]:
        """The numbers of blended motions by the word that says so; see `truepose.programs.core.blending`."""
        return blended(self.language, self.sources)

    @property
    def folder(self) -> Path:
        """The folder of its files."""
        return self.path.parent if self.root is None else self.root

    def names(self) -> list[Path]:
        """Return its files as seen from `folder`."""
        return [source.path.relative_to(self.folder) for source in self.sources]

    def correctable(self) -> IntArray:
        """Return the indices of the targets with a pose whose verdict is ``correct``; not those of joint targets."""
        rows = [rows for rows, _ in self.correctable_columns()]
        return np.concatenate(rows) if rows else np.empty(0, np.int64)

    @property
    def width(self) -> int:
        """The number of values of a target: three of its position and those of its orientation."""
        return next((columns.values.shape[1] for _, columns in self.targets.chunks()), 6)

    def counts(self) -> dict[Verdict, int]:
        """Return the number of targets with each verdict."""
        verdicts = self.targets.verdicts()
        correct, skip, refuse = (int(np.count_nonzero(verdicts == k)) for k in range(3))
        return {"correct": correct, "skip": skip, "refuse": refuse}

    def allowed(self) -> BoolArray:
        """Return whether each target can be corrected, or follows others that all can be, (n,)."""
        found: BoolArray = self.targets.verdicts() == 0
        for i, follow in self.targets.follows.items():
            found[i] = all(found[j] for j in follow.sources)
        return found

    @property
    def following(self) -> int:
        """The number of targets without numbers of their own that follow corrected ones; `counts` has them as skip."""
        return int(np.count_nonzero(self.allowed() & (self.targets.verdicts() != 0)))

    def correctable_columns(self) -> Iterator[tuple[IntArray, TargetColumns]]:
        """Yield the correctable targets with a pose some thousand at a time, with their indices."""
        for first, columns in self.targets.chunks():
            rows = np.flatnonzero((columns.verdict == "correct") & ~columns.commands_joints)
            if len(rows):
                yield first + rows, columns.take(rows)

    def joint_columns(self) -> Iterator[tuple[IntArray, TargetColumns]]:
        """Yield the correctable joint targets some thousand at a time, with their indices."""
        for first, columns in self.targets.chunks() if self.targets.corrects_joints else ():
            rows = np.flatnonzero((columns.verdict == "correct") & columns.commands_joints)
            if len(rows):
                yield first + rows, columns.take(rows)

    @property
    def modules(self) -> dict[Path, list[int]]:
        """The rows of each module with targets, by its first file; a .src and its .dat are one module."""
        first = {source.path.with_suffix(""): source.path for source in reversed(self.sources)}
        found: dict[Path, list[int]] = {}
        for k, columns in self.targets.chunks():
            found.setdefault(first[columns.path.with_suffix("")], []).extend(range(k, k + len(columns)))
        return found

    def poses_base(self) -> FloatArray:
        """Return the poses of the correctable targets, base to tool, (n, 4, 4) [mm]."""
        poses = [columns.poses_base() for _, columns in self.correctable_columns()]
        return np.concatenate(poses) if poses else np.empty((0, 4, 4))

    def positions_base(self) -> FloatArray:
        """Return the positions of the correctable targets, (n, 3) [mm], base frame."""
        return self.poses_base()[:, :3, 3]

    def tools(self, measured: FloatArray = IDENTITY) -> FloatArray:
        """Return the tools of the correctable targets, flange to tool, (n, 4, 4) [mm].

        `measured`, (4, 4) [mm], is the tool of targets that name none.
        """
        tools = [columns.tf_flange_tool(measured) for _, columns in self.correctable_columns()]
        return np.concatenate(tools) if tools else np.empty((0, 4, 4))


def frame_key(key: Key) -> Key:
    """Return a number or a name as tables hold it: ``"3"`` is number 3, names are folded to lower case."""
    text = str(key).strip()
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 6 else text.lower()


def linked(circles: Sequence[tuple[int, ...]], left_out: Iterable[int]) -> dict[int, int]:
    """Return the targets that cannot be corrected because another of their circle is not, each with that other.

    Parameters
    ----------
    circles : sequence of tuple of int
        ProgramTargets that are corrected together or not at all.
    left_out : iterable of int
        ProgramTargets that are not corrected.
    """
    members: dict[int, list[tuple[int, ...]]] = {}
    for circle in circles:
        for i in circle:
            members.setdefault(i, []).append(circle)
    waiting, cause = [i for i in left_out if i in members], {}
    out = set(waiting)
    while waiting:
        i = waiting.pop()
        for circle in members[i]:
            for j in circle:
                if j not in out:
                    out.add(j)
                    cause[j] = i
                    waiting.append(j)
    return cause
