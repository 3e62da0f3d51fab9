"""One target of a program with its verdict."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.programs.core import orientations
from truepose.programs.core.joint_targets import JointForm
from truepose.programs.core.source import Span

Verdict = Literal["correct", "skip", "refuse"]
JOINT_MOTION: Final = re.compile(
    r"S?PTP(?:_REL)?|ASYPTP|\w*J(?:DO|AO|GO|SYNC|IOS)?|G0*0|pointRx|point|joint\w*", re.IGNORECASE
)
"""Words of joint motions, whose path is no line in space, and of data whose motions are not known."""


Stands = Literal["", "tool", "base"]
"""Where the robot holds the part, what of tool and base stands in the world; empty where it holds the tool."""
Along = Literal["frame", "tool", "both"]


class Shifts(NamedTuple):
    """Positions that a program derives from a target by constant shifts, and moves to.

    Attributes
    ----------
    how : str
        How and where the program does it.
    shifts : tuple of (x, y, z) [mm]
        The shifts.
    axes : {"frame", "tool", "both"}
        The axes of the shifts: those of the target's frame, those of the tool at the target, or the former for the
        first three numbers of each shift and the latter for the last three.
    motions : tuple of str
        The motion word of every use of these positions.
    """

    how: str
    shifts: tuple[tuple[float, ...], ...]
    axes: Along = "frame"
    motions: tuple[str, ...] = ()

    def vectors(self, rotation: Rotation) -> tuple[FloatArray, FloatArray]:
        """Return the shifts in the target's frame, (n, 3) [mm], and what of them turns with the target.

        `rotation` is the orientation of the target in its frame.
        """
        shifts = np.array(self.shifts, float)
        along_tool = np.zeros((len(shifts), 3)) if self.axes == "frame" else rotation.apply(shifts[:, -3:])
        return along_tool + (0.0 if self.axes == "tool" else shifts[:, :3]), along_tool


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Target:
    """A target of a program, or a motion whose target cannot be corrected.

    Attributes
    ----------
    name : str
        The name of the point; an inline target is named by its motion and line.
    path : Path
        The file.
    line : int
        The line of its numbers.
    motions : tuple of str
        The motion word of every use.
    verdict : {"correct", "skip", "refuse"}
        The verdict.
    reason : str
        The reason of the verdict; empty where it is ``correct``.
    frame, tool : str
        The controller's names of frame and tool; empty where not known.
    frame_number, tool_number : int, optional
        Their numbers, if they have any.
    xyz : tuple of 3 float [mm], optional
        The position in its own frame.
    angles : tuple of float, optional
        The orientation in its own frame, in the controller's numbers.
    controller : str
        The convention of the angles; see `truepose.programs.core.orientations.rotation`.
    tf_base_frame, tf_flange_tool : (4, 4) array [mm], optional
        The frame and the tool. Without a tool, that of the measurements counts. Where the tool `stands`, it is relative
        to the robot's base, and the frame to the flange.
    status, turn : int, optional
        The configuration, where the target names it as KUKA does.
    configuration : str
        The configuration as other controllers name it.
    spans : tuple of (start, end)
        The bytes of the numbers, with the blanks in front where the column is kept.
    unit : float [mm]
        The unit of the position's digits.
    joints : tuple of float [unit of `joint_form`], optional
        The joints of a joint target, as the program writes them; `spans` are theirs then.
    joint_form : JointForm, optional
        How the controller writes joints; None where it is no joint target.
    derived : tuple of Shifts
        The positions that the program derives from it: its correction is theirs, too.
    follows : tuple of str
        The names of the targets that it is derived from, and whose correction it gets; it has no numbers of its own.
    frame_changed : str
        Where the program changes its frame, if the stored value is used within a tolerance; empty for any other.
    tool_changed : str
        The same for its tool.
    stands : {"", "tool", "base"}
        What of tool and frame stands in the world, where the robot holds the part and moves it to a tool that stands.
        "tool": the program states the tool's place on the part. "base": it states the part's place at the tool, which
        the program calls a base.
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
    joints: tuple[float, ...] | None = None
    joint_form: JointForm | None = None
    derived: tuple[Shifts, ...] = ()
    follows: tuple[str, ...] = ()
    frame_changed: str = ""
    tool_changed: str = ""
    stands: Stands = ""

    @property
    def p(self) -> FloatArray:
        """Position in its own frame, (3,) [mm]; NaN where the target has none."""
        return np.full(3, np.nan) if self.xyz is None else np.array(self.xyz)

    @property
    def rotation(self) -> Rotation | None:
        """Orientation in its own frame."""
        return None if self.angles is None else orientations.rotation(self.controller, np.array(self.angles))

    @property
    def on_paths(self) -> bool:
        """Whether every motion to it, and to what is derived from it, is straight, circular or a spline."""
        motions = [*self.motions, *(word for one in self.derived for word in one.motions)]
        return bool(motions) and not any(map(JOINT_MOTION.fullmatch, motions))

    @property
    def uses(self) -> dict[str, int]:
        """The number of motions of each kind that go to it."""
        return dict(Counter(self.motions))

    @property
    def motion(self) -> str:
        """The kinds of motion in words."""
        return ", ".join(word if n == 1 else f"{word} ({n} times)" for word, n in self.uses.items())

    def to_dict(self) -> dict[str, Any]:
        """Return the target with its verdict, for JSON."""
        return {
            "file": str(self.path),
            "line": self.line,
            "name": self.name,
            "verdict": self.verdict,
            "reason": self.reason,
            "frame": self.frame,
            "tool": self.tool,
            "motion": self.motion,
        }

    def __repr__(self) -> str:
        reason = f": {self.reason}" if self.reason else ""
        return f"<Target {self.name} ({self.where}, {self.motion or 'no motion'}): {self.verdict}{reason}>"

    @property
    def where(self) -> str:
        """The file and line."""
        return f"{self.path}:{self.line}"
