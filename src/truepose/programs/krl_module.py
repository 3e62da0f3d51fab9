"""KUKA KRL: the pair of .src and .dat as targets.

The .src is read statement by statement. Points gather what the program does with them, `Flow` what may be in force, and
`Judge` gives the verdicts when everything is known.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from truepose.errors import FileError
from truepose.programs import krl_runs
from truepose.programs.flow import Flow, InForce, Structure
from truepose.programs.krl_frames import SYSTEM, bas, fdat_value, frame_value, ipo_value
from truepose.programs.krl_lexer import LEXER, Lines, Statement, pieces, shown, statements
from truepose.programs.krl_motions import Goal, MotionReader, Settings
from truepose.programs.krl_names import Names, element
from truepose.programs.krl_points import Judge, Numbers, Variable, at
from truepose.programs.krl_runs import Run, find_run
from truepose.programs.krl_words import (
    DECLARE,
    FRAME_CHANGE,
    JOINT_MOTIONS,
    KEEPS_FRAMES,
    MOTIONS,
    OTHER_STATEMENTS,
    RELATIVE,
    STRAY_MOTION,
    TYPES,
    WITHOUT_USE,
)
from truepose.programs.points import in_order
from truepose.programs.source import Source
from truepose.programs.targets import FrameTable, Program, ReadOptions, Target

_ASSIGN = re.compile(rb"[ \t]*+(\[[^\]]*+\])?+[ \t]*+((?:\.[ \t]*+\w++(?:\[[^\]]*+\])?+[ \t]*+)*+)=(?!=)")
_CALL = re.compile(rb"[ \t]*+\(")
_LABEL = re.compile(rb"[ \t]*+:[ \t]*+")
_OPERAND = re.compile(rb"[ \t]*+\{|[ \t]++[A-Za-z_$]")
_ROUTINE = re.compile(
    rb"[ \t]*+(?:GLOBAL[ \t]++)?+(?:DEF|DEFFCT[ \t]++\w++(?:\[[^\]]*+\])?+)[ \t]++([A-Za-z_$][\w$]*+)", re.I
)
_HANDLER = re.compile(rb"\bDO\b\s*([A-Za-z_$][\w$]*+)\s*\(", re.I)
_WORD = re.compile(rb"[ \t]*+([A-Za-z_$][\w$]*+)")
_HOME: Final = re.compile(r"X?HOME\d*", re.I)
_FRAME_TABLES: Final = {"TOOL_DATA": "tool", "BASE_DATA": "base"}
_LOOPS: Final = {"ENDFOR": "FOR", "ENDWHILE": "WHILE", "ENDLOOP": "LOOP", "UNTIL": "REPEAT"}


def read(path: Path, frames: FrameTable, options: ReadOptions) -> Program:
    """Read a KRL program.

    Parameters
    ----------
    path : Path
        The .src, or the .dat beside it. A .src with inline targets alone needs no .dat.
    frames : FrameTable
    options : ReadOptions

    Raises
    ------
    FileError
        If one of the pair is missing, or a file is broken; with its line.
    """
    src_path = path if path.suffix.lower() == ".src" else _partner(path, ".src")
    if src_path is None:
        raise FileError(path, f"is the data list of {path.stem}.src, which is not beside it; both are needed")
    dat_path = _partner(src_path, ".dat") if src_path == path else path
    src = Source.read(src_path)
    return _Reader(src, None if dat_path is None else Source.read(dat_path), options).program(path, frames)


def _partner(path: Path, suffix: str) -> Path | None:
    """Return the other file of a pair, whatever the case of its name."""
    exact = path.with_suffix(suffix)
    if exact.is_file():
        return exact
    try:
        beside = sorted(path.parent.iterdir())
    except OSError:
        return None
    return next((p for p in beside if p.name.lower() == exact.name.lower() and p.is_file()), None)


class _Reader:
    def __init__(self, src: Source, dat: Source | None, options: ReadOptions) -> None:
        self._src, self._dat, self._options = src, dat, options
        self._names, self._flow = Names(), Flow()
        self._motions = MotionReader(src, self._names, self._flow)
        self._changed: dict[tuple[str, int | None], int] = {}
        self._variables: list[Variable] = []
        self._runs: list[tuple[Numbers, Lines]] = []
        self._routine: tuple[str, int] | None = None
        self._routines = 0

    def program(self, path: Path, frames: FrameTable) -> Program:
        if self._dat is not None:
            self._read_dat(self._dat)
        line = 1
        try:
            for piece in pieces(self._src, find_run, krl_runs.FEWEST):
                line = piece.line
                if isinstance(piece, Statement):
                    self._statement(piece)
                else:
                    self._runs.append((self._motions.first_of(piece), piece))
            if self._routine is None and not self._routines:
                self._flow.end_routine()
        except Structure as error:
            raise self._src.error(line, f"{error}; correct the file") from None
        if self._routine is not None:
            name, line = self._routine
            raise self._src.error(line, f"{name} has no END: the file is truncated")
        self._check_pair()
        ambient = self._flow.solve()
        judge = Judge(frames, self._options, self._flow.states, ambient, self._names.fdats, self._changed)
        return self._collect(path, judge)

    def _read_dat(self, dat: Source) -> None:
        opened: int | None = None
        for word, line, start, rest, end in statements(dat):
            if word == "DEFDAT":
                opened = line
            elif word == "ENDDAT":
                opened = None
            elif word in ("DECL", "GLOBAL", "CONST", "IMPORT") or (
                word in TYPES and _OPERAND.match(dat.data, rest, end)
            ):
                self._names.declare(dat, start, end, line, "dat")
            elif (variable := self._names.module.get(word)) and (m := _ASSIGN.match(dat.data, rest, end)):
                index = element(variable, m[1])
                if m[2]:
                    variable.writes[index].append((line, "component set"))
                else:
                    self._names.assign(dat, variable, index, m.end(), end, line)
            elif word in MOTIONS | RELATIVE and _OPERAND.match(dat.data, rest, end):
                raise dat.error(line, f"{word} is a motion, and a data list has none; is this a .src?")
        if opened is not None:
            raise dat.error(opened, "DEFDAT has no ENDDAT: the file is truncated")

    def _statement(self, statement: Statement) -> None:
        word, line, start, rest, end = statement
        data = self._src.data
        if word in MOTIONS:
            self._call(self._motions.read(statement))
        elif word in RELATIVE or word in JOINT_MOTIONS:
            self._call(self._names.scan(data, rest, end, line, "used by a relative motion"))
            reason = (
                "joint target"
                if word in JOINT_MOTIONS
                else "relative: it starts from a target that is corrected already"
            )
            self._motions.other(word, line, "skip", reason)
        elif word in ("DEF", "DEFFCT") or (word == "GLOBAL" and _ROUTINE.match(data, start, end)):
            self._begin_routine(statement)
        elif word in ("END", "ENDFCT"):
            self._end_routine()
        elif _declares(word, data, rest, end):
            if word == "GLOBAL" and self._interrupt(statement):
                return
            before = set(self._names.local)
            self._names.declare(self._src, start, end, line, "src")
            self._variables += [self._names.local[name] for name in self._names.local.keys() - before]
        elif word in WITHOUT_USE:
            pass
        elif not self._control(statement):
            self._other(statement)

    def _control(self, statement: Statement) -> bool:
        """Follow a statement that steers the program; False if it is none."""
        word, line, _, rest, end = statement
        flow = self._flow
        if word in ("IF", "SWITCH", "FOR", "WHILE", "LOOP", "REPEAT"):
            if _ASSIGN.match(self._src.data, rest, end):
                return False
            self._scan(statement)
            flow.begin(word, line)
        elif word in ("ELSE", "CASE", "DEFAULT"):
            flow.branch(word, last=word != "CASE")
        elif word in ("ENDIF", "ENDSWITCH"):
            flow.end(word, word[3:])
        elif word in _LOOPS:
            self._scan(statement)
            flow.end(word, _LOOPS[word])
        elif word == "EXIT":
            flow.exit()
        elif word in ("RETURN", "RESUME"):
            self._scan(statement)
            flow.leave()
        elif word == "GOTO" and (m := _WORD.match(self._src.data, rest, end)):
            flow.goto(m[1].decode().upper())
        elif word in ("SPLINE", "PTP_SPLINE"):
            if self._motions.block != Settings():
                raise Structure(f"{word} inside a spline block")
            if (m := _WORD.match(self._src.data, rest, end)) and m[1].upper() == b"WITH":
                self._motions.block = self._motions.settings(m.end(), end, line)
        elif word == "ENDSPLINE":
            self._motions.block = Settings()
        else:
            return False
        return True

    def _other(self, statement: Statement) -> None:
        word, line, start, rest, end = statement
        data = self._src.data
        if word and (m := _ASSIGN.match(data, rest, end)):
            self._assign(statement, m)
        elif word == "BAS" and _CALL.match(data, rest, end):
            bas(self._flow, self._src, rest + len(data[rest:end]) - len(data[rest:end].lstrip()), end, line)
        elif word and (m := _LABEL.fullmatch(data, rest, end)):
            self._flow.label(word)
        elif word == "INTERRUPT" and self._interrupt(statement):
            pass
        elif word and word not in OTHER_STATEMENTS and word not in KEEPS_FRAMES and _OPERAND.match(data, rest, end):
            self._names.scan(data, rest, end, line)
            self._motions.other(
                word, line, "refuse", f"looks like a motion that is not known: {shown(data, start, end)}"
            )
        else:
            self._scan(statement)

    def _scan(self, statement: Statement) -> None:
        """Take any other statement: what it reads and calls, and whether a motion hides in it."""
        _, line, start, _, end = statement
        data = self._src.data
        for m in STRAY_MOTION.finditer(data, start, end):
            if m[1]:
                word = m[1].decode().upper()
                self._motions.other(
                    word, line, "refuse", f"a motion inside another statement: {shown(data, start, end)}"
                )
                break
        if FRAME_CHANGE.search(data, start, end):
            unknown = InForce("unknown", f"{shown(data, start, end)} (line {line})")
            self._flow.change(tool=unknown, base=unknown)
        self._call(self._names.scan(data, start, end, line))

    def _assign(self, statement: Statement, m: re.Match[bytes]) -> None:
        word, line, start, rest, end = statement
        data, flow, fdats = self._src.data, self._flow, self._names.fdats
        self._call(self._names.scan(data, rest, end, line))
        if word in SYSTEM:
            which = SYSTEM[word]
            value = InForce("unknown", f"{shown(data, start, end)} (line {line})")
            if not m[1] and not m[2]:
                value = frame_value(self._src, m.end(), end, line, which, fdats)
            flow.change(**{which: value})
        elif word == "$IPO_MODE":
            flow.change(ipo=ipo_value(data[m.end() : end], fdats))
        elif word == "FDAT_ACT":
            flow.change(fdat=fdat_value(self._src, m.end(), end if not m[2] else m.end(), line, fdats))
        elif word in _FRAME_TABLES:
            number = m[1].strip(b"[] \t") if m[1] else b""
            key = int(number) if number.isdigit() and len(number) < 5 else None
            self._changed.setdefault((_FRAME_TABLES[word], key), line)
        elif (variable := self._names.find(word)) is not None:
            index = element(variable, m[1])
            if m[2]:
                variable.writes[index].append((line, f"component {m[2].decode('latin-1').strip()} set"))
            else:
                self._names.assign(self._src, variable, index, m.end(), end, line)

    def _interrupt(self, statement: Statement) -> bool:
        """Take INTERRUPT DECL … DO handler( ); False if it is another statement."""
        _, _, start, _, end = statement
        code = self._src.data[start:end]
        if b"INTERRUPT" not in code.upper():
            return False
        if (m := _HANDLER.search(code)) and m[1].decode().upper() not in KEEPS_FRAMES:
            self._flow.handlers.append(m[1].decode().upper())
        return True

    def _call(self, names: list[str]) -> None:
        for name in names:
            text = "" if self._options.calls_keep_frames else f"{name}() was called, which is not in this file"
            self._flow.call(name, text)

    def _begin_routine(self, statement: Statement) -> None:
        word, line, start, _, end = statement
        if self._routine is not None:
            raise Structure(f"{self._routine[0]} of line {self._routine[1]} has no END before this")
        m = _ROUTINE.match(self._src.data, start, end)
        if m is None:
            raise Structure(f"{word}: expected a name")
        name = m[1].decode()
        self._routine = (name, line)
        self._names.local = {}
        self._flow.begin_routine(name.upper(), outside=not self._routines or word == "GLOBAL")
        self._routines += 1

    def _end_routine(self) -> None:
        if self._routine is None and self._routines:
            raise Structure("END without DEF")
        self._flow.end_routine()
        self._routine = None
        self._routines += 1
        self._motions.block = Settings()
        self._names.local = {}

    def _check_pair(self) -> None:
        """Require the .dat if the program moves to points that only it can declare."""
        if self._dat is not None:
            return
        for variable in self._names.elsewhere.values():
            if variable.moves and not _HOME.fullmatch(variable.name):
                dat = self._src.path.with_suffix(".dat").name
                raise self._src.error(
                    variable.line,
                    f"moves to {variable.name}, which no file at hand declares; put {dat} beside it",
                )

    def _collect(self, path: Path, judge: Judge) -> Program:
        targets: list[Target | Run] = []
        place: dict[int, int] = {}
        for i, numbers in enumerate(self._names.numbers):
            target = judge.target(numbers)
            if target is not None:
                place[i] = len(targets)
                targets.append(target)
        first_other = len(targets)
        targets += self._motions.others
        for first, lines in self._runs:
            like = judge.target(first)
            assert like is not None  # it is moved to
            targets.append(Run(self._src, lines.start, lines.end, lines.line, lines.lines, like))
        unknown: dict[int, int] = {}
        for variable in [*self._names.module.values(), *self._variables, *self._names.elsewhere.values()]:
            if variable.moves and not variable.literals:
                unknown[id(variable)] = len(targets)
                targets.append(_without_numbers(variable, self._src))

        def places(goal: Goal) -> list[int]:
            if goal.numbers is not None:
                return [place[goal.numbers]]
            if goal.other is not None:
                return [first_other + goal.other]
            assert goal.variable is not None
            if id(goal.variable) in unknown:
                return [unknown[id(goal.variable)]]
            literals = at(goal.variable.literals, element(goal.variable, goal.brackets))
            return [place[i] for i in literals if i in place]

        circles = [[i for goal in goals for i in places(goal)] for goals in self._motions.circles]
        sources = (self._src,) if self._dat is None else (self._src, self._dat)
        return Program(path, sources, *in_order(targets, circles, sources), LEXER)


def _declares(word: str, data: bytes, rest: int, end: int) -> bool:
    return word in DECLARE or (word in TYPES and _OPERAND.match(data, rest, end) is not None)


def _without_numbers(variable: Variable, src: Source) -> Target:
    moves = [use for uses in variable.moves.values() for use in uses]
    if _HOME.fullmatch(variable.name) and variable.origin == "nowhere":
        reason = "joint target of $config.dat"
    elif variable.origin in ("nowhere", "import"):
        reason = "declared in another module"
    else:
        reason = "its value is known at run time only"
    return Target(variable.name, src.path, moves[0].line, tuple(use.word for use in moves), "skip", reason)
