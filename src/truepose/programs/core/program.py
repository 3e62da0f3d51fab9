"""A program as a reader understood it, the options of reading, and the frames that readers use."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, Protocol

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.programs.core.columns import Columns, Targets
from truepose.programs.core.source import Source
from truepose.programs.core.target import Verdict

Key = int | str
"""The number or name of a tool or base."""
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
