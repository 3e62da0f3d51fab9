"""Yaskawa INFORM (.jbi): positions under //POS, whose kind, tool and frame are modal, and instructions under //INST."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from truepose.errors import FileError
from truepose.programs.core import shifts
from truepose.programs.core.forms import FoundRun, Lines, RunFinder
from truepose.programs.core.named import Group
from truepose.programs.core.pieces import Section
from truepose.programs.core.points import RELATIVE, RUN_TIME, Derived, FileLine, Point, Problem, Use, unknown_motion
from truepose.programs.core.program import Key, KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Instruction, Reader
from truepose.programs.core.source import NotAProgramError, Source, Span, shown
from truepose.programs.core.state import Shift, State
from truepose.programs.inform import words
from truepose.programs.inform.controller import ANY, ELSEWHERE, Controller, Displacement, Mention, Survey
from truepose.programs.inform.positions import NAME, VALUES, Positions
from truepose.programs.inform.shifted import derived_by

_OF_ALL_JOBS: Final = Problem(
    "refuse",
    "P variables are those of all jobs: another may move to it or write it; state that none does (--whole-task)",
)
_COORDINATED: Final = Problem("refuse", "a coordinated motion: its path moves with another group, which has no model")
_UNSHIFTED: Final = "BASE"
_HEAD = re.compile(rb"(?<!/)//(?!/)[ \t]*(\w*)([^\r\n]*+)(?:\r\n|[\r\n])?+")
_GROUP = re.compile(rb"[ \t]*///GROUP([12])[ \t]+([^\r\n]*)", re.I)
_CAM_MOTION: Final = re.compile(
    rb"[ \t]*+MOV[JLS][ \t]++C([0-9]{3,6}+)[ \t]++V[JR]?=([0-9]{1,6}+(?:\.[0-9]{0,9}+)?+)"
    rb"(?:[ \t]++PL=([0-9]{1,2}+))?+[ \t]*+\r?+\n"
)
_MOTION_PATTERNS: Final = {1: NAME, 2: rb"[0-9]{1,6}+(?:\.[0-9]{0,9}+)?+", 3: rb"[0-9]{1,2}+"}


class _Move(NamedTuple):
    point: Point
    word: str
    line: int
    node: int
    section: Section
    problem: Problem | None = None


def read(
    path: Path,
    frames: KnownFrames,
    options: ReadOptions,
    *,
    controller: Controller | None = None,
    beside: Controller | None = None,
) -> Program:
    """Read a .jbi file; a FileError names the line if it is broken.

    `controller` is what a backup tells about all jobs; `beside` is what the jobs in the folder of this one tell, where
    there is no backup: there may be more of them.
    """
    return _Reader(Source.read(path), frames, options, controller, beside).read()


def survey(path: Path, frames: KnownFrames, controller: Controller) -> Survey:
    """Return what a job tells about others, given what is known about them."""
    return _Reader(Source.read(path), frames, ReadOptions(), controller).survey()


class _Reader(Reader):
    def __init__(
        self,
        source: Source,
        frames: KnownFrames,
        options: ReadOptions,
        controller: Controller | None,
        beside: Controller | None = None,
    ) -> None:
        super().__init__(source, frames, options)
        self._controller, self._beside = controller, beside
        self._kinds: dict[tuple[str, int, Section], int] = {}
        self._runs: list[FoundRun] = []
        self._moves: list[_Move] = []
        self._labels: set[bytes] = set()
        self._displacements: dict[str, Displacement] = {}
        self._mentions: list[Mention] = []
        self._calls: list[tuple[str, int]] = []
        self._ends: list[int] = []
        self._reframed: dict[str, str] = {}
        self._groups = {b"1": "RB1", b"2": ""}
        self._base_moved = ""
        self._all_read: Problem | None = None
        self._title = ""
        self._own: Controller | None = None

    def read(self) -> Program:
        self._follow()
        self.changed = {**self._known().changed, **self.changed}
        self._settle()
        self._attach()
        self.points = [*self._positions.ordered(), *self.points]
        return self.program("yaskawa", finest=1e-3, runs=self._runs)

    def survey(self) -> Survey:
        """Return what the job tells about others."""
        self._follow()
        states = self.flow.states
        calls = [(name, self._displaced(states[node]), _UNSHIFTED in states[node].ipo) for name, node in self._calls]
        left = frozenset[Displacement]().union(*(self._displaced(states[node]) for node in self._ends))
        return Survey(self._name(), self._all_mentions(), calls, left, self._reframed, self._own_changes())

    def _own_changes(self) -> dict[tuple[str, Key | None], FileLine]:
        """Return the tools and user frames that this job changes."""
        name = self.source.path.name
        return {key: FileLine(name, place) for key, place in self.changed.items() if isinstance(place, int)}

    def _all_mentions(self) -> list[Mention]:
        """Return the mentions of P variables, those under //POS included."""
        given = [
            Mention(number, self.source.path.name, point.line, "given", pose)
            for number, point, pose in self._positions.variables()
        ]
        return [*given, *self._mentions]

    def _displaced(self, state: State) -> frozenset[Displacement]:
        """Return the shifts that may be active, those of sensors included."""
        known, name = self._displacements, self.source.path.name
        sensed = {known.get(one.text) or Displacement(f"{one.text} of {name}", sensed=True) for one in state.shifts}
        return frozenset(known[text] for text in state.ipo if text != _UNSHIFTED) | sensed

    def _name(self) -> str:
        return self._title or self.source.path.stem.upper()

    def _sections(self) -> tuple[list[Span], list[Instruction | Lines]]:
        """Return where positions stand, and the instructions and runs of motions."""
        data = self.source.data
        if not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"/JOB"):
            raise NotAProgramError(self.source.path, "does not start with /JOB: it is no INFORM job")
        heads = list(_section_heads(data))
        borders = [*(start for start, _ in heads[1:]), len(data)]
        positions: list[Span] = []
        instructions: list[Instruction | Lines] = []
        ended = False
        for (_, head), border in zip(heads, borders, strict=False):
            section = head[1].upper()
            if section == b"NAME":
                self._title = head[2].decode("latin-1").strip().upper()
            elif section == b"POS":
                positions.append((head.end(), border))
            elif section == b"INST":
                ended = self._main(instructions, head.end(), border)
                break
        if not ended:
            raise FileError(self.source.path, "has no END: the file is truncated")
        return positions, instructions

    def _main(self, instructions: list[Instruction | Lines], start: int, end: int) -> bool:
        """Add the instructions between two starts of lines, and the runs of motions; return whether END closes them."""
        data, position = self.source.data, start
        finder = RunFinder(self.source, _CAM_MOTION, _MOTION_PATTERNS)
        while position < end:
            for line, a, b in self.source.lines(position, end):
                if (lines := finder.find(a)) is not None and lines.end <= end:
                    instructions.append(lines)
                    position = lines.end
                    break
                code = data[a:b]
                if code.strip().upper() == b"END":
                    if (more := re.compile(rb"[ \t]*/JOB\b", re.M).search(data, b)) is not None:
                        at = self.source.line(more.start() + 1)
                        raise self.source.error(at, "a second job in the file; write each into a file of its own")
                    return True
                if m := _GROUP.match(code):
                    self._groups[m[1]] = m[2].decode("latin-1").strip().upper()
                instructions.append(Instruction(line, code))
            else:
                break
        return False

    def _follow(self) -> None:
        """Take the instructions and follow all ways through them."""
        spans, instructions = self._sections()
        self._positions = Positions(self.source, spans, self._known(), own_arm=self.options.controller_kinematics)
        codes = [one.code for one in instructions if isinstance(one, Instruction)]
        self._labels = {m[1] for code in codes if (m := words.LABEL.match(code))}
        flow = self.flow
        flow.begin_routine("JOB", outside=True)
        for shift in sorted(self._known().entered.get(self._name(), ())):
            self._may_shift(shift)
        last = flow.node

        def take(piece: Instruction | Lines) -> None:
            nonlocal last
            self._take(piece)
            last = flow.node

        self.body(instructions, take)
        self._ends.append(last)
        flow.solve()
        self.arc(None)

    def _known(self) -> Controller:
        return self._controller or self._beside or Controller()

    def _may_shift(self, shift: Displacement) -> None:
        """Let a shift be active from here on, or not."""
        self._displacements[shift.text] = shift
        if not shift.sensed:
            self._may_be(shift.text)
            return
        self.flow.begin("IF", 0)
        self.flow.shift("of a job", shift.text)
        self.flow.end("ENDIF", "IF")

    def _may_be(self, shift: str) -> None:
        """Let a shift, or none, be in force from here on, or what was before."""
        self.flow.begin("IF", 0)
        self.flow.change(ipo=shift)
        self.flow.end("ENDIF", "IF")

    def _take(self, piece: Instruction | Lines) -> None:
        """Take an instruction, or a run of motions."""
        if isinstance(piece, Instruction):
            self._instruction(piece)
            return
        m = words.MOTION.match(self.source.data, piece.start)
        assert m is not None  # of `_CAM_MOTION`
        like = m[3].decode().upper(), self.flow.node, self.flow.motion()
        kind = self._kinds.setdefault(like, len(self._kinds))
        if self._plain() and self._positions.named.move(piece, 0, kind):
            self.arc(None)
            return
        for line, a, b in self.source.lines(piece.start, piece.end):
            self._instruction(Instruction(line, self.source.data[a:b]))

    def _plain(self) -> bool:
        """Return whether nothing but the positions themselves is against a correction of plain motions."""
        return self._group_problem("1") is None and not self._base_moved

    def _instruction(self, instruction: Instruction) -> None:
        line, code = instruction
        if not code.strip() or code.lstrip()[:1] in (b"'", b"/") or words.COMMENTED_OUT.match(code):
            return
        code, flow = words.without_comment(code), self.flow
        if m := words.LABEL.match(code):
            flow.label(m[1].decode("latin-1"))
            code = code[m.end() :]
        parts = words.TOGETHER.split(code)
        for part in parts:
            begin = re.match(rb"[ \t]*+[+*]?+[ \t]*+\w*+", part)
            for m in words.STRAY.finditer(part, begin.end() if begin else 0):
                if m[1]:
                    found = f"a motion or shift inside another instruction ({shown(code)})"
                    raise self.source.error(line, f"{found}: write each on its own line")
        if words.MOTION.match(code):
            for part in parts:
                if m := words.MOTION.match(part):
                    self._motion(m, line, words.CONVEYOR.search(part, m.end()))
                    self._read_beside(part[m.end() :], line)
            self._call(line, code)
            return
        shifts.follow(flow, shifts.INFORM, code, line)
        if words.OPERAND.search(code):
            self.arc(None)
        self._control(line, code)
        for which, number in words.changed_frames(code):
            self.changed.setdefault((which, number), line)
        self._operands(line, code)
        if words.STEPS.search(code):
            read = f"{shown(code)} (line {line}) may read its numbers; corrections would change what it does with them"
            self._all_read = self._all_read or Problem(self.options.ambiguous, read)

    def _control(self, line: int, code: bytes) -> None:
        """Follow jumps, blocks, calls and shifts of positions."""
        flow, labels = self.flow, self._labels
        self._call(line, code)
        if m := words.JUMP.match(code):
            to_job = words.CALLED.match(code)
            for label in [m[2]] if m[2] in labels else labels if m[2] is None and not to_job else ():
                flow.may_go(label.decode("latin-1"))
            if not words.CONDITION.search(code) and (m[2] in labels or to_job):
                self._ends += [flow.node] if to_job else []
                flow.leave()
        elif m := words.BLOCK.match(code):
            self._block(line, m[1].upper())
        elif m := words.SHIFT.match(code):
            self._shift(line, m)
        elif words.UNSHIFT.match(code):
            flow.change(ipo=_UNSHIFTED)
        elif words.RETURN.match(code):
            self._ends.append(flow.node)
            flow.leave()
        elif words.RETURNS.match(code):
            self._ends.append(flow.node)
        elif (m := words.JUMP_INSIDE.search(code)) and m[1] in labels:
            flow.may_go(m[1].decode("latin-1"))

    def _block(self, line: int, word: bytes) -> None:
        """Follow IFTHEN, WHILE, FOR and SWITCH."""
        flow = self.flow
        if word in (b"IFTHEN", b"IFTHENEXP"):
            flow.begin("IF", line)
        elif word in (b"ELSEIF", b"ELSEIFEXP", b"ELSE"):
            flow.branch("ELSE", last=word == b"ELSE")
        elif word in (b"WHILE", b"WHILEEXP", b"FOR", b"SWITCH"):
            flow.begin(word[:5].decode() if word != b"SWITCH" else "SWITCH", line)
            if word == b"SWITCH":  # the first case may stand in the same line
                flow.branch("CASE", last=False)
        elif word in (b"CASE", b"DEFAULT"):
            flow.branch("CASE", last=word == b"DEFAULT")
        else:
            flow.end(word.decode(), {b"ENDIF": "IF", b"NEXT": "FOR", b"ENDWHILE": "WHILE"}.get(word, "SWITCH"))

    def _shift(self, line: int, m: re.Match[bytes]) -> None:
        """Begin a shift of all positions by a P variable."""
        alone = self._controller is None and self._beside is None
        text = f"SFTON (line {line})" if alone else f"SFTON (line {line} of {self.source.path.name})"
        plain = m[2] and not m[1] and not m[4].strip()
        along = m[3].decode("latin-1").upper().replace(" ", "").replace("\t", "")
        self._displacements[text] = Displacement(text, int(m[2]) if plain else None, along)
        self.flow.change(ipo=text)
        if m[2]:
            self._mention(int(m[2]), line, "shift" if plain else "other")

    def _call(self, line: int, code: bytes) -> None:
        """Follow a call of another job: it may be shifted, and may leave a shift behind."""
        if m := words.CALLED.match(code):
            name = m[1].decode("latin-1").upper()
            if b"UF#(" in m[2].upper():
                self._reframed.setdefault(name, f"{shown(code)} (line {line} of {self.source.path.name})")
        elif words.UNKNOWN_CALL.match(code):
            name = ELSEWHERE
        elif named := [m[1] for m in words.JOB.finditer(code) if m[1]]:  # whatever the instruction does with it
            name = named[0].decode("latin-1").upper()
        else:
            return
        self._calls.append((name, self.flow.node))
        self.flow.may_move()
        self._may_be(_UNSHIFTED)
        for shift in sorted(self._known().left.get(name, ())):
            self._may_shift(shift)

    def _mention(self, number: int, line: int, how: str, element: tuple[int, float] | None = None) -> None:
        self._mentions.append(Mention(number, self.source.path.name, line, how, element=element))

    def _group_problem(self, group: str) -> Problem | None:
        """Return the reason why the positions of a group are not corrected; None for the robot of the map."""
        robots = [word for word in re.split(r"[,\s]+", self._groups[group.encode()]) if word.startswith("R")]
        robot = robots[0] if robots else "RB1" if group == "1" else "another group"
        wanted = self._known().robot
        if (wanted is None and group == "1") or robot == f"RB{wanted}":
            return None
        return Problem("skip", f"moves {robot}, which is not the robot of the map")

    def _motion(self, m: re.Match[bytes], line: int, conveyor: re.Match[bytes] | None) -> None:
        word, operand = m[3].decode().upper(), m[4]
        axes = [(e[0].decode().upper(), int(e[1])) for e in words.AXES.findall(m[5])]
        if alone := words.AXES.fullmatch(operand):  # base axes or a station without the robot
            kind, number = alone[1].decode().upper(), int(alone[2])
            if kind.startswith("B") and (kind, number) in self._positions.axes_in_use:
                self._base_moved = f"{operand.decode('latin-1')} (line {line})"
            return
        problem = self._group_problem("2" if m[1] else "1")
        found = words.OPERAND.fullmatch(operand)
        if found and found[1] == b"P":
            self._mention(int(found[2]), line, "moved to")
        elif not found and operand[:1].upper() in (b"P", b"C"):
            self._mention(ANY, line, "moved to")
        point = self._positions.get(found[1].decode(), int(found[2])) if found else None
        if point is None:
            self.other(word, line, problem or self._elsewhere(found), operand.decode("latin-1"))
            self.arc(None)
            return
        if problem is None and m[2]:
            problem = _COORDINATED
        if problem is None and conveyor:
            problem = shifts.problem_of([Shift("conveyor", f"{shown(conveyor[0])} (line {line})")])
        if problem is None and (own := words.OWN_FRAME.search(m.string, m.end())):
            problem = Problem("skip", f"moved to with {shown(own[0])}, not with the tool and frame it was taught with")
        external = [axis for axis in axes if axis in self._positions.axes_in_use and not self._station(axis[0])]
        if external and not self.options.external_axes:
            name = words.AXES.search(m[5])
            shown_axis = name[0].decode("latin-1") if name else external[0][0]
            problem = Problem("refuse", f"external axis {shown_axis} is in use and has no model; allow external_axes")
        self._moves.append(_Move(point, word, line, self.flow.node, self.flow.motion(), problem))
        self.arc(point if word == "MOVC" else None)

    def _station(self, kind: str) -> bool:
        """Return whether axes of a kind are those of a station, which carries neither the robot nor its base."""
        return kind.startswith("E") and any("ST" in group for group in self._groups.values())

    def _elsewhere(self, found: re.Match[bytes] | None) -> Problem:
        """Return the reason why a motion to a position that is not in the job is left out."""
        stored = self._known().variables.get(int(found[2])) if found and found[1] == b"P" else None
        if stored is None:
            return RUN_TIME
        return self._known().problem_of(int(found[2]), self.source.path.name) or RUN_TIME if found else RUN_TIME

    def _operands(self, line: int, code: bytes) -> None:
        """Take the positions in an instruction that is no motion."""
        relative = words.RELATIVE.match(code) is not None
        word = (code.split() or [b"?"])[0].decode("latin-1")
        element = words.ELEMENT.match(code)
        shift = words.SHIFT.match(code)
        if words.ANY_VARIABLE.search(code):
            self._mention(ANY, line, "other")
        for m in words.OPERAND.finditer(code):
            point = self._positions.get(m[1].decode(), int(m[2]))
            if m[1] == b"P" and element:
                value = int(element[3]) / (1e3 if element[2] < b"4" else 1e4)
                self._mention(int(m[2]), line, "element", (int(element[2]) - 1, value))
            elif m[1] == b"P" and not shift:
                self._mention(int(m[2]), line, "other")
            if relative:
                self.other(word, line, RELATIVE)
                if point is not None:
                    point.reads.append((line, "used by a relative motion"))
                return
            if words.SPEED.search(code):
                self.other(word, line, unknown_motion(shown(code)))
                return
            if point is not None and m[1] == b"P":
                point.writes.append((line, f"written or read by {word}"))
            elif point is not None:
                point.reads.append((line, f"read by {word}"))

    def _read_beside(self, code: bytes, line: int) -> None:
        """Take the positions that a motion names beside its own: whatever it does with them."""
        if words.ANY_VARIABLE.search(code):
            self._mention(ANY, line, "other")
        for m in words.OPERAND.finditer(code):
            if m[1] == b"P":
                self._mention(int(m[2]), line, "other")
            if (point := self._positions.get(m[1].decode(), int(m[2]))) is not None:
                point.reads.append((line, "read by a motion to another position"))

    def _settle(self) -> None:
        """Keep the runs of positions to which motions of one kind go, and take the other positions out of them."""
        named = self._positions.named
        before, kinds = named.taken.copy(), list(self._kinds)
        for group, lines in named.groups(self._alike):
            point = self._positions.read_at(lines.start, self._positions.first[group.run])
            if group.kind >= 0 and (use := self._uses_in(group, int(group.lines[0]))[0]) is not None:
                point.uses = [use]
            self._runs.append(FoundRun(lines, point, VALUES, group.lines, ("C", "")))
        for row in np.flatnonzero(named.taken & ~before).tolist():
            self._positions.take_out(row)
        moves = list(self._moves)
        for row, line, kind in named.left():
            word, node, section = kinds[kind]
            moves.append(_Move(self._positions.take_out(row), word, line, node, section))
        self._moves = sorted(moves, key=_line)

    def _alike(self, group: Group) -> bool:
        """Return whether the motions of a group differ in their lines at most."""
        if group.kind < 0:
            return True
        (first, a), (last, b) = (self._uses_in(group, int(line)) for line in group.lines[[0, -1]])
        if not (first and last):
            return first is last and not a and not b
        return first._replace(line=last.line) == last and not a and not b

    def _uses_in(self, group: Group, line: int) -> tuple[Use | None, list[Derived]]:
        word, node, section = list(self._kinds)[group.kind]
        return self._uses_at(_Move(self._positions.first[group.run], word, line, node, section))

    def _attach(self) -> None:
        """Give each position the motions to it, now that the shifts in force at each are known."""
        for number, point, _ in self._positions.variables():
            point.shared = self._settled().problem_of(number, self.source.path.name)
        for move in self._moves:
            use, derived = self._uses_at(move)
            move.point.uses += [use] if use else []
            move.point.derived += derived

    def _uses_at(self, move: _Move) -> tuple[Use | None, list[Derived]]:
        """Return a motion with the frames of its position, and the positions to which shifts move it instead."""
        point, problem = move.point, move.problem
        tool, frame = self._positions.frames_of(point)
        state = self.flow.states[move.node]
        problem = shifts.problem_of(state.shifts) or problem
        reframed = self._known().reframed.get(self._name())
        if problem is None and reframed and frame is not None and frame.key != 0:
            problem = Problem("skip", f"a relative job: {reframed} gives it another user frame")
        if problem is None and self._base_moved and not self.options.external_axes:
            problem = Problem("refuse", f"base axis {self._base_moved} has no model; allow external_axes")
        if problem is None and point.name.startswith("P") and not self.options.whole_task and self._controller is None:
            problem = _OF_ALL_JOBS
        derived: list[Derived] = []
        for text in sorted(state.ipo - {_UNSHIFTED}) if problem is None else ():
            found: Derived | Problem = Problem("skip", f"{text} shifts it at run time")
            if frame is not None:
                found = derived_by(self._displacements[text], frame, self.frames, self._settled(), move.line)
            if isinstance(found, Problem):
                problem = found
                break
            derived.append(found._replace(uses=(self.use(move.word, move.line, tool, frame, None, move.section),)))
        problem = problem or self._all_read
        if problem is None and derived and _UNSHIFTED not in state.ipo:
            return None, derived
        return self.use(move.word, move.line, tool, frame, problem, move.section), [] if problem else derived

    def _settled(self) -> Controller:
        """Return what is known about the P variables of all jobs; without a backup, what this job tells."""
        if self._controller is None and self._own is None:
            own: dict[int, list[Mention]] = {}
            for mention in self._all_mentions() if self.options.whole_task else ():
                own.setdefault(mention.number, []).append(mention)
            self._own = Controller(mentions=own, changed=self._own_changes())
            if self._beside is not None:
                mentions = self._beside.mentions if self.options.whole_task else {}
                self._own = replace(self._beside, mentions=mentions)
        return self._controller or self._own or Controller()


def _section_heads(data: bytes) -> Iterator[tuple[int, re.Match[bytes]]]:
    """Yield the lines that begin a section, each with its first byte."""
    for m in _HEAD.finditer(data):
        start = m.start()
        while start and data[start - 1] in b" \t":
            start -= 1
        if not start or data[start - 1] in b"\r\n":
            yield start, m


def _line(move: _Move) -> int:
    return move.line
