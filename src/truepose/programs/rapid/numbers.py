"""Values that an expression of RAPID may have: numbers, CONST num and CONST pos, and counters of loops.

A counter takes every value of its loop, and an index that only the run time knows every place of its array. So the
values are those that the expression may have, and perhaps more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Final, NamedTuple

from truepose.programs.core.source import parse_number
from truepose.programs.rapid import syntax
from truepose.programs.rapid.syntax import Token, Value, is_list

MOST: Final = 1000
"""Largest number of values; an expression with more counts as not known."""
_COMPONENTS: Final = {"X": 0, "Y": 1, "Z": 2}
_DEEPEST: Final = 20

Environment = Mapping[str, float]


class Unknown(Exception):  # noqa: N818 - the answer about an expression
    """A value that only the run time knows."""


class Constant(NamedTuple):
    """The value of a CONST num or CONST pos, or of an array of them."""

    type: str
    value: Value
    dimensions: int


class Loop(NamedTuple):
    """A FOR loop: its counter, and the expressions of its first and last value and of its step."""

    counter: str
    first: list[Token]
    last: list[Token]
    step: list[Token]

    @classmethod
    def of(cls, statement: list[Token]) -> Loop:
        """Return the loop of ``FOR i FROM first TO last STEP step DO``."""
        parts: dict[str, list[Token]] = {"FOR": [], "FROM": [], "TO": [], "STEP": []}
        part = parts["FOR"]
        for token in statement:
            if token.kind == "word" and (token.text in parts or token.text == "DO"):
                part = parts.get(token.text, [])
            else:
                part.append(token)
        counter = parts["FOR"][0].text if len(parts["FOR"]) == 1 else ""
        return cls(counter, parts["FROM"], parts["TO"], parts["STEP"])


Find = Callable[[str], Constant | None]


def values(expressions: Sequence[list[Token]], find: Find, loops: Sequence[Loop]) -> list[tuple[float, ...]] | None:
    """Return the values that some expressions may have together; None where they are not known.

    Parameters
    ----------
    expressions : sequence of list of Token
        The expressions.
    find : callable
        A function that returns the constant of a name.
    loops : sequence of Loop
        The loops around them, the outermost first.
    """
    used = {token.text for items in expressions for token in items if token.kind == "word"}
    try:
        known = list(islice(_environments(loops, used, find), MOST + 1))
        if len(known) > MOST:
            return None
        free = _free_indices(expressions, find, {loop.counter for loop in loops})
        for name, size in free.items():
            known = [{**one, name: float(k)} for one in known for k in range(1, size + 1)]
            if len(known) > MOST:
                return None
        found = {tuple([_Reading(items, find, one).whole() for items in expressions]) for one in known}
    except (Unknown, ValueError, ZeroDivisionError, OverflowError):
        return None
    return sorted(found)


def _environments(loops: Sequence[Loop], used: set[str], find: Find) -> Iterator[Environment]:
    """Yield the values that the counters may have together; those that nothing uses are left out."""
    wanted = list(loops)
    for k in range(len(loops) - 1, -1, -1):
        if loops[k].counter in used:
            used = used | {token.text for items in loops[k][1:] for token in items if isinstance(token, Token)}
        else:
            wanted.remove(loops[k])
    yield from _nested(wanted, find, {})


def _nested(loops: Sequence[Loop], find: Find, outer: Environment) -> Iterator[Environment]:
    if not loops:
        yield outer
        return
    loop = loops[0]
    first, last = (_Reading(items, find, outer).whole() for items in (loop.first, loop.last))
    step = _Reading(loop.step, find, outer).whole() if loop.step else (1.0 if last >= first else -1.0)
    if not step:
        raise Unknown
    count = int((last - first) / step + 1e-9) + 1
    if count > MOST:
        raise Unknown
    for k in range(count):
        yield from _nested(loops[1:], find, {**outer, loop.counter: first + k * step})


def _free_indices(expressions: Sequence[list[Token]], find: Find, counters: set[str]) -> dict[str, int]:
    """Return the names that are plain indices of arrays and that only the run time knows, each with its largest value.

    ``aOff{n,1}``: n is one of the places of that dimension, or the controller stops.
    """
    found: dict[str, int] = {}
    for items in expressions:
        for k, token in enumerate(items):
            constant = find(token.text) if token.kind == "word" else None
            if constant is None or k + 1 >= len(items) or items[k + 1].text != "{":
                continue
            for place, index in enumerate(syntax.split(_braced(items[k + 1 :]))):
                if len(index) == 1 and index[0].kind == "word" and index[0].text not in counters:
                    name = index[0].text
                    if find(name) is None:
                        size = _size(constant.value, place)
                        found[name] = min(found.get(name, size), size)
    return found


def _braced(items: list[Token]) -> list[Token]:
    end = next((k for k, token in enumerate(items) if token.text == "}"), len(items))
    return items[1:end]


def _size(value: Value, dimension: int) -> int:
    """Return the number of elements of an array along a dimension, counted from 0."""
    for _ in range(dimension):
        if not is_list(value):
            raise Unknown
        value = value[0]  # type: ignore[assignment]
    if not is_list(value):
        raise Unknown
    return len(value)


class _Reading:
    """Evaluates one expression from left to right."""

    def __init__(self, items: Sequence[Token], find: Find, known: Environment, depth: int = 0) -> None:
        self._items, self._find, self._known, self._depth = items, find, known, depth
        self._at = 0
        if depth > _DEEPEST:
            raise Unknown

    def whole(self) -> float:
        """Return the value of the expression."""
        value = self._sum()
        if self._at != len(self._items):
            raise Unknown
        return value

    def _peek(self) -> Token | None:
        return self._items[self._at] if self._at < len(self._items) else None

    def _next(self) -> Token:
        if (token := self._peek()) is None:
            raise Unknown
        self._at += 1
        return token

    def _sum(self) -> float:
        value = self._product()
        while (token := self._peek()) is not None:
            if token.text in ("+", "-") and token.kind == "mark":
                self._at += 1
                value += self._product() if token.text == "+" else -self._product()
            elif token.kind == "number" and token.text[0] in "+-":  # the sign adheres to the number
                value += self._product()
            else:
                break
        return value

    def _product(self) -> float:
        value = self._factor()
        while (token := self._peek()) is not None and token.text in ("*", "/", "DIV", "MOD"):
            self._at += 1
            other = self._factor()
            if token.text == "*":
                value *= other
            elif token.text == "/":
                value /= other
            else:
                if value < 0 or other <= 0 or value % 1 or other % 1:
                    raise Unknown
                value = value // other if token.text == "DIV" else value % other
        return value

    def _factor(self) -> float:
        token = self._next()
        if token.kind == "number":
            return parse_number(token.text.encode("latin-1"))
        if token.text in ("+", "-") and token.kind == "mark":
            return self._factor() if token.text == "+" else -self._factor()
        if token.text == "(":
            value = self._sum()
            if self._next().text != ")":
                raise Unknown
            return value
        if token.kind != "word":
            raise Unknown
        if token.text in self._known and not self._follows("{", "."):
            return self._known[token.text]
        return self._constant(token.text)

    def _follows(self, *texts: str) -> bool:
        return (token := self._peek()) is not None and token.text in texts

    def _constant(self, name: str) -> float:
        constant = self._find(name)
        if constant is None or name in self._known:
            raise Unknown
        value = constant.value
        if constant.dimensions:
            if not self._follows("{"):
                raise Unknown
            inside = _braced(list(self._items[self._at :]))
            self._at += len(inside) + 2
            indices = syntax.split(inside)
            if len(indices) != constant.dimensions:
                raise Unknown
            for index in indices:
                value = self._element(value, _Reading(index, self._find, self._known, self._depth + 1).whole())
        if constant.type == "POS":
            if self._next().text != "." or (part := _COMPONENTS.get(self._next().text)) is None:
                raise Unknown
            value = self._element(value, part + 1.0)
        if not value or not all(isinstance(token, Token) for token in value):
            raise Unknown
        return _Reading(value, self._find, {}, self._depth + 1).whole()  # type: ignore[arg-type]

    @staticmethod
    def _element(value: Value, index: float) -> Value:
        if not is_list(value) or index % 1 or not 1 <= index <= len(value):
            raise Unknown
        return value[int(index) - 1]  # type: ignore[return-value]
