"""Points with their numbers and uses: the reader of a language makes one for each target that it finds.

When the whole program is read, `truepose.programs.core.judge` gives the verdicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from truepose.programs.core.joint_targets import JointNumbers
from truepose.programs.core.order import Visit
from truepose.programs.core.pieces import WHOLE, Section
from truepose.programs.core.program import MEASURED_TOOL, Key, KnownFrames
from truepose.programs.core.source import Source, Span, parse_number
from truepose.programs.core.target import Along, Shifts, Stands, Verdict

NOT_HERE: Final = (-1, -1)
"""Span of a number that a point takes over from the one before it."""
AS_MEASURED: Final = "as measured"
"""Tool of targets that name none: the point that the map was measured with."""


class FileLine(NamedTuple):
    """A line of one of several files."""

    file: str
    line: int


Place = int | FileLine
"""A line; or, in a program of several files, a file with its line."""


def at(place: Place) -> str:
    """Return a place in words."""
    return f"line {place}" if isinstance(place, int) else f"{place.file}, line {place.line}"


class Problem(NamedTuple):
    """The reason why a target is not corrected."""

    verdict: Verdict
    reason: str


JOINTS: Final = Problem("skip", "joint target")
ALLOWED_JOINTS: Final = Problem("skip", "joint target; allow joint_targets to correct it")
FIXED_TOOL: Final = Problem(
    "refuse",
    "the robot holds the part to a fixed tool (IPO_FRAME #TCP): how its positions count is found with the robot of a "
    "map, from Status and Turn of PTP motions",
)
"""Until `truepose.programs.core.held_parts` has found it out."""
RUN_TIME: Final = Problem("skip", "target known at run time only")
RELATIVE: Final = Problem("skip", "relative: it starts from a target that is corrected already")


def unknown_motion(code: str) -> Problem:
    """Refuse an instruction that has the shape of a motion and is not one of the language's."""
    return Problem("refuse", f"looks like a motion that is not known: {code}")


def computed(code: str) -> Problem:
    """Skip a target that an expression gives."""
    return Problem("skip", f"target computed at run time: {code}")


def handed_to(name: str) -> Problem:
    """Skip a pose that is the argument of a subprogram."""
    return Problem("skip", f"handed to {name}(): where that moves is known at run time only")


def not_understood(code: str) -> Problem:
    """Refuse a motion whose operands are not understood."""
    return Problem("refuse", f"a motion that is not understood: {code}")


class Frame(NamedTuple):
    """A tool or base as a program names it.

    Attributes
    ----------
    text : str
        The name for messages.
    key : int or str, optional
        The key in the frame table.
    tf : bytes, optional
        The (4, 4) array [mm] if the program itself gives the values; the frame table takes precedence.
    changed : str
        Where the program changes a base whose stored value is used within the tolerance of the options; empty for any
        other.
    stands : {"", "tool", "base"}
        Where the robot holds the part, what of tool and base stands in the world; the other one is on the flange.
    """

    text: str
    key: Key | None = None
    tf: bytes | None = None
    changed: str = ""
    stands: Stands = ""


def stated_frame(frames: KnownFrames, which: Literal["tool", "base"]) -> Frame | None:
    """Return the tool or base that the user states as in force; None where none is stated."""
    key = frames.tool if which == "tool" else frames.base
    if which == "tool" and key == MEASURED_TOOL and key not in frames.tools:
        return Frame(AS_MEASURED)
    return None if key is None else Frame(str(key), key)


def how_to_state(which: Literal["tool", "base"]) -> str:
    """Return how the user states the tool or base in force."""
    return f"--tool NAME, or --tool {MEASURED_TOOL} for that of the map" if which == "tool" else "--base NAME"


class Use(NamedTuple):
    """A motion to a point; without tool or frame, those count that the user states as in force.

    `section` and `order` are those of `Visit`.
    """

    word: str
    line: Place
    tool: Frame | None = None
    frame: Frame | None = None
    problem: Problem | None = None
    section: Section = WHOLE
    order: int = 0

    def visit(self, item: int) -> Visit:
        """Return the motion as one to a target."""
        file, line = ("", self.line) if isinstance(self.line, int) else self.line
        return Visit(file, line, self.order, self.section, item, self.word)


class Derived(NamedTuple):
    """Positions that a program derives from a point by constant shifts, and moves to.

    Attributes
    ----------
    place : Place
        Where.
    how : str
        How the program does it, such as ``Offs(p1,0,0,50)``.
    shifts : tuple of (x, y, z) [mm]
        The shifts.
    axes : {"frame", "tool", "both"}
        The axes of the shifts: those of the point's frame, those of the tool at the point, or the former for the first
        three numbers of each shift and the latter for the last three.
    uses : tuple of Use
        The motions to these positions, which count for the tool and the frame of the point.
    """

    place: Place
    how: str
    shifts: tuple[tuple[float, ...], ...]
    axes: Along = "frame"
    uses: tuple[Use, ...] = ()

    def of_target(self) -> Shifts:
        """Return the shifts as a target holds them."""
        words = tuple([use.word for use in self.uses])
        return Shifts(f"{self.how} ({at(self.place)})", self.shifts, self.axes, words)


@dataclass(slots=True, eq=False)
class Point:
    """A target and the uses that the program makes of it.

    Attributes
    ----------
    name : str
        The name.
    source : Source
        The file.
    line : int
        The line of its numbers.
    values, spans : tuples
        The position and orientation in the controller's own numbers, and their bytes; empty where there are none.
    problem : Problem, optional
        The reason, in the numbers themselves, why it is not corrected.
    configuration : str
        The word of configuration.
    status, turn : int, optional
        The configuration as KUKA names it.
    shared : Problem, optional
        The reason why programs that are not at hand may use it.
    objection : Problem, optional
        The reason that counts where nothing else is against a correction.
    joints : JointNumbers, optional
        The joints, where it is a joint target; it has no `values` then, and needs no frame.
    uses : list of Use
        The motions to it.
    reads, writes : list of (place, how)
        The places that use it other than by a motion, each with a phrase for the reason.
    derived : list of Derived
        The positions that the program derives from it and moves to; see `derive`.
    follows : list of Point
        The points that this target is derived from by constant shifts: it has no numbers of its own.
    shift : Shifts, optional
        Its shift from the point that it follows, where it is one shift from one point.
    """

    name: str
    source: Source
    line: int
    values: tuple[float, ...] = ()
    spans: tuple[Span, ...] = ()
    problem: Problem | None = None
    configuration: str = ""
    status: int | None = None
    turn: int | None = None
    shared: Problem | None = None
    objection: Problem | None = None
    joints: JointNumbers | None = None
    uses: list[Use] = field(default_factory=list)
    reads: list[tuple[Place, str]] = field(default_factory=list)
    writes: list[tuple[Place, str]] = field(default_factory=list)
    derived: list[Derived] = field(default_factory=list)
    follows: list[Point] = field(default_factory=list)
    shift: Shifts | None = None


def derive(target: Point, derived: Sequence[tuple[Point, Derived]]) -> None:
    """Let the target of motions follow the points that it is derived from.

    Parameters
    ----------
    target : Point
        The target, with its uses; its problem says why it is left without the option ``derived``.
    derived : sequence of (Point, Derived)
        Each point with the shifts of the target from it.
    """
    target.follows = list(dict.fromkeys(point for point, _ in derived))
    for point, one in derived:
        point.derived.append(one._replace(uses=tuple(target.uses)))
    if len(derived) == 1 and len(derived[0][1].shifts) == 1:
        target.shift = derived[0][1].of_target()


def numbers_at(
    source: Source, line: int, names: Sequence[str], tokens: Sequence[bytes], starts: Sequence[int]
) -> tuple[tuple[float, ...], tuple[Span, ...]]:
    """Return the values of number tokens and their spans; a FileError names a broken one."""
    values = []
    for name, token in zip(names, tokens, strict=True):
        try:
            values.append(parse_number(token))
        except ValueError as error:
            raise source.error(line, f"{name}: {error}; correct the file") from None
    spans = [(start, start + len(token)) for start, token in zip(starts, tokens, strict=True)]
    return tuple(values), tuple(spans)
