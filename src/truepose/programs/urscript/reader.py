"""URScript (.script): poses ``p[…]`` in m and rad, which are targets only where a motion goes to them.

The frame is the robot's base. The tool is that of the last ``set_tcp(p[…])``, followed through the program. Where the
program sets none, it is the one that the user names, or that of the measurements.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.geometry import invert_transform
from truepose.programs.core import shifts
from truepose.programs.core.forms import FoundRun, is_run
from truepose.programs.core.judge import NotCorrected
from truepose.programs.core.points import (
    JOINTS,
    Derived,
    Frame,
    Point,
    Problem,
    Use,
    computed,
    derive,
    handed_to,
    not_understood,
    unknown_motion,
)
from truepose.programs.core.program import KnownFrames, Program, ReadOptions, frame_key
from truepose.programs.core.reader import Reader
from truepose.programs.core.source import NotAProgramError, Source, Span, shown
from truepose.programs.core.state import InForce, State
from truepose.programs.urscript.declarations import Declarations
from truepose.programs.urscript.poses import (
    INVERSE,
    Inverse,
    Join,
    Literal,
    Pose,
    Unknown,
    has_literal,
    keys,
    read_joints,
    transform,
)
from truepose.programs.urscript.routines import Routines
from truepose.programs.urscript.syntax import (
    ARGUMENT,
    ASSIGN,
    AT_RUN_TIME,
    BLOCK,
    COUNT,
    KEYWORD,
    MOTION,
    NAME,
    SHORTENED,
    STRANGE,
    TAKES_POSES,
    WORD,
    Statement,
    arguments,
    calls,
    statements,
)
from truepose.programs.urscript.variables import READ, Variable, Variables, Way, is_followed

_VALUES: Final = slice(0, 6)
_BASE: Final = Frame("base", 0)


@dataclass(slots=True)
class _Goal:
    """A motion to a pose that is not written in it, and its places in the flow: also where joints are computed."""

    pose: Pose
    use: Use
    line: int
    nodes: list[int]
    name: str
    points: list[Point] = field(default_factory=list)


class _Passed(NamedTuple):
    """What a call passes to a function of the program; `key` is that of the parameter."""

    key: str
    pose: Pose
    use: Use
    line: int
    function: str
    name: str


def read(
    path: Path, frames: KnownFrames, options: ReadOptions, *, installations: Mapping[str, object] | None = None
) -> Program:
    """Read a .script file; a FileError names the line if it is broken.

    `installations` are for .urp programs; scripts see their features by name, and those are in `frames`.
    """
    return _Reader(Source.read(path), frames, options).read()


class _Reader(Reader):
    def __init__(self, source: Source, frames: KnownFrames, options: ReadOptions) -> None:
        super().__init__(source, frames, options)
        self._runs: list[FoundRun] = []
        self._inline: list[tuple[Point, Use, list[int]]] = []
        self._goals: list[_Goal] = []
        self._arcs: list[list[Point | _Goal]] = []
        self._passed: list[_Passed] = []
        self._tcps: dict[Pose, int] = {}
        self._nested: list[int] = []
        self._started: dict[str, None] = {}
        self._routines = Routines(source)
        self._variables = Variables(self._routines.own, self._stored_base)
        self._declared = Declarations(source, self._routines, self._variables)

    def read(self) -> Program:
        routines = self._routines.bodies
        if not any(MOTION.search(s.code) for body in routines.values() for s in body) and not any(routines):
            raise NotAProgramError(self.source.path, "has neither a def nor a motion: it is no URScript")
        called = self._routines.called()
        for name, body in routines.items():
            self.flow.begin_routine(name or "(file)", outside=name not in called)
            self._take_defaults(name)
            self._routines.current = name
            self.body(body, self._leave if name in self._routines.replaced else self._take)
        self.flow.handlers, self.flow.concurrent = list(self._started), True
        self._attach(self.flow.solve())
        arcs = [[[one] if isinstance(one, Point) else one.points for one in arc] for arc in self._arcs]
        self.circles = [[point for points in arc for point in points] for arc in arcs]
        return self.program("ur", unit=1000.0, frame=_BASE, runs=self._runs)

    def _stored_base(self, name: str) -> FloatArray | None:
        """Return a base that the controller stores; programs see it under its name."""
        tf = self.frames.bases.get(frame_key(name))
        return None if tf is None else invert_transform(self.frames.bases[0]) @ tf

    def _leave(self, statement: Statement) -> None:
        """List the motions of a function that another definition replaces."""
        end = statement.end if statement.run is None else statement.run.end
        for one in statements(self.source, start=statement.start, end=end):
            for m in MOTION.finditer(one.code):
                again = f"{self._routines.current} is defined again below, and the controller takes that definition"
                self.other(m[1].decode(), one.line, Problem("skip", again))

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

    def _take_defaults(self, name: str) -> None:
        """Take the expressions that parameters of a routine have by default: calls may need them, or not."""
        self._routines.current = self._routines.outer.get(name, "")
        for default in self._routines.defaults[name]:
            self.flow.begin("IF", default.line)
            self._evaluate(default)
            self.flow.end("IF", "IF")

    def _marks(self) -> tuple[int, ...]:
        """Return how much has been read, to see what a statement adds; the last is the number of inline poses."""
        return self.flow.node, len(self.points), len(self._goals), len(self._arcs), len(self._passed), len(self._inline)

    def _statement(self, statement: Statement) -> None:
        if statement.start in self._declared.adjusted:
            return
        code, line, flow = statement.code, statement.line, self.flow
        block = m[1] if (m := BLOCK.match(code)) else b""
        word = m[1] if (m := WORD.match(code)) else b""
        if block == b"while":  # its condition counts at each turn
            flow.begin("WHILE", line)
        elif block not in (b"", b"if"):
            flow.branch("ELSE", last=True)
        self._evaluate(statement)
        if block == b"while":
            flow.exit(maybe=True)
            self._nested.append(0)
        elif block == b"if":
            flow.begin("IF", line)
            self._nested.append(0)
        elif block not in (b"", b"else"):  # elif: one IF more, in the branch of ELSE
            flow.begin("IF", line)
            self._nested[-1] += 1
        elif word == b"end" and code.strip() == b"end":
            for _ in range(self._nested.pop() + 1):
                flow.end("end", flow.innermost)
        elif word == b"break":
            flow.exit()
        elif word == b"continue":
            flow.next_turn()
        elif word in (b"return", b"halt"):
            flow.leave()

    def _evaluate(self, statement: Statement) -> None:
        """Take what a statement calls, in this order, and what it reads."""
        code, line, table = statement.code, statement.line, self._variables.table
        assigned = ASSIGN.match(code)
        masked = bytearray(code)
        alias = self._declared.aliases.get(statement.start)
        if assigned is not None and self._routines.key(assigned[2].decode()) in table:
            end = assigned.end(2) if alias is None else len(code)
            masked[:end] = b" " * end
        if alias is not None and INVERSE.search(code):
            table[alias.key].solved.append(self.flow.node)
        for m in COUNT.finditer(code):
            if m[1].decode() not in self._routines.bodies:
                masked[slice(*m.span())] = b" " * len(m[0])
        begun = self.flow.node
        shortened = SHORTENED.search(code)
        for m in calls(code):
            left_out = shortened is not None and m.start() > shortened.start()
            if left_out:
                self.flow.begin("IF", line)
            self._call(m, statement, masked, begun)
            if left_out:
                self.flow.end("IF", "IF")
        for name in _names(bytes(masked)):
            if (key := self._routines.key(name)) in table:
                table[key].reads.append((line, READ))
        for name in _names(code):
            for key in self._routines.others(name):
                if key in table:
                    table[key].reads.append((line, "perhaps meant by a function inside another"))

    def _call(self, m: re.Match[bytes], statement: Statement, masked: bytearray, begun: int) -> None:
        """Take a call; `begun` is the node of the flow at which its statement begins."""
        name, code = m[1].decode(), statement.code
        if name in self._routines.threads:
            self.flow.start(name)
            self._started[name] = None
        elif name in self._routines.bodies:
            self._pass(m, statement, masked, begun)
            self.flow.call(name, "")
        elif name == "set_tcp":
            self._tcp(m, statement, masked)
        elif MOTION.match(code, m.start()):
            self._motion(m, statement, masked, begun)
        elif STRANGE.match(code, m.start()):
            self.other(name, statement.line, unknown_motion(shown(code)))
        else:
            shifts.follow(self.flow, shifts.UR, m[1] + b"(", statement.line)
            if not TAKES_POSES.fullmatch(name):
                self._handed(name, statement, m.end(), masked)

    def _handed(self, name: str, statement: Statement, start: int, masked: bytearray) -> None:
        """List the poses that are arguments of a function that the language does not have: it may move there."""
        for k, (a, b) in enumerate(arguments(bytes(masked), start), 1):
            argument = masked[a:b].decode("latin-1")
            if (key := self._routines.key(argument)) in self._variables.table:
                self._variables.table[key].reads.append((statement.line, f"handed to {name}()"))
            elif re.search(r"(?<!\w)p\s*\[", argument):
                self.other(name, statement.line, handed_to(name), f"{name}:{statement.line} argument {k}")

    def _pass(self, m: re.Match[bytes], statement: Statement, masked: bytearray, begun: int) -> None:
        """Note what a call passes to a function of the program."""
        code, line, function = statement.code, statement.line, m[1].decode()
        parameters = self._routines.parameters.get(function, [])
        for k, (start, b) in enumerate(arguments(code, m.end())):
            keyword = ARGUMENT.match(code, start, b)
            a = start if keyword is None else keyword.end()
            which = parameters[k] if keyword is None and k < len(parameters) else keyword and keyword[1].decode()
            variable = self._variables.table.get(key := f"{function}.{which}")
            if variable is None:  # such as one with a default value: what is passed counts as read
                continue
            name = f"{function}:{line} argument {k + 1}"
            pose = self._declared.pose(name, statement, a, b)
            use = self.use(function, line)
            self._passed.append(_Passed(key, pose, use, line, function, name))
            variable.given.append(pose)
            variable.callers.append(use)
            if INVERSE.search(code, a, b):
                variable.solved += {begun, self.flow.node}
            if not isinstance(pose, Unknown | Literal):
                masked[a:b] = b" " * (b - a)

    def _tcp(self, m: re.Match[bytes], statement: Statement, masked: bytearray) -> None:
        spans = _chosen(statement.code, arguments(statement.code, m.end()), ("pose",))
        text = shown(statement.code[slice(*spans[0])] if spans else b"")
        pose = self._declared.pose("set_tcp", statement, *spans[0]) if spans else Unknown("")
        if isinstance(pose, Literal) and pose.point.values:
            text = statement.code[slice(*spans[0])].decode("latin-1")
            value = InForce("literal", f"set_tcp({text})", None, pose.point.values)
        elif isinstance(pose, Literal | Unknown):
            value = InForce("unknown", f"set_tcp({text}) (line {statement.line})")
        else:
            masked[slice(*spans[0])] = b" " * (spans[0][1] - spans[0][0])
            self._tcps.setdefault(pose, statement.line)
            value = InForce("unknown", f"set_tcp({text})", list(self._tcps).index(pose))
        self.flow.change(tool=value)

    def _motion(self, m: re.Match[bytes], statement: Statement, masked: bytearray, begun: int) -> None:
        word, code, line = m[1].decode(), statement.code, statement.line
        if word in AT_RUN_TIME:
            self.other(word, line, Problem("skip", f"{word}: followed at run time"))
            return
        named = ("pose_via", "pose_to") if word == "movec" else ("q",) if word == "movej" else ("pose",)
        spans = _chosen(code, arguments(code, m.end()), named)
        if len(spans) < len(named) or any(a == b for a, b in spans):
            self.other(word, line, not_understood(shown(code)))
            return
        found: list[Point | _Goal] = []
        for k, (a, b) in enumerate(spans):
            name = f"{word}:{line}" + ("" if len(named) == 1 else (" via", " end")[k])
            found.append(self._goal(name, word, statement, (a, b), masked, begun))
        if len(named) == 2:
            self._arcs.append(found)

    def _goal(
        self, name: str, word: str, statement: Statement, span: Span, masked: bytearray, begun: int
    ) -> Point | _Goal:
        (a, b), line, text = span, statement.line, statement.code[slice(*span)]
        nodes = [self.flow.node, begun] if INVERSE.search(text) else [self.flow.node]
        pose = self._declared.pose(name, statement, a, b)
        use = self.use(word, line, None, _BASE)
        if isinstance(pose, Literal):
            self._inline.append((pose.point, use, nodes))
            return pose.point
        if isinstance(pose, Unknown):
            joints = read_joints(self.source, name, statement.start + a, statement.start + b, line)
            if joints is not None:
                self._inline.append((joints, use, nodes))
                return joints
            return self.other(word, line, JOINTS if text.startswith(b"[") else computed(shown(text)), name)
        masked[a:b] = b" " * (b - a)
        self._goals.append(_Goal(pose, use, line, nodes, name))
        return self._goals[-1]

    def _attach(self, ambient: State) -> None:
        """Give the points their uses, when all of the program is known."""
        in_runs = {id(run.point) for run in self._runs}
        for point, use, nodes in self._inline:
            point.uses.append(self._with_tool(use, nodes, ambient))
            if id(point) not in in_runs:
                self.points.append(point)
        self._variables.settle([*(goal.pose for goal in self._goals)])
        for pose, line in self._tcps.items():
            if any(self._variables.is_goal(key) for key in self._variables.closure(pose)):
                self._read(pose, line, "used as a TCP")
        for alias in self._declared.aliases.values():
            if not self._variables.is_goal(alias.key) or self._variables.table[alias.key].meaning is None:
                self._read(alias.pose, alias.line, READ)
        for variable in list(self._variables.table.values()):
            for line, _ in list(variable.reads):
                for pose in variable.given:
                    self._read(pose, line, READ)
        moved: dict[int, Point] = {}
        for goal in self._goals:
            for point in self._arrive(goal, ambient):
                moved.setdefault(id(point), point)
        self._list_passed()
        for variable in self._variables.table.values():
            self._finish(variable, moved)
        self.points += moved.values()

    def _list_passed(self) -> None:
        """List the arguments of functions of the program whose motions to them are not followed."""
        for one in self._passed:
            variable = self._variables.table[one.key]
            if self._variables.is_goal(one.key) and not variable.writes:
                problem = is_followed(self._variables, one.pose)
                if problem is not None:
                    self._read(one.pose, one.line, READ)
            elif not (variable.reads or variable.writes):
                continue  # a feature or a TCP, or nothing at all
            else:
                self._read(one.pose, one.line, f"handed to {one.function}()")
                poses = isinstance(one.pose, Literal | Join | Inverse) and has_literal(one.pose)
                problem = handed_to(one.function) if poses else None
            if problem is not None:
                self.points.append(Point(one.name, self.source, one.line, problem=problem, uses=[one.use]))

    def _read(self, pose: Pose, line: int, how: str) -> None:
        """Note that the program reads the variables of an expression, and those that give them their values."""
        direct = set(keys(pose))
        for key in self._variables.closure(pose):
            self._variables.table[key].reads.append((line, how if key in direct else READ))

    def _arrive(self, goal: _Goal, ambient: State) -> list[Point]:
        """Add a motion to the points that it goes to, and return these."""
        line = goal.line
        try:
            ways = self._variables.ways(goal.pose)
        except NotCorrected as stop:
            goal.points = [Point(goal.name, self.source, line, problem=stop.problem, uses=[goal.use])]
            self.points += goal.points
            self._read(goal.pose, line, READ)
            return []
        use = self._with_tool(goal.use, [*goal.nodes, *self._variables.solved_at(goal.pose)], ambient)
        for k, way in enumerate(ways):
            place = way.caller or use
            frame = way.frame or use.frame
            order = k if len(ways) > 1 else use.order
            here = use._replace(line=place.line, section=place.section, frame=frame, order=order)
            if way.shift is None:
                way.point.uses.append(here)
                goal.points.append(way.point)
            else:
                goal.points.append(self._derive(goal, way, here))
        return [way.point for way in ways]

    def _derive(self, goal: _Goal, way: Way, use: Use) -> Point:
        """Return the target of a motion to a position that is derived from a point."""
        assert way.shift is not None  # it is derived
        name = goal.name if way.caller is None else f"{goal.name}, {way.caller.word}:{way.caller.line}"
        target = Point(name, self.source, goal.line, problem=computed(way.how), uses=[use])
        derive(target, [(way.point, Derived(goal.line, way.how, (tuple(way.shift.tolist()),), way.axes))])
        self.points.append(target)
        return target

    def _finish(self, variable: Variable, moved: dict[int, Point]) -> None:
        """Give the points of a variable what the program does with it other than by motions."""
        if len(variable.points) > 1 and not variable.listed:
            variable.writes.append((variable.points[1].line, "assigned again"))
        handed = any(how.startswith("handed") for _, how in variable.reads)
        for point in variable.points:
            used = id(point) in moved
            point.reads += variable.reads if used or handed else []
            point.writes += variable.writes
            if handed and point.joints is None:
                moved.setdefault(id(point), point)
        if variable.reads and not variable.points:
            for point in (point for pose in variable.given for point in self._variables.points(pose)):
                point.reads += variable.reads if id(point) in moved else []

    def _resolved(self, value: InForce) -> InForce:
        """Return the numbers of a TCP that the program names."""
        if value.number is None:
            return value
        tf = self._variables.constant(list(self._tcps)[value.number])
        if tf is None:
            return value._replace(number=None)
        rotvec = Rotation.from_matrix(tf[:3, :3]).as_rotvec()
        return InForce("literal", value.text, None, (*(tf[:3, 3] / 1000.0).tolist(), *rotvec.tolist()))

    def _with_tool(self, use: Use, nodes: Sequence[int], ambient: State) -> Use:
        """Return a motion with its TCP, which must be the same at all nodes; the first is that of the motion."""
        if problem := shifts.problem_of(self.flow.states[nodes[0]].shifts | ambient.shifts):
            return use._replace(problem=problem)
        states = [ambient, *(self.flow.states[node] for node in nodes)]
        found = sorted({self._resolved(value) for state in states for value in state.tool}, key=lambda one: one.text)
        values = {tuple(np.round(value.pose, 9)) if value.pose else value: value for value in found}
        if len(values) > 1:
            shown = " or ".join([value.text for value in values.values()][:2])
            return use._replace(problem=Problem("refuse", f"the TCP depends on the way through the program: {shown}"))
        for value in values.values():
            if value.pose is not None:
                return use._replace(tool=Frame(value.text, None, transform(value.pose).tobytes()))
            if value.kind == "unknown":
                return use._replace(problem=Problem("refuse", f"the TCP is known at run time only: {value.text}"))
        return use


def _names(code: bytes) -> list[str]:
    """Return the names of variables in a statement; the v of ``movel(p, v=0.25)`` is none."""
    plain = KEYWORD.sub(lambda found: b" " * len(found[0]), code)
    return [m[1].decode() for m in NAME.finditer(plain) if not m[2]]


def _chosen(code: bytes, spans: list[Span], names: tuple[str, ...]) -> list[Span]:
    """Return the spans of some arguments of a call, which may be named."""
    found: dict[str, Span] = {}
    for k, (a, b) in enumerate(spans):
        keyword = ARGUMENT.match(code, a, b)
        if keyword is None and k < len(names):
            found[names[k]] = a, b
        elif keyword is not None and (name := keyword[1].decode()) in names:
            found[name] = keyword.end(), b
    return [found[name] for name in names if name in found]
