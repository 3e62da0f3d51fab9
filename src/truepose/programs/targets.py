"""What every dialect's reader hands on: targets with their place, frame and use, and the controller's frames."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.errors import DataError
from truepose.geometry import euler, make_transform
from truepose.geometry.transforms import check_transforms
from truepose.programs.source import Source, Span

if TYPE_CHECKING:
    from truepose.cell import Cell

FloatArray = NDArray[np.float64]
Verdict = Literal["correct", "skip", "refuse"]
Key = int | str
"""Of a tool or base: controllers number them or name them."""
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
    """

    ambiguous: Literal["refuse", "skip"] = "refuse"
    calls_keep_frames: bool = False
    absolute_accuracy: bool = False
    external_axes: bool = False
    offsets: bool = False
    angles: str = ""


@dataclass(frozen=True, eq=False)
class FrameTable:
    """The controller's tools and bases, by number or by name. Number 0 is the null frame on every controller.

    Parameters
    ----------
    tools : mapping of int or str to (4, 4) array [mm]
        Flange to tool.
    bases : mapping of int or str to (4, 4) array [mm]
        Robot base to the frame that targets are given in.
    tool, base : int or str, optional
        In force where a program sets none.

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
        """Return the tools and bases of a KUKA ``$config.dat``; see `truepose.programs.krl_config.read_config_dat`."""
        from truepose.programs.krl_config import read_config_dat

        return cls(*read_config_dat(path))

    @classmethod
    def from_cell(cls, cell: Cell) -> Self:
        """Return the frames that a cell file gives, those of its ``$config.dat`` included; the cell file's own win."""
        known = cls() if cell.config_dat is None else cls.from_config_dat(cell.config_dat)
        return cls({**known.tools, **cell.tools}, {**known.bases, **cell.bases})


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A target of a program, or a motion whose target cannot be corrected.

    Attributes
    ----------
    name : str
        Of the point; an inline target is named by its motion and line.
    path : Path
    line : int
        Where its numbers stand.
    motions : tuple of str
        The motion word of every use.
    verdict : {"correct", "skip", "refuse"}
    reason : str
        Why not ``correct``; empty where it is.
    frame, tool : str
        What the controller calls them; empty where not known.
    frame_number, tool_number : int, optional
    xyz : tuple of 3 float [mm], optional
        Position in its own frame.
    angles : tuple of float, optional
        Orientation in its own frame, in the controller's numbers.
    controller : str
        Whose angles they are, for `truepose.geometry.euler`.
    tf_base_frame, tf_flange_tool : (4, 4) array [mm], optional
        No tool: that of the measurements.
    status, turn : int, optional
        Configuration, where the target names it as KUKA does.
    configuration : str
        As other controllers name it.
    spans : tuple of (start, end)
        Bytes of the numbers X, Y, Z and the angles, with the blanks in front where the column is kept.
    unit : float [mm]
        Of the position's digits.
    """

    name: str
    path: Path
    line: int
    motions: tuple[str, ...]
    verdict: Verdict
    reason: str = ""
    frame: str = ""
    tool: str = ""
    frame_number: int | None = None
    tool_number: int | None = None
    xyz: tuple[float, ...] | None = None
    angles: tuple[float, ...] | None = None
    controller: str = "kuka"
    tf_base_frame: FloatArray | None = None
    tf_flange_tool: FloatArray | None = None
    status: int | None = None
    turn: int | None = None
    configuration: str = ""
    spans: tuple[Span, ...] = ()
    unit: float = 1.0

    @property
    def p(self) -> FloatArray:
        """Position in its own frame, (3,) [mm]; NaN where the target has none."""
        return np.full(3, np.nan) if self.xyz is None else np.array(self.xyz)

    @property
    def rotation(self) -> Rotation | None:
        """Orientation in its own frame."""
        return None if self.angles is None else euler(self.controller, np.array(self.angles))

    @property
    def uses(self) -> dict[str, int]:
        """How often each kind of motion goes to it."""
        return dict(Counter(self.motions))

    @property
    def motion(self) -> str:
        """The kinds of motion in words."""
        return ", ".join(word if n == 1 else f"{word} ({n} times)" for word, n in self.uses.items())

    @property
    def where(self) -> str:
        """File and line."""
        return f"{self.path}:{self.line}"


@dataclass(frozen=True, eq=False)
class Program:
    """A program as its dialect's reader understood it.

    Attributes
    ----------
    path : Path
        As the user named it.
    sources : tuple of Source
        Every file of it.
    targets : tuple of Target
    circles : tuple of tuple of int
        Indices of targets that are corrected together or not at all.
    lexer : compiled pattern
        Of the dialect, for the proof.
    finest : float [mm]
        The controller keeps no smaller step.
    """

    path: Path
    sources: tuple[Source, ...]
    targets: tuple[Target, ...]
    circles: tuple[tuple[int, ...], ...]
    lexer: re.Pattern[bytes]
    finest: float = 0.0

    def correctable(self) -> NDArray[np.intp]:
        """Return the indices of the targets whose verdict is ``correct``."""
        return np.flatnonzero([target.verdict == "correct" for target in self.targets])

    def poses_base(self) -> FloatArray:
        """Return the poses of the correctable targets, base to tool, (n, 4, 4) [mm]."""
        chosen = [self.targets[i] for i in self.correctable()]
        if not chosen:
            return np.empty((0, 4, 4))
        angles = np.array([target.angles for target in chosen])
        tf_frame_tool = make_transform(euler(chosen[0].controller, angles), np.array([target.xyz for target in chosen]))
        tf_base_frame = np.array([target.tf_base_frame for target in chosen])
        poses: FloatArray = tf_base_frame @ tf_frame_tool
        return poses

    def positions_base(self) -> FloatArray:
        """Return the positions of the correctable targets, (n, 3) [mm], base frame."""
        return self.poses_base()[:, :3, 3]

    def tools(self, measured: FloatArray = IDENTITY) -> FloatArray:
        """Return the tools of the correctable targets, flange to tool, (n, 4, 4) [mm].

        `measured`, (4, 4) [mm], stands where the program names none.
        """
        tools = [self.targets[i].tf_flange_tool for i in self.correctable()]
        return np.array([measured if tool is None else tool for tool in tools]).reshape(-1, 4, 4)


def frame_key(key: Key) -> Key:
    """Return a number or a name as tables hold it: ``"3"`` is number 3, names are folded to lower case."""
    text = str(key).strip()
    return int(text) if text.isdecimal() and len(text) < 6 else text.lower()


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
