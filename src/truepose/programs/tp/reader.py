"""FANUC TP (.ls): instructions under /MN, positions with their own frame numbers under /POS.

UF and UT of a position are the frames in which it was taught, and the controller stops if others are in force. So they
are used, unless UFRAME_NUM or UTOOL_NUM is certainly another where a motion goes to the position.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from truepose.programs.core import shifts
from truepose.programs.core.forms import FoundRun, Lines
from truepose.programs.core.named import Group
from truepose.programs.core.points import Point, Problem, Use, not_understood, unknown_motion
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Instruction, Reader
from truepose.programs.core.source import Source, shown
from truepose.programs.tp import frames as tp_frames
from truepose.programs.tp.positions import REMOTE, VALUES, Positions, Taught
from truepose.programs.tp.registers import Registers
from truepose.programs.tp.sections import NUMBERED, REMARK, add_line, read_sections
from truepose.programs.tp.words import check_language

_LABELS = re.compile(rb"\[[^\]\[]*\]")
_MESSAGE = re.compile(rb"\b(MESSAGE|PROMPT_BOX_?\w*|STATUS|UALM)\s*\[[^\]]*\]", re.I)
_TEXT = re.compile(rb"'[^']*'|\"[^\"]*\"")
_P = rb"(?<![\w$])P[ \t]*\[[ \t]*(?:(\d{1,9})[ \t]*(?::[^\]]*)?|([^\]\[]*\[[^\]]*\][^\]]*|[^\]\d][^\]]*))\]"
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
_SHIFTS: Final = (
    (re.compile(rb"\bTool_Offset\b", re.I), Problem("skip", "Tool_Offset: shifted by a register at run time")),
    (re.compile(rb"(?<!_)\bOffset\b", re.I), Problem("skip", "Offset: shifted by a register at run time")),
    (re.compile(rb"\bINC\b", re.I), Problem("skip", "INC: starts from a target that is corrected already")),
    (re.compile(rb"\bVOFFSET\b", re.I), Problem("skip", "VOFFSET: shifted by what a camera sees")),
    (re.compile(rb"\bSearch\s*\[", re.I), Problem("skip", "Search: the motion ends at what it touches")),
    (re.compile(rb"\b(?:RTCP|REMOTE_TCP)\b", re.I), REMOTE),
)
_COORD = re.compile(rb"\bCOORD\b", re.I)
_BY_GROUP = re.compile(rb"\s*(?:Independent|Simultaneous)[ \t]+GP\b(?!\d)", re.I)
"""An instruction with one motion for each group."""
_MOTION_OF = re.compile(rb"\bGP(\d)\s+(?=[JLCAS]\s)", re.I)
_LABEL = re.compile(rb"\s*LBL\s*\[\s*(\d{1,9})", re.I)
_JUMP = re.compile(rb"\bLBL\s*\[\s*(\d+|[^\]]*)", re.I)
_CALL = re.compile(rb"\b(?:CALL|RUN)\s+(\w+)", re.I)
_WRITE = re.compile(rb"\s*P\s*\[[^=]*=", re.I)


class _Move(NamedTuple):
    point: Point
    word: str
    line: int
    node: int
    problem: Problem | None
    coordinated: bool = False


def read(path: Path, frames: KnownFrames, options: ReadOptions, *, registers: Registers | None = None) -> Program:
    """Read a .ls file; a FileError names the line if it is broken.

    `registers` are those of the controller's backup.
    """
    return _Reader(Source.read(path), frames, options, registers or Registers()).read()


class _Reader(Reader):
    def __init__(self, source: Source, frames: KnownFrames, options: ReadOptions, registers: Registers) -> None:
        super().__init__(source, frames, options)
        self._registers = registers
        self._kinds: dict[tuple[str, int], int] = {}
        self._runs: list[FoundRun] = []
        self._moves: list[_Move] = []
        self._indirect: list[tuple[str, int, int]] = []
        self._labels: set[bytes] = set()
        self._coordinated = False
        self._group = frames.groups.robot

    def read(self) -> Program:
        instructions, start, end, tracked, self._mask = read_sections(self.source)
        self._positions = Positions(self.source, self.options, start, end, self._group)
        codes = (one.code for one in instructions if isinstance(one, Instruction))
        self._labels = {m[1] for code in codes if (m := _LABEL.match(code))}
        self.flow.begin_routine("MAIN", outside=True)
        if tracked:
            self.flow.shift("program", tracked)
        self.body(self._closed(instructions), self._take)
        self.flow.solve()
        self._settle()
        self._attach()
        self.points = [*self._positions.ordered(), *self.points]
        return self.program("fanuc", finest=1e-3, runs=self._runs)

    def _closed(self, instructions: Iterable[Instruction | Lines]) -> Iterator[Instruction | Lines]:
        """Yield the instructions, and close the IF that are left open, as controllers do."""
        yield from instructions
        self._close_ifs()

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
        kind = self._kinds.setdefault((motion[1].decode(), self.flow.node), len(self._kinds))
        if self._positions.named.move(piece, 1, kind):
            self.arc(None)
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
            self._calls(b" ".join(motions.values()))
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
        elif _POINT.search(code):
            self.arc(None)
            self._point_elsewhere(line, code)
        else:
            shifts.follow(flow, shifts.FANUC, code, line)
        for which, value in tp_frames.chosen(code, self._group):
            flow.change(**{which: value})
        for which, key in tp_frames.changed(code, self._group):
            self.changed.setdefault((which, key), line)
        self._calls(code)
        self._control(line, code.strip(b" \t;").upper())

    def _calls(self, code: bytes) -> None:
        for name in _CALL.findall(code):
            called = name.decode("latin-1")
            self.flow.call(called.upper(), f"{called} was called, which is not in this file")

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
            flow.begin("FOR", line)
        elif code == b"ENDFOR":
            self._close_ifs()
            flow.end("ENDFOR", "FOR")
        elif code in (b"END", b"ABORT") or re.match(rb"JMP\b", code):
            flow.leave()

    def _motion(self, line: int, word: str, code: bytes) -> None:
        goals = list(_GOAL.finditer(code))
        wanted = 2 if word == "C" else 1
        problem = next((p for pattern, p in _SHIFTS if pattern.search(code)), None)
        for m in goals[wanted:]:
            if not m[1] and m[2] and (beyond := self._positions.get(int(m[2]))):
                beyond.reads.append((line, "read by a motion to another position"))
        goals = goals[:wanted]
        if len(goals) < wanted:
            self.other(word, line, not_understood("a circle needs two positions"))
            return
        coordinated = _COORD.search(code) is not None
        self._coordinated = self._coordinated or coordinated
        points = [self._goal(m, word, line, problem, coordinated=coordinated) for m in goals]
        if word == "C" and None not in points:
            self.circles.append([p for p in points if p is not None])
        if word == "A" and points[0] is not None:
            self.arc(points[0])
        else:
            self.arc(None)

    def _goal(
        self, m: re.Match[bytes], word: str, line: int, problem: Problem | None, *, coordinated: bool
    ) -> Point | None:
        text = m[0].decode("latin-1")
        if m[1]:
            return self.other(word, line, Problem("skip", self._about_register(m[2])), text)
        if m[2] is None:
            self._indirect.append((word, line, self.flow.node))
            return self.other(word, line, Problem("skip", "which position is known at run time only"), text)
        point = self._positions.moved_to(int(m[2]), line)
        self._moves.append(_Move(point, word, line, self.flow.node, problem, coordinated))
        return point

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
            word, node = kinds[kind]
            moves.append(_Move(self._positions.take_out(row), word, line, node, None))
        self._moves = sorted(moves, key=_line)

    def _alike(self, group: Group) -> bool:
        """Return whether the motions of a group differ in their lines at most."""
        if group.kind < 0:
            return True
        first, last = (self._use_in(group, int(line)) for line in group.lines[[0, -1]])
        return first._replace(line=last.line) == last

    def _use_in(self, group: Group, line: int) -> Use:
        return self._use_at(self._positions.first[group.run], *list(self._kinds)[group.kind], line, None)

    def _attach(self) -> None:
        """Give each position the motions to it, now that the frames in force at each are known."""
        for word, line, node in self._indirect:
            self._moves += [_Move(p, word, line, node, None) for p in self._positions.all() if p.values or p.joints]
        for point, word, line, node, problem, coordinated in self._moves:
            point.uses.append(self._use_at(point, word, node, line, problem, coordinated=coordinated))

    def _use_at(
        self, point: Point, word: str, node: int, line: int, problem: Problem | None, *, coordinated: bool = False
    ) -> Use:
        """Return a motion with the frames of its position, refused where others are in force."""
        taught, state = self._positions.taught(point), self.flow.states[node]
        needed = taught if point.joints is None else taught._replace(base=None)
        tool, base, stopped = tp_frames.frames_at(needed, state, self._group, line)
        problem = shifts.problem_of(state.shifts) or problem or self._with_others(taught, coordinated) or stopped
        return self.use(word, line, tool, base, problem)

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


def _line(item: Point | _Move) -> int:
    return item.line
