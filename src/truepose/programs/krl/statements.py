"""Take the statements of a KRL module that shift points, and those that may change numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator

from truepose.programs.core.arithmetic import Name, Opaque, Variable, names_in
from truepose.programs.core.points import Place
from truepose.programs.core.source import Source, strip
from truepose.programs.krl.derived import (
    AXES,
    FOR,
    UNKNOWN,
    KrlDerivations,
    NumberVariable,
    Resolver,
    expression,
)
from truepose.programs.krl.lexer import BLANK, Statement, closing_brace, parse_aggregate
from truepose.programs.krl.names import Names, element, is_partial
from truepose.programs.krl.points import Index, PointVariable
from truepose.programs.krl.words import IDENTIFIER


class KrlStatements:
    """The statements of one module, as far as they shift points; see `KrlDerivations`."""

    def __init__(self, known: KrlDerivations, names: Names) -> None:
        self._known, self._names = known, names
        self._resolver = Resolver(names.find, names.number)
        names.escape = self._escape

    def _escape(self, variable: PointVariable, index: Index, place: Place, how: str) -> None:
        if variable.name.upper() in self._known.assigned:
            self._known.derivations.escape([self._known.name(variable, index)], place, how)

    def hand_over(self, data: bytes, start: int, end: int, *, at_any_time: bool = False) -> None:
        """Note that code may change the variables that it names, perhaps at any time from here on."""
        for name in self._named(data, start, end):
            self._known.derivations.escape([name], 0, "handed to another routine")
            if at_any_time:
                self._known.derivations.distrust(name)

    def distrust(self, data: bytes, start: int, end: int) -> None:
        """Note that code may change what it names at any time from here on."""
        self.hand_over(data, start, end, at_any_time=True)
        for m in IDENTIFIER.finditer(data, start, end):
            if m[1] is not None and (variable := self._names.find(m[1].decode().upper())) is not None:
                self._known.derivations.distrust(self._known.name(variable, None if variable.array else ()))

    def _named(self, data: bytes, start: int, end: int) -> Iterator[Name]:
        for m in IDENTIFIER.finditer(data, start, end):
            word = m[1].decode().upper() if m[1] is not None else ""
            if word and (number := self._names.number(word)) is not None:
                number.handed = True
                yield self._known.name(number)

    def begin_for(self, source: Source, statement: Statement, place: Place) -> bool:
        """Open a FOR loop; False if its bounds are not known."""
        word, line, _, rest, end = statement
        counter = self._known.counter(source, rest, end, self._resolver)
        if counter is not None:
            self._known.derivations.begin_loop(counter, word, line, place)
        elif (m := FOR.fullmatch(source.data, rest, end)) and (number := self._names.number(m[1].decode().upper())):
            number.handed = True
            self._known.derivations.distrust(self._known.name(number))
        return counter is not None

    def end_loop(self, word: str, opener: str, place: Place) -> None:
        """Close a loop."""
        self._known.derivations.end_loop(word, opener, place)

    def assign(self, source: Source, statement: Statement, m: re.Match[bytes], place: Place, *, whole: bool) -> bool:
        """Note an assignment; return whether its right side is followed, so that it reads nothing else.

        `whole`: no other modules than those at hand use the points.
        """
        word, line, _, _, end = statement
        variable = self._names.find(word)
        if variable is None:
            return self._assign_number(source, word, m, end, line, place)
        index, known = element(variable, m[1]), self._known
        if variable.parameter:  # what it gets may be for the caller
            known.derivations.assign(known.name(variable, index), UNKNOWN, place, point=True)
            return False
        private = whole or not (variable.is_global or variable.is_public or variable.origin in ("nowhere", "import"))
        right = expression(source, m.end(), end, line, self._resolver, known) if private else None
        if index is None:
            known.derivations.distrust(known.name(variable, None))
            return False
        name = known.name(variable, index)
        path = m[2].decode("latin-1").strip(". \t").upper() if m[2] else ""
        if not path:
            kept = Opaque((Variable(name),)) if keeps_components(source, m.end(), end, line) else UNKNOWN
            known.derivations.assign(name, right or kept, place, point=True)
        elif right is not None and path in AXES:
            known.derivations.assign(name, right, place, AXES[path])
        else:
            others = (Variable(name),) if right is None else (Variable(name), right)
            known.derivations.assign(name, Opaque(others), place, point=True)
        if right is not None and name in names_in(right):
            variable.reads[index].append((line, "read by arithmetic"))
        return right is not None

    def _assign_number(self, source: Source, word: str, m: re.Match[bytes], end: int, line: int, place: Place) -> bool:
        number = self._names.number(word)
        if number is None:
            return False
        if m[1] or m[2]:
            number.handed = True
            return False
        right = expression(source, m.end(), end, line, self._resolver, self._known)
        if right is not None and self._known.points_in(right):
            right = None
        self._known.assign_number(number, right, place)
        return right is not None


def keeps_components(source: Source, start: int, end: int, line: int) -> bool:
    """Return whether a right side is an aggregate that leaves some of X to C as before."""
    start, end = strip(source.data, start, end, BLANK)
    if source.data[start : start + 1] != b"{" or closing_brace(source, start, end, line) != end:
        return False
    return is_partial(parse_aggregate(source, start, end, line))


def element_of(brackets: bytes | None) -> tuple[int, ...] | None:
    """Return the element that ``[3]`` of a data list names; () without brackets."""
    texts = brackets.strip(b"[] \t").split(b",") if brackets else []
    return tuple([int(text) for text in texts]) if all(text.strip().isdigit() for text in texts) else None


__all__ = ["KrlStatements", "NumberVariable", "element_of"]
