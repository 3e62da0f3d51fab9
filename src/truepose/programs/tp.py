"""FANUC TP (.ls): instructions under /MN, positions with their own frame numbers under /POS.

UF and UT of a position are the frames in which it was taught, and the controller stops if others are in force. So they
are used, unless UFRAME_NUM or UTOOL_NUM is certainly another where a motion goes to the position.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final, NamedTuple

from truepose.errors import FileError
from truepose.programs.core import shifts
from truepose.programs.core.flow import InForce
from truepose.programs.core.points import JOINTS, Frame, Point, Problem, not_understood, numbers_at, unknown_motion
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Instruction, Reader
from truepose.programs.core.source import Source, shown

_SECTION = re.compile(rb"[ \t]*/(PROG|ATTR|APPL|MN|POS|END)\b", re.I)
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
_HEAD = re.compile(rb"(?<![\w$])P[ \t]*\[[ \t]*(\d{1,9})[ \t]*(?::[ \t]*(?:\"[^\"\r\n]*\"|[^\]\r\n]*))?\]\s*\{", re.I)
_GROUP = re.compile(rb"\bGP(\d{1,9})\s*:", re.I)
_FRAMES = re.compile(rb"\b(UF|UT)\s*:\s*([^\s,]*)", re.I)
_CONFIG = re.compile(rb"\bCONFIG\s*:\s*'([^'\r\n]*)'", re.I)
_VALUE = re.compile(rb"(?<![\w'])([XYZWPR]|J\d|E\d)[ \t]*=([ \t]*[^\s,;}]*)[ \t]*(mm|deg)?", re.I)
_AXES: Final = ("X", "Y", "Z", "W", "P", "R")
_UNIT: Final = dict(zip(_AXES, (b"mm", b"mm", b"mm", b"deg", b"deg", b"deg"), strict=True))
_WHICH: Final = {b"TOOL": "tool", b"FRAME": "base"}
_NUMBERS: Final = {"tool": ("UTOOL_NUM", "UT"), "base": ("UFRAME_NUM", "UF")}


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
        self._positions: dict[int, Point] = {}
        self._frames_of: dict[int, tuple[Frame | None, Frame | None]] = {}
        self._moves: list[_Move] = []
        self._indirect: list[tuple[str, int, int]] = []
        self._labels: set[bytes] = set()
        self._tracked = ""

    def read(self) -> Program:
        instructions, position_start, position_end = self._sections()
        self._read_positions(position_start, position_end)
        self._labels = {m[1] for _, code in instructions if (m := _LABEL.match(code))}
        self.flow.begin_routine("MAIN", outside=True)
        if self._tracked:
            self.flow.shift("program", self._tracked)
        self.body(instructions, self._instruction)
        self.flow.solve()
        self._attach()
        self.points = [*self._positions.values(), *self.points]
        return self.program("fanuc", finest=1e-3)

    def _sections(self) -> tuple[list[Instruction], int, int]:
        """Return the instructions, and where the positions start and end."""
        data, section, seen = self.source.data, b"", set()
        instructions: list[Instruction] = []
        start = end = len(data)
        goes_on = False
        for line, a, b in self.source.lines():
            if m := _SECTION.match(data, a, b):
                section = m[1].upper()
                if section in seen:
                    raise self.source.error(line, f"/{section.decode()} is given a second time; keep one")
                seen.add(section)
                if section == b"POS":
                    start = b
                elif section == b"END":
                    end = a
                    break
            elif section == b"APPL" and (m := _TRACKED.match(data, a, b)) and not self._tracked:
                self._tracked = f"{m[1].decode().upper()} (line {line})"
            elif section == b"MN":
                goes_on = self._take_line(instructions, line, data[a:b], goes_on)
        if b"PROG" not in seen:
            raise FileError(self.source.path, "has no /PROG: it is not a FANUC program in text form (.ls)")
        if b"END" not in seen:
            raise FileError(self.source.path, "has no /END: the file is truncated")
        return instructions, min(start, end), end

    def _take_line(self, instructions: list[Instruction], line: int, text: bytes, goes_on: bool) -> bool:
        """Add a line to the instructions; return whether the last instruction has no ``;`` yet.

        A line without a number continues an instruction only if that is open (`goes_on`); else it is one of its own.
        """
        if not text.strip():
            return goes_on
        m = _NUMBERED.match(text)
        code = text[m.end() :] if m else text
        if goes_on and not (m and m[1]):
            line, code = instructions[-1].line, instructions.pop().code + b" " + code
        instructions.append(Instruction(line, code))
        return not _REMARK.match(code) and b";" not in _LABELS.sub(b"", code)

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
        point = self._positions.get(int(m[2]))
        if point is None:
            point = self._positions[int(m[2])] = Point(f"P[{int(m[2])}]", self.source, line)
            point.problem = Problem("skip", "not taught: it is not under /POS")
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
            numbers = [int(m[1])] if m[1] else list(self._positions)
            for number in numbers:
                point = self._positions.get(number)
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

    def _attach(self) -> None:
        """Give each position the motions to it, now that the frames in force at each are known."""
        for word, line, node in self._indirect:
            self._moves += [_Move(p, word, line, node, None) for p in self._positions.values() if p.values]
        number = {id(point): n for n, point in self._positions.items()}
        for point, word, line, node, problem in self._moves:
            tool, base = self._frames_of.get(number[id(point)], (None, None))
            state = self.flow.states[node]
            for which, frame in (("tool", tool), ("base", base)):
                values = getattr(state, which)
                numbers = {v.number for v in values if v.kind == "number"}
                if problem is None and frame and numbers and len(numbers) == len(values) and frame.key not in numbers:
                    other, own = _NUMBERS[which]
                    reason = f"{other} {min(numbers)} is in force (line {line}), but it was taught in {own} {frame.key}"
                    problem = Problem("refuse", reason)
            problem = shifts.problem_of(state.shifts) or problem
            point.uses.append(self.use(word, line, tool, base, problem))

    def _read_positions(self, start: int, end: int) -> None:
        data, source = self.source.data, self.source
        position = start
        for m in _HEAD.finditer(data, start, end):
            line = source.line(m.start(1))
            if data[position : m.start()].strip():
                raise source.error(
                    source.line(position + 1), "a position under /POS that is not understood; correct it"
                )
            number, close = int(m[1]), data.find(b"}", m.end(), end)
            if close < 0 or data.find(b"{", m.end(), close) >= 0:
                raise source.error(line, f"the brace of P[{number}] is not closed: the file is truncated or broken")
            if number in self._positions:
                raise source.error(line, f"P[{number}] is given twice, first in line {self._positions[number].line}")
            self._positions[number] = self._position(number, line, m.end(), close)
            position = close + 1
            while data[position : position + 1] in (b" ", b";", b"\t"):
                position += 1
        if data[position:end].strip():
            line = source.line(position + len(data[position:end]) - len(data[position:end].lstrip()))
            raise source.error(line, "a position under /POS that is not understood; correct it")

    def _position(self, number: int, line: int, start: int, end: int) -> Point:
        source, data = self.source, self.source.data
        point = Point(f"P[{number}]", source, line)
        groups = list(_GROUP.finditer(data, start, end))
        if groups:
            ours = [k for k, m in enumerate(groups) if int(m[1]) == 1]
            if not ours:
                point.problem = Problem("skip", "no position of group 1, the robot")
                return point
            start = groups[ours[0]].end()
            end = groups[ours[0] + 1].start() if ours[0] + 1 < len(groups) else end
        frames: dict[bytes, bytes] = {m[1].upper(): m[2] for m in _FRAMES.finditer(data, start, end)}
        config = _CONFIG.search(data, start, end)
        point.configuration = config[1].decode("latin-1") if config else ""
        point.problem = _problem_of(frames)
        self._frames_of[number] = (_frame(frames, b"UT", "UTOOL"), _frame(frames, b"UF", "UFRAME"))
        found: dict[str, re.Match[bytes]] = {}
        for m in _VALUE.finditer(data, start, end):
            key = m[1].decode().upper()
            if key in found:
                raise source.error(source.line(m.start()), f"P[{number}] gives {key} twice; keep one")
            found[key] = m
        if any(key.startswith("J") for key in found):
            point.problem = JOINTS
            return point
        missing = [key for key in _AXES if key not in found]
        if missing:
            raise source.error(line, f"P[{number}] has no {', '.join(missing)}; correct the file")
        if any(found[key][2].strip().startswith(b"*") for key in _AXES):
            point.problem = Problem("skip", "not taught: its numbers are ****")
            return point
        for key in _AXES:
            if (found[key][3] or b"").lower() != _UNIT[key]:
                at = source.line(found[key].start())
                raise source.error(
                    at, f"P[{number}] {key}: expected a number in {_UNIT[key].decode()}; correct the file"
                )
        tokens = [found[key][2].strip() for key in _AXES]
        values, _ = numbers_at(source, source.line(found["X"].start()), _AXES, tokens, [0] * 6)
        point.values, point.spans = values, tuple([found[key].span(2) for key in _AXES])
        external = [key for key in found if key.startswith("E")]
        if external and point.problem is None and not self.options.external_axes:
            reason = f"external axis {external[0]} in group 1 has no model; allow external_axes if it does not move it"
            point.problem = Problem("refuse", reason)
        return point


def _problem_of(frames: dict[bytes, bytes]) -> Problem | None:
    for key in (b"UF", b"UT"):
        value = frames.get(key, b"")
        if not value.isdigit() or len(value) > 4:
            found = shown(value) or "missing"
            return Problem("refuse", f"{key.decode()} : {found}: in whatever frame is in force; teach it in a number")
    return None


def _frame(frames: dict[bytes, bytes], key: bytes, name: str) -> Frame | None:
    value = frames.get(key, b"")
    return Frame(f"{name}[{int(value)}]", int(value)) if value.isdigit() and len(value) < 5 else None
