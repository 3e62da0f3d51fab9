"""One module of a KRL program: its .dat and its .src, statement by statement.

Points collect their uses, `Flow` the values in force. The verdicts follow when everything is read (see
`truepose.programs.krl.reader`).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

from truepose.programs.core import shifts
from truepose.programs.core.flow import BlockError, Flow
from truepose.programs.core.points import JOINTS, RELATIVE, Place, Problem, at, handed_to, unknown_motion
from truepose.programs.core.program import ReadOptions
from truepose.programs.core.source import Source, shown
from truepose.programs.core.state import FdatFrames, InForce, State
from truepose.programs.krl import runs as krl_runs
from truepose.programs.krl.constants import find_constants
from truepose.programs.krl.controller import is_null
from truepose.programs.krl.derived import KrlDerivations
from truepose.programs.krl.frames import SYSTEM, Which, bas, entry_of, fdat_value, frame_value, handed, ipo_value
from truepose.programs.krl.lexer import Lines, Statement, pieces, statements
from truepose.programs.krl.libraries import is_encoded
from truepose.programs.krl.motions import KrlMotionReader, Settings
from truepose.programs.krl.names import Names, element
from truepose.programs.krl.points import Numbers, PointVariable
from truepose.programs.krl.runs import find_run
from truepose.programs.krl.statements import KrlStatements, element_of
from truepose.programs.krl.words import (
    DECLARE,
    HANDED_POSE,
    IDENTIFIER,
    JOINT_MOTIONS,
    KEEPS_FRAMES,
    MOTIONS,
    OTHER_STATEMENTS,
    RELATIVE_MOTIONS,
    STATE,
    STATE_CHANGE,
    STRAY_MOTION,
    TYPES,
    WITHOUT_USE,
    WORLD_CHANGE,
    split_parameters,
)

_ASSIGN = re.compile(rb"[ \t]*+(\[[^\]]*+\])?+[ \t]*+((?:\.[ \t]*+\w++(?:\[[^\]]*+\])?+[ \t]*+)*+)=(?!=)")
_CALL = re.compile(rb"[ \t]*+\(")
_TEXT = re.compile(rb"\"[^\"]*+\"")
_LABEL = re.compile(rb"[ \t]*+:[ \t]*+")
_OPERAND = re.compile(rb"[ \t]*+\{|[ \t]++[A-Za-z_$]")
_ROUTINE = re.compile(
    rb"[ \t]*+(?:GLOBAL[ \t]++)?+(?:DEF|DEFFCT[ \t]++\w++(?:\[[^\]]*+\])?+)[ \t]++([A-Za-z_$][\w$]*+)", re.I
)
_ROUTINES = re.compile(rb"^[ \t]*+(?:DEF|DEFFCT[ \t]++\w++(?:\[[^\]]*+\])?+)[ \t]++([A-Za-z_$][\w$]*+)", re.I | re.M)
"""Routines that other modules do not see, and the first one."""
_DEFINED = re.compile(rb"^" + _ROUTINE.pattern + rb"(?:[ \t]*+\(([^()\r\n]*+)\))?+", re.I | re.M)
_FDAT_SET = re.compile(
    rb"^[ \t]*+([A-Za-z]\w*+)[ \t]*+(?:\.[ \t]*+(?:TOOL_NO|BASE_NO|IPO_FRAME)[ \t]*+)?+=(?!=)", re.I | re.M
)
_ARGUMENTS = re.compile(
    rb"^[ \t]*+(?!S?(?:PTP|LIN|CIRC)\b|SPL(?:INE)?\b|PTP_SPLINE\b)[^\r\n;(]*+\([^\r\n;]*+", re.I | re.M
)
_HANDLER = re.compile(rb"\bDO\b\s*([A-Za-z_$][\w$]*+)\s*\(", re.I)
_PUBLIC = re.compile(rb"\bPUBLIC\b", re.I)
_WORD = re.compile(rb"[ \t]*+([A-Za-z_$][\w$]*+)")
FRAME_TABLES: Final[dict[str, Which]] = {"TOOL_DATA": "tool", "BASE_DATA": "base"}
_ASSIGNED: Final = re.compile(
    rb"^[ \t]*+([A-Za-z_$][\w$]*+)[ \t]*+(?:\[[^\]\r\n]*+\][ \t]*+)?(?:\.[ \t]*+\w++[ \t]*+)?=(?!=)", re.M
)
_WORLD: Final = ("$ROBROOT", "$WORLD")
_WORLD_NAMED: Final = re.compile(rb"\$(?:ROBROOT|WORLD)\b", re.I)
_LOOPS: Final = {"ENDFOR": "FOR", "ENDWHILE": "WHILE", "ENDLOOP": "LOOP", "UNTIL": "REPEAT"}


@dataclass(eq=False)
class Shared:
    """Data that the modules of a program share.

    Attributes
    ----------
    options : ReadOptions
        The options of reading.
    project : bool
        Whether all modules that exist are read, so that all uses of GLOBAL points and routines are known.
    flow : Flow
        The ways through the program.
    numbers : list of Numbers
        Every literal that may be a target.
    points : dict of str to PointVariable
        The GLOBAL points.
    fdats : dict of str to FdatFrames
        The GLOBAL FDATs and those of ``$config.dat``.
    changed : dict of ("tool" or "base", number or None) to place
        The places where the program changes a numbered frame.
    moved : list of str
        The statements that change the place of the robot in the world.
    by_libraries : list of (int, callable)
        What statements of libraries do to `changed` and `moved`, each with its node of the flow: only what the programs
        run counts.
    set_to : dict of ("tool" or "base", number) to list of InForce
        The values that the program gives to numbered frames, as far as they are constants.
    libraries : frozenset of Path
        The files that are read for their effects only; see `truepose.programs.krl.libraries`.
    routines : dict of str to list of bool
        The routines that the modules define, by name in upper case: whether each parameter is IN.
    """

    options: ReadOptions
    project: bool = False
    flow: Flow = field(default_factory=Flow)
    numbers: list[Numbers] = field(default_factory=list)
    points: dict[str, PointVariable] = field(default_factory=dict)
    fdats: dict[str, FdatFrames] = field(default_factory=dict)
    changed: dict[tuple[str, int | None], Place] = field(default_factory=dict)
    moved: list[str] = field(default_factory=list)
    by_libraries: list[tuple[int, Callable[[], object]]] = field(default_factory=list)
    libraries: frozenset[Path] = frozenset()
    set_to: dict[tuple[str, int | None], list[InForce]] = field(default_factory=dict)
    routines: dict[str, list[bool]] = field(default_factory=dict)

    def solve(self) -> State:
        """Follow the ways through the program; return the values that interrupts may set anywhere."""
        ambient = self.flow.solve()
        reached = self.flow.reached() if self.by_libraries else frozenset[int]()
        for node, act in self.by_libraries:
            if node in reached:
                act()
        return ambient

    def __post_init__(self) -> None:
        self.derivations = KrlDerivations(self.flow)
        self.derivations.whole = self.project or self.options.whole_task


class KrlModule:
    """Reads one module; `read_dat` of all modules first, then `read_src`.

    Attributes
    ----------
    src, dat : Source, optional
        The files.
    name : str
        The name in upper case.
    names : Names
        The symbol table.
    motions : KrlMotionReader, optional
        The reader of its motions, if it has a .src.
    variables : list of PointVariable
        The points that its routines declare.
    runs : list of (Numbers, Lines)
        The runs of motions of one form, each with its first point.
    """

    def __init__(self, src: Source | None, dat: Source | None, shared: Shared) -> None:
        for source in filter(None, (src, dat)):
            if is_encoded(source.data):
                raise source.error(1, "is encoded and cannot be read; give the text of the program")
        self.src, self.dat, self._shared = src, dat, shared
        self.name = next(source.path.stem.upper() for source in (src, dat) if source is not None)
        self._options, self._flow, self._changed = shared.options, shared.flow, shared.changed
        everywhere = (shared.points, shared.fdats) if shared.project else (None, None)
        self.names = self._names = Names(shared.numbers, *everywhere)
        self._names.routines = shared.routines
        self.variables: list[PointVariable] = []
        self.runs: list[tuple[Numbers, Lines]] = []
        self._whole = shared.project or shared.options.whole_task
        self._routine: tuple[str, int] | None = None
        self._routines = 0
        self._own: dict[str, str] = {}
        self._conditions: list[Statement] = []
        """The open WHILE loops, whose conditions are evaluated again behind each turn."""
        if src is not None:
            self._src = src
            self.motions = self._motions = KrlMotionReader(
                src, self.names, self._flow, shared.derivations, named=shared.project
            )
            shared.derivations.assigned |= {m[1].decode().upper() for m in _ASSIGNED.finditer(src.data)}
        self._derivations = KrlStatements(shared.derivations, self.names)

    def look_ahead(self) -> None:
        """Find the routines and constants of the module, and forget the FDATs that the .src assigns to."""
        routines = self._shared.routines
        for m in _DEFINED.finditer(self._src.data):
            by_value = [code.strip().upper().endswith(b":IN") for code in (m[2] or b"").split(b",")]
            name = m[1].decode().upper()
            routines[name] = [a and b for a, b in zip(routines.get(name, by_value), by_value, strict=False)]
        if not self._names.public:
            self._names.constants = find_constants(self.dat, self._src)
        for m in _FDAT_SET.finditer(self._src.data):
            if (name := m[1].decode().upper()) in self._names.fdats:
                unknown = InForce("unknown", f"{name} is set at run time (line {self._src.line(m.start(1))})")
                self._names.forget_fdat(name, FdatFrames(unknown, unknown, "BASE"))

    def forget_handed(self) -> None:
        """Forget the FDATs that the .src hands to a routine which may change them; once all routines are known."""
        for m in _ARGUMENTS.finditer(self._src.data) if self._names.fdats else ():
            for argument in handed(self._src.data, *m.span(), self._names.kept):
                if (name := argument.partition(b".")[0].strip().decode("latin-1").upper()) in self._names.fdats:
                    unknown = InForce("unknown", f"{name} is handed to a routine (line {self._src.line(m.start())})")
                    self._names.forget_fdat(name, FdatFrames(unknown, unknown, "BASE"))

    def read_src(self) -> None:
        """Read the statements; a FileError names the line of a broken one."""
        if self._shared.project:
            inner = [m[1].decode().upper() for m in _ROUTINES.finditer(self._src.data)][1:]
            self._own = {name: f"{self.name}.{name}" for name in inner}
        line = 1
        try:
            for piece in pieces(self._src, find_run, krl_runs.FEWEST):
                line = piece.line
                if isinstance(piece, Statement):
                    self._statement(piece)
                else:
                    self.runs.append((self._motions.first_of(piece), piece))
            if self._routine is None and not self._routines:
                self._flow.end_routine()
        except BlockError as error:
            raise self._src.error(line, f"{error}; correct the file") from None
        if self._routine is not None:
            name, line = self._routine
            raise self._src.error(line, f"{name} has no END: the file is truncated")

    def read_dat(self) -> None:
        """Read the data list; a FileError names the line of a broken one."""
        if self.dat is None:
            return
        dat = self.dat
        opened: int | None = None
        for word, line, start, rest, end in statements(dat):
            if word == "DEFDAT":
                opened = line
                self._names.public = _PUBLIC.search(dat.data, rest, end) is not None
            elif word == "ENDDAT":
                opened = None
            elif word in ("DECL", "GLOBAL", "CONST", "IMPORT") or (
                word in TYPES and _OPERAND.match(dat.data, rest, end)
            ):
                self._names.declare(dat, start, end, line, "dat")
            elif (number := self._names.own_numbers.get(word)) and (m := _ASSIGN.match(dat.data, rest, end)):
                number.declare(element_of(m[1]), dat.data[m.end() : end])
            elif (variable := self._names.module.get(word)) and (m := _ASSIGN.match(dat.data, rest, end)):
                index = element(variable, m[1])
                if m[2]:
                    variable.writes[index].append((line, "component set"))
                else:
                    self._names.assign(dat, variable, index, m.end(), end, line)
            elif word in MOTIONS | RELATIVE_MOTIONS and _OPERAND.match(dat.data, rest, end):
                raise dat.error(line, f"{word} is a motion, and a data list has none; is this a .src?")
        if opened is not None:
            raise dat.error(opened, "DEFDAT has no ENDDAT: the file is truncated")

    def _statement(self, statement: Statement) -> None:
        word, line, start, rest, end = statement
        data = self._src.data
        if word in MOTIONS:
            if calls := self._names.calls(data, rest, end):  # these run before the motion
                self._derivations.hand_over(data, rest, end)
                self._hand_frames(statement)
                self._call(calls)
            self._motions.read(statement)
        elif word in RELATIVE_MOTIONS or word in JOINT_MOTIONS:
            self._hand_frames(statement)
            self._call(self._names.scan(data, rest, end, line, "used by a relative motion"))
            self._motions.other(word, line, JOINTS if word in JOINT_MOTIONS else RELATIVE)
        elif word in ("DEF", "DEFFCT") or (word == "GLOBAL" and _ROUTINE.match(data, start, end)):
            self._begin_routine(statement)
        elif word in ("END", "ENDFCT"):
            self._end_routine()
        elif _declares(word, data, rest, end):
            if word == "GLOBAL" and self._interrupt(statement):
                return
            if calls := self._names.calls(data, rest, end):
                self._derivations.hand_over(data, rest, end)
                self._call(calls)
            before = set(self._names.local.values())
            self._names.declare(self._src, start, end, line, "src")
            self.variables += [variable for variable in self._names.local.values() if variable not in before]
        elif word in WITHOUT_USE:
            self._names.scan(data, rest, end, line)
        elif not self._control(statement):
            self._other(statement)

    def _control(self, statement: Statement) -> bool:
        """Follow a statement of the control flow; False if it is none."""
        word, line, _, rest, end = statement
        flow = self._flow
        if word in ("IF", "SWITCH", "FOR", "WHILE", "LOOP", "REPEAT"):
            if _ASSIGN.match(self._src.data, rest, end):
                return False
            self._follow_shifts(statement)
            if word != "FOR" or not self._derivations.begin_for(self._src, statement, self._motions.place(line)):
                self._scan(statement)
                flow.begin(word, line)
            if word == "WHILE":
                self._conditions.append(statement)
        elif word in ("ELSE", "CASE", "DEFAULT"):
            flow.branch(word, last=word != "CASE")
            self._scan(statement)
        elif word in ("ENDIF", "ENDSWITCH"):
            flow.end(word, word[3:])
            self._scan(statement)
        elif word in _LOOPS:
            condition = self._conditions.pop() if word == "ENDWHILE" and self._conditions else statement
            self._follow_shifts(condition)
            self._scan(condition)
            self._derivations.end_loop(word, _LOOPS[word], self._motions.place(line))
        elif word == "EXIT":
            self._scan(statement)
            flow.exit()
        elif word in ("RETURN", "RESUME"):
            self._follow_shifts(statement)
            self._scan(statement)
            (flow.abort if word == "RESUME" else flow.leave)()
        elif word == "GOTO" and (m := _WORD.match(self._src.data, rest, end)):
            flow.goto(m[1].decode().upper())
        elif word in ("SPLINE", "PTP_SPLINE"):
            if self._motions.block != Settings():
                raise BlockError(f"{word} inside a spline block")
            self._hand_frames(statement)
            self._call(self._names.scan(self._src.data, rest, end, line, "used in the settings of a motion"))
            if (m := _WORD.match(self._src.data, rest, end)) and m[1].upper() == b"WITH":
                self._motions.block = self._motions.settings(m.end(), end, line)
        elif word == "ENDSPLINE":
            self._scan(statement)
            self._motions.block = Settings()
        else:
            return False
        return True

    def _other(self, statement: Statement) -> None:
        word, line, start, rest, end = statement
        data = self._src.data
        if not word or not _ASSIGN.match(data, rest, end):
            self._derivations.hand_over(data, start, end, at_any_time=word in OTHER_STATEMENTS)
        if word != "INTERRUPT":
            self._follow_shifts(statement, later=word == "TRIGGER")
        for given in HANDED_POSE.finditer(data, start, end):
            if given[1] and (name := given[1].decode()).upper() not in KEEPS_FRAMES:
                self._motions.other(name, line, handed_to(name))
        if word and (m := _ASSIGN.match(data, rest, end)):
            self._stray(statement)
            self._assign(statement, m)
        elif word == "BAS" and _CALL.match(data, rest, end):
            self._stray(statement)
            bas(
                self._flow,
                self._src,
                rest + len(data[rest:end]) - len(data[rest:end].lstrip()),
                end,
                line,
                self._names.constants,
            )
        elif word and (m := _LABEL.fullmatch(data, rest, end)):
            self._flow.label(word)
        elif word == "INTERRUPT" and self._interrupt(statement):
            pass
        elif word == "TRIGGER":
            self._trigger(statement)
        elif word and word not in OTHER_STATEMENTS and word not in KEEPS_FRAMES and _OPERAND.match(data, rest, end):
            self._distrust(statement)
            self._motions.other(word, line, unknown_motion(shown(data, start, end)))
        elif word in OTHER_STATEMENTS or word in KEEPS_FRAMES or (word and _CALL.match(data, rest, end)):
            self._scan(statement)
        else:
            self._distrust(statement)

    def _follow_shifts(self, statement: Statement, *, later: bool = False) -> None:
        """Note the shifts that a statement begins or ends; one that acts `later` ends none."""
        word, line, start, _, end = statement
        code, place = _TEXT.sub(b'""', self._src.data[start:end]), self._motions.place(line)
        if word == "TRIGGER" or not later:  # a trigger acts once, with the next motion
            kinds = [kind._replace(ends=None) for kind in shifts.KRL] if later else shifts.KRL
            shifts.follow(self._flow, kinds, code, place)
        else:
            for shift in shifts.begun(shifts.KRL, [(line, code)]):
                self._flow.shift(*shift)

    def _distrust(self, statement: Statement) -> None:
        """Take a statement that is not understood: it may change all that it names, and run all routines it names."""
        _, _, start, _, end = statement
        data = self._src.data
        self._scan(statement)
        self._change_state(statement, [m[0] for m in STATE.finditer(data, start, end)])
        self._derivations.distrust(data, start, end)
        if world := _WORLD_NAMED.search(data, start, end):
            self._move_world(f"{world[0].decode('latin-1')} in {shown(data, start, end)}", statement.line)
        named = {m[1].decode().upper() for m in IDENTIFIER.finditer(data, start, end) if m[1] and m[2] != b"("}
        for name in sorted(named & self._names.fdats.keys()):
            unknown = self._not_known(statement)
            self._names.forget_fdat(name, FdatFrames(unknown, unknown, "BASE"))
        if routines := sorted(named & self._shared.routines.keys()):
            self._flow.call_one_of([self._own.get(name, name) for name in routines])

    def _not_known(self, statement: Statement) -> InForce:
        _, line, start, _, end = statement
        return InForce("unknown", f"{shown(self._src.data, start, end)} (line {line})")

    def _change_state(self, statement: Statement, named: list[bytes]) -> None:
        """Note that a statement may set what it names, in a way that is not followed."""
        unknown, code = self._not_known(statement), self._src.data[statement.start : statement.end]
        for name in {name.decode("latin-1").upper() for name in named}:
            if name in FRAME_TABLES:
                for m in re.finditer(rb"(?<![\w$])" + name.encode() + rb"\b", code, re.I):
                    if (entry := entry_of(code[m.start() :])) is not None:
                        self._change_entry(entry, statement.line)
            elif name in ("$TOOL", "$BASE"):
                self._flow.change(tool=unknown, base=unknown)
            elif name == "$IPO_MODE":
                self._flow.change(ipo=unknown.text)
            else:
                self._flow.change(fdat=FdatFrames(unknown, unknown, unknown.text))

    def _scan(self, statement: Statement, later: str = "") -> None:
        """Take any other statement: its reads and calls, and a motion inside it; `later`: a routine not called yet."""
        _, line, start, _, end = statement
        data = self._src.data
        self._stray(statement)
        if WORLD_CHANGE.search(data, start, end):
            self._move_world(shown(data, start, end), line)
        self._change_state(statement, [m[0] for m in STATE_CHANGE.finditer(data, start, end)])
        self._hand_frames(statement)
        calls = self._names.scan(data, start, end, line)
        if calls:
            self._derivations.hand_over(data, start, end)
        self._call([name for name in calls if name != later])

    def _stray(self, statement: Statement) -> None:
        _, line, start, _, end = statement
        data = self._src.data
        if found := next((m for m in STRAY_MOTION.finditer(data, start, end) if m[1]), None):
            reason = f"a motion inside another statement: {shown(data, start, end)}"
            self._motions.other(found[1].decode().upper(), line, Problem("refuse", reason))

    def _assign(self, statement: Statement, m: re.Match[bytes]) -> None:
        word, line, start, rest, end = statement
        data, flow, fdats = self._src.data, self._flow, self._names.fdats
        self._hand_frames(statement)
        followed = self._derivations.assign(self._src, statement, m, self._motions.place(line), whole=self._whole)
        if not followed and b"(" in data[m.end() : end]:
            self._derivations.hand_over(data, m.end(), end)
        self._call(self._names.scan(data, rest, m.end() if followed else end, line))
        if word in SYSTEM:
            which = SYSTEM[word]
            value = InForce("unknown", f"{shown(data, start, end)} (line {line})")
            if not m[1] and not m[2]:
                value = frame_value(self._src, m.end(), end, line, which, fdats, self._names.constants)
            flow.change(**{which: value})
        elif word == "$IPO_MODE":
            flow.change(ipo=ipo_value(data[m.end() : end], fdats))
        elif word == "FDAT_ACT":
            flow.change(fdat=fdat_value(self._src, m.end(), end if not m[2] else m.end(), line, fdats))
        elif word in FRAME_TABLES:
            number = m[1].strip(b"[] \t") if m[1] else b""
            key = int(number) if number.isdigit() and len(number) < 5 else None
            which = FRAME_TABLES[word]
            self._change_entry((which, key), line)
            if not m[2]:
                self._shared.set_to.setdefault((which, key), []).append(
                    frame_value(self._src, m.end(), end, line, which, fdats)
                )
        elif word in _WORLD:
            if m[1] or m[2] or not is_null(self._src, m.end(), end, line):
                self._move_world(shown(data, start, end), line)
        elif (variable := self._names.find(word)) is not None:
            index = element(variable, m[1])
            if m[2]:
                variable.writes[index].append((line, f"component {m[2].decode('latin-1').strip()} set"))
            else:
                self._names.assign(self._src, variable, index, m.end(), end, line)

    def _hand_frames(self, statement: Statement) -> None:
        """Note the tools and bases that a routine gets and may change."""
        _, _, start, _, end = statement
        if STATE.search(self._src.data, start, end):
            for argument in handed(self._src.data, start, end, self._names.kept):
                if m := STATE.match(argument):
                    self._change_state(statement, [m[0]])

    def _change_entry(self, key: tuple[str, int | None], line: int) -> None:
        """Note a change of a tool or base of the tables."""
        self._act(partial(self._changed.setdefault, key, self._motions.place(line)))

    def _act(self, act: Callable[[], object]) -> None:
        """Do what a statement does to the program as a whole; of a library's, only if the programs run it."""
        if self._is_library:
            self._shared.by_libraries.append((self._flow.node, act))
        else:
            act()

    def _move_world(self, text: str, line: int) -> None:
        """Note a change of the place of the robot in the world."""
        self._act(partial(self._shared.moved.append, f"{text}, {at(self._motions.place(line))}"))

    def _interrupt(self, statement: Statement) -> bool:
        """Take INTERRUPT DECL … DO handler( ); False if it is another statement."""
        word, _, start, _, end = statement
        code = self._src.data[start:end]
        if b"INTERRUPT" not in code.upper():
            return False
        self._follow_shifts(statement, later=True)
        handler = ""
        if (m := _HANDLER.search(code)) and not self._names.is_known(m[1].decode().upper()):
            handler = m[1].decode().upper()
        # a submit has no tool and base of its own, and cannot set those of the robot
        if handler in self._shared.routines or (handler and not self._is_submit):
            if self._is_library:
                self._flow.handle_if_reached(self._own.get(handler, handler))
            else:
                self._flow.handlers.append(self._own.get(handler, handler))
            self._flow.start(self._own.get(handler, handler))
            self._flow.may_abort(self._own.get(handler, handler), anywhere=word == "GLOBAL")
        self._at_any_time(statement, handler)
        return True

    def _at_any_time(self, statement: Statement, routine: str) -> None:
        """Take a statement that runs at any time from here on; the `routine` that it calls is started already."""
        _, _, start, _, end = statement
        self._derivations.distrust(self._src.data, start, end)
        self._scan(statement, later=routine)
        if STATE_CHANGE.search(self._src.data, start, end):
            self._flow.handlers.append(shown(self._src.data, start, end))

    def _trigger(self, statement: Statement) -> None:
        """Take TRIGGER … DO subprogram( ), which runs while the motions after it do."""
        _, _, start, _, end = statement
        name = ""
        if m := _HANDLER.search(self._src.data[start:end]):
            name = m[1].decode().upper()
            self._flow.start(self._own.get(name, name))
        outside = not self._shared.project and not self._options.calls_keep_frames and not self._names.is_known(name)
        if name in self._shared.routines or (name and outside):
            self._flow.handlers.append(self._own.get(name, name))
        self._at_any_time(statement, name if name in self._shared.routines else "")

    def _call(self, names: list[str]) -> None:
        where = "project" if self._shared.project else "file"
        for name in names:
            text = "" if self._options.calls_keep_frames else f"{name}() was called, which is not in this {where}"
            self._flow.call(self._own.get(name, name), text)

    def _begin_routine(self, statement: Statement) -> None:
        word, line, start, _, end = statement
        if self._routine is not None:
            raise BlockError(f"{self._routine[0]} of line {self._routine[1]} has no END before this")
        m = _ROUTINE.match(self._src.data, start, end)
        if m is None:
            raise BlockError(f"{word}: expected a name")
        name = m[1].decode()
        self._routine = (name, line)
        self._names.local, self._names.local_numbers = {}, {}
        for parameter in split_parameters(self._src.data[m.end() : end]):  # it hides a point of the module
            variable = self._names.local[parameter.upper()] = PointVariable(parameter, "", line, "src", parameter=True)
            self.variables.append(variable)
        outside = not self._shared.project and (not self._routines or word == "GLOBAL")
        key = name.upper() if not self._routines or word == "GLOBAL" else self._own.get(name.upper(), name.upper())
        self._flow.begin_routine(key, outside=outside)
        if self._is_library and not self._is_submit and key != "BAS":
            self._flow.only_called.add(key)
        self._routines += 1

    @property
    def _is_library(self) -> bool:
        return self._src.path in self._shared.libraries

    @property
    def _is_submit(self) -> bool:
        return self._src.path.suffix.lower() == ".sub"

    def _end_routine(self) -> None:
        if self._routine is None and self._routines:
            raise BlockError("END without DEF")
        self._flow.end_routine()
        self._routine = None
        self._routines += 1
        self._motions.block = Settings()
        self._names.local, self._names.local_numbers = {}, {}


def _declares(word: str, data: bytes, rest: int, end: int) -> bool:
    return word in DECLARE or (word in TYPES and _OPERAND.match(data, rest, end) is not None)
