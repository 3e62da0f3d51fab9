"""FANUC TP (.ls): instructions under /MN, positions with their own frame numbers under /POS.

UF and UT of a position are the frames in which it was taught, and the controller stops if others are in force. So they
are used, unless UFRAME_NUM or UTOOL_NUM is certainly another where a motion goes to the position.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from truepose.errors import FileError
from truepose.programs.core import shifts
from truepose.programs.core.flow import InForce
from truepose.programs.core.forms import FoundRun, Lines, RunFinder
from truepose.programs.core.named import Group
from truepose.programs.core.points import Point, Problem, Use, not_understood, unknown_motion
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Instruction, Reader
from truepose.programs.core.source import Source, shown
from truepose.programs.tp.positions import NAME, VALUES, Positions

_SECTION = re.compile(rb"[ \t]*/(PROG|ATTR|APPL|MN|POS|END)\b", re.I)
_HEAD_WORD = re.compile(rb"/(?:PROG|ATTR|APPL|MN|POS|END)\b", re.I)
_REST = re.compile(rb"[^\r\n]*+(?:\r\n|[\r\n])")
_NUMBERED = re.compile(rb"[ \t]*(\d*)[ \t]*:")
_LABELS = re.compile(rb"'[^']*'|\"[^\"]*\"|\[[^\]\[]*\]")
"""Texts and brackets, whose comments may hold anything."""
_MESSAGE = re.compile(rb"\b(MESSAGE|PROMPT_BOX_?\w*|STATUS|UALM)\s*\[[^\]]*\]", re.I)
_TRACKED = re.compile(rb"[ \t]*(\w*_TRACK)\b", re.I)
"""A header of line tracking: the whole program follows a conveyor."""
_REMARK = re.compile(rb"\s*(?:!|//|--)")
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
    (re.compile(rb"\b(?:RTCP|REMOTE_TCP)\b", re.I), Problem("refuse", "remote TCP: tool and frame change roles")),
    (re.compile(rb"\bCOORD\b", re.I), Problem("refuse", "COORD: the frame moves with another group; it has no model")),
)
_FRAME_NUMBER = re.compile(
    rb"(?:\bU(FRAME|TOOL)_NUM\s*(?:\[\s*GP\d[^\]]*\]\s*)?|\$MNU(FRAME|TOOL)NUM\s*\[[^\]]*\]\s*)=\s*(.*)", re.I
)
_FRAME_SET = re.compile(
    rb"(?:(?<![\w$])U(FRAME|TOOL)\s*\[\s*(?:GP\d+\s*:\s*)?|\$MNU(FRAME|TOOL)\s*\[[^\],=]*,\s*)(\d{0,9})[^=]*\][\s.$\w]*="
    rb"|\$GROUP\s*\[[^\]=]*\]\s*\.\s*\$U(FRAME|TOOL)\b[^=]*=",
    re.I,
)
"""A frame that is set, also as a system variable. Without a number it may be any."""
_LABEL = re.compile(rb"\s*LBL\s*\[\s*(\d{1,9})", re.I)
_JUMP = re.compile(rb"\bLBL\s*\[\s*(\d+|[^\]]*)", re.I)
_CALL = re.compile(rb"\b(?:CALL|RUN)\s+(\w+)", re.I)
_WRITE = re.compile(rb"\s*P\s*\[[^=]*=", re.I)
_WHICH: Final = {b"TOOL": "tool", b"FRAME": "base"}
_NUMBERS: Final = {"tool": ("UTOOL_NUM", "UT"), "base": ("UFRAME_NUM", "UF")}


_CAM_MOTION: Final = re.compile(
    rb"[ \t]*+([0-9]{1,9}+)[ \t]*+:[ \t]*+[JL][ \t]++P\[([1-9][0-9]{0,8}+)\]"
    rb"[ \t]++([0-9]{1,9}+)(?:%|mm/sec|cm/min|deg/sec)[ \t]++(?:FINE|CNT[ \t]*+([0-9]{1,3}+))[ \t]*+;[ \t]*+\r?+\n"
)
_WHOLE: Final = rb"[0-9]{1,9}+"


class _Move(NamedTuple):
    point: Point
    word: str
    line: int
    node: int
    problem: Problem | None


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read a .ls file; a FileError names the line if it is broken."""
    return _Reader(Source.read(path), frames, options).read()


class _Reader(Reader):
    def __init__(self, source: Source, frames: KnownFrames, options: ReadOptions) -> None:
        super().__init__(source, frames, options)
        self._kinds: dict[tuple[str, int], int] = {}
        self._runs: list[FoundRun] = []
        self._moves: list[_Move] = []
        self._indirect: list[tuple[str, int, int]] = []
        self._labels: set[bytes] = set()
        self._tracked = ""

    def read(self) -> Program:
        instructions, position_start, position_end = self._sections()
        self._positions = Positions(self.source, self.options, position_start, position_end)
        codes = (one.code for one in instructions if isinstance(one, Instruction))
        self._labels = {m[1] for code in codes if (m := _LABEL.match(code))}
        self.flow.begin_routine("MAIN", outside=True)
        if self._tracked:
            self.flow.shift("program", self._tracked)
        self.body(instructions, self._take)
        self.flow.solve()
        self._settle()
        self._attach()
        self.points = [*self._positions.ordered(), *self.points]
        return self.program("fanuc", finest=1e-3, runs=self._runs)

    def _sections(self) -> tuple[list[Instruction | Lines], int, int]:
        """Return the instructions and runs of motions, and where the positions start and end."""
        data, seen = self.source.data, set()
        instructions: list[Instruction | Lines] = []
        start = end = len(data)
        heads = list(_section_heads(data))
        for head, border in zip(heads, [*(head.start() for head in heads[1:]), len(data)], strict=False):
            section = head[1].upper()
            if section in seen:
                line = self.source.line(head.start())
                raise self.source.error(line, f"/{section.decode()} is given a second time; keep one")
            seen.add(section)
            first = m.end() if (m := _REST.match(data, head.end())) else len(data)
            if section == b"POS":
                start = min(first, border)
            elif section == b"END":
                end = head.start()
                break
            elif section == b"APPL":
                lines = ((line, _TRACKED.match(data, a, b)) for line, a, b in self.source.lines(first, border))
                tracked = next(((line, m[1]) for line, m in lines if m), None)
                self._tracked = f"{tracked[1].decode().upper()} (line {tracked[0]})" if tracked else ""
            elif section == b"MN":
                self._main(instructions, first, border)
        if b"PROG" not in seen:
            raise FileError(self.source.path, "has no /PROG: it is not a FANUC program in text form (.ls)")
        if b"END" not in seen:
            raise FileError(self.source.path, "has no /END: the file is truncated")
        return instructions, min(start, end), end

    def _main(self, instructions: list[Instruction | Lines], start: int, end: int) -> None:
        """Add the instructions between two starts of lines, and the runs of motions among them."""
        data, finder = (
            self.source.data,
            RunFinder(self.source, _CAM_MOTION, {1: _WHOLE, 2: NAME, 3: _WHOLE, 4: _WHOLE}),
        )
        goes_on, position = False, start
        while position < end:
            for line, a, b in self.source.lines(position, end):
                if not goes_on and (lines := finder.find(a)) is not None and lines.end <= end:
                    instructions.append(lines)
                    position = lines.end
                    break
                goes_on = self._take_line(instructions, line, data[a:b], goes_on)
            else:
                break

    def _take_line(self, instructions: list[Instruction | Lines], line: int, text: bytes, goes_on: bool) -> bool:
        """Add a line to the instructions; return whether the last instruction has no ``;`` yet.

        A line without a number continues an instruction only if that is open (`goes_on`); else it is one of its own.
        """
        if not text.strip():
            return goes_on
        m = _NUMBERED.match(text)
        code = text[m.end() :] if m else text
        if goes_on and not (m and m[1]):
            before = instructions.pop()
            assert isinstance(before, Instruction)  # a run is not open
            line, code = before.line, before.code + b" " + code
        instructions.append(Instruction(line, code))
        return not _REMARK.match(code) and b";" not in _LABELS.sub(b"", code)

    def _take(self, piece: Instruction | Lines) -> None:
        """Take an instruction, or a run of motions."""
        if isinstance(piece, Instruction):
            self._instruction(piece)
            return
        data = self.source.data
        numbered = _NUMBERED.match(data, piece.start)
        motion = _MOTION.match(data, numbered.end() if numbered else piece.start)
        assert motion is not None  # of `_CAM_MOTION`
        kind = self._kinds.setdefault((motion[1].decode(), self.flow.node), len(self._kinds))
        if self._positions.named.move(piece, 1, kind):
            self.arc(None)
            return
        instructions: list[Instruction | Lines] = []
        for line, a, b in self.source.lines(piece.start, piece.end):
            self._take_line(instructions, line, data[a:b], goes_on=False)
        for one in instructions:
            self._take(one)

    def _instruction(self, instruction: Instruction) -> None:
        line, code = instruction.line, _TEXT.sub(b"''", instruction.code)
        if _REMARK.match(code):
            return
        flow = self.flow
        if m := _LABEL.match(code):
            flow.label(m[1].decode())
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
        self._frames(line, code)
        for name in _CALL.findall(code):
            flow.call(name.decode("latin-1").upper(), f"{name.decode('latin-1')} was called, which is not in this file")
        self._control(line, code.strip(b" \t;").upper())

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
        points = [self._goal(m, word, line, problem) for m in goals]
        if word == "C" and None not in points:
            self.circles.append([p for p in points if p is not None])
        if word == "A" and points[0] is not None:
            self.arc(points[0])
        else:
            self.arc(None)

    def _goal(self, m: re.Match[bytes], word: str, line: int, problem: Problem | None) -> Point | None:
        text = m[0].decode("latin-1")
        if m[1]:
            return self.other(word, line, Problem("skip", "position register, known at run time only"), text)
        if m[2] is None:
            self._indirect.append((word, line, self.flow.node))
            return self.other(word, line, Problem("skip", "which position is known at run time only"), text)
        point = self._positions.moved_to(int(m[2]), line)
        self._moves.append(_Move(point, word, line, self.flow.node, problem))
        return point

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

    def _frames(self, line: int, code: bytes) -> None:
        for m in _FRAME_NUMBER.finditer(code):
            digits, which = m[3].strip(b" \t;"), _WHICH[(m[1] or m[2]).upper()]
            text = f"{_NUMBERS[which][0]}={digits.decode('latin-1')}"
            value = (
                InForce("number", text, int(digits))
                if digits.isdigit() and len(digits) < 10
                else InForce("unknown", text[:40])
            )
            self.flow.change(**{which: value})
        for m in _FRAME_SET.finditer(code):
            which = _WHICH[(m[1] or m[2] or m[4]).upper()]
            self.changed.setdefault((which, int(m[3]) if m[3] else None), line)

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
            self._moves += [_Move(p, word, line, node, None) for p in self._positions.all() if p.values]
        for point, word, line, node, problem in self._moves:
            point.uses.append(self._use_at(point, word, node, line, problem))

    def _use_at(self, point: Point, word: str, node: int, line: int, problem: Problem | None) -> Use:
        """Return a motion with the frames of its position, refused where others are in force."""
        tool, base = self._positions.frames_of(point)
        state = self.flow.states[node]
        for which, frame in (("tool", tool), ("base", base)):
            values = getattr(state, which)
            numbers = {v.number for v in values if v.kind == "number"}
            if problem is None and frame and numbers and len(numbers) == len(values) and frame.key not in numbers:
                other, own = _NUMBERS[which]
                reason = f"{other} {min(numbers)} is in force (line {line}), but it was taught in {own} {frame.key}"
                problem = Problem("refuse", reason)
        return self.use(word, line, tool, base, shifts.problem_of(state.shifts) or problem)


def _section_heads(data: bytes) -> Iterator[re.Match[bytes]]:
    """Yield the lines that begin a section; the match starts with the line."""
    for m in _HEAD_WORD.finditer(data):
        start = m.start()
        while start and data[start - 1] in b" \t":
            start -= 1
        if (not start or data[start - 1] in b"\r\n") and (head := _SECTION.match(data, start)):
            yield head


def _line(item: Point | _Move) -> int:
    return item.line
