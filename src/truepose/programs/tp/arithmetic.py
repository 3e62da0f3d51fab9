"""Arithmetic of FANUC registers as expressions: ``PR[1,3]+R[5]``, ``PR[2]-PR[3]``, ``LPOS-LPOS``."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Final, Literal, NamedTuple

from truepose.programs.core.arithmetic import (
    ArithmeticReader,
    Coordinate,
    Element,
    Expression,
    Name,
    NotArithmetic,
    Number,
    Opaque,
    Operation,
    Shifted,
    Variable,
)

HERE: Final = "LPOS"
"""The name of the position at which the robot is."""
_COMMENT = re.compile(rb":[^\],\[]*(?=[\],])")
_GROUP = re.compile(rb"(?<=\[)\s*GP(\d)\s*:\s*", re.I)
_ASSIGNED = re.compile(rb"\s*(PR|R)\s*\[([^\]=]*(?:\[[^\]]*\][^\]=]*)*)\]\s*=(?!=)(.*)", re.I | re.S)
_TERM = re.compile(rb"\s*([+-]?)\s*(?:(PR?)\s*\[\s*(\d{1,9}|R\s*\[\s*\d{1,5}\s*\])\s*\]|(LPOS|JPOS)\b)\s*", re.I)
_REFERENCE = re.compile(rb"(?<![\w$])(PR?|R)\s*\[\s*(?:(\d{1,9})\s*(?:,\s*(\d))?\s*\])?|\b(LPOS|JPOS)\b", re.I)
_ZERO = re.compile(rb"\(?[-+]?0*\.?0+\)?")
_INDIRECT = re.compile(rb"R\s*\[\s*(\d{1,5})\s*\]", re.I)


def point(number: int) -> Element:
    """Return the name of a position."""
    return Element("P", (number,))


def register(number: int) -> Element:
    """Return the name of a position register that may hold a position."""
    return Element("PR", (number,))


class Assignment(NamedTuple):
    """An assignment to a register.

    Attributes
    ----------
    kind : {"R", "PR"}
        The kind of register.
    number : int, optional
        Its number; None where another register gives it.
    axis : int, optional
        The component (0 to 5) of a position register; None for the whole, −1 where another register gives it.
    value : bytes
        The code of the value, without comments.
    """

    kind: Literal["R", "PR"]
    number: int | None
    axis: int | None
    value: bytes


def without_comments(code: bytes, group: int) -> bytes:
    """Return code without the comments of registers and positions, and without the name of the motion group."""
    return _COMMENT.sub(b"", _GROUP.sub(lambda m: b"" if int(m[1]) == group else m[0], code))


def assignment_in(code: bytes) -> Assignment | None:
    """Return the assignment to a register that an instruction without comments is."""
    m = _ASSIGNED.fullmatch(code.strip(b" \t;"))
    if m is None:
        return None
    first, _, second = (part.strip() for part in m[2].partition(b","))
    number = int(first) if first.isdigit() and len(first) < 6 else None
    axis = None if not second else int(second) - 1 if second in (b"1", b"2", b"3", b"4", b"5", b"6") else -1
    return Assignment("PR" if m[1].upper() == b"PR" else "R", number, axis, m[3].strip())


class Term(NamedTuple):
    """A position in a sum: its sign, its kind ("P", "PR", "LPOS", "JPOS") and its number or the register of that."""

    sign: str
    kind: str
    number: int | None = None
    given_by: int | None = None


def terms_in(value: bytes) -> list[Term]:
    """Return the positions of a sum; nothing where the code is none."""
    found, at = list[Term](), 0
    while at < len(value):
        m = _TERM.match(value, at)
        if m is None or (found and not m[1]):
            return []
        digits = (m[3] or b"").strip()
        given = _INDIRECT.fullmatch(digits)
        kind = (m[2] or m[4]).decode().upper()
        number = int(digits) if digits.isdigit() else None
        found.append(Term(m[1].decode() or "+", kind, number, int(given[1]) if given else None))
        at = m.end()
    return found


def is_zero(value: bytes) -> bool:
    """Return whether a value is a position minus itself, which programs write to clear a register.

    ``JPOS-JPOS`` makes it one of joint angles.
    """
    terms = terms_in(value)
    return (
        len(terms) == 2 and terms[0].kind != "JPOS" and terms[0].sign == "+" and terms[1] == terms[0]._replace(sign="-")
    )


class Offsets:
    """The position registers that hold nothing but numbers: shifts.

    Parameters
    ----------
    assignments : iterable of Assignment
        All assignments of the program.
    stored : mapping of int to tuple of 6 float
        The stored values of position registers [mm, deg].
    """

    def __init__(self, assignments: Iterable[Assignment], stored: Mapping[int, tuple[float, ...]]) -> None:
        self._of: dict[int, list[Assignment]] = {}
        self._stored, self._all = stored, True
        for one in assignments:
            if one.kind == "PR":
                self._all = self._all and one.number is not None
                self._of.setdefault(one.number or 0, []).append(one)
        self._numbers = self._largest(self._of.keys(), self._holds_numbers)
        self._unturned = self._largest(self._numbers, self._holds_no_turn)

    def __contains__(self, number: int) -> bool:
        return self._all and (number in self._numbers or number not in self._of)

    def unturned(self, number: int) -> bool:
        """Return whether W, P, R of a register are zero wherever they are known."""
        return number in self and self._is_unturned(number, self._unturned)

    def _largest(self, numbers: Iterable[int], holds: Callable[[Assignment, set[int]], bool]) -> set[int]:
        """Return the registers for all of whose assignments something holds, given that it does for the others."""
        found, size = set(numbers), -1
        while size != len(found):
            size = len(found)
            found = {number for number in found if all(holds(one, found) for one in self._of[number])}
        return found

    def _holds_numbers(self, one: Assignment, known: set[int]) -> bool:
        if one.axis is None:
            terms = terms_in(one.value)
            return is_zero(one.value) or (bool(terms) and all(self._is_number(term, known) for term in terms))
        for m in _REFERENCE.finditer(one.value):
            kind = (m[1] or m[4]).upper()
            if kind != b"R" and not (kind == b"PR" and m[2] and (int(m[2]) in known or int(m[2]) not in self._of)):
                return False
        return True

    def _is_number(self, term: Term, known: set[int]) -> bool:
        return term.kind == "PR" and term.number is not None and (term.number in known or term.number not in self._of)

    def _holds_no_turn(self, one: Assignment, known: set[int]) -> bool:
        if one.axis is None:
            return is_zero(one.value) or all(self._is_unturned(term.number or 0, known) for term in terms_in(one.value))
        return one.axis in (0, 1, 2) or (one.axis > 2 and _ZERO.fullmatch(one.value) is not None)

    def _is_unturned(self, number: int, known: set[int]) -> bool:
        """Return whether neither the program nor the stored value turns."""
        if (own := self._of.get(number)) is not None and number not in known:
            return False
        set_here = own is not None and (any(one.axis is None for one in own) or {3, 4, 5} <= {one.axis for one in own})
        return set_here or not any(self._stored.get(number, (0.0,) * 6)[3:])


class RegisterArithmetic:
    """Turns the code of values into expressions.

    The components of a register of `offsets` are numbers with the names ``("PR", number, axis)``. Other position
    registers are points with the names of `register`. The names of numeric registers are ``("R", number)``.

    Parameters
    ----------
    offsets : Offsets
        The registers that hold shifts.
    """

    def __init__(self, offsets: Offsets) -> None:
        self.offsets = offsets

    def number(self, value: bytes) -> Expression:
        """Return a number; an opaque expression where the code is none that is understood."""
        try:
            return ArithmeticReader(value.decode("latin-1"), self._named).read()
        except NotArithmetic:
            return self.opaque(value)

    def _named(self, word: str, indices: tuple[Expression, ...], path: str) -> Expression:
        places = [int(index.value) for index in indices if isinstance(index, Number) and index.value.is_integer()]
        if path or len(places) != len(indices):
            raise NotArithmetic
        match word.upper(), places:
            case "R", [number]:
                return Variable(("R", number))
            case "PR", [number, component] if 1 <= component <= 6 and number in self.offsets:
                return Variable(("PR", number, component - 1))
            case "PR", [number, component] if 1 <= component <= 3:
                return Coordinate(Variable(register(number)), component - 1)
        raise NotArithmetic

    def position(self, value: bytes) -> Expression:
        """Return the position that a register gets: a point, a sum of a point and shifts, or an opaque expression."""
        terms = terms_in(value)
        points = [term for term in terms if not self._is_offset(term)]
        first = terms[0] if terms else None
        if first is None or points != [first] or first.sign != "+" or first.kind == "JPOS":
            return self.opaque(value)
        found = self.of(first)
        for term in terms[1:]:
            assert term.number is not None  # an offset
            if not self.offsets.unturned(term.number):
                return self.opaque(value)
            x, y, z = self.shift(term.number, term.sign)
            found = Shifted(found, (x, y, z), "frame")
        return found

    def of(self, term: Term) -> Expression:
        """Return the position of a term."""
        if term.kind == HERE:
            return Variable(HERE)
        if term.given_by is not None:
            return Variable(term.kind, (Variable(("R", term.given_by)),))
        return Variable(Element(term.kind, (term.number or 0,)))

    def _is_offset(self, term: Term) -> bool:
        return term.kind == "PR" and term.number is not None and term.number in self.offsets

    def shift(self, number: int, sign: str = "+") -> tuple[Expression, Expression, Expression]:
        """Return the shift in a register; it is known where all six components are."""
        turn = Operation("+", Operation("+", self._part(number, 3), self._part(number, 4)), self._part(number, 5))
        known = Operation("*", Number(0.0), turn)
        factor = Number(1.0 if sign == "+" else -1.0)
        x, y, z = (Operation("*", factor, Operation("+", self._part(number, k), known)) for k in range(3))
        return x, y, z

    def components(self, value: bytes) -> list[Expression]:
        """Return the components that a register of `offsets` gets as a whole."""
        if is_zero(value):
            return [Number(0.0)] * 6
        terms, found = terms_in(value), list[Expression]()
        for axis in range(6):
            total: Expression = Number(0.0)
            for term in terms:
                total = Operation("+" if term.sign == "+" else "-", total, self._part(term.number or 0, axis))
            found.append(total)
        return found

    def _part(self, number: int, axis: int) -> Expression:
        return Variable(("PR", number, axis))

    def opaque(self, value: bytes) -> Expression:
        """Return an expression that depends on all that the code names."""
        return Opaque(tuple([Variable(name) for name in self.names_in(value)]))

    def names_in(self, code: bytes) -> list[Name]:
        """Return the positions and the position registers with positions that code names."""
        found: list[Name] = []
        for m in _REFERENCE.finditer(code):
            kind = (m[1] or m[4]).upper()
            if kind == b"LPOS":
                found.append(HERE)
            elif kind == b"JPOS":
                continue
            elif kind == b"P":
                found.append(point(int(m[2])) if m[2] else Element("P", None))
            elif kind == b"PR" and not (m[2] and int(m[2]) in self.offsets):
                found.append(register(int(m[2])) if m[2] else Element("PR", None))
        return found
