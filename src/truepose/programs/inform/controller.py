"""What a backup of the controller tells about all jobs: position variables, and the ways from job to job."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from truepose.programs.core.joint_targets import OwnLengths
from truepose.programs.core.points import FileLine, Problem
from truepose.programs.core.program import Key

_MOST: Final = 64
"""Number of values that a variable may have."""
ELSEWHERE: Final = ""
"""The name of a job that is known at run time only."""
ANY: Final = -1
"""The number of a variable that is known at run time only, or of several."""


class Pose(NamedTuple):
    """A position of a variable.

    Attributes
    ----------
    numbers : tuple of 6 float [mm, deg]
        X, Y, Z, Rx, Ry, Rz.
    frame : str
        The frame that they are given in: "BASE", "ROBOT", "USER 3"; empty where it is not known.
    """

    numbers: tuple[float, ...]
    frame: str


class StoredPosition(NamedTuple):
    """A position variable as VAR.DAT holds it: its line there, and its position unless that is in pulses."""

    line: int
    pose: Pose | None


class Mention(NamedTuple):
    """A P variable in a job.

    Attributes
    ----------
    number : int
        The number of the variable, or `ANY`.
    job : str
        The name of the job's file.
    line : int
        The line.
    how : {"given", "moved to", "shift", "element", "other"}
        How it is used: "given" with a position under //POS, an "element" that is set to a constant, or otherwise.
    pose : Pose, optional
        The position that is given; None where it is in pulses.
    element : (int, float), optional
        The element that is set, 0 to 5, and its value [mm, deg].
    """

    number: int
    job: str
    line: int
    how: str
    pose: Pose | None = None
    element: tuple[int, float] | None = None


class Displacement(NamedTuple):
    """An instruction that shifts motions.

    Attributes
    ----------
    text : str
        The instruction with its place.
    number : int, optional
        The P variable of the shift; None where another operand gives it.
    along : str
        The coordinates of the shift: "BF", "RF", "TF", "UF#(3)"; empty where the instruction names none.
    sensed : bool
        Whether it is one at run time, which SFTOF does not end.
    """

    text: str
    number: int | None = None
    along: str = ""
    sensed: bool = False


class Survey(NamedTuple):
    """What a job tells about others.

    Attributes
    ----------
    name : str
        The name of the job, in upper case.
    mentions : list of Mention
        The P variables that it names.
    calls : list of (str, frozenset of Displacement, bool)
        The jobs that it calls, with the shifts that may be active there, and whether those of its own callers may be.
    left : frozenset of Displacement
        The shifts that may be active at its end, without those of its callers.
    reframed : dict of str to str
        The jobs that it calls with another user frame, with the instruction.
    changed : dict of ("tool" or "base", int or None) to FileLine
        The tools and user frames that it changes; None: some of them.
    """

    name: str
    mentions: list[Mention]
    calls: list[tuple[str, frozenset[Displacement], bool]]
    left: frozenset[Displacement]
    reframed: dict[str, str]
    changed: dict[tuple[str, Key | None], FileLine]


@dataclass(frozen=True, eq=False)
class Controller:
    """The knowledge that concerns all jobs.

    Attributes
    ----------
    variables : mapping of int to StoredPosition
        The P variables of VAR.DAT that hold a position.
    mentions : mapping of int to sequence of Mention
        Every mention of a P variable in any job.
    entered : mapping of str to frozenset of Displacement
        The shifts that may be active when a job is called, by job name in upper case.
    left : mapping of str to frozenset of Displacement
        The shifts that a job may leave active when it returns.
    reframed : mapping of str to str
        Relative jobs that an instruction calls with a user frame of its own, with that instruction.
    robot : int, optional
        The number of the robot that the map describes; None: the first robot of each job.
    pulses : tuple of 6 float
        The pulses of one degree of each of its joints; empty where they are not known.
    no_pulses : str
        The reason why they are not known.
    lengths : OwnLengths, optional
        The lengths of the arm that the controller stores, by which it turns joints into poses.
    own_lengths : str
        How these differ from those of the data sheet, in words; empty where they do not.
    unread : tuple of str
        The jobs that cannot be read: they may write any P variable.
    changed : mapping of ("tool" or "base", int or None) to FileLine
        The tools and user frames that some job changes; None: some of them.
    """

    variables: Mapping[int, StoredPosition] = field(default_factory=dict)
    mentions: Mapping[int, Sequence[Mention]] = field(default_factory=dict)
    entered: Mapping[str, frozenset[Displacement]] = field(default_factory=dict)
    left: Mapping[str, frozenset[Displacement]] = field(default_factory=dict)
    reframed: Mapping[str, str] = field(default_factory=dict)
    robot: int | None = None
    pulses: tuple[float, ...] = ()
    no_pulses: str = "the pulses of a degree are in a backup only"
    lengths: OwnLengths | None = None
    own_lengths: str = ""
    unread: tuple[str, ...] = ()
    changed: Mapping[tuple[str, Key | None], FileLine] = field(default_factory=dict)

    def problem_of(self, number: int, job: str) -> Problem | None:
        """Return the reason why the copy of a P variable in a job's file is not corrected; None without one."""
        name = f"P{number:03}"
        if (stored := self.variables.get(number)) is not None:
            reason = f"{name} is a variable of all jobs, whose value is in VAR.DAT (line {stored.line})"
            return Problem("skip", f"{reason}; that file has a checksum and is only read: teach a C position instead")
        if self.unread:
            return Problem("refuse", f"{name} is a variable of all jobs, and {self.unread[0]} cannot be read")
        other = next((m for m in self._of(number) if m.job != job or m.number == ANY), None)
        if other is not None:
            return Problem("refuse", f"{name} is a variable of all jobs: {other.job}, line {other.line}, uses it, too")
        return None

    def _of(self, number: int) -> list[Mention]:
        """Return the mentions that may be of a variable."""
        return [*self.mentions.get(number, ()), *self.mentions.get(ANY, ())]

    def values(self, number: int) -> list[Pose] | None:
        """Return all values that a P variable may have: as it is stored and given, and as constants set its elements.

        None where it is written in another way, is stored in pulses, has no value, or may have too many; and where a
        job cannot be read.
        """
        mentions = self._of(number)
        if self.unread or any(m.how == "other" for m in mentions):
            return None
        poses = [m.pose for m in mentions if m.how == "given"]
        if number in self.variables:
            poses.append(self.variables[number].pose)
        sets: list[set[float]] = [set() for _ in range(6)]
        frames = set()
        for pose in poses:
            if pose is None:
                return None
            frames.add(pose.frame)
            for values, value in zip(sets, pose.numbers, strict=True):
                values.add(value)
        for element in [m.element for m in mentions if m.element is not None]:
            sets[element[0]].add(element[1])
        count = 1
        for values in sets:
            count *= len(values)
        if len(frames) > 1 or not 0 < count <= _MOST:
            return None
        frame = frames.pop() if frames else ""
        return [Pose(numbers, frame) for numbers in itertools.product(*map(sorted, sets))]
