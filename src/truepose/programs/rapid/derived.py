"""What RAPID statements do to robtargets: assignments, Offs and RelTool, and motions to what they give."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

from truepose.programs.core.arithmetic import (
    Element,
    Expression,
    Name,
    Shifted,
    names_in,
)
from truepose.programs.core.derived import NOT_CONSTANT, Derivations, Goal, words
from truepose.programs.core.derived import Derived as Found
from truepose.programs.core.flow import Flow
from truepose.programs.core.points import Derived, Place, Point, Problem, Use, at, derive
from truepose.programs.core.source import parse_number
from truepose.programs.rapid import syntax
from truepose.programs.rapid.syntax import Token

Reach = Literal["routine", "module", "task", "controller"]
"""The code that sees a name."""


class Robtarget(Protocol):
    """A robtarget or an array of them; see `truepose.programs.rapid.names.RobtargetVariable`."""

    name: str
    kind: str
    reach: Reach
    elements: dict[tuple[int, ...], Point]
    joints: bool
    array: bool


@dataclass(slots=True, eq=False)
class NumberVariable:
    """A num or an array of them.

    Attributes
    ----------
    name : str
        The name.
    kind : {"CONST", "PERS", "VAR"}
        The kind of data; values of a PERS are not known, because the controller keeps them.
    values : dict of tuple of int to float
        The declared values by element; () of a plain variable.
    handed : bool
        Whether a statement may change it in a way that is not followed.
    array : bool
        Whether it is an array.
    """

    name: str
    kind: str
    values: dict[tuple[int, ...], float]
    handed: bool = False
    array: bool = False


class Followed(NamedTuple):
    """A motion whose goal may be derived.

    Attributes
    ----------
    point : Point
        The target of this motion.
    use : Use
        The motion.
    node : int
        Its node in the flow.
    instead : tuple of Point
        The declared points to which it goes if it is not followed; then `point` is no target.
    goal : Expression
        Its goal.
    """

    point: Point
    use: Use
    node: int
    instead: tuple[Point, ...]
    goal: Expression


class RapidDerivations:
    """Notes what the statements of a task do to robtargets; see `truepose.programs.core.derived.Derivations`.

    Parameters
    ----------
    flow : Flow
        The ways through the task.

    Attributes
    ----------
    followed : list of Followed
        The motions whose goals may be derived.
    assigned : list of (Expression, Place)
        What is assigned to any robtarget.
    read_itself : list of (Robtarget, Place)
        Robtargets whose components are set to others of their own.
    """

    def __init__(self, flow: Flow) -> None:
        self.derivations = Derivations(flow)
        self.followed: list[Followed] = []
        self.assigned: list[tuple[Expression, Place]] = []
        self.read_itself: list[tuple[Robtarget, Place]] = []
        self._keys: dict[int, tuple[str, int]] = {}
        self._points: dict[Name, Robtarget] = {}
        self._numbers: dict[Name, NumberVariable] = {}

    def name(self, variable: Robtarget | NumberVariable, index: tuple[int, ...] | None = ()) -> Name:
        """Return the name of a variable or of an element; None is any element."""
        if id(variable) not in self._keys:
            key = self._keys[id(variable)] = (variable.name.upper(), len(self._keys))
            if isinstance(variable, NumberVariable):
                self._numbers[key] = variable
            else:
                self._points[key] = variable
        key = self._keys[id(variable)]
        return key if index == () else Element(key, index)

    def reads_point(self, expression: Expression) -> bool:
        """Return whether an expression reads a robtarget."""
        return any(Element.of(name).array in self._points for name in names_in(expression))

    def escape(self, variable: Robtarget, place: Place, how: str) -> None:
        """Note another use of a robtarget that the program may write."""
        if variable.kind != "CONST":
            name = self.name(variable)
            self.derivations.escape([name, Element(name, None)], place, how)

    def distrust(self, variable: Robtarget) -> None:
        """Note that there are motions to a robtarget which are not followed."""
        self.derivations.distrust(self.name(variable))

    def escape_number(self, number: NumberVariable) -> None:
        """Note that a num may change here."""
        self.derivations.escape([self.name(number)], 0, "handed to another routine")

    def move(self, point: Point, goal: Expression, use: Use, node: int, instead: tuple[Point, ...] = ()) -> None:
        """Note a motion; see `Followed`."""
        followed = Followed(point, use, node, instead, goal)
        self.followed.append(followed)
        self.derivations.move(len(self.followed) - 1, goal, use.line)

    def solve(self) -> Found:
        """Return what is derived from which point, once the flow is solved."""
        return self.derivations.solve(self._is_point, self._number)

    def _is_point(self, name: Name) -> bool:
        array, place = Element.of(name)
        variable = self._points.get(array)
        if variable is None or variable.joints:
            return False
        if place is None:
            return bool(variable.elements)
        point = variable.elements.get(place)
        return point is not None and bool(point.values) and not point.writes

    def _number(self, name: Name) -> float | None:
        array, place = Element.of(name)
        variable = self._numbers.get(array)
        if variable is None or variable.handed or place is None:
            return None
        return variable.values.get(place)

    def points_of(self, name: Name) -> list[Point]:
        """Return the points of a name: one, or all elements of an array."""
        array, place = Element.of(name)
        elements = self._points[array].elements
        return list(elements.values()) if place is None else [elements[place]]

    def sources_of(self, name: Name) -> list[tuple[Robtarget, Point]]:
        """Return the points of a name, each with its variable."""
        return [(self._points[Element.of(name).array], point) for point in self.points_of(name)]

    def spoil(self, found: Found) -> None:
        """Note the points that are used otherwise as read."""
        for name, (place, how) in found.spoiled.items():
            for point in self.points_of(name):
                direct = any(one.use.line == place and self._is_offset(one) for one in self.followed)
                if how == NOT_CONSTANT and direct:
                    reason = f"moved to with an offset that is known at run time only ({at(place)})"
                    point.problem = point.problem or Problem("skip", reason)
                else:
                    point.reads.append((place, how))

    def spoil_assigned(self, why: str) -> None:
        """Note all points whose values variables take: code that is not at hand may change or use these."""
        for expression, place in self.assigned:
            for name in names_in(expression):
                if self._is_point(name):
                    for point in self.points_of(name):
                        point.reads.append((place, f"read by arithmetic ({why})"))

    def _is_offset(self, one: Followed) -> bool:
        """Return whether nothing else hinders a motion with an offset from a point itself, Offs or RelTool."""
        if not isinstance(one.goal, Shifted) or any(use.problem for use in one.point.uses):
            return False
        return not self.derivations.assigned(names_in(one.goal.of))

    def derive(self, goal: Goal, followed: Followed, *, allowed: bool) -> list[Point]:
        """Let a target follow the points of its goal, if it goes nowhere else; return those without a shift.

        Without `allowed`, points with a shift are left, and say with which one.
        """
        derived: list[tuple[Point, Derived]] = []
        direct: list[Point] = []
        point, place, offset = followed.point, followed.use.line, self._is_offset(followed)
        for (source, along), shifts in goal.shifts.items():
            (one,) = self.points_of(source)
            moved = [shift for shift in shifts if any(shift)]
            direct += [one] * (len(moved) < len(shifts))
            if not moved:
                continue
            derived.append((one, Derived(place, words(point.name, one.name, shifts, along), tuple(shifts), along)))
            if offset and not allowed:
                size = max(sum(part * part for part in shift) ** 0.5 for shift in moved)
                reason = f"moved to with an offset (largest {size:g} mm, {at(place)})"
                one.problem = one.problem or Problem("skip", f"{reason}; --derived gives both one correction")
        derive(point, derived)
        if direct:
            point.follows = list(dict.fromkeys([*point.follows, *direct]))
            alone = Derived(place, f"{point.name} = {direct[0].name}", ((0.0, 0.0, 0.0),))
            point.shift = None if derived or len(direct) > 1 else alone.of_target()
        if not goal.complete:
            point.follows, point.shift = [], None
        return direct


def number_values(parsed: syntax.Value, dimensions: int) -> dict[tuple[int, ...], float]:
    """Return the values of a declared num, by element."""
    found = {}
    for index, element in syntax.elements(parsed, dimensions):
        text = "".join(token.text for token in element if isinstance(token, Token))
        try:
            found[index] = parse_number(text.encode("latin-1"))
        except ValueError:
            continue
    return found
