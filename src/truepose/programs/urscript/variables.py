"""The variables of a program that hold poses, and the ways from a motion to the numbers that it goes to."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from truepose._typing import FloatArray
from truepose.geometry import invert_transform, make_transform
from truepose.programs.core.arithmetic import Axes
from truepose.programs.core.judge import NotCorrected
from truepose.programs.core.points import Frame, Point, Problem, Use, computed
from truepose.programs.urscript.poses import (
    Inverse,
    Item,
    Join,
    Literal,
    Name,
    Offset,
    Pose,
    Unknown,
    added,
    is_shift,
    keys,
    text_of,
    transform,
)

DEEPEST: Final = 12
"""The largest number of variables and calls between a motion and its numbers."""
MOST_STEPS: Final = 20_000
"""The largest number of calls and expressions that are followed from one motion."""
READ: Final = "read by arithmetic"
"""The phrase for a point that the program computes with."""


@dataclass(slots=True)
class Variable:
    """A variable or parameter that may hold poses.

    Attributes
    ----------
    points : list of Point
        The literals that are assigned to it, or the elements of a list.
    listed : bool
        Whether it is a list.
    given : list of Pose
        The other expressions that are assigned to it; those passed to it by calls, if it is a parameter.
    callers : list of Use
        The call of each, if it is a parameter.
    reads, writes : list of (line, how)
        The places that use it other than by a motion, and that change it at run time.
    parameter : bool
        Whether it is a parameter.
    solved : list of int
        The nodes of the flow at which ``get_inverse_kin`` gives it joints, with the TCP in force there.
    """

    points: list[Point] = field(default_factory=list)
    listed: bool = False
    given: list[Pose] = field(default_factory=list)
    callers: list[Use] = field(default_factory=list)
    reads: list[tuple[int, str]] = field(default_factory=list)
    writes: list[tuple[int, str]] = field(default_factory=list)
    parameter: bool = False
    solved: list[int] = field(default_factory=list)

    @property
    def meaning(self) -> Pose | None:
        """The only expression that is assigned to it; None of a parameter, of literals and of several."""
        alone = len(self.given) == 1 and not (self.points or self.writes or self.parameter)
        return self.given[0] if alone else None


class Way(NamedTuple):
    """The way from a motion to the numbers of one of its targets.

    Attributes
    ----------
    point : Point
        The numbers.
    tf : (4, 4) array [mm], optional
        The constant frame of the numbers; None: the base.
    frame : Frame, optional
        That frame as the program names it.
    shift : (3,) array [mm], optional
        The constant shift from the point to the position of the motion.
    axes : {"frame", "tool"}
        The axes of the shift: those of the frame, or those of the tool at the point.
    how : str
        The expression of the shift.
    caller : Use, optional
        The call that passes the point to a function.
    """

    point: Point
    tf: FloatArray | None = None
    frame: Frame | None = None
    shift: FloatArray | None = None
    axes: Axes = "frame"
    how: str = ""
    caller: Use | None = None


class Variables:
    """The variables of a program by their keys.

    Parameters
    ----------
    assigned : set of str
        The keys of all variables that the program assigns, whatever their values.
    base : callable
        A function that returns the transform of a base that the controller stores under a name, or None.
    """

    def __init__(self, assigned: set[str], base: Callable[[str], FloatArray | None]) -> None:
        self.table: dict[str, Variable] = {}
        self._assigned, self._base = assigned, base
        self._goals: set[str] = set()
        self._steps = 0
        self._endless: set[str] = set()
        self._marked: set[tuple[str, bool]] = set()
        self._constants: dict[Name | Item, FloatArray | None] = {}

    def settle(self, goals: Iterable[Pose]) -> None:
        """Find the variables that motions go to; all others are constant features and shifts."""
        goals = list(goals)
        size = -1
        for goal in goals:
            self._mark(goal, joins=False)
        while size != len(self._goals):
            size = len(self._goals)
            self._marked.clear()
            self._constants.clear()
            for goal in goals:
                self._mark(goal, joins=True)

    def _mark(self, pose: Pose, *, joins: bool, depth: int = 0) -> None:
        """Mark the variables that a motion to a pose goes to; `joins`: also through features."""
        if depth > DEEPEST:
            return
        if isinstance(pose, Join):
            if pose.adds or self._is_goal(pose.first):
                self._mark(pose.first, joins=joins, depth=depth + 1)
            elif joins and self.constant(pose.first) is not None:
                self._mark(pose.second, joins=joins, depth=depth + 1)
            elif joins and not isinstance(pose.first, Unknown):
                self._mark(pose.first, joins=joins, depth=depth + 1)
        elif isinstance(pose, Name | Item) and (variable := self.table.get(pose.key)):
            if (pose.key, joins) in self._marked:
                return
            self._marked.add((pose.key, joins))
            self._goals.add(pose.key)
            following = variable.given if variable.parameter else [variable.meaning] if variable.meaning else []
            for one in following:
                self._mark(one, joins=joins, depth=depth + 1)

    def is_goal(self, key: str) -> bool:
        """Return whether motions go to a variable."""
        return key in self._goals

    def _is_goal(self, pose: Pose) -> bool:
        return isinstance(pose, Name | Item) and pose.key in self._goals

    def constant(self, pose: Pose, depth: int = 0) -> FloatArray | None:
        """Return the transform (4, 4) [mm] of a pose that never changes and is not corrected; None of any other."""
        if depth > DEEPEST or self._is_goal(pose):
            return None
        match pose:
            case Literal():
                return transform(pose.point.values) if pose.point.values else None
            case Name() | Item():
                if pose not in self._constants:
                    self._constants[pose] = None  # a variable that is made of itself is no constant
                    self._constants[pose] = self._constant_variable(pose, depth)
                return self._constants[pose]
            case Offset():
                return make_transform(translation=pose.shift)
            case Inverse():
                of = self.constant(pose.of, depth + 1)
                return None if of is None else invert_transform(of)
            case Join():
                first, second = (self.constant(part, depth + 1) for part in (pose.first, pose.second))
                if first is None or second is None:
                    return None
                return added(first, second) if pose.adds else first @ second
        return None

    def _constant_variable(self, pose: Name | Item, depth: int) -> FloatArray | None:
        variable = self.table.get(pose.key)
        if variable is None:
            known = isinstance(pose, Item) or pose.key in self._assigned
            return None if known else self._base(pose.text)
        if variable.writes:
            return None
        if isinstance(pose, Item) or variable.listed:
            k = pose.place if isinstance(pose, Item) and variable.listed else None
            if k is None or k >= len(variable.points):
                return None
            return self.constant(Literal(variable.points[k]))
        if len(variable.points) == 1 and not variable.given:
            return self.constant(Literal(variable.points[0]))
        if variable.points or not variable.given or (len(variable.given) > 1 and not variable.parameter):
            return None
        found = [self.constant(one, depth + 1) for one in variable.given]
        first = found[0]
        same = first is not None and all(tf is not None and np.array_equal(tf, first) for tf in found)
        return first if same else None

    def ways(self, pose: Pose, depth: int = 0) -> list[Way]:
        """Return the ways from a motion to its numbers.

        Raises
        ------
        NotCorrected
            If they are known at run time only, a frame is not known, or there are too many.
        """
        if depth == 0:
            self._steps = 0
        self._steps += 1
        if depth > DEEPEST or self._steps > MOST_STEPS:
            self._steps = MOST_STEPS + 1  # such as a function that calls itself: no other way counts then
            raise NotCorrected(*computed(text_of(pose)))
        if depth == 0 and isinstance(pose, Name | Item):
            try:
                return self._ways_of(pose, depth)
            finally:
                if self._steps > MOST_STEPS:
                    self._endless.add(pose.key)
        match pose:
            case Literal():
                return [Way(pose.point)]
            case Name() | Item():
                return self._ways_of(pose, depth)
            case Join() if pose.adds:
                return self._shifted(pose, depth)
            case Join():
                if self._is_goal(pose.first):
                    return self._shifted(pose, depth)
                tf = self.constant(pose.first)
                if tf is not None:
                    frame = self._frame(pose.first, tf)
                    return [self._under(way, tf, frame) for way in self._posed(pose, pose.second, depth)]
                if isinstance(pose.first, Name) and pose.first.key not in {*self._assigned, *self.table}:
                    name = pose.first.text
                    remedy = f"give it in [frames.bases.{name}] of the cell file, or the .installation that defines it"
                    raise NotCorrected("skip", f"base {name} is not known; {remedy}")
                return self._shifted(pose, depth)
        raise NotCorrected(*computed(text_of(pose)))

    def points(self, pose: Pose) -> list[Point]:
        """Return the points that a motion to a pose would go to; none where that is known at run time only."""
        try:
            return [way.point for way in self.ways(pose)]
        except NotCorrected:
            return []

    def solved_at(self, pose: Pose) -> set[int]:
        """Return the nodes at which the joints of a pose are computed, where that is not in the motion itself."""
        return {node for key in self.closure(pose) for node in self.table[key].solved}

    def closure(self, pose: Pose) -> set[str]:
        """Return the keys of the variables in an expression, and of all those that give them their values."""
        found, waiting = set[str](), [pose]
        while waiting:
            new = {key for key in keys(waiting.pop()) if key in self.table} - found
            found |= new
            waiting += [one for key in new for one in self.table[key].given]
        return found

    def _frame(self, pose: Pose, tf: FloatArray) -> Frame:
        """Return the frame of a feature; one that the controller stores counts by its name."""
        if isinstance(pose, Name) and pose.key not in {*self._assigned, *self.table}:
            return Frame(pose.text, pose.text)
        return Frame(text_of(pose), None, tf.tobytes())

    @staticmethod
    def _under(way: Way, tf: FloatArray, frame: Frame) -> Way:
        """Return the way of a point under one more feature."""
        if way.tf is None or way.frame is None:
            return way._replace(tf=tf, frame=frame)
        tf = tf @ way.tf
        return way._replace(tf=tf, frame=Frame(f"{frame.text} · {way.frame.text}", None, tf.tobytes()))

    def _posed(self, whole: Join, part: Pose, depth: int) -> list[Way]:
        """Return the ways to a part of an expression, which must be poses."""
        ways = self.ways(part, depth + 1)
        if any(way.point.joints is not None for way in ways):
            raise NotCorrected(*computed(whole.text))
        return ways

    def _shifted(self, pose: Join, depth: int) -> list[Way]:
        """Return the ways to a point that is moved to with a constant shift."""
        by = self.constant(pose.second)
        if by is None or not is_shift(by):
            raise NotCorrected(*computed(pose.text))
        found = []
        axes: Axes = "frame" if pose.adds else "tool"
        for way in self._posed(pose, pose.first, depth):
            if way.shift is not None and way.axes != axes:
                raise NotCorrected(*computed(pose.text))
            # pose_add counts along the axes of the base
            shift = by[:3, 3] if way.tf is None or axes == "tool" else way.tf[:3, :3].T @ by[:3, 3]
            shift = shift if way.shift is None else way.shift + shift
            found.append(way._replace(shift=shift, axes=axes, how=pose.text))
        return found

    def _ways_of(self, pose: Name | Item, depth: int) -> list[Way]:
        variable = self.table.get(pose.key)
        if pose.key in self._endless:
            raise NotCorrected(*computed(pose.text))
        if variable is None and "." in pose.key:
            raise NotCorrected("skip", f"{pose.text} is known at run time only")
        if variable is None or isinstance(pose, Item) != variable.listed:
            raise NotCorrected(*computed(pose.text))
        if variable.parameter:
            return self._passed(pose, variable, depth)
        if variable.meaning is not None:
            return self.ways(variable.meaning, depth + 1)
        if variable.given:
            raise NotCorrected(*computed(pose.text))
        if isinstance(pose, Item) and pose.place is not None:
            if pose.place >= len(variable.points):
                raise NotCorrected(*computed(pose.text))
            return [Way(variable.points[pose.place])]
        return [Way(point) for point in variable.points]

    def _passed(self, pose: Name | Item, variable: Variable, depth: int) -> list[Way]:
        """Return the ways to what calls pass to a parameter; calls that pass anything else are listed on their own."""
        found: list[Way] = []
        if not variable.writes:
            for one, caller in zip(variable.given, variable.callers, strict=True):
                try:
                    found += [way._replace(caller=way.caller or caller) for way in self.ways(one, depth + 1)]
                except NotCorrected:
                    if self._steps > MOST_STEPS:
                        raise
        if not found:
            raise NotCorrected("skip", f"{pose.text} is known at run time only")
        return found


def is_followed(variables: Variables, pose: Pose) -> Problem | None:
    """Return the reason why what a call passes is not followed to its numbers; None if it is."""
    try:
        variables.ways(pose)
    except NotCorrected as stop:
        return stop.problem
    return None
