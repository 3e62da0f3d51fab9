"""Yaskawa INFORM (.jbi): positions under //POS, whose kind, tool and frame are modal, and instructions under //INST."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from truepose.errors import FileError
from truepose.programs.core import shifts
from truepose.programs.core.flow import Shift
from truepose.programs.core.points import JOINTS, RELATIVE, RUN_TIME, Frame, Point, Problem, numbers_at, unknown_motion
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Instruction, Reader
from truepose.programs.core.source import Source, shown

_OF_ALL_JOBS: Final = Problem(
    "refuse",
    "P variables are those of all jobs: another may move to it or write it; state that none does (--whole-task)",
)
_POSITION = re.compile(rb"[ \t]*(B?E?[CP])(\d{3,6})[ \t]*=[ \t]*")
_MODAL = re.compile(rb"[ \t]*///(\w+)[ \t]*([^\r\n]*)")
_MOTION = re.compile(rb"[ \t]*[+*]?[ \t]*S?(MOV[JLCS])[ \t]+([A-Z]+[\d\[][^\s]*)((?:[ \t]+[BE][CP]X?\d+)*)", re.I)
_STRAY = re.compile(rb"\"[^\"]*+\"|(?<![\w*:#$])([SE]?I?MOV[JLCS](?=[ \t]+[A-Z]+[\d\[])|SFTON\b|SFTOF\b)", re.I)
"""Words that must begin an instruction; texts are skipped."""
_OPERAND = re.compile(rb"(?<![\w#$])(C|P)X?(\d{3,6})\b")
_RELATIVE = re.compile(rb"[ \t]*(?:S|E)?IMOV\w*", re.I)
_CONVEYOR = re.compile(rb"\bCV#\([^)]*\)?", re.I)
_SPEED = re.compile(rb"\bV[JRE]?[ \t]*=", re.I)
_LABEL = re.compile(rb"[ \t]*\*([^\s]+)")
_JUMP = re.compile(rb"[ \t]*JUMP[ \t]+(\*([^\s]+)|[^\s]+)([ \t]+IF\b)?", re.I)
_STRUCTURED = re.compile(rb"[ \t]*(?:IFTHEN|WHILE|FOR|SWITCH)(?:EXP)?\b", re.I)
_FRAME_CHANGE = re.compile(rb"[ \t]*(?:MFRAME|SETUF|GETUF)\b[^#]*UF#\([ \t]*(\d{1,9})?", re.I)
_TOOL_CHANGE = re.compile(rb"[ \t]*(?:SETTOOL|MTOOL)\b[^#]*TL#\([ \t]*(\d{1,9})?", re.I)
_KEYS: Final = ("X", "Y", "Z", "Rx", "Ry", "Rz")
_BASES: Final = ("BASE", "ROBOT")


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read a .jbi file; a FileError names the line if it is broken."""
    return _Reader(Source.read(path), frames, options).read()


class _Reader(Reader):
    def __init__(self, source: Source, frames: KnownFrames, options: ReadOptions) -> None:
        super().__init__(source, frames, options)
        self._positions: dict[tuple[str, int], Point] = {}
        self._frames_of: dict[int, tuple[Frame | None, Frame | None]] = {}
        self._external: set[tuple[str, int]] = set()
        self._moves: list[tuple[Point, str, int, int, Problem | None]] = []
        self._modal: dict[str, str] = {}
        self._labels: set[bytes] = set()
        self._always_shifted = False

    def read(self) -> Program:
        data, section, ended = self.source.data, "", False
        instructions: list[Instruction] = []
        if not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"/JOB"):
            raise FileError(self.source.path, "does not start with /JOB: it is no INFORM job")
        for line, start, end in self.source.lines():
            code = data[start:end]
            if code.lstrip().startswith(b"//") and not code.lstrip().startswith(b"///"):
                section = code.strip()[2:].split()[0].decode("latin-1").upper() if code.strip()[2:].split() else ""
            elif section == "POS":
                self._position_line(line, start, end)
            elif section == "INST":
                if code.strip().upper() == b"END":
                    ended = True
                    break
                instructions.append(Instruction(line, code))
        if not ended:
            raise FileError(self.source.path, "has no END: the file is truncated")
        self._follow(instructions)
        self.points = [*self._positions.values(), *self.points]
        return self.program("yaskawa", finest=1e-3)

    def _position_line(self, line: int, start: int, end: int) -> None:
        data = self.source.data
        if m := _MODAL.match(data, start, end):
            key, text = m[1].decode("latin-1").upper(), m[2].decode("latin-1").strip()
            self._modal[key] = text
            return
        m = _POSITION.match(data, start, end)
        if m is None:
            if data[start:end].strip():
                raise self.source.error(line, f"a line under //POS that is not understood: {shown(data[start:end])}")
            return
        kind, number = m[1].decode(), int(m[2])
        pieces, position = [], m.end()
        for piece in data[m.end() : end].split(b","):
            pieces.append((piece.strip(), position + len(piece) - len(piece.lstrip())))
            position += len(piece) + 1
        name = data[m.start(1) : m.end(2)].decode("latin-1")
        if kind not in ("C", "P"):
            if any(token.strip(b"+-0.") for token, _ in pieces):
                self._external.add((kind, number))
            return
        if (kind, number) in self._positions:
            raise self.source.error(line, f"{name} is given twice, first in line {self._positions[kind, number].line}")
        point = self._positions[kind, number] = Point(name, self.source, line)
        self._fill(point, pieces, line)

    def _fill(self, point: Point, pieces: list[tuple[bytes, int]], line: int) -> None:
        postype = self._modal.get("POSTYPE", "").upper()
        point.configuration = self._modal.get("RCONF", "")
        if postype == "PULSE":
            point.problem = Problem("skip", f"{JOINTS.reason} (pulses)")
            return
        if len(pieces) < 6:
            raise self.source.error(line, f"{point.name} has {len(pieces)} numbers, expected 6; correct the file")
        tokens, starts = zip(*pieces[:6], strict=True)
        point.values, point.spans = numbers_at(self.source, line, _KEYS, tokens, starts)
        tool, user = self._modal.get("TOOL", ""), self._modal.get("USER", "")
        tool_frame = Frame(f"TOOL {int(tool)}", int(tool)) if _small(tool) else None
        if postype in _BASES:
            frame = Frame(postype, 0)
        elif postype == "USER" and _small(user):
            frame = Frame(f"USER {int(user)}", int(user))
        else:
            frame = None
            shown = f"///POSTYPE {postype or 'missing'}" + (" without ///USER" if postype == "USER" else "")
            point.problem = Problem("refuse", f"{shown}: the frame of its numbers is not known")
        if tool_frame is None and point.problem is None:
            point.problem = Problem("refuse", f"///TOOL {tool or 'missing'}: its tool is not known")
        if len(pieces) > 6:
            reason = f"{len(pieces)} numbers: a seventh axis, which has no model, or a number that a comma splits"
            point.problem = Problem("refuse", reason)
        self._frames_of[id(point)] = (tool_frame, frame)

    def _follow(self, instructions: list[Instruction]) -> None:
        flow = self.flow
        shifted = next((line for line, code in instructions if re.match(rb"[ \t]*SFTON\b", code, re.I)), 0)
        # with structures or without: nothing is guessed about where a shift ends
        steered = any(_STRUCTURED.match(code) for _, code in instructions)
        structured = shifted if steered else 0
        self._labels = {m[1] for _, code in instructions if (m := _LABEL.match(code))}
        self._always_shifted = bool(structured)
        flow.begin_routine("JOB", outside=True)
        if structured:
            flow.change(ipo=f"SFTON (line {structured})")
        for shift in shifts.begun(shifts.INFORM, instructions) if steered else ():
            flow.shift(*shift)
        self.body(instructions, self._instruction)
        flow.solve()
        self.arc(None)
        for point, word, line, node, problem in self._moves:
            tool, frame = self._frames_of.get(id(point), (None, None))
            state = flow.states[node]
            shifted_by = [ipo for ipo in state.ipo if ipo != "BASE"]
            if problem is None and shifted_by:
                problem = Problem("skip", f"{min(shifted_by)} shifts it at run time")
            problem = shifts.problem_of(state.shifts) or problem
            if problem is None and point.name.startswith("P") and not self.options.whole_task:
                problem = _OF_ALL_JOBS
            point.uses.append(self.use(word, line, tool, frame, problem))

    def _instruction(self, instruction: Instruction) -> None:
        line, code = instruction
        if not code.strip() or code.lstrip()[:1] in (b"'", b"/"):
            return
        code, flow, labels = code.split(b" '")[0], self.flow, self._labels
        if m := _LABEL.match(code):
            flow.label(m[1].decode("latin-1"))
            code = code[m.end() :]
        begin = re.match(rb"[ \t]*+[+*]?+[ \t]*+\w*+", code)
        for m in _STRAY.finditer(code, begin.end() if begin else 0):
            if m[1]:
                message = f"a motion or shift inside another instruction ({shown(code)}): write each on its own line"
                raise self.source.error(line, message)
        if m := _MOTION.match(code):
            self._motion(m, line, _CONVEYOR.search(code, m.end()))
            return
        shifts.follow(flow, shifts.INFORM, code, line)
        if _OPERAND.search(code):
            self.arc(None)
        if m := _JUMP.match(code):
            for label in [m[2]] if m[2] in labels else labels if m[2] is None else ():
                flow.may_go(label.decode("latin-1"))
            if not m[3] and m[2] in labels:
                flow.leave()
        elif re.match(rb"[ \t]*SFTON\b", code, re.I):
            flow.change(ipo=f"SFTON (line {line})")
        elif re.match(rb"[ \t]*SFTOF\b", code, re.I) and not self._always_shifted:
            flow.change(ipo="BASE")
        elif re.match(rb"[ \t]*RET\b(?![^\r\n]*\bIF\b)", code, re.I):
            flow.leave()
        elif m := _FRAME_CHANGE.match(code):
            self.changed.setdefault(("base", int(m[1]) if m[1] else None), line)
        elif m := _TOOL_CHANGE.match(code):
            self.changed.setdefault(("tool", int(m[1]) if m[1] else None), line)
        self._operands(line, code)

    def _motion(self, m: re.Match[bytes], line: int, conveyor: re.Match[bytes] | None) -> None:
        word, operand = m[1].decode().upper(), m[2]
        found = _OPERAND.fullmatch(operand)
        point = self._positions.get((found[1].decode(), int(found[2]))) if found else None
        if point is None:
            self.other(word, line, RUN_TIME, operand.decode("latin-1"))
            self.arc(None)
            return
        external = [
            e for e in re.findall(rb"([BE][CP])X?(\d{1,9})", m[3]) if (e[0].decode(), int(e[1])) in self._external
        ]
        problem = shifts.problem_of([Shift("conveyor", f"{shown(conveyor[0])} (line {line})")] if conveyor else [])
        if external and not self.options.external_axes:
            name = b"".join(external[0]).decode()
            problem = Problem("refuse", f"external axis {name} is in use and has no model; allow external_axes")
        self._moves.append((point, word, line, self.flow.node, problem))
        if word == "MOVC":
            self.arc(point)
        else:
            self.arc(None)

    def _operands(self, line: int, code: bytes) -> None:
        """Take the positions in an instruction that is no motion."""
        relative = _RELATIVE.match(code) is not None
        word = (code.split() or [b"?"])[0].decode("latin-1")
        for m in _OPERAND.finditer(code):
            point = self._positions.get((m[1].decode(), int(m[2])))
            if relative:
                self.other(word, line, RELATIVE)
                if point is not None:
                    point.reads.append((line, "used by a relative motion"))
                return
            if _SPEED.search(code):
                self.other(word, line, unknown_motion(shown(code)))
                return
            if point is not None and m[1] == b"P":
                point.writes.append((line, f"written or read by {word}"))
            elif point is not None:
                point.reads.append((line, f"read by {word}"))


def _small(text: str) -> bool:
    return text.isdecimal() and text.isascii() and len(text) < 5
