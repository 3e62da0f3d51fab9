"""Positions that a program derives from its own through registers: approach points, pallets, constant offsets.

Registers belong to all programs of a controller. So a value is followed only as far as other programs, which the backup
shows, neither write nor read the register.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.geometry import euler, make_transform
from truepose.programs.core.arithmetic import (
    UNKNOWN,
    Element,
    Expression,
    Name,
    Number,
    Opaque,
    Operation,
    Shifted,
    Variable,
    evaluate,
)
from truepose.programs.core.derived import Derivations, Derived
from truepose.programs.core.flow import Flow
from truepose.programs.core.graph import Counter
from truepose.programs.tp.arithmetic import (
    HERE,
    Assignment,
    Offsets,
    RegisterArithmetic,
    Term,
    assignment_in,
    point,
    register,
    without_comments,
)
from truepose.programs.tp.registers import ANYTHING, Effects, Registers, writes_in

_NOTHING: Final = Opaque(())
_LOOP = re.compile(rb"\s*FOR\s+R\s*\[\s*(\d{1,5})\s*\]\s*=\s*(.*?)\s+(DOWN)?TO\s+(.*?)[\s;]*", re.I | re.S)
_NUMBERS = re.compile(rb"(?<![\w$])(P?R)\s*\[\s*(\d{1,5})", re.I)
_BARE = re.compile(rb"\s*[A-Za-z]\w*(?:[ \t-]+\w+)*(?:\([^)]*\))?\s*;?\s*")
_OWN_WORDS = re.compile(
    rb"\s*(?:END|ENDIF|ENDFOR|ELSE|PAUSE|ABORT|CALL|RUN|JMP|IF|FOR|SELECT|WAIT|MONITOR|(?:UN)?LOCK[ \t]+[PV]REG"
    rb"|COL[ \t]+(?:DETECT|GUARD)|DETACH|PALLETIZING|POINT_LOGIC)\b|.*\bEND[\s;]*$",
    re.I,
)
"""Instructions of one word or more, which are no macros."""
MONITORED: Final = re.compile(rb"\s*MONITOR\b(?!\s+END\b)", re.I)
"""The start of a condition, whose program runs when it holds."""
_FROM_REGISTER = re.compile(rb"=\s*PR\s*\[\s*(\d{1,5})\s*(?::[^\]]*)?\][\s;]*$", re.I)
_SAME: Final = 1e-4  # [mm], and of direction cosines
_OFFSET = re.compile(rb"(?<!\w)(?:Tool_)?Offset\s*,\s*PR\s*\[[^\]]*\]", re.I)
_OWN_AXES = re.compile(rb"Offset\s*,\s*PR\s*\[[^\]]*\]\s*,\s*U(?:FRAME|TOOL)\b", re.I)
"""A shift along the axes of another frame or tool than those in force."""
_ENDS_EARLY = re.compile(rb"\b(?:Skip|Search)\b", re.I)
_EXACT = re.compile(rb"\bFINE\b", re.I)


@dataclass(frozen=True, eq=False)
class Facts:
    """What is known of registers outside of a program.

    Attributes
    ----------
    registers : Registers
        Those of the controller.
    name : str
        The name of the program.
    group : int
        The motion group of the robot.
    alone : bool
        Whether the user states that no other program uses the registers.
    """

    registers: Registers
    name: str
    group: int
    alone: bool

    @cached_property
    def stored(self) -> dict[int, tuple[float, ...]]:
        """Return the stored values of position registers [mm, deg]."""
        found = self.registers.positions.items()
        return {n: one.values for (group, n), one in found if group == self.group and one.values is not None}

    def number(self, name: Name) -> float | None:
        """Return the stored number of a register that no other program writes."""
        match name:
            case "R", int(number) if not self.registers.writer("R", number, self.name):
                return self.registers.values.get(number)
            case "PR", int(number), int(axis) if not self.registers.writer("PR", number, self.name):
                values = self.stored.get(number)
                return None if values is None else values[axis]
        return None

    def is_stored(self, code: bytes, tf: FloatArray | None, constants: tuple[float, ...] = ()) -> bool:
        """Return whether an instruction sets a frame to its stored value.

        That is the value of a register in POSREG.VA, or `constants`, X, Y, Z [mm], W, P, R [deg], that the program
        writes to the register before.
        """
        m = _FROM_REGISTER.search(code)
        values: list[float | None] = list(constants) if self.group == 1 else []
        values = values or ([self.number(("PR", int(m[1]), axis)) for axis in range(6)] if m else [])
        known = [value for value in values if value is not None]
        if tf is None or len(known) < 6:
            return False
        return bool(np.allclose(make_transform(euler("fanuc", known[3:]), known[:3]), tf, rtol=0.0, atol=_SAME))

    def later_reader(self, number: int) -> str:
        """Return who may read a position register when the program has ended; empty where nobody does."""
        if self.registers.programs:
            return self.registers.reader(number, self.name)
        return "" if self.alone else "another program (give the whole backup, or --whole-task)"


def is_macro(code: bytes) -> bool:
    """Return whether an instruction may be a macro: one of bare words that are not of the language."""
    return _BARE.fullmatch(code) is not None and not _OWN_WORDS.match(code)


def _runs(counter: Counter) -> bool:
    """Return whether a loop has constant bounds that let it turn at least once."""
    first, last, step = (evaluate(one, lambda _: UNKNOWN) for one in (counter.first, counter.last, counter.step))
    if not (isinstance(first, float) and isinstance(last, float) and isinstance(step, float)):
        return False
    return (last - first) * step >= 0.0


class RegisterFlow:
    """Tells `Derivations` what the instructions of a program do to registers.

    Parameters
    ----------
    flow : Flow
        The ways through the program.
    facts : Facts
        What is known outside of it.
    codes : iterable of bytes
        All its instructions.
    """

    def __init__(self, flow: Flow, facts: Facts, codes: Iterable[bytes]) -> None:
        cleaned = [without_comments(code, facts.group) for code in codes]
        found = [one for code in cleaned if (one := assignment_in(code))]
        numbers = {(m[1].upper(), int(m[2])) for code in cleaned for m in _NUMBERS.finditer(code)}
        self._facts, self._flow = facts, flow
        self.is_stored = facts.is_stored
        self._numeric = sorted(n for kind, n in numbers if kind == b"R")
        self._positions = sorted(n for kind, n in numbers if kind == b"PR")
        self._offsets = Offsets(found, facts.stored)
        self._arithmetic = RegisterArithmetic(self._offsets)
        follows_robot = any(b"LPOS" in code.upper() for code in cleaned)
        self._derivations = Derivations(flow)
        self._with_robot = Derivations(flow) if follows_robot else None
        """The same, where a register may also get the position at which the robot stands."""
        self._uses_registers = bool(self._positions) or any(re.search(rb"P\s*\[\s*R\s*\[", code) for code in cleaned)
        if any(MONITORED.match(code) for code in cleaned):  # a program may run between any two instructions
            for derivations in self._both():
                for name in (*self._registers(), *(("R", n) for n in self._numeric)):
                    derivations.distrust(name)
                for number in self._positions:
                    for axis in range(6):
                        derivations.distrust(("PR", number, axis))

    @property
    def used(self) -> bool:
        """Whether the program has position registers or indirect positions at all."""
        return self._uses_registers

    def assign(self, code: bytes, line: int) -> bool:
        """Take an assignment to a register; return whether the instruction is one whose register is known."""
        code = without_comments(code, self._facts.group)
        if not self._uses_registers or (one := assignment_in(code)) is None:
            return False
        if one.number is None:
            self._any_written(one, line)
            return False
        if one.kind == "R":
            self._assign(("R", one.number), self._arithmetic.number(one.value), line)
            self._read(one.value, line, "read by arithmetic")
        elif one.number in self._offsets:
            self._shift_set(one, one.number, line)
        else:
            self._position_set(one, one.number, line)
        return True

    def _any_written(self, one: Assignment, line: int) -> None:
        self._escape_all(self._arithmetic.names_in(one.value), line, "written to a register by its number")
        self._spoil({(one.kind, None)}, line)

    def _shift_set(self, one: Assignment, number: int, line: int) -> None:
        if one.axis is None:
            for axis, value in enumerate(self._arithmetic.components(one.value)):
                self._assign(("PR", number, axis), value, line)
        for axis in range(6) if one.axis == -1 else [one.axis] if one.axis is not None else []:
            value = _NOTHING if one.axis == -1 else self._arithmetic.number(one.value)
            self._assign(("PR", number, axis), value, line)

    def _position_set(self, one: Assignment, number: int, line: int) -> None:
        name = register(number)
        if one.axis is None:
            self._assign(name, self._arithmetic.position(one.value), line, point=True)
        elif one.axis in (0, 1, 2):
            self._assign(name, self._arithmetic.number(one.value), line, axis=one.axis)
        else:  # a turn
            reads = [name, *self._arithmetic.names_in(one.value)]
            self._assign(name, Opaque(tuple([Variable(read) for read in reads])), line, point=True)

    def other(self, code: bytes, line: int) -> None:
        """Take any instruction that is neither a motion nor an assignment to a register."""
        if not self._uses_registers:
            return
        code = without_comments(code, self._facts.group)
        self._read(code, line, "used by another instruction")
        self._spoil(writes_in(code), line)
        if is_macro(code):
            self._affected(self._facts.registers.macros() or ANYTHING, line, code.strip(b" ;").decode("latin-1"))

    def _read(self, code: bytes, line: int, how: str) -> None:
        """Let the positions in the registers that code names be used otherwise."""
        self._escape([name for name in self._arithmetic.names_in(code) if name in self._registers()], line, how)

    def call(self, name: str, line: int) -> None:
        """Take the call or start of another program."""
        if self._uses_registers:
            self._affected(self._facts.registers.behind([name]) or ANYTHING, line, name)

    def _affected(self, effects: Effects, line: int, who: str) -> None:
        read = [n for n in self._positions if effects.read & {n, None}]
        self._escape([register(n) for n in read if n not in self._offsets], line, f"in a register that {who} may use")
        self._spoil(set(effects.written), line)
        if effects.moves or effects.frames:
            self.moves(line)

    def end(self, line: int) -> None:
        """Take the end of the program: registers keep their values for others."""
        for number in self._positions:
            if number not in self._offsets and (who := self._facts.later_reader(number)):
                self._escape([register(number)], line, f"left in PR[{number}], which {who} may read")

    def loop(self, code: bytes, line: int) -> None:
        """Open a loop that counts."""
        m = _LOOP.fullmatch(without_comments(code, self._facts.group))
        counter = None
        if m is not None:
            first, last = self._arithmetic.number(m[2]), self._arithmetic.number(m[4])
            counter = Counter(("R", int(m[1])), first, last, Number(-1.0 if m[3] else 1.0))
        if counter is not None and self._with_robot is not None:
            self._with_robot.assign(counter.name, counter.first, line)
        self._derivations.begin_loop(counter, "FOR", line, line, runs=counter is not None and _runs(counter))

    def end_loop(self, line: int) -> None:
        """Close a loop."""
        counter = self._flow.counter
        if counter is not None and self._with_robot is not None:
            self._with_robot.assign(counter.name, Operation("+", Variable(counter.name), counter.step), line)
        self._derivations.end_loop("ENDFOR", "FOR", line)

    def goal(self, kind: str, number: int | None, given_by: int | None, shifts: bytes) -> Expression | None:
        """Return where a motion goes: to a position ("P") or register ("PR") with ``Offset,PR[n]`` and the like.

        None where this is not followed.
        """
        if _OWN_AXES.search(shifts) or (kind == "PR" and number is not None and number in self._offsets):
            return None
        found = self._arithmetic.of(Term("+", kind, number, given_by))
        for m in re.finditer(rb"(?<!\w)(Tool_)?Offset\b\s*(?:,\s*PR\s*\[\s*(\d{1,5})\s*[\]:])?", shifts, re.I):
            if not m[2] or not self._offsets.unturned(int(m[2])):
                return None
            found = Shifted(found, self._arithmetic.shift(int(m[2])), "tool" if m[1] else "frame")
        return found

    def move(self, motion: Hashable | None, goal: Expression | None, code: bytes, line: int) -> None:
        """Take a motion; without an object of its own it goes to a position of the program itself."""
        if motion is not None and goal is not None:
            inner: Expression = goal
            while isinstance(inner, Shifted):
                inner = inner.of
            itself = isinstance(inner, Variable) and inner.name == "P"
            for one in self._both():
                one.move(motion, goal, line, itself=itself)
        code = without_comments(code, self._facts.group)
        names = self._arithmetic.names_in(code if goal is None else _OFFSET.sub(b"", code))
        how = "moved to with a shift that is known at run time only" if goal is None else "used by another instruction"
        self._escape([name for name in names if name in self._registers()], line, how)
        self._spoil(writes_in(code), line)
        if self._with_robot is not None:
            stands = goal is not None and _EXACT.search(code) and not _ENDS_EARLY.search(code)
            self._with_robot.assign(HERE, goal if stands and goal is not None else _NOTHING, line, point=True)

    def moves(self, line: int) -> None:
        """Take motions, or other frames, after which the numbers of the place of the robot are not known."""
        if self._with_robot is not None:
            self._with_robot.assign(HERE, _NOTHING, line, point=True)

    def solve(self, is_point: Callable[[int], bool]) -> Derived:
        """Return what is derived; `is_point` tells whether the numbers of a position never change."""

        def known(name: Name) -> bool:
            match name:
                case "P", (int(number),):
                    return name == point(number) and is_point(number)
                case Element("P", None):  # one of them
                    return True
            return False

        found = self._derivations.solve(known, self._facts.number)
        if self._with_robot is not None:
            more = self._with_robot.solve(known, self._facts.number)
            if more.spoiled.keys() <= found.spoiled.keys():  # to read the robot's position is no use of a taught one
                return more
        return found

    def _both(self) -> list[Derivations]:
        return [one for one in (self._derivations, self._with_robot) if one is not None]

    def _assign(
        self, name: Name, value: Expression, line: int, axis: int | None = None, *, point: bool = False
    ) -> None:
        for one in self._both():
            one.assign(name, value, line, axis, point=point)

    def _escape_all(self, names: list[Name], line: int, how: str) -> None:
        for one in self._both():
            one.escape(names, line, how)

    def _registers(self) -> set[Name]:
        return {register(n) for n in self._positions if n not in self._offsets}

    def _escape(self, names: list[Name], line: int, how: str) -> None:
        if names:
            self._escape_all(names, line, how)

    def _spoil(self, written: Iterable[tuple[str, int | None]], line: int) -> None:
        """Let registers have unknown values."""
        some = set(written)
        for number in self._numeric:
            if some & {("R", number), ("R", None)}:
                self._assign(("R", number), _NOTHING, line)
        for number in self._positions:
            if not some & {("PR", number), ("PR", None)}:
                continue
            if number in self._offsets:
                for axis in range(6):
                    self._assign(("PR", number, axis), _NOTHING, line)
            else:  # it may also keep its value
                name = register(number)
                self._assign(name, Opaque((Variable(name),)), line, point=True)
