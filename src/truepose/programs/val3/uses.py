"""What VAL3 programs do with the points of an application: motions, arithmetic, shifts by constants."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from truepose.programs.core.pieces import Piece, Section
from truepose.programs.core.points import FileLine, Frame, Point, Problem, Use
from truepose.programs.core.source import parse_number, shown
from truepose.programs.val3.code import ProgramCode, Reference, Statement

_MOVE: Final = re.compile(rb"(?<![\w:])((?:alter)?mov(?:e)?([jlc])(f?))\s*\(\s*", re.I)
_ALTER: Final = re.compile(rb"(?<![\w:])alter(?:Begin|Mov\w*)?\s*\(", re.I)
_APPRO: Final = re.compile(rb"\s*appro\s*\(", re.I)
_STEP_BY: Final = re.compile(rb"\s*([\w:.\[\]\s]+?)\s*([-+])\s*([0-9.]+)\s*")
_MOST_ELEMENTS: Final = 10**9
_AXES: Final = {"x": 0, "y": 1, "z": 2}

Vector = tuple[float, float, float]


class Shifted(NamedTuple):
    """A value of a variable: points, and a constant shift from each.

    Attributes
    ----------
    points : tuple of Point
        The points.
    shift : tuple of 3 float [the unit of the data]
        The shift.
    axes : {"", "frame", "tool"}
        Its axes; empty for no shift.
    how : str
        How the program makes it.
    """

    points: tuple[Point, ...]
    shift: Vector = (0.0, 0.0, 0.0)
    axes: Literal["", "frame", "tool"] = ""
    how: str = ""

    def by(self, shift: Vector, axes: Literal["frame", "tool"], how: str) -> Shifted | None:
        """Return the value with another shift added; None where the two do not add up."""
        if self.axes not in ("", axes):
            return None
        x, y, z = (a + b for a, b in zip(self.shift, shift, strict=True))
        return Shifted(self.points, (x, y, z), axes, f"{self.how}, {how}" if self.how else how)


class ShiftedMotion(NamedTuple):
    """A motion to a shifted value; `variable` names what holds it, empty where the motion itself shifts a point."""

    value: Shifted
    variable: str
    place: FileLine
    use: Callable[[Point], Use]


class ComputedMotion(NamedTuple):
    """A motion to what a program computes."""

    word: str
    place: FileLine
    goal: str


@dataclass(eq=False)
class Variables:
    """The points that programs assign to variables, and the variables that are used where their value is not known.

    Attributes
    ----------
    sources : dict of str to list of (Point, FileLine)
        The points whose numbers a variable gets, by its name, each with where.
    loose : set of str
        The names of the others.
    shared : bool
        Whether tasks run beside each other, so that no value is known.
    """

    sources: dict[str, list[tuple[Point, FileLine]]] = field(default_factory=dict)
    loose: set[str] = field(default_factory=set)
    shared: bool = False

    def settle(self) -> None:
        """Note the points whose numbers reach a loose variable."""
        for name, sources in self.sources.items():
            if self.shared or name in self.loose:
                for point, place in sources:
                    point.reads.append((place, "read by arithmetic"))


@dataclass(eq=False)
class Uses:
    """Collects what programs do with points.

    Parameters
    ----------
    points : callable
        A function that returns the points that a reference names, and how many of its parts that takes; None where it
        names no point. Its second argument states whether a name without an index stands for the whole array.
    frame_of : callable
        A function that returns the frame of a point.
    place_of : callable
        A function that returns the place of a point in its array, which is the order of motions to all of them.

    Attributes
    ----------
    moved : list of ShiftedMotion
        The motions to shifted points.
    computed : list of ComputedMotion
        The motions of the application's own programs to anything else that is not one of a library.
    variables : Variables
        The data that programs assign points to.
    """

    points: Callable[[Reference, bool], tuple[list[Point], int] | None]
    frame_of: Callable[[Point], Frame | None]
    place_of: Callable[[Point], int]
    moved: list[ShiftedMotion] = field(default_factory=list)
    computed: list[ComputedMotion] = field(default_factory=list)
    variables: Variables = field(default_factory=Variables)

    def take(self, code: ProgramCode, tool: Callable[[str], Frame | None], name: str, alias: str) -> None:
        """Take a program.

        `tool` returns the tool that it names, `name` is that of its file in messages, and `alias` that of the library
        in which it finds the points; empty for the application's own programs.
        """
        _Program(self, code, tool, name, alias).take()

    def settle(self) -> None:
        """Note the points whose numbers reach what nobody can follow, when all programs are taken."""
        self.variables.settle()


def _inside(position: int, spans: Iterable[tuple[int, int]]) -> bool:
    return any(a <= position < b for a, b in spans)


class _Program:
    def __init__(
        self, uses: Uses, code: ProgramCode, tool: Callable[[str], Frame | None], name: str, alias: str
    ) -> None:
        self._uses, self._code, self._tool, self._name, self._alias = uses, code, tool, name, alias
        self._values: dict[str, Shifted | None] = {}
        self._section = Section(0, Piece())
        self._locals = Variables(loose=set(code.parameters))
        uses.variables.shared |= code.starts_tasks
        altered = _ALTER.search(code.data)
        self._altered = ""
        if altered:
            word = altered[0].decode().rstrip("( ")
            self._altered = f"{word} (line {code.source.line(altered.start())} of {name})"

    def take(self) -> None:
        """Take the statements in the order of the text."""
        for statement in self._code.statements():
            if statement.is_border:
                self._values.clear()
                self._section = Section(0, Piece())
            taken = self._motions(statement)
            self._assignment(statement, taken)
            indices = self._code.indices(statement.start, statement.end)
            for reference in self._references(statement, indices):
                if not _inside(reference.start, taken) or _inside(reference.start, indices):
                    self._read(reference)
                    if reference.alias == self._alias:
                        self._uses.variables.loose.add(reference.parts[0][0])
            for name, position in self._code.locals_in(statement):
                if not _inside(position, taken) or _inside(position, indices):
                    self._locals.loose.add(name)
        self._locals.settle()

    def _references(self, statement: Statement, indices: list[tuple[int, int]]) -> Iterator[Reference]:
        """Yield the references in a statement, those in indices too."""
        yield from self._code.references(statement.start, statement.end)
        for span in indices:
            yield from self._code.references(*span)

    def _place(self, position: int) -> FileLine:
        return FileLine(self._name, self._code.source.line(position))

    def _motions(self, statement: Statement) -> list[tuple[int, int]]:
        """Take the motions of a statement; return the goals that are understood."""
        code, taken = self._code, []
        for m in _MOVE.finditer(code.data, statement.start, statement.end):
            arguments = code.arguments(m.end(), statement.end)
            goals = 2 if m[2] in b"cC" else 1
            if len(arguments) <= goals:
                continue
            named = code.data[slice(*arguments[goals])].decode("latin-1")
            local = code.local(*arguments[goals])
            tool = Frame(local, f"{local} of {self._name}") if local else self._tool(named)
            for rank, goal in enumerate(arguments[:goals]):
                if self._goal(m, goal, tool, rank):
                    taken.append(goal)
                elif not self._alias:
                    self._computed(m[1].decode().lower(), goal)
        return taken

    def _goal(self, m: re.Match[bytes], goal: tuple[int, int], tool: Frame | None, rank: int) -> bool:
        """Take a goal of a motion, the first or second; return whether it is understood."""
        word, place, problem = m[1].decode().lower(), self._place(goal[0]), None
        if m[3]:
            problem = Problem("refuse", f"{word} (line {place.line} of {self._name}) yields to forces")
        elif self._altered:
            reason = f"{self._altered} may shift it at run time; corrections do not know by how much"
            problem = Problem("refuse", reason)

        def use(point: Point) -> Use:
            order = rank * _MOST_ELEMENTS + min(self._uses.place_of(point), _MOST_ELEMENTS - 1)
            return Use(word, place, tool, self._uses.frame_of(point), problem, self._section, order)

        variable = self._variable(*goal)
        value = self._values.get(variable) if variable else None
        if value is None and (variable not in self._values or not variable):
            value = self._value(*goal)
            variable = ""
        if value is None:
            return False
        if not variable:
            self._uses.variables.loose |= self._not_known(*goal)
        if value.axes:
            said = shown(self._code.data, *goal) if variable else ""
            self._uses.moved.append(ShiftedMotion(value, said, place, use))
        else:
            for point in value.points:
                point.uses.append(use(point))
        return True

    def _not_known(self, start: int, end: int) -> set[str]:
        """Return the names in a piece of code whose values are not known here, if a program assigns them."""
        found = [one for one in self._code.references(start, end) if one.alias == self._alias]
        return {one.parts[0][0] for one in found if one.key not in self._values}

    def _computed(self, word: str, goal: tuple[int, int]) -> None:
        """Note a motion to what the program computes."""
        code = self._code
        reference = code.reference(*goal)
        if reference is None or not reference.alias:
            text = shown(code.data, *goal)
            self._uses.computed.append(ComputedMotion(word, self._place(goal[0]), text))

    def _variable(self, start: int, end: int) -> str:
        """Return the key of the variable that a piece of code is; empty for anything else."""
        if local := self._code.local(start, end):
            return local
        reference = self._code.reference(start, end)
        if reference is None or any(index is None for _, index in reference.parts):
            return ""
        return reference.key

    def _value(self, start: int, end: int) -> Shifted | None:
        """Return the value of an expression of points; None where it is not known."""
        code = self._code
        a, b = code.trim(start, end)
        variable = self._variable(a, b)
        if variable in self._values and variable:
            return self._values[variable]
        if (reference := code.reference(a, b)) is not None:
            found = self._points(reference)
            return Shifted(tuple(found[0])) if found and found[1] == len(reference.parts) else None
        if (m := _APPRO.match(code.data, a, b)) is None:
            return None
        arguments = code.arguments(m.end(), b)
        if len(arguments) != 2 or arguments[1][1] != b - 1:
            return None
        inner, by = self._value(*arguments[0]), code.constants(*arguments[1])
        if inner is None or by is None or len(by) != 6 or any(by[3:]):
            return None
        return inner.by(by[:3], "tool", code.data[a:b].decode("latin-1").strip())

    def _assignment(self, statement: Statement, taken: list[tuple[int, int]]) -> None:
        """Take an assignment: what it writes, and the value of its variable behind it."""
        code = self._code
        left = code.left(statement)
        if left is None or taken:
            return
        right = left[1] + 1
        name, parts = self._target(*left)
        place = self._place(left[0])
        if (reference := code.reference(*left)) is not None:
            taken.append(left)
            self._write(reference, place)
        self._forget(reference or code.array(*left))
        if not name:
            return
        taken.append(left)
        if not parts:
            value = self._value(right, statement.end)
            if value is not None:
                taken.append((right, statement.end))
                self._uses.variables.loose |= self._not_known(right, statement.end)
                variables = self._locals if name in code.hidden else self._uses.variables
                base = name.split(":")[-1].split(".")[0].split("[")[0]
                variables.sources.setdefault(base, []).extend((point, place) for point in value.points)
            self._values[name] = value
        else:
            self._values[name] = self._component(name, parts, statement, right, taken)

    def _forget(self, written: Reference | None) -> None:
        """Forget the values of an array of which the run time knows the element that is written, and of a structure."""
        if written is None:
            return
        if any(index is None for _, index in written.parts):
            start = re.split(r"[\[.]", written.key)[0]
            lost = [name for name in self._values if re.split(r"[\[.]", name)[0] == start]
        else:
            lost = [name for name in self._values if name.startswith(f"{written.key}.")]
        for name in lost:
            self._values[name] = None

    def _target(self, start: int, end: int) -> tuple[str, list[str]]:
        """Return the variable that an assignment writes, and the names behind it, such as ``trsf``, ``z``."""
        start, end = self._code.trim(start, end)
        head, dot, tail = self._code.data[start:end].decode("latin-1").lower().partition(".trsf")
        components = [part for part in tail.split(".") if part]
        return self._variable(start, start + len(head)), components or (["trsf"] if dot else [])

    def _component(
        self, name: str, parts: list[str], statement: Statement, start: int, taken: list[tuple[int, int]]
    ) -> Shifted | None:
        """Return the value of a variable whose component is assigned: known if it is itself with a constant added."""
        code, value = self._code, self._values.get(name)
        m = _STEP_BY.fullmatch(code.data, *code.trim(start, statement.end))
        if value is None or len(parts) != 1 or parts[0] not in _AXES or m is None:
            return None
        variable, components = self._target(m.start(1), m.end(1))
        if variable != name or components != parts:
            return None
        try:
            step = parse_number(m[3])
        except ValueError:
            return None
        taken.append((start, statement.end))
        shift = [0.0, 0.0, 0.0]
        shift[_AXES[parts[0]]] = step if m[2] == b"+" else -step
        how = code.data[slice(*code.trim(statement.start, statement.end))].decode("latin-1")
        return value.by((shift[0], shift[1], shift[2]), "frame", how)

    def _points(self, reference: Reference, *, every: bool = False) -> tuple[list[Point], int] | None:
        """Return the points that a reference names; None where it is one of another application."""
        return self._uses.points(reference, every) if reference.alias == self._alias else None

    def _write(self, reference: Reference, place: FileLine) -> None:
        found = self._points(reference, every=True)
        for point in found[0] if found else ():
            point.writes.append((place, "assigned"))

    def _read(self, reference: Reference) -> None:
        found = self._points(reference, every=True)
        for point in found[0] if found else ():
            place = self._place(reference.start)
            point.reads.append((place, "read by arithmetic"))
