"""What KRL statements do to points: assignments, shifts, and motions to what they give.

`XAP = XP1`, `XAP.Z = XAP.Z + 50`, `XP1 : {X 0,Y 0,Z -50,A 0,B 0,C 0}` with numbers that are constants of the module or
counters of loops. Everything else depends on the run time.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from truepose.programs.core.arithmetic import (
    ArithmeticReader,
    Coordinate,
    Element,
    Expression,
    Name,
    NotArithmetic,
    Number,
    Opaque,
    Shifted,
    Variable,
    names_in,
)
from truepose.programs.core.derived import Derivations, Goal, words
from truepose.programs.core.derived import Derived as Found
from truepose.programs.core.flow import Flow
from truepose.programs.core.graph import Counter
from truepose.programs.core.points import Derived, Place, Point, derive
from truepose.programs.core.source import Source, parse_number, strip
from truepose.programs.krl.lexer import BLANK, CARTESIAN, parse_aggregate
from truepose.programs.krl.points import JOINTS, Index, KrlMotion, PointVariable, concerning

AXES: Final = {"X": 0, "Y": 1, "Z": 2}
FOR: Final = re.compile(
    rb"[ \t]*+([A-Za-z_$][\w$]*+)[ \t]*+=(?!=)(.+?)[ \t]TO[ \t](.+?)(?:[ \t]STEP[ \t](.+))?[ \t]*+", re.I | re.S
)
_PART: Final = re.compile(rb"[ \t]*+(\{[^{}]*+\}|[^{}:]++)[ \t]*+(?::|\Z)")
UNKNOWN: Final = Opaque(())


@dataclass(slots=True, eq=False)
class NumberVariable:
    """A number or an array of numbers that a module or a routine declares.

    Attributes
    ----------
    type : str
        INT or REAL.
    values : dict of tuple of int to float
        The declared values by element; () of a plain variable.
    handed : bool
        Whether a statement may change it in a way that is not followed.
    """

    type: str
    name: str
    values: dict[tuple[int, ...], float] = field(default_factory=dict)
    handed: bool = False

    def declare(self, place: tuple[int, ...] | None, code: bytes) -> None:
        """Take the value of an element in a data list."""
        value = numbers_of(code)
        if place is None or value is None:
            self.handed = True
        else:
            self.values[place] = value


class Followed(NamedTuple):
    """A motion to a point that may be derived: a variable and its element, or an expression; `order` counts them."""

    motion: KrlMotion
    order: int
    variable: PointVariable | None = None
    element: Index = ()


class KrlDerivations:
    """Notes what the statements of a program do to points; see `truepose.programs.core.derived.Derivations`.

    Parameters
    ----------
    flow : Flow
        The ways through the program.

    Attributes
    ----------
    assigned : set of str
        The names, in upper case, that some statement assigns.
    whole : bool
        Whether no other modules than those at hand use the points.
    """

    def __init__(self, flow: Flow) -> None:
        self.derivations = Derivations(flow)
        self.assigned: set[str] = set()
        self._keys: dict[int, tuple[str, int]] = {}
        self._points: dict[Name, PointVariable] = {}
        self._numbers: dict[Name, NumberVariable] = {}
        self._components: dict[Name, tuple[PointVariable, Index, str]] = {}
        self.whole = False

    def component(self, variable: PointVariable, index: Index, key: str, line: int) -> Expression:
        """Return a coordinate of a FRAME as a number, which is constant if nothing changes the frame."""
        name = (f"{variable.name.upper()}.{key}", id(variable))
        found = name if index == () else Element(name, index)
        self._components[found] = variable, index, key
        self.derivations.escape([self.name(variable, index)], line, "used as a shift")
        return Variable(found)

    def _coordinate(self, variable: PointVariable, index: Index, key: str) -> float | None:
        """Return a coordinate of a FRAME that nothing changes and that turns nothing; None for any other."""
        elsewhere = variable.is_global or variable.is_public or variable.origin in ("nowhere", "import")
        literals = concerning(variable.literals, index)
        if (elsewhere and not self.whole) or len(literals) != 1 or literals[0].index is None:
            return None
        if concerning(variable.writes, index) or concerning(variable.reads, index):
            return None
        values = literals[0].aggregate.values
        turns = any(values.get(angle) != 0.0 for angle in ("A", "B", "C"))
        return None if turns or set(values) != set(CARTESIAN) else values[key]

    def points_in(self, expression: Expression) -> list[tuple[PointVariable, Index]]:
        """Return the points that an expression names, each with its element."""
        names = map(Element.of, names_in(expression))
        return [(self._points[array], place) for array, place in names if array in self._points]

    def element(self, goal: Variable) -> tuple[PointVariable, Index] | None:
        """Return the point that an expression consists of, and its element; None where it is no point."""
        array, place = Element.of(goal.name)
        return (self._points[array], None if goal.indices else place) if array in self._points else None

    def _key(self, variable: PointVariable | NumberVariable) -> Name:
        if id(variable) not in self._keys:
            key = self._keys[id(variable)] = (variable.name.upper(), len(self._keys))
            if isinstance(variable, PointVariable):
                self._points[key] = variable
            else:
                self._numbers[key] = variable
        return self._keys[id(variable)]

    def name(self, variable: PointVariable | NumberVariable, index: Index = ()) -> Name:
        """Return the name of a variable or of an element."""
        key = self._key(variable)
        return key if index == () else Element(key, index)

    def point(self, variable: PointVariable, index: Index = ()) -> Expression:
        """Return the expression of a point."""
        return Variable(self.name(variable, index))

    def shown(self, name: Name) -> str:
        """Return a name as the program has it."""
        array, place = Element.of(name)
        variable = self._points[array]
        return variable.name + ("" if not place else "[" + ",".join(map(str, place)) + "]")

    def assign_number(self, variable: NumberVariable, expression: Expression | None, place: Place) -> None:
        """Note the assignment to a number; None is a value that only the run time knows."""
        whole = expression is None or (variable.type == "INT" and not self._is_whole(expression))
        self.derivations.assign(self.name(variable), UNKNOWN if whole or expression is None else expression, place)

    def _is_whole(self, expression: Expression) -> bool:
        """Return whether an expression has whole numbers alone: KRL rounds others when an INT takes them."""
        if isinstance(expression, Number):
            return expression.value == round(expression.value)
        if isinstance(expression, Variable):
            variable = self._numbers.get(expression.name)
            return variable is not None and variable.type == "INT"
        if isinstance(expression, (Coordinate, Opaque, Shifted)):
            return False
        return self._is_whole(expression.left) and self._is_whole(expression.right)

    def counter(self, source: Source, rest: int, end: int, names: Resolver) -> Counter | None:
        """Return the counter of a FOR loop; None where it is not understood."""
        m = FOR.fullmatch(source.data, rest, end)
        variable = names.number(m[1].decode().upper()) if m else None
        if m is None or variable is None or variable.type != "INT":
            return None
        first, last, step = (arithmetic(code, names, self) for code in (m[2], m[3], m[4] or b"1"))
        if first is None or last is None or step is None or not all(map(self._is_whole, (first, last, step))):
            return None
        if any(map(self.points_in, (first, last, step))):
            return None
        return Counter(self.name(variable), first, last, step)

    def solve(self) -> Found:
        """Return what is derived from which point, once the flow is solved."""
        return self.derivations.solve(self._is_point, self._number)

    def _is_point(self, name: Name) -> bool:
        array, place = Element.of(name)
        variable = self._points.get(array)
        if variable is None or variable.type in JOINTS:
            return False
        if place is None:
            return bool(variable.literals)
        return len(concerning(variable.literals, place)) == 1 and not concerning(variable.writes, place)

    def _number(self, name: Name) -> float | None:
        if name in self._components:
            return self._coordinate(*self._components[name])
        array, place = Element.of(name)
        variable = self._numbers.get(array)
        if variable is None or variable.handed or place is None:
            return None
        return variable.values.get(place)

    def spoil(self, found: Found) -> None:
        """Note the points that are used otherwise as read."""
        for name, (place, how) in found.spoiled.items():
            array, index = Element.of(name)
            line = place if isinstance(place, int) else place.line
            self._points[array].reads[index].append((line, how))

    def derive(self, goal: Goal, point: Point, points: Mapping[Name, Point]) -> bool:
        """Let a target follow the points of its goal; return whether it goes nowhere else.

        `points` are the points of the program by their names here.
        """
        derived = []
        for (source, axes), shifts in goal.shifts.items():
            if source in points:
                how = words(point.name, self.shown(source), shifts, axes)
                derived.append((points[source], Derived(point.uses[0].line, how, tuple(shifts), axes)))
        derive(point, derived)
        if not goal.complete or len(derived) < len(goal.shifts):
            point.follows, point.shift = [], None
        return bool(point.follows)


class Resolver(NamedTuple):
    """The names that a module sees: points and numbers by their names in upper case."""

    find: Callable[[str], PointVariable | None]
    number: Callable[[str], NumberVariable | None]


def arithmetic(code: bytes, names: Resolver, known: KrlDerivations) -> Expression | None:
    """Return an expression of sums and products; None where it is another."""

    def named(word: str, indices: Sequence[Expression], path: str) -> Expression:
        places = [int(one.value) for one in indices if isinstance(one, Number) and one.value == round(one.value)]
        if (point := names.find(word.upper())) is not None:
            constant = len(places) == len(indices) and bool(indices) == point.array
            if not constant and indices:
                whole: Expression = Variable(known.name(point), tuple(indices))
            else:
                whole = known.point(point, tuple(places) if constant else None)
            if not path:
                return whole
            return Coordinate(whole, AXES[path.upper()]) if path.upper() in AXES else Opaque((whole,))
        number = None if path else names.number(word.upper())
        if number is None:
            return Opaque(tuple(indices))
        name = known.name(number)
        return Variable(name, tuple(indices))

    try:
        return ArithmeticReader(code.decode("latin-1"), named).read()
    except NotArithmetic:
        return None


def expression(
    source: Source, start: int, end: int, line: int, names: Resolver, known: KrlDerivations
) -> Expression | None:
    """Return the expression of an assignment's right side, or of a motion's goal; None where it is not understood."""
    start, end = strip(source.data, start, end, BLANK)
    code = source.data[start:end]
    if b"{" not in code and b":" not in code:
        return arithmetic(code, names, known)
    spans, at = [], start
    while at < end:
        if (m := _PART.match(source.data, at, end)) is None:
            return None
        spans.append(m.span(1))
        at = m.end()
    found: Expression | None = None
    before: list[tuple[Expression, Expression, Expression]] = []
    goals = [span for span in spans if not _is_frame(source.data[slice(*span)], names)] or spans[:1]
    for a, b in spans:
        if (a, b) in goals and source.data[a : a + 1] != b"{":
            goal = arithmetic(source.data[a:b].strip(), names, known)
            if found is not None or not isinstance(goal, Variable):
                return None
            found = goal
            for shift in reversed(before):
                found = Shifted(found, shift, "frame")
            continue
        by = _frame(source.data[a:b], line, names, known) or _shift(source, a, b, line, names, known)
        if by is None:
            return None
        if found is None:
            before.append(by)
        else:
            found = Shifted(found, by, "tool")
    return found


_NAMED: Final = re.compile(rb"([A-Za-z]\w*+)[ \t]*+(?:\[[ \t]*+(\d{1,4})[ \t]*+\])?+[ \t]*+")


def _is_frame(code: bytes, names: Resolver) -> bool:
    """Return whether code is an aggregate, or names a FRAME."""
    if code.startswith(b"{"):
        return True
    m = _NAMED.fullmatch(code)
    variable = names.find(m[1].decode().upper()) if m else None
    return variable is not None and variable.type == "FRAME"


def _frame(
    code: bytes, line: int, names: Resolver, known: KrlDerivations
) -> tuple[Expression, Expression, Expression] | None:
    """Return the shift of a FRAME that is named; None where code is no such name."""
    m = _NAMED.fullmatch(code)
    variable = names.find(m[1].decode().upper()) if m else None
    if m is None or variable is None or variable.array != (m[2] is not None):
        return None
    index = (int(m[2]),) if m[2] else ()
    x, y, z = (known.component(variable, index, key, line) for key in AXES)
    return x, y, z


def _shift(
    source: Source, start: int, end: int, line: int, names: Resolver, known: KrlDerivations
) -> tuple[Expression, Expression, Expression] | None:
    """Return the shift of an aggregate that turns nothing; None for any other."""
    aggregate = parse_aggregate(source, start, end, line)
    if {*aggregate.values, *aggregate.loose} != set(CARTESIAN):
        return None
    if any(aggregate.values.get(key) != 0.0 for key in ("A", "B", "C")):
        return None
    parts = []
    for key in ("X", "Y", "Z"):
        value = aggregate.values.get(key)
        part = arithmetic(aggregate.loose[key], names, known) if value is None else Number(value)
        if part is None:
            return None
        parts.append(part)
    x, y, z = parts
    return x, y, z


def numbers_of(code: bytes) -> float | None:
    """Return the number that a declaration gives; None where it is an expression."""
    try:
        return parse_number(code.strip())
    except ValueError:
        return None
