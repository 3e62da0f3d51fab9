"""URScript (.script): poses ``p[…]`` in m and rad, which are targets only where a motion goes to them.

The frame is the robot's base. The tool is that of the last ``set_tcp(p[…])``, followed through the program. Where the
program sets none, it is the one that the user names, or that of the measurements.
"""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from truepose.errors import DataError, FileError
from truepose.geometry import euler, make_transform
from truepose.programs.core import shifts
from truepose.programs.core.flow import InForce, State
from truepose.programs.core.forms import FoundRun, RunFinder, is_run
from truepose.programs.core.points import (
    AS_MEASURED,
    JOINTS,
    Frame,
    Point,
    Problem,
    Use,
    computed,
    handed_to,
    not_understood,
    unknown_motion,
)
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Reader
from truepose.programs.core.source import Source, is_broken, parse_number, shown, strip
from truepose.programs.urscript.syntax import (
    ASSIGN,
    AT_RUN_TIME,
    BLOCK,
    INVERSE,
    KEYWORD,
    MOTION,
    NAME,
    POSE,
    ROUTINE,
    RUN,
    STRANGE,
    TAKES_POSES,
    TCP,
    VARIABLE,
    WORD,
    Statement,
    arguments,
    statements,
)

_VALUES: Final = slice(0, 6)
_KEYS: Final = ("X", "Y", "Z", "RX", "RY", "RZ")
_BASE: Final = Frame("base", 0)


class _Named(NamedTuple):
    points: list[Point]
    uses: list[tuple[Use, int]]
    reads: list[tuple[int, str]]
    writes: list[tuple[int, str]]


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read a .script file; a FileError names the line if it is broken."""
    return _Reader(Source.read(path), frames, options).read()


class _Reader(Reader):
    def __init__(self, source: Source, frames: KnownFrames, options: ReadOptions) -> None:
        super().__init__(source, frames, options)
        self._runs: list[FoundRun] = []
        self._named: dict[str, _Named] = {}
        self._inline: list[tuple[Point, Use, int]] = []
        self._goals: list[list[Point | str]] = []
        self._calls: set[str] = set()
        self._threads: list[str] = []
        self._routine = ""
        self._locals: dict[str, set[str]] = {"": set()}
        self._outer: dict[str, str] = {}
        self._assigned: list[tuple[str, int, str]] = []

    def read(self) -> Program:
        routines = self._routines()
        if not any(MOTION.search(s.code) for body in routines.values() for s in body) and not any(routines):
            raise FileError(self.source.path, "has neither a def nor a motion: it is no URScript")
        self._declare(routines)
        self._calls = set(routines)
        for name, body in routines.items():
            self._routine = name
            self.flow.begin_routine(name or "(file)", outside=name not in self._threads)
            self.body(body, self._take)
        self.flow.handlers, self.flow.concurrent = self._threads, True
        self._attach(self.flow.solve())
        circles = [[self._point(goal) for goal in circle] for circle in self._goals]
        self.circles = [[p for p in circle if p is not None] for circle in circles]
        return self.program("ur", unit=1000.0, tool=Frame(AS_MEASURED), frame=_BASE, runs=self._runs)

    def _routines(self) -> dict[str, list[Statement]]:
        """Return the statements of each routine, those of the file itself under an empty name."""
        routines: dict[str, list[Statement]] = {"": []}
        stack: list[tuple[str, str, int]] = []
        for statement in statements(self.source, RunFinder(self.source, RUN).find):
            code, line = statement.code, statement.line
            owner = next((name for kind, name, _ in reversed(stack) if kind == "def"), "")
            word = m[1] if (m := WORD.match(code)) else b""
            if m := ROUTINE.match(code):
                name = m[2].decode()
                if name in routines:
                    raise self.source.error(line, f"{name} is defined twice; give one another name")
                routines[name] = []
                self._outer[name] = owner
                self._locals[name] = {p.split(b"=")[0].strip().decode("latin-1") for p in m[3].split(b",")}
                if m[1] == b"thread":
                    self._threads.append(name)
                stack.append(("def", name, line))
            elif word == b"end" and code.strip() == b"end":
                if not stack:
                    raise self.source.error(line, "end closes nothing; correct the file")
                kind, name, _ = stack.pop()
                if kind != "def":
                    routines[owner].append(statement)
            else:
                if word in (b"if", b"while") and BLOCK.match(code):
                    stack.append((word.decode(), "", line))
                routines[owner].append(statement)
        if stack:
            kind, name, line = stack[-1]
            raise self.source.error(line, f"{kind} {name}".strip() + " has no end: the file is truncated")
        return routines

    def _key(self, name: str) -> str:
        """Return the variable that a name means here: that of the routine if it is its own, else of the program."""
        routine = self._routine
        while routine and name not in self._locals[routine]:
            routine = self._outer[routine]
        return f"{routine}.{name}" if routine else name

    def _declare(self, routines: dict[str, list[Statement]]) -> None:
        """Note the variables that hold poses; one may be used above its assignment in the text."""
        for routine, body in routines.items():
            for statement in body:
                if routine and (m := ASSIGN.match(statement.code)) and m[1] == b"local":
                    self._routine = self._outer[routine]
                    self._assigned.append((self._key(m[2].decode()), statement.line, "hidden by a local variable"))
                    self._locals[routine].add(m[2].decode())
        for self._routine, body in routines.items():
            for statement in body:
                self._assign(statement)
        for key, line, how in self._assigned:
            if key in self._named:
                self._named[key].writes.append((line, how))

    def _assign(self, statement: Statement) -> None:
        m = ASSIGN.match(statement.code)
        if m is None:
            return
        name, start = m[2].decode(), statement.start + m.end()
        end = statement.start + len(statement.code.rstrip())
        pose = None if m[3] else self._literal(name, start, end, statement.line)
        if pose is not None:
            self._named.setdefault(self._key(name), _Named([], [], [], [])).points.append(pose)
        else:
            self._assigned.append((self._key(name), statement.line, "component set" if m[3] else "assigned"))

    def _take(self, statement: Statement) -> None:
        """Take a statement, or a run of them."""
        lines = statement.run
        before = self._marks()
        self._statement(statement)
        if lines is None:
            return
        if self._marks() == (*before[:-1], before[-1] + 1):
            point = self._inline[-1][0]
            if is_run(lines, "ur", point, _VALUES):
                self._runs.append(FoundRun(lines, point, _VALUES))
                return
        for one in statements(self.source, start=statement.end, end=lines.end):
            self._statement(one)

    def _marks(self) -> tuple[int, ...]:
        """Return how much has been read, to see what a statement adds; the last is the number of inline poses."""
        return self.flow.node, len(self.points), len(self._goals), len(self._inline)

    def _statement(self, statement: Statement) -> None:
        code, line, routines = statement.code, statement.line, self._calls
        block = m[1] if (m := BLOCK.match(code)) else b""
        word = m[1] if (m := WORD.match(code)) else b""
        flow = self.flow
        if block in (b"elif", b"else"):
            flow.branch("ELSE", last=block == b"else")
        assigned = ASSIGN.match(code)
        pose_name = assigned is not None and self._key(assigned[2].decode()) in self._named
        masked = bytearray(code)
        if pose_name and assigned is not None:
            masked[: assigned.end()] = b" " * assigned.end()
        if TCP.search(code):
            self._tcp(statement)
        for m in MOTION.finditer(code):
            self._motion(m, statement, masked)
        shifts.follow(flow, shifts.UR, code, line)
        strange = STRANGE.search(code)
        if (m := strange) and m[1].decode() not in routines and not MOTION.match(code, m.start()):
            self.other(m[1].decode(), line, unknown_motion(shown(code)))
        # the v of movel(p, v=0.25) is no variable
        for m in NAME.finditer(KEYWORD.sub(lambda found: b" " * len(found[0]), bytes(masked))):
            name = m[1].decode()
            if m[2]:
                if name in self._threads:
                    flow.start(name)
                elif name in routines:
                    flow.call(name, "")
                if name in routines or not (strange or TAKES_POSES.fullmatch(name) or MOTION.match(code, m.start())):
                    self._handed(name, statement, m.end(), masked)
            elif self._key(name) in self._named:
                self._named[self._key(name)].reads.append((line, "read by arithmetic"))
        if block in (b"if", b"while"):
            flow.begin(block.decode().upper(), line)
        elif word == b"end" and code.strip() == b"end":
            opener = flow.innermost
            flow.end("end", opener)
        elif word == b"break":
            flow.exit()
        elif word in (b"return", b"halt"):
            flow.leave()

    def _handed(self, name: str, statement: Statement, start: int, masked: bytearray) -> None:
        """List the poses that are arguments of a function that the language does not have: it may move there."""
        for k, (a, b) in enumerate(arguments(bytes(masked), start), 1):
            argument = masked[a:b].decode("latin-1")
            if (key := self._key(argument)) in self._named:
                self._named[key].reads.append((statement.line, f"handed to {name}()"))
            elif re.search(r"(?<!\w)p\s*\[", argument):
                self.other(name, statement.line, handed_to(name), f"{name}:{statement.line} argument {k}")

    def _tcp(self, statement: Statement) -> None:
        code = statement.code
        m = TCP.search(code)
        assert m is not None
        spans = arguments(code, m.end())
        value = InForce("unknown", f"set_tcp({shown(code[m.end() :])} (line {statement.line})")
        if spans and POSE.match(code, spans[0][0]):
            start, end = (statement.start + k for k in spans[0])
            pose = self._literal("set_tcp", start, end, statement.line)
            if pose is not None and pose.values:
                text = self.source.data[start:end].decode("latin-1")
                value = InForce("literal", f"set_tcp({text})", None, pose.values)
        self.flow.change(tool=value)

    def _motion(self, m: re.Match[bytes], statement: Statement, masked: bytearray) -> None:
        word, code, line = m[1].decode(), statement.code, statement.line
        spans = arguments(code, m.end())
        if word in AT_RUN_TIME:
            self.other(word, line, Problem("skip", f"{word}: followed at run time"))
            return
        goals = 2 if word == "movec" else 1
        if len(spans) < goals or any(a == b for a, b in spans[:goals]):
            self.other(word, line, not_understood(shown(code)))
            return
        found: list[Point | str] = []
        for k, (a, b) in enumerate(spans[:goals]):
            name = f"{word}:{line}" + ("" if goals == 1 else (" via", " end")[k])
            if inverse := INVERSE.match(code, a, b):  # only chooses the branch near qnear
                inner = arguments(code, inverse.end())
                a, b = inner[0] if inner else (a, b)
            found.append(self._goal(name, word, statement, a, b, masked))
        if goals == 2:
            self._goals.append(found)

    def _goal(self, name: str, word: str, statement: Statement, a: int, b: int, masked: bytearray) -> Point | str:
        line, text = statement.line, statement.code[a:b]
        use = self.use(word, line, None, _BASE)
        variable = self._key(text.decode("latin-1"))
        if variable in self._named:
            masked[a:b] = b" " * (b - a)
            self._named[variable].uses.append((use, self.flow.node))
            return variable
        if VARIABLE.fullmatch(text) and "." in variable:
            return self.other(word, line, Problem("skip", f"{shown(text)} is known at run time only"), name)
        if POSE.match(text):
            pose = self._literal(name, statement.start + a, statement.start + b, line)
            if pose is not None:
                self._inline.append((pose, use, self.flow.node))
                return pose
        if text.startswith(b"["):
            return self.other(word, line, JOINTS, name)
        return self.other(word, line, computed(shown(text)), name)

    def _literal(self, name: str, start: int, end: int, line: int) -> Point | None:
        """Return the pose of ``p[…]`` that fills the span; None if it is anything else."""
        data = self.source.data
        m = POSE.match(data, start, end)
        if m is None or data[end - 1 : end] != b"]" or b"]" in data[m.end() : end - 1]:
            return None
        cuts = [m.end() - 1, *(m.end() + k for k, c in enumerate(data[m.end() : end - 1]) if c == 0x2C), end - 1]
        spans = [strip(data, a + 1, b) for a, b in itertools.pairwise(cuts)]
        if len(spans) != 6:
            raise self.source.error(line, f"{name}: a pose has 6 numbers, this has {len(spans)}; correct the file")
        line = self.source.line(spans[0][0])
        values = []
        for key, (a, b) in zip(_KEYS, spans, strict=True):
            token = data[a:b]
            if b"{{" not in token and is_broken(token):
                raise self.source.error(line, f"{name}: {key} {shown(token)!r} is not a number; correct the file")
            try:
                values.append(parse_number(token))
            except ValueError as error:
                if (len(token) > 40 and token[:20].isdigit()) or "beyond" in str(error):
                    raise self.source.error(line, f"{name}: {key}: {error}; correct the file") from None
                return Point(
                    name, self.source, line, problem=Problem("skip", f"{key}: an expression, known at run time only")
                )
        try:
            euler("ur", values[3:])
        except DataError as error:
            raise self.source.error(line, f"{name}: {error}") from None
        return Point(name, self.source, line, tuple(values), tuple(spans))

    def _attach(self, ambient: State) -> None:
        in_runs = {id(run.point) for run in self._runs}
        for point, use, node in self._inline:
            point.uses.append(self._with_tool(use, node, ambient))
            if id(point) not in in_runs:
                self.points.append(point)
        for known in self._named.values():
            if not known.uses and not known.reads:
                continue  # a pose that no motion goes to: a feature, a wrench, a speed
            if len(known.points) > 1:
                known.writes.append((known.points[1].line, "assigned again"))
            for point in known.points:
                handed = any(how.startswith("handed") for _, how in known.reads)
                point.uses += [self._with_tool(use, node, ambient) for use, node in known.uses]
                point.reads += known.reads if known.uses or handed else []
                point.writes += known.writes
                if known.uses or handed:
                    self.points.append(point)

    def _with_tool(self, use: Use, node: int, ambient: State) -> Use:
        if problem := shifts.problem_of(self.flow.states[node].shifts | ambient.shifts):
            return use._replace(problem=problem)
        values = self.flow.states[node].tool | ambient.tool
        if len(values) > 1:
            shown = " or ".join(sorted(value.text for value in values)[:2])
            return use._replace(problem=Problem("refuse", f"the TCP depends on the way through the program: {shown}"))
        for value in values:
            if value.pose is not None:
                tf = make_transform(euler("ur", value.pose[3:]), 1000.0 * np.array(value.pose[:3]))
                return use._replace(tool=Frame(value.text, None, tf.tobytes()))
            if value.kind == "unknown":
                return use._replace(problem=Problem("refuse", f"the TCP is known at run time only: {value.text}"))
        return use

    def _point(self, goal: Point | str) -> Point | None:
        return goal if isinstance(goal, Point) else self._named[goal].points[0]
