"""What every dialect's reader hands on: targets with their place, frame and use, and the controller's frames."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.geometry.transforms import check_transforms, invert_transform
from truepose.programs.core.columns import Columns, Targets
from truepose.programs.core.source import Source
from truepose.programs.core.target import Target, Verdict

if TYPE_CHECKING:
    from truepose.cell import Cell

__all__ = [
    "IDENTITY",
    "FloatArray",
    "FrameTable",
    "Key",
    "Program",
    "ReadOptions",
    "Target",
    "Targets",
    "Verdict",
    "frame_key",
    "linked",
]
Key = int | str
"""Of a tool or base: controllers number them or name them."""
_SAME_MM: Final = 1e-3
IDENTITY: Final = np.eye(4)
IDENTITY.flags.writeable = False


@dataclass(frozen=True)
class ReadOptions:
    """What a user may allow although the reader would refuse it.

    Attributes
    ----------
    ambiguous : {"refuse", "skip"}
        What happens to a point that is both moved to and read by arithmetic, or used under several frames or tools.
    calls_keep_frames : bool
        Subprograms in other files leave tool and base as they are. By default what is in force after one is unknown.
    absolute_accuracy : bool
        Correct targets taught on an absolutely accurate robot (KUKA Status bit 4): only if that option is off now.
    external_axes : bool
        Correct targets with an external axis away from zero: only if it moves neither the robot nor the base.
    offsets : bool
        Correct points that are also moved to with a constant offset: one correction for both.
    angles : str
        Whose angles A, B, C are in G-code ("kuka", "fanuc", "staubli", "yaskawa"); how the tool axis i, j, k of APT
        lies: "z" along the tool's z, "-z" against it.
    orientation : bool
        Orientations are to be corrected, too: targets whose orientation stands in another line are left out.
    whole_task : bool
        A file that is read by itself is the whole task (RAPID), project (KRL) or application (VAL3): no other file
        uses its points.
    """

    ambiguous: Literal["refuse", "skip"] = "refuse"
    calls_keep_frames: bool = False
    absolute_accuracy: bool = False
    external_axes: bool = False
    offsets: bool = False
    angles: str = ""
    orientation: bool = False
    whole_task: bool = False


@dataclass(frozen=True, eq=False)
class FrameTable:
    """The controller's tools and bases, by number or by name. Number 0 is the null frame on every controller.

    Parameters
    ----------
    tools : mapping of int or str to (4, 4) array [mm]
        Flange to tool.
    bases : mapping of int or str to (4, 4) array [mm]
        Robot base to the frame that targets are given in. Number 0 is the controller's world.
    tool, base : int or str, optional
        In force where a program sets none.
    in_world : set of int or str
        The bases that are given in the controller's world instead, as ``$config.dat`` has them.
    tf_world_base : (4, 4) array [mm], optional
        Where the robot stands in that world, once it is known; see `standing_at`.

    Raises
    ------
    DataError
        If a frame is not a rigid transform, or the one in force is not among those given.

    Examples
    --------
    >>> import numpy as np
    >>> sorted(FrameTable(tools={3: np.eye(4)}).tools)
    [0, 3]
    """

    tools: Mapping[Key, FloatArray] = field(default_factory=dict)
    bases: Mapping[Key, FloatArray] = field(default_factory=dict)
    tool: Key | None = None
    base: Key | None = None
    in_world: frozenset[Key] = frozenset()
    tf_world_base: FloatArray | None = None

    def __post_init__(self) -> None:
        for kind in ("tools", "bases"):
            given = {frame_key(n): check_transforms(f"{kind} {n}", tf) for n, tf in getattr(self, kind).items()}
            object.__setattr__(self, kind, {0: IDENTITY, **given})
        for which, kind in (("tool", "tools"), ("base", "bases")):
            if (given_default := getattr(self, which)) is None:
                continue
            key = frame_key(given_default)
            if key not in (known := getattr(self, kind)):
                shown = ", ".join(map(str, known))
                raise DataError(f"{which} {key} is not among those given ({shown}); give it in [frames.{kind}.{key}]")
            object.__setattr__(self, which, key)

    @classmethod
    def from_config_dat(cls, path: str | Path) -> Self:
        """Return the tools and bases of a KUKA ``$config.dat``; see `truepose.programs.krl.config.read_config_dat`."""
        from truepose.programs.krl.config import read_config_dat

        tools, bases = read_config_dat(path)
        return cls(tools, bases, in_world=frozenset(bases))

    @classmethod
    def from_cell(
        cls, cell: Cell, config_dat: str | Path | None = None, tool: Key | None = None, base: Key | None = None
    ) -> Self:
        """Return the frames that a cell file gives, those of its ``$config.dat`` included; the cell file's own win.

        Parameters
        ----------
        cell : Cell
        config_dat : str or Path, optional
            Another ``$config.dat``, which wins over that of the cell.
        tool, base : int or str, optional
            In force where a program sets none.
        """
        known = [cls.from_config_dat(path) for path in (cell.config_dat, config_dat) if path is not None]
        tools = {key: tf for table in known for key, tf in table.tools.items()}
        bases = {key: tf for table in known for key, tf in table.bases.items()}
        own = {frame_key(key): tf for key, tf in cell.bases.items()}
        in_world = frozenset(key for table in known for key in table.in_world) - own.keys()
        table = cls({**tools, **cell.tools}, {**bases, **own}, tool, base, in_world)
        return table.standing_at(invert_transform(own[0]), "[frames.bases.0] of the cell file") if 0 in own else table

    def standing_at(self, tf_world_base: FloatArray, where: str) -> Self:
        """Return the frames as seen from a robot that stands somewhere in its controller's world.

        Base 0, which is the world, and the bases that are given in it change; those of a cell file do not.

        Parameters
        ----------
        tf_world_base : (4, 4) array [mm]
        where : str
            Who says so; for messages.

        Raises
        ------
        DataError
            If another place is known already.
        """
        if self.tf_world_base is not None:
            if not np.allclose(self.tf_world_base, tf_world_base, rtol=0.0, atol=_SAME_MM):
                known, new = (
                    ", ".join(f"{x:g}" for x in tf[:3, 3].round(3) + 0.0) for tf in (self.tf_world_base, tf_world_base)
                )
                raise DataError(
                    f"{where}: the robot stands at ({new}) mm in its controller's world or is turned there, but "
                    f"({known}) mm was said before; make them agree ([frames.bases.0] of the cell file is the world as "
                    "seen from the robot)"
                )
            return self
        tf_base_world = invert_transform(check_transforms(where, tf_world_base))
        bases = {key: tf_base_world @ tf if key in self.in_world else tf for key, tf in self.bases.items()}
        return replace(self, bases={**bases, 0: tf_base_world}, in_world=frozenset(), tf_world_base=tf_world_base)


@dataclass(frozen=True, eq=False)
class Program:
    """A program as its dialect's reader understood it.

    Attributes
    ----------
    path : Path
        As the user named it.
    sources : tuple of Source
        Every file of it.
    targets : Targets
        In the order of the text, file by file.
    circles : tuple of tuple of int
        Indices of targets that are corrected together or not at all.
    lexer : compiled pattern
        Of the dialect, for the proof.
    finest : float [mm]
        The controller keeps no smaller step.
    root : Path, optional
        The folder that was named; without it, that of the file.
    options : ReadOptions, optional
        The options that it was read with.
    again : callable, optional
        Reads the program once more, with the same frames and options, for the proof.
    """

    path: Path
    sources: tuple[Source, ...]
    targets: Targets
    circles: tuple[tuple[int, ...], ...]
    lexer: re.Pattern[bytes]
    finest: float = 0.0
    root: Path | None = None
    options: ReadOptions | None = None
    again: Callable[[], Program] | None = None

    @property
    def folder(self) -> Path:
        """The folder that its files lie under."""
        return self.path.parent if self.root is None else self.root

    def names(self) -> list[Path]:
        """Return its files as seen from `folder`."""
        return [source.path.relative_to(self.folder) for source in self.sources]

    def correctable(self) -> IntArray:
        """Return the indices of the targets whose verdict is ``correct``."""
        return np.flatnonzero(self.targets.verdicts() == 0)

    @property
    def width(self) -> int:
        """How many numbers a target has: three of its position and those of its orientation."""
        return next((columns.values.shape[1] for _, columns in self.targets.chunks()), 6)

    def counts(self) -> dict[Verdict, int]:
        """Return how many targets have each verdict."""
        verdicts = self.targets.verdicts()
        correct, skip, refuse = (int(np.count_nonzero(verdicts == k)) for k in range(3))
        return {"correct": correct, "skip": skip, "refuse": refuse}

    def correctable_columns(self) -> Iterator[tuple[IntArray, Columns]]:
        """Yield the correctable targets some thousand at a time, with their indices."""
        for first, columns in self.targets.chunks():
            rows = np.flatnonzero(columns.verdict == "correct")
            if len(rows):
                yield first + rows, columns.take(rows)

    def poses_base(self) -> FloatArray:
        """Return the poses of the correctable targets, base to tool, (n, 4, 4) [mm]."""
        poses = [columns.poses_base() for _, columns in self.correctable_columns()]
        return np.concatenate(poses) if poses else np.empty((0, 4, 4))

    def positions_base(self) -> FloatArray:
        """Return the positions of the correctable targets, (n, 3) [mm], base frame."""
        return self.poses_base()[:, :3, 3]

    def tools(self, measured: FloatArray = IDENTITY) -> FloatArray:
        """Return the tools of the correctable targets, flange to tool, (n, 4, 4) [mm].

        `measured`, (4, 4) [mm], stands where the program names none.
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
        Targets that are corrected together or not at all.
    left_out : iterable of int
        Targets that are not corrected.
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
