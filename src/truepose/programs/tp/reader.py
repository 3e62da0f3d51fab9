"""FANUC TP (.ls): instructions under /MN, positions with their own frame numbers under /POS.

UF and UT of a position are the frames in which it was taught, and the controller stops if others are in force. So they
are used, unless UFRAME_NUM or UTOOL_NUM is certainly another where a motion goes to the position.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import cached_property, partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from truepose.programs.core import shifts
from truepose.programs.core.forms import FoundRun, Lines
from truepose.programs.core.named import Group
from truepose.programs.core.pieces import Section
from truepose.programs.core.points import FileLine, Place, Point, Problem, Use, not_understood, unknown_motion
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Instruction, Reader
from truepose.programs.core.source import Source, shown
from truepose.programs.tp import frames as tp_frames
from truepose.programs.tp.beside import read_beside
from truepose.programs.tp.derived import MONITORED, Facts, RegisterFlow, is_macro
from truepose.programs.tp.followers import Follower, Followers
from truepose.programs.tp.positions import IN_FORCE, REMOTE, VALUES, Positions, Taught
from truepose.programs.tp.registers import Effects, Registers, effects_of
from truepose.programs.tp.sections import NUMBERED, REMARK, add_line, read_sections
from truepose.programs.tp.words import check_language

_LABELS = re.compile(rb"\[[^\]\[]*\]")
_MESSAGE = re.compile(rb"\b(MESSAGE|PROMPT_BOX_?\w*|STATUS|UALM)\s*\[[^\]]*\]", re.I)
_TEXT = re.compile(rb"'[^']*'|\"[^\"]*\"")
_P = rb"(?<![\w$])P[ \t]*\[[ \t]*(?:(\d{1,9})[ \t]*(?:[:,][^\]]*)?|([^\]\[]*\[[^\]]*\][^\]]*|[^\]\d][^\]]*))\]"
_POINT = re.compile(_P, re.I)
_GOAL = re.compile(
    rb"(?<![\w$])P(R?)[ \t]*\[[ \t]*(?:(\d{1,9})[ \t]*(?::[^\]]*)?|[^\]\[]*(?:\[[^\]]*\][^\]\[]*)*)\]", re.I
)
_MOTION = re.compile(rb"\s*([JLCAS])\s+(?=P\s*R?\s*\[)", re.I)
_HIDDEN_MOTION = re.compile(rb"(?<![\w$\[:])[JLCAS]\s+P\s*R?\s*\[", re.I)
_OTHER_MOTION = re.compile(rb"\s*([JLCAS])(?:\s+(PAL_?\d*\s*\[[^\]]*\]|[A-Z]\w*\s*\[[^\]]*\])|(PR?)\s*\[)", re.I)
"""A motion to an operand other than a position, such as `J PAL_1[A_1]`, a pattern of palletising."""
_SPEED = re.compile(
    rb"\d\s*(?:%|mm/sec|cm/min|inch/min|deg/sec|m?sec)|\]\s*(?:mm/sec|cm/min|%)|\b(?:FINE|CNT\s*\d+)\b", re.I
)
_OFFSETS: Final = (
    (re.compile(rb"\bTool_Offset\b", re.I), Problem("skip", "Tool_Offset: shifted by a register at run time")),
    (re.compile(rb"(?<!_)\bOffset\b", re.I), Problem("skip", "Offset: shifted by a register at run time")),
)
_SHIFTS: Final = (
    (re.compile(rb"\bINC\b", re.I), Problem("skip", "INC: starts from a target that is corrected already")),
    (re.compile(rb"\bVOFFSET\b", re.I), Problem("skip", "VOFFSET: shifted by what a camera sees")),
    (re.compile(rb"\bSearch\s*\[", re.I), Problem("skip", "Search: the motion ends at what it touches")),
    (re.compile(rb"\b(?:RTCP|REMOTE_TCP)\b", re.I), REMOTE),
)
_COORD = re.compile(rb"\bCOORD\b", re.I)
_BY_GROUP = re.compile(rb"\s*(?:Independent|Simultaneous)[ \t]+GP\b(?!\d)", re.I)
"""An instruction with one motion for each group."""
_MOTION_OF = re.compile(rb"\bGP(\d)\s+(?=[JLCAS]\s)", re.I)
_GIVEN_BY = re.compile(rb"\[\s*R\s*\[\s*(\d{1,5})", re.I)
_AFTER_SPEED = re.compile(rb".*?(?=\b(?:Tool_)?Offset\b)|.*", re.I | re.S)
_LABEL = re.compile(rb"\s*LBL\s*\[\s*(\d{1,9})", re.I)
_JUMP = re.compile(rb"\bLBL\s*\[\s*(\d+|[^\]]*)", re.I)
_CALL = re.compile(rb"\b(?:CALL|RUN)\s+(\w+)", re.I)
_WRITE = re.compile(rb"\s*P\s*\[[^=]*=", re.I)
_NUMBER = re.compile(rb"\s*R\s*\[", re.I)
"""An assignment to a numeric register."""


class _Motion(NamedTuple):
    """A motion, and what is against a correction of its target; `followed`: constant shifts of it are followed."""

    word: str
    line: int
    node: int
    section: Section
    problem: Problem | None = None
    coordinated: bool = False
    followed: bool = False


class _Move(NamedTuple):
    """A motion to a position; `shifted` is its target if the motion shifts the position."""

    point: Point
    motion: _Motion
    shifted: Point | None = None


def read(path: Path, frames: KnownFrames, options: ReadOptions, *, registers: Registers | None = None) -> Program:
    """Read a .ls file; a FileError names the line if it is broken.

    `registers` are those of the controller's backup.
    """
    return _Reader(Source.read(path), frames, options, registers or Registers()).read()


class _Reader(Reader):
    def __init__(self, source: Source, frames: KnownFrames, options: ReadOptions, registers: Registers) -> None:
        super().__init__(source, frames, options)
        self._registers = registers
        self._kinds: dict[_Motion, int] = {}
        self._runs: list[FoundRun] = []
        self._moves: list[_Move] = []
        self._indirect: list[tuple[Point, _Motion]] = []
        self._labels: set[bytes] = set()
        self._coordinated = False
        self._beside, self._name = read_beside(source.path), source.path.stem.upper()
        self._monitored: Problem | None = None
        self._group = frames.groups.robot

    @cached_property
    def _effects(self) -> Effects:
        return effects_of(self.source.data)

    def read(self) -> Program:
        instructions, start, end, tracked, self._mask = read_sections(self.source)
        self._positions = Positions(self.source, self.options, start, end, self._group)
        codes = [one.code for one in instructions if isinstance(one, Instruction) and not REMARK.match(one.code)]
        self._labels = {m[1] for code in codes if (m := _LABEL.match(code))}
        facts = Facts(self._registers, self._name, self._group, self.options.whole_task)
        self._derived = RegisterFlow(self.flow, facts, [_TEXT.sub(b"", code) for code in codes])
        self._followers = Followers(self._positions, self._group, allowed=self.options.derived)
        self.flow.begin_routine(self._name, outside=True)
        if tracked:
            self.flow.shift("program", tracked)
        for shift in sorted(self._beside.entered.get(self._name, ())):
            self._may_shift(shift, 1)
        self.body(self._closed(instructions), self._take)
        self.flow.solve()
        if self._derived.used:
            self._followers.settle(self._derived.solve(self._positions.is_constant), self.flow.states)
        self._settle()
        self._attach()
        self.points = [*self._positions.ordered(), *self.points]
        for name, effects in self._registers.programs.items():
            for line, code in effects.changes if name != self._name else ():
                self._change(code, FileLine(f"{name}.LS", line), effects.constant_in(line))
        for place, code, values in [] if self._registers.programs else self._beside.changes(self._name):
            self._change(code, place, values)
        return self.program("fanuc", finest=1e-3, runs=self._runs)

    def _closed(self, instructions: Iterable[Instruction | Lines]) -> Iterator[Instruction | Lines]:
        """Yield the instructions, and close the IF that are left open, as controllers do."""
        last = 1
        for one in instructions:
            last = one.line + (one.items * one.form.lines - 1 if isinstance(one, Lines) else 0)
            yield one
        self._close_ifs()
        self._derived.end(last)

    def _close_ifs(self) -> None:
        while self.flow.innermost == "IF":
            self.flow.end("ENDIF", "IF")

    def _take(self, piece: Instruction | Lines) -> None:
        """Take an instruction, or a run of motions."""
        if isinstance(piece, Instruction):
            self._instruction(piece)
            return
        data = self.source.data
        numbered = NUMBERED.match(data, piece.start)
        motion = _MOTION.match(data, numbered.end() if numbered else piece.start)
        assert motion is not None  # of `_CAM_MOTION`
        coordinated = _COORD.search(data, piece.start, data.find(b"\n", piece.start)) is not None
        like = _Motion(motion[1].decode(), 0, self.flow.node, self.flow.motion(), coordinated=coordinated)
        kind = self._kinds.setdefault(like, len(self._kinds))
        self._coordinated = self._coordinated or coordinated
        if self._positions.named.move(piece, 1, kind):
            self.arc(None)
            self._derived.moves(piece.line)
            return
        instructions: list[Instruction | Lines] = []
        for line, a, b in self.source.lines(piece.start, piece.end):
            add_line(instructions, line, data[a:b], goes_on=False)
        for one in instructions:
            self._take(one)

    def _instruction(self, instruction: Instruction) -> None:
        line, code = instruction.line, _TEXT.sub(b"''", instruction.code)
        if REMARK.match(code):
            return
        flow = self.flow
        if m := _LABEL.match(code):
            flow.label(m[1].decode())
            return
        check_language(self.source, line, _LABELS.sub(b"", code))
        if m := _BY_GROUP.match(code):
            pieces = _MOTION_OF.split(code[m.end() :])
            motions = dict(zip(map(int, pieces[1::2]), pieces[2::2], strict=True))
            ours = motions.pop(self._group, b"")
            self._calls(line, b" ".join(motions.values()))
            self._instruction(Instruction(line, ours))
            return
        m = _MOTION.match(code)
        if hidden := _HIDDEN_MOTION.search(_MESSAGE.sub(b"", code), m.end() if m else 0):
            reason = f"a motion inside another instruction ({shown(code[hidden.start() :])}): end each with ;"
            raise self.source.error(line, f"{reason} and write it on its own line")
        if m:
            self._motion(line, m[1].decode().upper(), code)
        elif other := _OTHER_MOTION.match(code):
            self.arc(None)
            self._motion_elsewhere(line, code, other[1].decode().upper(), other[2] or other[3])
        elif self._derived.assign(code, line):
            self.arc(None)
            if _NUMBER.match(code):
                self._point_elsewhere(line, code)
            else:
                self._joints_read(line, code)
        else:
            self._derived.other(code, line)
            if MONITORED.match(code) and self._monitored is None:
                reason = f"{shown(code)} (line {line}) may change the frame in force at any time"
                self._monitored = Problem("refuse", f"{reason}; teach it in a number")
            if _POINT.search(code):
                self.arc(None)
                self._point_elsewhere(line, code)
            else:
                shifts.follow(flow, shifts.FANUC, code, line)
        conditional = re.match(rb"\s*(?:IF|SELECT|WHEN)\b", code, re.I) is not None
        for which, value in tp_frames.chosen(code, self._group):
            if conditional:
                flow.begin("IF", line)
            flow.change(**{which: value})
            self._derived.moves(line)  # the robot stands where it did, but in other numbers
            if conditional:
                flow.end("ENDIF", "IF")
        if next(tp_frames.changed(code, self._group), None) is not None:
            self._change(code, line, self._effects.constant_in(line))
        self._calls(line, code)
        self._control(line, code.strip(b" \t;").upper())

    def _change(self, code: bytes, place: Place, constants: tuple[float, ...] = ()) -> None:
        """Note the frames that an instruction changes, unless it sets them to their stored values.

        `constants` are those that the program has written to the register before.
        """
        for which, key in tp_frames.changed(code, self._group):
            table = self.frames.tools if which == "tool" else self.frames.bases
            if key is None or not self._derived.is_stored(code, table.get(key), constants):
                self.changed.setdefault((which, key), place)

    def _calls(self, line: int, code: bytes) -> None:
        calls = _CALL.findall(code)
        conditional = bool(calls) and _CALL.match(code.lstrip()) is None
        if conditional:
            self.flow.begin("IF", line)
        for name in calls:
            called = name.decode("latin-1")
            self._derived.call(called, line)
            self._called(called, self._registers.behind([called]))
            for shift in sorted(self._beside.left.get(called.upper(), ())):
                self._may_shift(shift, line)
        if conditional:
            self.flow.end("ENDIF", "IF")
        if is_macro(code):
            self._called(shown(code.strip(b" ;")), self._registers.macros())

    def _may_shift(self, shift: str, line: int) -> None:
        """Let a shift of another program be in force from here on, or not."""
        self.flow.begin("IF", line)
        self.flow.shift("of a program", shift)
        self.flow.end("ENDIF", "IF")

    def _called(self, name: str, effects: Effects | None) -> None:
        """Follow a call of another program, whose effects may be known."""
        self.flow.may_move()
        if effects is None or any(list(tp_frames.chosen(one, self._group)) for _, one in effects.frames):
            self.flow.call(name.upper(), f"{name} was called, which is not in this file")

    def _control(self, line: int, code: bytes) -> None:
        flow, labels = self.flow, self._labels
        for label in _JUMP.findall(code):
            for name in [label] if label in labels else labels if not label.isdigit() else ():
                flow.may_go(name.decode())
        if re.match(rb"IF\b.*\bTHEN$", code):
            flow.begin("IF", line)
        elif code == b"ELSE":
            flow.branch("ELSE", last=True)
        elif code == b"ENDIF":
            flow.end("ENDIF", "IF")
        elif re.match(rb"FOR\b", code):
            self._derived.loop(code, line)
        elif code == b"ENDFOR":
            self._close_ifs()
            self._derived.end_loop(line)
        elif code in (b"END", b"ABORT"):
            self._derived.end(line)
            flow.leave()
        elif re.match(rb"JMP\b", code):
            flow.leave()

    def _motion(self, line: int, word: str, code: bytes) -> None:
        goals = list(_GOAL.finditer(code))
        wanted = 2 if word == "C" else 1
        followed = not any(pattern.search(code) for pattern, _ in _SHIFTS)
        problem = next((p for pattern, p in _OFFSETS + _SHIFTS if pattern.search(code)), None)
        for m in goals[wanted:]:
            if not m[1] and m[2] and (beyond := self._positions.get(int(m[2]))):
                beyond.reads.append((line, "read by a motion to another position"))
        goals = goals[:wanted]
        if len(goals) < wanted:
            self.other(word, line, not_understood("a circle needs two positions"))
            return
        coordinated = _COORD.search(code) is not None
        self._coordinated = self._coordinated or coordinated
        end = goals[-1].end()
        points = [
            self._goal(
                m, _Motion(word, line, self.flow.node, self.flow.motion(), problem, coordinated, followed), code[end:]
            )
            for m in goals
        ]
        if word == "C" and None not in points:
            self.circles.append([p for p in points if p is not None])
        if word == "A" and points[0] is not None:
            self.arc(points[0])
        else:
            self.arc(None)

    def _goal(self, m: re.Match[bytes], motion: _Motion, tail: bytes) -> Point | None:
        """Take a goal of a motion; return its position or target."""
        word, line, problem = motion.word, motion.line, motion.problem
        text, number = m[0].decode("latin-1"), int(m[2]) if m[2] else None
        given = _GIVEN_BY.search(m[0])
        kind = "PR" if m[1] else "P"
        goal = None
        if motion.followed and (number is not None or given):
            goal = self._derived.goal(kind, number, int(given[1]) if given else None, tail)
        own = None if m[1] or number is None else self._positions.moved_to(number, line)
        if own is not None and problem is None:
            self._derived.move(None, goal, tail, line)
            self._moves.append(_Move(own, motion))
            return own
        if m[1]:
            problem = Problem("skip", self._about_register(m[2]))
        elif own is None:
            problem = Problem("skip", "which position is known at run time only")
        target = Point(text, self.source, line, problem=problem, uses=[self.use(word, line)])
        self._derived.move(target, goal, tail if goal is not None else m[0] + tail, line)
        how = f"{word} {text}{shown(_AFTER_SPEED.sub(b'', tail))}"
        plain = motion._replace(problem=None)
        use = partial(self._use_at, motion=plain)
        self._followers.add(Follower(target, own, line, motion.node, own is None and not m[1], how, use))
        if own is None:
            self.points.append(target)
            if not m[1]:
                self._indirect.append((target, motion))
            return target
        self._moves.append(_Move(own, motion, target))
        return own

    def _about_register(self, digits: bytes | None) -> str:
        """Return why a motion to a position register is not corrected."""
        number = int(digits or 0)
        stored = self._registers.positions.get((self._group, number))
        if digits is None or stored is None:
            return "position register, known at run time only"
        if writer := self._registers.writer("PR", number):
            return f"position register, which {writer} may write: known at run time only"
        return "position register: its value stands in POSREG.VA, which is not written; teach a position instead"

    def _motion_elsewhere(self, line: int, code: bytes, word: str, operand: bytes) -> None:
        """Take a motion to something that is neither a position nor a register."""
        self._derived.moves(line)
        if operand.upper().startswith(b"PAL"):
            problem = Problem("skip", "position of a palletising pattern, known at run time only")
            self.other(word, line, problem, operand.decode("latin-1"))
        else:
            self.other(word, line, unknown_motion(shown(code)))

    def _point_elsewhere(self, line: int, code: bytes) -> None:
        """Take an instruction with a position that is not a known motion."""
        written = _WRITE.match(code)
        if not written and _SPEED.search(code) and not re.search(rb"=|\bCALL\b", code, re.I):
            word = (code.split() or [b"?"])[0].decode("latin-1")[:12]
            self.other(word, line, unknown_motion(shown(code)))
            return
        for k, m in enumerate(_POINT.finditer(code)):
            for point in [self._positions.get(int(m[1]))] if m[1] else self._positions.all():
                if point is not None:
                    if written and k == 0:
                        point.writes.append((line, "assigned"))
                    else:
                        point.reads.append((line, "read by arithmetic"))

    def _joints_read(self, line: int, code: bytes) -> None:
        """Note the joint targets that an assignment reads: what it does to a copy is no shift in space."""
        for m in _POINT.finditer(code):
            for point in self._positions.of_joints():
                if not m[1] or point.name == f"P[{int(m[1])}]":
                    point.reads.append((line, "read by arithmetic"))

    def _settle(self) -> None:
        """Keep the runs of positions to which motions of one kind go, and take the other positions out of them."""
        if self._indirect:
            self._positions.all()
        before, kinds = self._positions.named.taken.copy(), list(self._kinds)
        for group, lines in self._positions.named.groups(self._alike):
            _, point = self._positions.read_at(lines.start)
            if group.kind >= 0:
                point.uses = [self._use_in(group, int(group.lines[0]))]
            self._runs.append(FoundRun(lines, point, VALUES, group.lines, ("P[", "]"), blanks=True))
        for row in np.flatnonzero(self._positions.named.taken & ~before).tolist():
            self._positions.take_out(row)
        moves = list(self._moves)
        for row, line, kind in self._positions.named.left():
            moves.append(_Move(self._positions.take_out(row), kinds[kind]._replace(line=line)))
        self._moves = sorted(moves, key=_line)

    def _alike(self, group: Group) -> bool:
        """Return whether the motions of a group differ in their lines at most."""
        if group.kind < 0:
            return True
        first, last = (self._use_in(group, int(line)) for line in group.lines[[0, -1]])
        return first._replace(line=last.line) == last

    def _use_in(self, group: Group, line: int) -> Use:
        motion = list(self._kinds)[group.kind]._replace(line=line)
        return self._use_at(self._positions.first[group.run], motion)

    def _attach(self) -> None:
        """Give each position the motions to it, now that the frames in force at each are known."""
        allowed, resolved = self.options.derived, self._followers.resolved
        for target, motion in self._indirect:
            if not (allowed and id(target) in resolved):
                some = (p for p in self._positions.all() if p.values or p.joints)
                self._moves += [_Move(p, motion) for p in some]
        for point, motion, shifted in self._moves:
            if shifted is not None and id(shifted) in resolved:
                if allowed:
                    self.points.append(shifted)
                    continue
                assert motion.problem is not None  # it is shifted
                reason = f"{motion.problem.reason}; it is constant: --derived corrects both alike"
                motion = motion._replace(problem=Problem("skip", reason))
            point.uses.append(self._use_at(point, motion))

    def _use_at(self, point: Point, motion: _Motion) -> Use:
        """Return a motion with the frames of its position, refused where others are in force."""
        taught, state = self._positions.taught(point), self.flow.states[motion.node]
        needed = taught if point.joints is None else taught._replace(base=None)
        tool, base, stopped = tp_frames.frames_at(needed, state, self._group, motion.line)
        if IN_FORCE in needed and self._monitored is not None:
            stopped = stopped or self._monitored
        others = self._with_others(taught, motion.coordinated)
        problem = shifts.problem_of(state.shifts) or motion.problem or others or stopped
        return self.use(motion.word, motion.line, tool, base, problem, motion.section)

    def _with_others(self, taught: Taught, coordinated: bool) -> Problem | None:
        """Return what is against a motion together with other groups."""
        known = self.frames.groups.independent
        if not (coordinated or ((self._coordinated or known) and taught.others)):
            return None
        others = (taught.others | self._mask if coordinated else taught.others) - {self._group}
        if others and others <= known:
            return None
        named = ", ".join(map(str, sorted(others - known))) or "?"
        reason = f"moves together with group {named}; if this carries neither the robot nor a user frame of its targets"
        remedy = "add it to [frames.groups] independent of the cell file"
        return Problem("refuse", f"{'COORD: ' if self._coordinated else ''}{reason}, {remedy}")


def _line(item: _Move) -> int:
    return item.motion.line
