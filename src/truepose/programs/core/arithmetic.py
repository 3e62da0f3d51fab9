"""Expressions of programs as far as they shift points: numbers, points, their components, and constant shifts.

A reader turns the code of its language into these expressions, and `truepose.programs.core.derived` evaluates them
along the ways through the program. What an expression does not say exactly depends on what it reads.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Final, Literal, NamedTuple

Axes = Literal["frame", "tool"]
Vector = tuple[float, float, float]
Name = Hashable
"""A variable as the reader names it."""
_ZERO: Final = (0.0, 0.0, 0.0)
_DECIMALS: Final = 6  # [mm] sums of shifts are kept to a nanometre, so that equal ones are one


class Element(NamedTuple):
    """The name of an element of an array; None stands for any element."""

    array: Name
    place: tuple[int, ...] | None

    @classmethod
    def of(cls, name: Name) -> Element:
        """Return a name as array and place; a variable that is no element has the place ()."""
        return name if isinstance(name, cls) else cls(name, ())


class At(NamedTuple):
    """The position of a point with shifts [mm] along the axes of its frame, and along those of its tool."""

    source: Name
    shift: Vector = _ZERO
    along_tool: Vector = _ZERO


class PartOf(NamedTuple):
    """A coordinate (0 to 2) of a position plus an offset [mm], in the frame of the point."""

    source: Name
    axis: int
    offset: float


class Depends(NamedTuple):
    """A value that is not known, and the points that it depends on."""

    sources: frozenset[Name] = frozenset()


Value = float | At | PartOf | Depends
UNKNOWN: Final = Depends()


class Number(NamedTuple):
    """A constant."""

    value: float


class Variable(NamedTuple):
    """A variable, or an element of an array."""

    name: Name
    indices: tuple[Expression, ...] = ()


class Coordinate(NamedTuple):
    """A coordinate (0 to 2) of a point."""

    of: Expression
    axis: int


class Operation(NamedTuple):
    """A sum, a difference or a product."""

    operator: Literal["+", "-", "*"]
    left: Expression
    right: Expression


class Shifted(NamedTuple):
    """A point with a shift."""

    of: Expression
    by: tuple[Expression, Expression, Expression]
    axes: Axes


class Opaque(NamedTuple):
    """Anything else that reads other expressions."""

    reads: tuple[Expression, ...]


Expression = Number | Variable | Coordinate | Operation | Shifted | Opaque


def parts_of(expression: Expression) -> tuple[Expression, ...]:
    """Return the expressions that one consists of."""
    match expression:
        case Variable(_, indices):
            return indices
        case Coordinate(of, _):
            return (of,)
        case Operation(_, left, right):
            return left, right
        case Shifted(of, by, _):
            return of, *by
        case Opaque(reads):
            return reads
    return ()


def names_in(expression: Expression) -> Iterator[Name]:
    """Yield the variables that an expression names; any element where it names an array."""
    if isinstance(expression, Variable):
        yield Element(expression.name, None) if expression.indices else expression.name
    for part in parts_of(expression):
        yield from names_in(part)


def sources_of(value: Value) -> frozenset[Name]:
    """Return the points that a value depends on."""
    if isinstance(value, float):
        return frozenset()
    return value.sources if isinstance(value, Depends) else frozenset([value.source])


def evaluate(expression: Expression, get: Callable[[Name], Value]) -> Value:
    """Return the value of an expression; `get` gives those of variables."""
    match expression:
        case Number(value):
            return value
        case Variable(name, indices):
            return get(name) if not indices else _element(name, [evaluate(index, get) for index in indices], get)
        case Coordinate(of, axis):
            point = evaluate(of, get)
            if isinstance(point, At) and point.along_tool == _ZERO:
                return PartOf(point.source, axis, point.shift[axis])
            return Depends(sources_of(point))
        case Operation(operator, left, right):
            return _operate(operator, evaluate(left, get), evaluate(right, get))
        case Shifted(of, by, axes):
            point, shift = evaluate(of, get), [evaluate(one, get) for one in by]
            numbers = [one for one in shift if isinstance(one, float)]
            if isinstance(point, At) and len(numbers) == 3:
                return shifted(point, numbers, axes)
            return _depending(point, *shift)
        case Opaque(reads):
            return _depending(*[evaluate(one, get) for one in reads])


def shifted(point: At, by: Sequence[float], axes: Axes) -> At:
    """Return a position with one more shift."""
    before = point.shift if axes == "frame" else point.along_tool
    x, y, z = (round(a + b, _DECIMALS) + 0.0 for a, b in zip(before, by, strict=True))
    return point._replace(shift=(x, y, z)) if axes == "frame" else point._replace(along_tool=(x, y, z))


def with_coordinate(point: Value, axis: int, value: Value) -> Value:
    """Return a position with another coordinate (0 to 2); a coordinate that is not its own loses the correction."""
    if not (isinstance(point, At) and isinstance(value, PartOf)):
        return _depending(point, value)
    if point.along_tool != _ZERO or (point.source, axis) != (value.source, value.axis):
        return _depending(point, value)
    x, y, z = (round(value.offset, _DECIMALS) + 0.0 if k == axis else point.shift[k] for k in range(3))
    return At(point.source, (x, y, z))


def _depending(*values: Value) -> Depends:
    return Depends(frozenset[Name]().union(*map(sources_of, values)))


def _element(name: Name, indices: list[Value], get: Callable[[Name], Value]) -> Value:
    places = [int(index) for index in indices if isinstance(index, float) and index == round(index)]
    if len(places) == len(indices):
        return get(Element(name, tuple(places)))
    whole = get(Element(name, None))
    return Depends(sources_of(whole) | _depending(*indices).sources)


def _operate(operator: str, a: Value, b: Value) -> Value:
    if isinstance(a, float) and isinstance(b, float):
        found = a * b if operator == "*" else a + b if operator == "+" else a - b
        return found if math.isfinite(found) else UNKNOWN
    if operator == "+" and isinstance(a, float):
        a, b = b, a
    if operator in "+-" and isinstance(a, PartOf) and isinstance(b, float):
        return a._replace(offset=a.offset + (b if operator == "+" else -b))
    return _depending(a, b)


_LONGEST: Final = 200
"""Number of characters of an expression; longer ones are not read, which also limits their depth."""
_TOKEN: Final = re.compile(
    r"\s*(?:([0-9]+\.?[0-9]*(?:[eE][+-]?[0-9]+)?|\.[0-9]+)(?![\w.])|([A-Za-z_$][\w$]*)|([-+*()\[\],{}.]))"
)


class NotArithmetic(Exception):  # noqa: N818 - ends the reading of one expression
    """Code that is no expression of numbers, names, brackets, sums and products."""


class ArithmeticReader:
    """Reads sums, differences and products of numbers and names: ``2*pitch + (i-1)*50.0``.

    Parameters
    ----------
    code : str
        The code of the expression.
    name : callable
        A function that returns the expression of a name with its indices and component (empty without), or raises
        `NotArithmetic`.
    brackets : str
        The brackets of indices: ``[]`` or ``{}``.
    """

    def __init__(
        self, code: str, name: Callable[[str, tuple[Expression, ...], str], Expression], brackets: str = "[]"
    ) -> None:
        self._name, self._open, self._close = name, brackets[0], brackets[1]
        self._tokens: list[tuple[str, str, str]] = []
        at = 0
        code = code.rstrip()
        if len(code) > _LONGEST:
            raise NotArithmetic
        while at < len(code):
            if (m := _TOKEN.match(code, at)) is None:
                raise NotArithmetic
            self._tokens.append((m[1] or "", m[2] or "", m[3] or ""))
            at = m.end()
        self._at = 0

    def read(self) -> Expression:
        """Return the expression; raise `NotArithmetic` if the code is none."""
        found = self._sum()
        if self._at < len(self._tokens):
            raise NotArithmetic
        return found

    def _sign(self) -> str:
        return self._tokens[self._at][2] if self._at < len(self._tokens) else ""

    def _take(self, sign: str) -> None:
        if self._sign() != sign:
            raise NotArithmetic
        self._at += 1

    def _sum(self) -> Expression:
        found = self._product()
        while (sign := self._sign()) and sign in "+-":
            self._at += 1
            found = Operation("+" if sign == "+" else "-", found, self._product())
        return found

    def _product(self) -> Expression:
        found = self._factor()
        while self._sign() == "*":
            self._at += 1
            found = Operation("*", found, self._factor())
        return found

    def _factor(self) -> Expression:
        if self._at >= len(self._tokens):
            raise NotArithmetic
        number, word, sign = self._tokens[self._at]
        self._at += 1
        if number:
            if not math.isfinite(value := float(number)):
                raise NotArithmetic
            return Number(value)
        if sign == "-":
            return Operation("-", Number(0.0), self._factor())
        if sign == "+":
            return self._factor()
        if sign == "(":
            found = self._sum()
            self._take(")")
            return found
        if not word:
            raise NotArithmetic
        indices: list[Expression] = []
        if self._sign() == self._open:
            self._at += 1
            indices.append(self._sum())
            while self._sign() == ",":
                self._at += 1
                indices.append(self._sum())
            self._take(self._close)
        path = []
        while self._sign() == ".":
            self._at += 1
            if self._at >= len(self._tokens) or not self._tokens[self._at][1]:
                raise NotArithmetic
            path.append(self._tokens[self._at][1])
            self._at += 1
        return self._name(word, tuple(indices), ".".join(path))
