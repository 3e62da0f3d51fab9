"""KRL programs as trees, their text, and a controller that runs them.

The subset has what changes points, frames and modes: assignments, calls with parameters by value (IN) and by reference
(OUT), functions with effects, branches, loops, interrupts with RESUME, triggers, FDATs, WITH and sensors. Motions do
not overlap with what follows, interrupts come between two statements, and a program that would stop with an error
stops.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

import numpy as np

from truepose.geometry import euler, make_transform

KEYS = ("X", "Y", "Z", "A", "B", "C")
TOOLS = {n: (5.0 * n, -3.0, 150.0, 10.0 * n, 20.0, -30.0) for n in (1, 2)}
BASES = {n: (900.0, 100.0 * n, 40.0, 30.0 * n, -15.0, 5.0) for n in (1, 2)}
MOST_STEPS = 120


@dataclass(eq=False)
class Literal:
    """Six coordinates, each a number or an expression, with the place of the first one: the file and the byte."""

    parts: list[Any]
    place: tuple[str, int] = ("", -1)


@dataclass(eq=False)
class Statement:
    """A statement by its kind, what it needs, and the statements in it; `line` is set when it is written."""

    kind: str
    data: tuple[Any, ...] = ()
    blocks: list[list[Statement]] = field(default_factory=list)
    line: int = 0


@dataclass(eq=False)
class Routine:
    """A routine with its parameters (name, IN or OUT, type) and variables; one that returns a type is a function."""

    name: str
    parameters: list[tuple[str, str, str]]
    body: list[Statement]
    returns: str = ""
    variables: list[tuple[str, str]] = field(default_factory=list)


@dataclass(eq=False)
class Program:
    """The points of the data list by name (None: no value), their FDATs (tool, base), and the routines."""

    points: dict[str, list[Literal | None]]
    fdats: dict[str, tuple[int, int, str]]
    routines: list[Routine]

    def literals(self) -> Iterator[Literal]:
        """Yield the literals that the text has."""
        for values in self.points.values():
            yield from filter(None, values)
        for routine in self.routines:
            yield from _literals(routine.body)


def _literals(found: Any) -> Iterator[Literal]:
    if isinstance(found, Literal):
        yield found
        yield from _literals(found.parts)
    elif isinstance(found, Statement):
        yield from _literals(found.data)
        yield from _literals(found.blocks)
    elif isinstance(found, (list, tuple)):
        for one in found:
            yield from _literals(one)


class Writer:
    """Writes the files of a program; with `split`, all routines but the first are in a module of their own."""

    def __init__(self, program: Program, *, split: bool = False) -> None:
        self.files: dict[str, str] = {}
        self._split = split
        self._begin("cell.src")
        for routine in program.routines:
            if split and routine is program.routines[1]:
                self._end()
                self._begin("other.src")
                self._line("DEF OTHER()")
                self._line("END")
            head = ",".join(f"{name}:{way}" for name, way, _ in routine.parameters)
            kind = "GLOBAL " * (split and routine is not program.routines[0])
            kind += f"DEFFCT {routine.returns}" if routine.returns else "DEF"
            self._line(f"{kind} {routine.name}({head})")
            for name, kind in [(name, kind) for name, _, kind in routine.parameters] + routine.variables:
                self._line(f"DECL {kind} {name}")
            self._block(routine.body)
            self._line("ENDFCT" if routine.returns else "END")
        self._end()
        self._begin("cell.dat")
        self._line("DEFDAT CELL PUBLIC" if split else "DEFDAT CELL")
        declare = "DECL GLOBAL" if split else "DECL"
        for name, values in program.points.items():
            kind = "FRAME" if name.startswith("F") else "E6POS"
            if len(values) > 1:
                self._line(f"{declare} {kind} {name}[{len(values)}]")
                for k, value in enumerate(values, 1):
                    if value is not None:
                        self._line(f"{name}[{k}]=", value)
            elif values[0] is None:
                self._line(f"{declare} {kind} {name}")
            else:
                self._line(f"{declare} {kind} {name}=", values[0])
        for name, (tool, base, mode) in program.fdats.items():
            self._line(f"{declare} FDAT {name}={{TOOL_NO {tool},BASE_NO {base},IPO_FRAME #{mode}}}")
        for text in ("REAL H=15.0", "INT N=0", "INT K[2]"):
            self._line(f"{declare} {text}")
        for text in ("K[1]=1", "K[2]=2", "ENDDAT"):
            self._line(text)
        self._end()

    def _begin(self, file: str) -> None:
        self._file, self._lines, self._at = file, list[str](), 0

    def _end(self) -> None:
        self.files[self._file] = "\n".join(self._lines) + "\n"

    def _line(self, *parts: Any) -> int:
        """Write a line of texts, expressions and literals; return its number."""
        text = ""
        for part in parts:
            text += part if isinstance(part, str) else self._expression(part, self._at + len(text))
        self._lines.append(text)
        self._at += len(text) + 1
        return len(self._lines)

    def _expression(self, found: Any, at: int = 0) -> str:
        if isinstance(found, Literal):
            text = "{"
            for key, part in zip(KEYS, found.parts, strict=True):
                text += f"{key} "
                found.place = (self._file, at + len(text)) if key == "X" else found.place
                text += f"{part}" if isinstance(part, float) else self._expression(part)
                text += "," if key != "C" else "}"
            return text
        kind, *data = found
        match kind:
            case "number" | "variable" | "point":
                return str(data[0])
            case "element":
                return f"{data[0]}[{self._expression(data[1])}]"
            case "coordinate":
                return f"{self._expression(data[0])}.{KEYS[data[1]]}"
            case "operation":
                return f"{self._expression(data[1])}{data[0]}{self._expression(data[2])}"
            case "call":
                return f"{data[0]}({','.join(map(self._expression, data[1]))})"
            case "input":
                return f"$IN[{data[0]}]"
            case "entry":
                return f"BASE_DATA[{data[0]}]"
            case "compare":
                return f"{self._expression(data[0])}>{self._expression(data[1])}"
            case "shifted":
                left = self._expression(data[0], at)
                return f"{left}:{self._expression(data[1], at + len(left) + 1)}"
        raise AssertionError(found)

    def _block(self, statements: list[Statement]) -> None:
        for one in statements:
            self._statement(one)

    def _statement(self, one: Statement) -> None:
        d = one.data
        match one.kind:
            case "tool" | "base":
                name = one.kind.upper()
                one.line = self._line(f"BAS(#{name},{d[0]})" if d[1] else f"${name}={name}_DATA[{d[0]}]")
            case "base is":
                one.line = self._line("$BASE=", d[0])
            case "entry":
                one.line = self._line(f"BASE_DATA[{d[0]}].{KEYS[d[1]]}=", d[2])
            case "fdat":
                one.line = self._line(f"FDAT_ACT={d[0]}")
            case "fdat number":
                one.line = self._line(f"{d[0]}.{d[1]}_NO={d[2]}")
            case "goto":
                one.line = self._line(f"GOTO {d[0]}")
            case "label":
                one.line = self._line(f"{d[0]}:")
            case "spline":
                one.line = self._line("SPLINE", *self._settings(d[0]))
                self._block(one.blocks[0])
                self._line("ENDSPLINE")
            case "frames":
                one.line = self._line("BAS(#CP_PARAMS,0.5)")
            case "mode":
                one.line = self._line(f"$IPO_MODE=#{d[0]}")
            case "sensor":
                one.line = self._line(f"RSI_{d[0]}()")
            case "move":
                word, goals, more = d
                parts: list[Any] = [f"{word} ", goals[0]]
                parts += [", ", goals[1]] if len(goals) > 1 else []
                parts += [", CA ", more[1]] if more and more[0] == "angle" else self._settings(more)
                one.line = self._line(*parts)
            case "relative":
                one.line = self._line("LIN_REL {Z ", d[0], "}")
            case "set":
                one.line = self._line(d[0], "=", d[1])
            case "output":
                one.line = self._line("$ANOUT[1]=", d[0])
            case "call":
                one.line = self._line(("call", *d))
            case "return":
                one.line = self._line("RETURN", *([" ", d[0]] if d else []))
            case "resume" | "exit":
                one.line = self._line(one.kind.upper())
            case "if":
                one.line = self._line("IF ", d[0], " THEN")
                self._block(one.blocks[0])
                if len(one.blocks) > 1:
                    self._line("ELSE")
                    self._block(one.blocks[1])
                self._line("ENDIF")
            case "switch":
                one.line = self._line("SWITCH ", d[0])
                for k, block in enumerate(one.blocks, 1):
                    self._line(f"CASE {k}")
                    self._block(block)
                self._line("ENDSWITCH")
            case "for":
                one.line = self._line("FOR N=", d[0], " TO ", d[1])
                self._block(one.blocks[0])
                self._line("ENDFOR")
            case "while":
                one.line = self._line("WHILE ", d[0])
                self._block(one.blocks[0])
                self._line("ENDWHILE")
            case "repeat":
                one.line = self._line("REPEAT")
                self._block(one.blocks[0])
                self._line("UNTIL ", d[0])
            case "loop":
                one.line = self._line("LOOP")
                self._block(one.blocks[0])
                self._line("ENDLOOP")
            case "interrupt":
                condition, handler, everywhere = d
                words = "GLOBAL " * everywhere + "INTERRUPT DECL 4 WHEN "
                one.line = self._line(words, condition, f" DO {handler}()")
                self._line("INTERRUPT ON 4")
            case "trigger":
                delay, handler = d
                one.line = self._line("TRIGGER WHEN DISTANCE=0 DELAY=", delay, f" DO {handler}() PRIO=-1")
            case _:
                raise AssertionError(one.kind)

    def _settings(self, more: Any) -> list[Any]:
        """Return the settings of a motion or of a spline block."""
        if not more:
            return []
        kind, value = more
        if kind == "mode":
            return [f" WITH $IPO_MODE=#{value}"]
        if kind in ("tool", "entry"):
            return [" WITH $TOOL=TOOL_DATA" if kind == "tool" else " WITH $BASE=BASE_DATA", f"[{value}]"]
        return [" WITH $BASE=" if kind == "base" else " WITH $VEL.CP=", value]


class Event(NamedTuple):
    """What a run does: a motion with its goals and what is in force, or an output, and the line."""

    line: int
    word: str
    values: tuple[Any, ...]
    tool: Any = None
    base: Any = None
    plain: bool = True


class Stop(Exception):  # noqa: N818 - ends a run, a routine or a loop
    """The end of a run (an error), of a routine, of a loop, or of all routines that a handler aborts."""

    def __init__(self, kind: str, value: Any = None) -> None:
        super().__init__(kind)
        self.kind, self.value = kind, value


class Box:
    """A variable: a number, six coordinates, or a list of these; None without a value."""

    def __init__(self, value: Any) -> None:
        self.value = value


class Part:
    """A variable that is a part of another one, or of a table."""

    def __init__(self, whole: Any, key: Any) -> None:
        self._whole, self._key = whole, key

    @property
    def value(self) -> Any:
        """The value of the part."""
        return self._whole[self._key]

    @value.setter
    def value(self, value: Any) -> None:
        self._whole[self._key] = value


class Call:
    """A routine that runs, with its own variables and the interrupts that it declared."""

    def __init__(self, boxes: dict[str, Any]) -> None:
        self.boxes = boxes
        self.handlers: list[tuple[Any, str, bool]] = []


class Machine:
    """A controller. `shift` gives the literals that have other numbers in this run."""

    def __init__(self, program: Program, shift: dict[int, np.ndarray] | None = None) -> None:
        self.program, self._shift = program, shift or {}
        self._routines = {routine.name: routine for routine in program.routines}
        self.boxes = {
            name: Box(values if len(values := [self._numbers(one) for one in given]) > 1 else values[0])
            for name, given in program.points.items()
        }
        self.boxes |= {"H": Box(15.0), "N": Box(0), "K": Box([1, 2])}
        self.entries = {n: np.array(values) for n, values in BASES.items()}
        self.fdats: dict[str, Any] = {
            name: {"TOOL": tool, "BASE": base, "IPO": mode} for name, (tool, base, mode) in program.fdats.items()
        }
        self.events: list[Event] = []

    def run(self, dice: Random) -> None:
        """Run the first routine once, with what the runs before left in the data list."""
        self._dice, self._steps, self._calls = dice, 0, list[Call]()
        self.tool: Any = None
        self.base: Any = None
        self._mode, self._sensor, self._block_settings = "BASE", False, ()
        self.fdats["FDAT_ACT"] = None
        self._pending, self._armed = list[str](), list[str]()
        self._interrupted = 0
        try:
            self._call(self.program.routines[0], [])
        except Stop as stop:
            self.events.append(Event(0, stop.kind, ()))

    def _numbers(self, literal: Literal | None) -> Any:
        if literal is None or not all(isinstance(part, float) for part in literal.parts):
            return None
        return np.array(literal.parts) + self._shift.get(id(literal), np.zeros(6))

    # expressions

    def _box(self, name: str) -> Box:
        return self._calls[-1].boxes.get(name) or self.boxes[name]

    def _value(self, found: Any) -> Any:
        if isinstance(found, Literal):
            numbers = self._numbers(found)
            return np.array([self._number(part) for part in found.parts]) if numbers is None else numbers
        kind, *data = found
        match kind:
            case "number":
                return data[0]
            case "variable" | "point":
                value = self._box(data[0]).value
                if value is None:
                    raise Stop("no value")
                return value
            case "element":
                index, values = self._number(data[1]), self._box(data[0]).value
                if index != int(index) or not 1 <= index <= len(values):
                    raise Stop("index")
                if values[int(index) - 1] is None:
                    raise Stop("no value")
                return values[int(index) - 1]
            case "coordinate":
                return float(self._value(data[0])[data[1]])
            case "operation":
                a, b = self._number(data[1]), self._number(data[2])
                return a + b if data[0] == "+" else a - b if data[0] == "-" else a * b
            case "call":
                return self._call(self._routines[data[0]], data[1])
            case "input":
                return self._dice.random() < 0.5
            case "entry":
                return self.entries[data[0]]
            case "compare":
                return self._number(data[0]) > self._number(data[1])
            case "shifted":
                return _compose(self._value(data[0]), self._value(data[1]))
        raise AssertionError(found)

    def _number(self, found: Any) -> Any:
        if isinstance(found, float):
            return found
        value = self._value(found)
        if value is None:
            raise Stop("no value")
        return value

    def _set(self, place: Any, value: Any) -> None:
        kind, name, *data = place
        match kind:
            case "variable":
                self._box(name).value = int(np.floor(value + 0.5)) if name == "N" else value
            case "point":
                self._box(name).value = np.array(value)
            case "element":
                values = self._box(name).value
                index = self._number(data[0])
                if index != int(index) or not 1 <= index <= len(values):
                    raise Stop("index")
                values[int(index) - 1] = np.array(value)
            case "coordinate":
                old = self._value(name).copy()
                old[data[0]] = value
                self._set(name, old)

    # routines

    def _call(self, routine: Routine, arguments: Any) -> Any:
        boxes: dict[str, Any] = {name: Box(None) for name, _ in routine.variables}
        for (name, way, _), given in zip(routine.parameters, arguments, strict=True):
            kind = "" if isinstance(given, Literal) or way == "IN" else given[0]
            value = None if kind in ("variable", "point") else self._value(given)
            if kind in ("variable", "point"):
                boxes[name] = self._box(given[1])
            elif kind == "element":
                boxes[name] = Part(self._box(given[1]).value, int(self._number(given[2])) - 1)
            elif kind == "entry":
                boxes[name] = Part(self.entries, given[1])
            else:
                boxes[name] = Box(value.copy() if isinstance(value, np.ndarray) else value)
        if len(self._calls) > 12:
            raise Stop("too deep")
        self._calls.append(Call(boxes))
        depth, settings = len(self._calls), self._block_settings
        self._block_settings = ()
        start: int | None = 0
        try:
            while start is not None:
                start = self._from(routine.body, start)
        except Stop as stop:
            if stop.kind != "return":
                raise
            return stop.value
        finally:
            self._block_settings = settings
            del self._calls[depth - 1 :]
        return None

    def _from(self, body: list[Statement], start: int) -> int | None:
        """Run a routine from a statement on; return where to go on after GOTO, or None at the end."""
        try:
            self._block(body[start:])
        except Stop as stop:
            if stop.kind != "goto":
                raise
            self._tick()
            labels = [one.data[0] if one.kind == "label" else "" for one in body]
            if stop.value not in labels:
                raise Stop("no label") from None
            return labels.index(stop.value)
        return None

    def _block(self, statements: list[Statement]) -> None:
        for one in statements:
            depth, interrupted = len(self._calls), self._interrupted
            try:
                self._interrupt()
                self._take(one)
            except Stop as stop:
                if stop.kind != "resume" or stop.value is not self._calls[depth - 1]:
                    raise
                del self._calls[depth:]  # goes on behind the call that was aborted
                self._interrupted = interrupted

    def _interrupt(self) -> None:
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise Stop("too long")
        while self._armed and self._dice.random() < 0.6:
            self._call(self._routines[self._armed.pop()], [])
        if self._interrupted:
            return
        for owner in self._calls:
            for condition, handler, _ in owner.handlers:
                if self._dice.random() < 0.15 and self._holds(condition):
                    self._interrupted += 1
                    self._owner, self._depth = owner, len(self._calls)
                    self._call(self._routines[handler], [])
                    self._interrupted -= 1

    def _holds(self, condition: Any) -> bool:
        return bool(self._value(condition)) if condition[0] != "input" else True

    # statements

    def _take(self, one: Statement) -> None:
        d = one.data
        match one.kind:
            case "tool":
                self.tool = np.array(TOOLS[d[0]])
            case "base":
                self.base = self.entries[d[0]].copy()
            case "base is":
                self.base = self._value(d[0]).copy()
            case "entry":
                self.entries[d[0]][d[1]] = self._number(d[2])
            case "fdat":
                self.fdats["FDAT_ACT"] = dict(self.fdats[d[0]])
            case "fdat number":
                if self.fdats[d[0]] is None:
                    raise Stop("no FDAT")
                self.fdats[d[0]][d[1]] = d[2]
            case "frames":
                if (fdat := self.fdats["FDAT_ACT"]) is None:
                    raise Stop("no FDAT")
                self.tool, self.base = np.array(TOOLS[fdat["TOOL"]]), self.entries[fdat["BASE"]].copy()
                self._mode = fdat["IPO"]
            case "goto":
                raise Stop("goto", d[0])
            case "label":
                pass
            case "spline":
                self._block_settings = d[0]
                if d[0] and d[0][0] not in ("tool", "entry", "mode"):
                    self._value(d[0][1])
                self._block(one.blocks[0])
                self._block_settings = ()
            case "mode":
                self._mode = d[0]
            case "sensor":
                self._sensor = d[0] == "ON"
            case "move":
                self._move(one.line, *d)
            case "relative":
                self.events.append(Event(one.line, "LIN_REL", (self._number(d[0]),)))
            case "set":
                self._set(d[0], self._value(d[1]))
            case "output":
                self.events.append(Event(one.line, "output", (self._number(d[0]),)))
            case "call":
                self._value(("call", *d))
            case "return":
                raise Stop("return", self._value(d[0]) if d else None)
            case "resume":
                if not self._interrupted or self._owner is self._calls[self._depth - 1]:
                    raise Stop("RESUME at a wrong place")
                raise Stop("resume", self._owner)
            case "exit":
                raise Stop("exit")
            case "if":
                if self._value(d[0]):
                    self._block(one.blocks[0])
                elif len(one.blocks) > 1:
                    self._block(one.blocks[1])
            case "switch":
                value = self._number(d[0])
                for k, block in enumerate(one.blocks, 1):
                    if value == k:
                        self._block(block)
                        break
            case "for" | "while" | "repeat" | "loop":
                self._loop(one)
            case "interrupt":
                (self._calls[0] if d[2] else self._calls[-1]).handlers.append(d)
            case "trigger":
                self._number(d[0])
                self._pending.append(d[1])

    def _loop(self, one: Statement) -> None:
        try:
            if one.kind == "for":
                first, last = self._number(one.data[0]), self._number(one.data[1])
                self._set(("variable", "N"), first)
                while self.boxes["N"].value <= last:
                    self._block(one.blocks[0])
                    self.boxes["N"].value += 1
                    self._tick()
            while one.kind == "loop" or (one.kind == "while" and self._value(one.data[0])):
                self._block(one.blocks[0])
                self._tick()
            while one.kind == "repeat":
                self._block(one.blocks[0])
                self._tick()
                if self._value(one.data[0]):
                    break
        except Stop as stop:
            if stop.kind != "exit":
                raise

    def _tick(self) -> None:
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise Stop("too long")

    def _move(self, line: int, word: str, goals: Any, more: Any) -> None:
        values = [np.array(self._value(goal)) for goal in goals]
        tool, base, mode, extra = self.tool, self.base, self._mode, ()
        for kind, value in [one for one in (self._block_settings, more) if one]:
            if kind in ("velocity", "angle"):
                extra = (self._number(value),)
            elif kind == "base":
                base = self._value(value)
            elif kind == "entry":
                base = self.entries[value]
            elif kind == "tool":
                tool = np.array(TOOLS[value])
            else:
                mode = value
        frames = [None if one is None else np.array(one) for one in (tool, base)]
        self.events.append(Event(line, word, (*values, *extra), *frames, mode == "BASE" and not self._sensor))
        self._armed += self._pending  # triggers act from here on, perhaps later than what follows
        self._pending = []


def _compose(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    tf = transform(left) @ transform(right)
    angles = euler("kuka", left[3:]) * euler("kuka", right[3:])
    return np.concatenate([tf[:3, 3], angles.as_euler("ZYX", degrees=True)])


def transform(values: Any) -> np.ndarray:
    """Return the transform of six coordinates."""
    return make_transform(euler("kuka", values[3:]), values[:3])
