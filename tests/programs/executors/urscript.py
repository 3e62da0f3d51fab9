"""URScript executed directly: an interpreter of its text, and random programs for it.

What the manual leaves open is drawn for each run: whether ``and`` and ``or`` stop early, and whether a function inside
another sees the variables of that one or those of the program.
"""

from __future__ import annotations

import re
from collections.abc import Generator
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

STORED = {"Plane_1": (0.4, -0.2, 0.05, 0.1, -0.2, 0.7)}
"""The features of the controller."""
MOST_STEPS = 150
_TOKEN = re.compile(r"#[^\n]*|\"[^\"\n]*\"|\d+\.?\d*(?:e-?\d+)?|\.\d+|[A-Za-z_]\w*|==|!=|<=|>=|\n|[^ \t]")
_SHIFTS = {
    "force_mode": ("force", True), "end_force_mode": ("force", False), "path_offset_enable": ("path", True),
    "path_offset_disable": ("path", False), "track_conveyor_linear": ("belt", True),
    "stop_conveyor_tracking": ("belt", False),
}  # fmt: skip
_NAMED = {
    "movel": ("pose", "a", "v", "t", "r"), "movep": ("pose", "a", "v", "r"), "movej": ("q", "a", "v", "t", "r"),
    "movec": ("pose_via", "pose_to", "a", "v", "r", "mode"), "set_tcp": ("pose", "tcp_name"),
    "get_inverse_kin": ("x", "qnear", "maxPositionError", "maxOrientationError", "tcp"),
}  # fmt: skip

Pose = tuple[float, ...]


class Place(NamedTuple):
    """A pose, as a value of the program."""

    values: Pose


class Joints(NamedTuple):
    """The joints that ``get_inverse_kin`` gives for a pose, with the TCP in force there."""

    pose: Pose
    tcp: Pose | None


class Motion(NamedTuple):
    """A motion: to a pose, or to joints of the program."""

    line: int
    kind: str
    goal: Pose
    tcp: Pose | None
    shifts: frozenset[str]


class Stop(Exception):  # noqa: N818 - ends a run
    """The program stops: at its end, by ``halt`` or by an error."""


class _Leave(Exception):  # noqa: N818 - control flow
    def __init__(self, how: str, value: Any = None) -> None:
        self.how, self.value = how, value
        super().__init__(how)


def transform(pose: Pose) -> np.ndarray:
    """Return the transform (4, 4) [m] of a pose."""
    tf = np.eye(4)
    tf[:3, :3], tf[:3, 3] = Rotation.from_rotvec(pose[3:]).as_matrix(), pose[:3]
    return tf


def _pose(tf: np.ndarray) -> Place:
    return Place((*tf[:3, 3].tolist(), *Rotation.from_matrix(tf[:3, :3]).as_rotvec().tolist()))


class Syntax(Exception):  # noqa: N818 - of a text that reduction has broken
    """The text is no program."""


@dataclass
class Routine:
    """A function or thread."""

    name: str
    parameters: list[tuple[str, Any]]
    body: list[Any]
    line: int


class _Parser:
    """Statements and expressions as tuples, each with its line."""

    def __init__(self, text: str) -> None:
        self._tokens: list[tuple[str, int]] = []
        line = 1
        for m in _TOKEN.finditer(text):
            if not m[0].startswith("#"):
                self._tokens.append((m[0], line))
            line += m[0] == "\n"
        self._tokens.append(("", line))
        self._at = self._depth = 0

    def peek(self, k: int = 0) -> str:
        at = self._at
        while self._depth and self._tokens[at][0] == "\n":
            at += 1
        return self._tokens[min(at + k, len(self._tokens) - 1)][0]

    @property
    def line(self) -> int:
        return self._tokens[self._at][1]

    def take(self, wanted: str = "") -> str:
        while self._depth and self._tokens[self._at][0] == "\n":
            self._at += 1
        token = self._tokens[self._at][0]
        if (wanted and token != wanted) or not token:
            raise Syntax(f"line {self.line}: expected {wanted!r}, got {token!r}")
        self._at += 1
        self._depth += (token in "([") - (token in ")]")
        return token

    def block(self, *ends: str) -> list[Any]:
        found = []
        while (token := self.peek()) not in ends:
            if token in "\n;" and token:
                self.take()
                continue
            found.append(self.statement())
        return found

    def statement(self) -> Any:
        line, word = self.line, self.peek()
        if word in ("def", "thread"):
            self.take()
            name = self.take()
            self.take("(")
            parameters = []
            while self.peek() != ")":
                key, default = self.take(), None
                if self.peek() == "=":
                    self.take()
                    default = self.expression()
                parameters.append((key, default))
                if self.peek() == ",":
                    self.take()
            self.take(")")
            self.take(":")
            body = self.block("end", "")
            self.take("end")
            return ("def", line, Routine(name, parameters, body, line))
        if word == "if":
            branches = []
            while self.peek() in ("if", "elif"):
                self.take()
                condition = self.expression()
                self.take(":")
                branches.append((condition, self.block("elif", "else", "end", "")))
            other: list[Any] = []
            if self.peek() == "else":
                self.take()
                self.take(":")
                other = self.block("end", "")
            self.take("end")
            return ("if", line, branches, other)
        if word == "while":
            self.take()
            condition = self.expression()
            self.take(":")
            body = self.block("end", "")
            self.take("end")
            return ("while", line, condition, body)
        if word in ("break", "continue", "halt"):
            return (self.take(), line)
        if word == "return":
            self.take()
            return ("return", line, None if self.peek() in ("\n", "end", ";", "") else self.expression())
        if word == "run":
            self.take()
            return ("run", line, self.expression())
        scope = self.take() if word in ("global", "local") else ""
        start = self._at
        if re.fullmatch(r"[A-Za-z_]\w*", self.peek()):
            name, index = self.take(), None
            if self.peek() == "[" and name != "p":
                self.take()
                index = self.expression()
                self.take("]")
            if self.peek() == "=":
                self.take()
                return ("set", line, scope, name, index, self.expression())
        self._at = start
        self._depth = 0
        return ("do", line, self.expression())

    def expression(self, level: int = 0) -> Any:
        levels = (("or",), ("and",), ("not",), ("==", "!=", "<", ">", "<=", ">="), ("+", "-"), ("*",))
        if level == len(levels):
            return self.unary()
        if level == 2:
            if self.peek() == "not":
                self.take()
                return ("not", self.expression(2))
            return self.expression(3)
        left = self.expression(level + 1)
        while self.peek() in levels[level]:
            left = ("op", self.take(), left, self.expression(level + 1))
        return left

    def unary(self) -> Any:
        if self.peek() == "-":
            self.take()
            return ("op", "-", ("value", 0.0), self.unary())
        found = self.atom()
        while self.peek() == "[":
            self.take()
            found = ("item", found, self.expression())
            self.take("]")
        return found

    def atom(self) -> Any:
        line, token = self.line, self.take()
        if token == "(":
            inside = self.expression()
            self.take(")")
            return inside
        if token == "[" or (token == "p" and self.peek() == "["):
            if token == "p":
                self.take()
            parts = self.several("]")
            return ("pose" if token == "p" else "list", parts)
        if token in ("True", "False"):
            return ("value", token == "True")
        if token[0] == '"':
            return ("value", token)
        if token[0].isdigit() or token[0] == ".":
            return ("value", float(token))
        if not (token[0].isalpha() or token[0] == "_"):
            raise Syntax(f"line {line}: {token!r}")
        if self.peek() != "(":
            return ("name", token)
        self.take()
        parts = []
        while self.peek() != ")":
            key = ""
            if self.peek(1) == "=":
                key = self.take()
                self.take()
            parts.append((key, self.expression()))
            if self.peek() == ",":
                self.take()
        self.take(")")
        return ("call", line, token, parts)

    def several(self, end: str) -> list[Any]:
        parts = []
        while self.peek() != end:
            parts.append(self.expression())
            if self.peek() == ",":
                self.take()
        self.take(end)
        return parts


@dataclass
class _Frame:
    routine: Routine
    own: dict[str, Any]
    outer: _Frame | None
    routines: dict[str, tuple[Routine, _Frame]] = field(default_factory=dict)


class _Run:
    def __init__(self, seed: int) -> None:
        self._random = Random(seed)
        self._early, self._lexical = self._random.random() < 0.5, self._random.random() < 0.5
        self.trace: list[Any] = []
        self._tcp: Pose | None = None
        self._shifts: set[str] = set()
        self._steps = 0
        self._globals = _Frame(Routine("", [], [], 0), {name: Place(pose) for name, pose in STORED.items()}, None)
        self._threads: list[Generator[None]] = []

    def go(self, text: str) -> None:
        body = _Parser(text).block("")
        programs = [one[2] for one in body if one[0] == "def"]
        if len(programs) != len(body) or not programs:
            raise Syntax("expected functions")
        for one in programs:
            self._globals.routines[one.name] = one, self._globals
        self._threads.append(self._block(programs[-1].body, self._globals))
        try:
            while self._threads and self._steps < MOST_STEPS:
                k = 0 if len(self._threads) == 1 else self._random.randrange(len(self._threads))
                self._steps += 1
                try:
                    next(self._threads[k])
                except StopIteration:
                    if k == 0:
                        break
                    del self._threads[k]
        except (Stop, _Leave):
            pass
        except (TypeError, ValueError, IndexError, KeyError, AttributeError, RecursionError):
            pass  # an error stops the program

    def _find(self, name: str, frame: _Frame) -> _Frame | None:
        here: _Frame | None = frame
        if name in frame.own:
            return frame
        while self._lexical and here is not None:
            if name in here.own:
                return here
            here = here.outer
        return self._globals if name in self._globals.own else None

    def _block(self, body: list[Any], frame: _Frame) -> Generator[None]:
        for statement in body:
            if statement[0] == "def":
                frame.routines[statement[2].name] = statement[2], frame
        for statement in body:
            yield
            yield from self._statement(statement, frame)

    def _statement(self, statement: Any, frame: _Frame) -> Generator[None]:
        match statement:
            case ("if", _, branches, other):
                for condition, body in branches:
                    if (yield from self._truth(condition, frame)):
                        yield from self._block(body, frame)
                        return
                yield from self._block(other, frame)
            case ("while", _, condition, body):
                while (yield from self._truth(condition, frame)):
                    yield
                    try:
                        yield from self._block(body, frame)
                    except _Leave as leave:
                        if leave.how == "break":
                            return
                        if leave.how != "continue":
                            raise
            case (("break" | "continue") as how, _):
                raise _Leave(how)
            case ("halt", _):
                raise Stop
            case ("return", _, value):
                raise _Leave("return", None if value is None else (yield from self._value(value, frame)))
            case ("run", _, ("call", _, name, _)):
                routine, outer = self._routine(name, frame)
                self._threads.append(self._thread(routine, outer))
            case ("set", _, scope, name, index, value):
                where = self._globals if scope == "global" else frame if scope == "local" else self._find(name, frame)
                k = None if index is None else (yield from self._value(index, frame))
                found = yield from self._value(value, frame)
                if where is None:
                    where = frame
                if k is None:
                    where.own[name] = found
                    return
                before = where.own[name]
                parts = list(before.values if isinstance(before, Place) else before)
                if isinstance(before, Place) and not _is_number(found):
                    raise TypeError
                parts[_index(k)] = found
                where.own[name] = Place(tuple(parts)) if isinstance(before, Place) else tuple(parts)
            case ("do", _, value):
                yield from self._value(value, frame)

    def _thread(self, routine: Routine, outer: _Frame) -> Generator[None]:
        try:
            yield from self._block(routine.body, _Frame(routine, {}, outer))
        except _Leave as leave:
            if leave.how != "return":
                raise

    def _routine(self, name: str, frame: _Frame) -> tuple[Routine, _Frame]:
        here: _Frame | None = frame
        while here is not None:
            if name in here.routines:
                return here.routines[name]
            here = here.outer
        return self._globals.routines[name]

    def _truth(self, condition: Any, frame: _Frame) -> Generator[None, None, bool]:
        found = yield from self._value(condition, frame)
        if not isinstance(found, bool):
            raise TypeError
        return found

    def _value(self, node: Any, frame: _Frame) -> Generator[None, None, Any]:
        match node:
            case ("value", value):
                return value
            case ("name", name):
                where = self._find(name, frame)
                if where is None:
                    raise Stop
                return where.own[name]
            case (("pose" | "list") as kind, parts):
                values = []
                for part in parts:
                    values.append((yield from self._value(part, frame)))
                if kind == "pose":
                    if len(values) != 6 or not all(map(_is_number, values)):
                        raise TypeError
                    return Place(tuple(values))
                return tuple(values)
            case ("item", of, index):
                value = yield from self._value(of, frame)
                k = yield from self._value(index, frame)
                return (value.values if isinstance(value, Place) else value)[_index(k)]
            case ("not", of):
                return not (yield from self._truth(of, frame))
            case ("op", (("and" | "or") as op), left, right):
                first = yield from self._truth(left, frame)
                if self._early and first == (op == "or"):
                    return first
                second = yield from self._truth(right, frame)
                return first or second if op == "or" else first and second
            case ("op", op, left, right):
                a = yield from self._value(left, frame)
                b = yield from self._value(right, frame)
                if not (_is_number(a) and _is_number(b)):
                    raise TypeError
                if op in "+-*":
                    return a + b if op == "+" else a - b if op == "-" else a * b
                self.trace.append(("compared", a, b))
                return {"==": a == b, "!=": a != b, "<": a < b, ">": a > b, "<=": a <= b, ">=": a >= b}[op]
            case ("call", line, name, parts):
                given = []
                for key, part in parts:
                    given.append((key, (yield from self._value(part, frame))))
                try:
                    routine, outer = self._routine(name, frame)
                except KeyError:
                    return self._built_in(line, name, given)
                return (yield from self._own(routine, outer, given))
        raise TypeError

    def _own(self, routine: Routine, outer: _Frame, given: list[tuple[str, Any]]) -> Generator[None, None, Any]:
        names = [key for key, _ in routine.parameters]
        own = {key or names[k]: value for k, (key, value) in enumerate(given)}
        if len(own) != len(given) or not set(own) <= set(names):
            raise TypeError
        for key, default in routine.parameters:
            if key not in own:
                if default is None:
                    raise TypeError
                own[key] = yield from self._value(default, outer)
        try:
            yield from self._block(routine.body, _Frame(routine, own, outer))
        except _Leave as leave:
            if leave.how != "return":
                raise
            return leave.value
        return 0.0

    def _built_in(self, line: int, name: str, given: list[tuple[str, Any]]) -> Any:
        names = _NAMED.get(name, ())
        by_name = {key or names[k]: value for k, (key, value) in enumerate(given)} if names else {}
        values = [value for _, value in given]
        if name in ("movel", "movej", "movep", "movec"):
            for key in names[: 2 if name == "movec" else 1]:
                self._move(line, by_name[key])
            return 0.0
        if name == "set_tcp":
            self._tcp = by_name["pose"].values
            return True
        if name == "get_inverse_kin":
            return Joints(by_name["x"].values, self._tcp)
        if name in _SHIFTS:
            kind, begins = _SHIFTS[name]
            (self._shifts.add if begins else self._shifts.discard)(kind)
            return 0.0
        if name == "get_actual_tcp_pose":
            return Place(tuple(round(self._random.uniform(-0.3, 0.3), 4) for _ in range(6)))
        if name == "get_digital_in":
            return self._random.random() < 0.5
        if name == "read_input":
            return round(self._random.uniform(0.0, 1.0), 3)
        if name == "pose_trans":
            return _pose(transform(values[0].values) @ transform(values[1].values))
        if name == "pose_add":
            a, b = (transform(value.values) for value in values)
            a[:3, 3] += b[:3, 3]
            a[:3, :3] = a[:3, :3] @ b[:3, :3]
            return _pose(a)
        if name == "pose_inv":
            return _pose(np.linalg.inv(transform(values[0].values)))
        if name == "pose_dist":
            return float(np.linalg.norm(np.subtract(values[0].values[:3], values[1].values[:3])))
        if name == "size":
            return float(len(values[0]))
        self.trace.append((name, line, tuple(values)))  # what others see of the program
        return 0.0

    def _move(self, line: int, goal: Any) -> None:
        if isinstance(goal, Joints):
            motion = Motion(line, "pose", goal.pose, goal.tcp, frozenset(self._shifts))
            if goal.tcp != self._tcp:
                motion = motion._replace(kind="joints of another TCP")
        elif isinstance(goal, Place):
            motion = Motion(line, "pose", goal.values, self._tcp, frozenset(self._shifts))
        else:
            if len(goal) != 6 or not all(map(_is_number, goal)):
                raise TypeError
            motion = Motion(line, "joints", goal, self._tcp, frozenset(self._shifts))
        self.trace.append(motion)


def _is_number(value: Any) -> bool:
    return isinstance(value, float) and not isinstance(value, bool)


def _index(value: Any) -> int:
    if not _is_number(value) or value != int(value) or value < 0:
        raise TypeError
    return int(value)


def execute(text: str, seed: int) -> list[Any]:
    """Return what a program does: motions, comparisons, and what it hands to functions that are not its own.

    Raises
    ------
    Syntax
        If the text is no program.
    """
    run = _Run(seed)
    run.go(text)
    return run.trace
