"""Registers of a FANUC controller: their stored values, and which programs of a backup write them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Literal, NamedTuple, TypeVar

from truepose.programs.tp.arithmetic import assignment_in, is_zero, without_comments
from truepose.programs.tp.sections import NUMBERED, REMARK

Kind = Literal["R", "PR"]
_Used = TypeVar("_Used")
_TEXT = re.compile(rb"'[^']*'|\"[^\"]*\"")
_WRITTEN = re.compile(
    rb"(?<![\w$])(P?R)[ \t]*\[[ \t]*(?:GP\d[ \t]*:[ \t]*)?"
    rb"(?:(\d{1,5})[^\]\[=]*|[^\]=]*(?:\[[^\]]*\][^\]=\[]*)*)\][ \t]*=(?!=)",
    re.I,
)
_OUTPUT = re.compile(rb"\bSearch[ \t]+Start\b|\bVISION\b|\bGET_\w+", re.I)
"""Touch sensing and cameras write the registers that they name."""
_NAMED = re.compile(rb"(?<![\w$])(P?R)[ \t]*\[[ \t]*(?:GP\d[ \t]*:[ \t]*)?(\d{1,5})?", re.I)
_CHANGE = re.compile(rb"U(?:FRAME|TOOL)[ \t]*\[[^=]*=|\$MNU(?:FRAME|TOOL)[ \t]*\[|\$GROUP\b[^=]*\$U", re.I)
_FRAME = re.compile(rb"U(?:FRAME|TOOL)|\$MNU|\$GROUP", re.I)
CALL: Final = re.compile(rb"(?<![\w$])(?:CALL|RUN)[ \t]+(\w+)", re.I)
_RELEVANT = re.compile(
    rb"^[^\r\n]*(?:=|PR[ \t]*\[|CALL|RUN|SEARCH|TOUCH|Skip,|VISION|THEN|ELSE|END|LBL)[^\r\n]*", re.I | re.M
)
_MENTIONED = re.compile(rb"(?<![\w$])PR[ \t]*\[[ \t]*(?:GP\d[ \t]*:[ \t]*)?(\d{1,5})?", re.I)
_WHOLE = re.compile(rb"[ \t]*PR[ \t]*\[[ \t]*(\d{1,5})[ \t]*(?::[^\],\[]*)?\][ \t]*=", re.I)
"""A position register that is set as a whole."""
_MOVES = re.compile(rb"^[ \t]*\d*[ \t]*:?[ \t]*(?:GP\d[ \t]+)?[JLCAS][ \t]+\w+[ \t]*\[", re.I | re.M)
_LABEL = re.compile(rb"[ \t]*LBL[ \t]*\[", re.I)
_JUMP = re.compile(rb"\bLBL[ \t]*\[", re.I)
_OPENS = re.compile(rb"FOR\b|IF\b.*\bTHEN$", re.S)
_ELSEWHERE = re.compile(rb"\b(?:LBL|IF|ELSE|ENDIF|SELECT|FOR|ENDFOR|CALL|RUN|WAIT|WHEN|MONITOR)\b", re.I)
"""Instructions behind which control may come from elsewhere, or before which others may run."""
_OTHER = re.compile(rb"^[ \t]*\d*[ \t]*:[ \t]*(?![ \t!;/\r\n-])", re.M)
"""An instruction that is no remark."""
_CONSTANT = re.compile(rb"\(?[ \t]*([-+]?[ \t]*(?:\d{1,7}\.?\d{0,9}|\.\d{1,9}))[ \t]*\)?")
_FROM_REGISTER = re.compile(
    rb"[ \t]*U(?:TOOL|FRAME)[ \t]*\[[ \t]*\d{1,5}[ \t]*\][ \t]*=[ \t]*PR[ \t]*\[[ \t]*(\d{1,5})[ \t]*\]", re.I
)
_SAME: Final = 1e-3  # [mm, deg]
_CONDITION = re.compile(rb"[ \t]*(?:IF|SELECT|WAIT|WHEN|SKIP)\b", re.I)


class StoredRegister(NamedTuple):
    """A position register as the controller stores it.

    Attributes
    ----------
    values : tuple of 6 float, optional
        X, Y, Z [mm], W, P, R [deg]; None where it is not set, or gives joints.
    name : str
        The comment of the operator.
    """

    values: tuple[float, ...] | None
    name: str = ""


class Effects(NamedTuple):
    """The use that a program makes of registers that all programs share.

    Attributes
    ----------
    written : frozenset of ("R" or "PR", int or None)
        The registers that it writes; None: any of them.
    read : frozenset of int or None
        The position registers that it may read before it sets them.
    calls : frozenset of str
        The names of the programs that it calls or starts, in upper case.
    macro : bool
        Whether it is a macro, which other programs call by a name of its own.
    frames, changes : tuple of (int, bytes)
        The instructions that name tools or user frames, and those of them that change one, each with its line.
    moves : bool
        Whether it moves the robot.
    set_to : frozenset of (int, int, float)
        The components that it sets to constants: register, axis (0 to 5), value [mm, deg].
    computed : frozenset of int or None
        The position registers that it writes in any other way; None: any of them.
    constants : tuple of (int, tuple of 6 float)
        The lines that set a tool or user frame to a register which holds constants there, with these.
    """

    written: frozenset[tuple[Kind, int | None]] = frozenset()
    read: frozenset[int | None] = frozenset()
    calls: frozenset[str] = frozenset()
    macro: bool = False
    frames: tuple[tuple[int, bytes], ...] = ()
    changes: tuple[tuple[int, bytes], ...] = ()
    moves: bool = False
    set_to: frozenset[tuple[int, int, float]] = frozenset()
    computed: frozenset[int | None] = frozenset()
    constants: tuple[tuple[int, tuple[float, ...]], ...] = ()

    def constant_in(self, line: int) -> tuple[float, ...]:
        """Return the constants to which a line sets a tool or user frame; nothing where they are not known."""
        return next((values for at, values in self.constants if at == line), ())


ANYTHING: Final = Effects(
    frozenset([("R", None), ("PR", None)]), frozenset([None]), moves=True, computed=frozenset([None])
)


@dataclass(frozen=True, eq=False)
class Registers:
    """The registers of a controller, as its backup states them.

    Attributes
    ----------
    positions : mapping of (group, number) to StoredRegister
        The position registers.
    values : mapping of int to float
        The numeric registers.
    programs : mapping of str to Effects
        The programs of the backup, by their names in upper case; empty without a backup.
    """

    positions: Mapping[tuple[int, int], StoredRegister] = field(default_factory=dict)
    values: Mapping[int, float] = field(default_factory=dict)
    programs: Mapping[str, Effects] = field(default_factory=dict)

    @cached_property
    def _writers(self) -> dict[tuple[Kind, int | None], list[str]]:
        """The programs that write each register with another value than the stored one."""
        return _by_use((name, self._changed_by(one)) for name, one in self.programs.items())

    def _changed_by(self, effects: Effects) -> frozenset[tuple[Kind, int | None]]:
        """Return the registers that a program writes, without those that it sets to what is stored in any case."""
        different = {
            number
            for number, axis, value in effects.set_to
            if (stored := self.positions.get((1, number))) is None
            or stored.values is None
            or abs(stored.values[axis] - value) > _SAME
        }
        kept = {number for number, _, _ in effects.set_to} - different - effects.computed
        return effects.written - {("PR", number) for number in kept}

    @cached_property
    def _readers(self) -> dict[int | None, list[str]]:
        """The programs that may read each position register."""
        return _by_use((name, one.read) for name, one in self.programs.items())

    @cached_property
    def _unknown_call(self) -> str:
        """The first program that is called and is not there; empty where there is none."""
        called = frozenset[str]().union(*[one.calls for one in self.programs.values()])
        return min(called - self.programs.keys(), default="")

    def writer(self, kind: Kind, number: int, besides: str = "") -> str:
        """Return the name of a program, `besides` one, that may write a register; empty where none does."""
        names = self._writers.get((kind, number), []) + self._writers.get((kind, None), [])
        return next((name for name in names if name != besides), self._unknown_call)

    def reader(self, number: int, besides: str) -> str:
        """Return the name of a program, `besides` one, that may read a position register; empty where none does."""
        names = self._readers.get(number, []) + self._readers.get(None, [])
        return next((name for name in names if name != besides), "")

    def behind(self, names: Iterable[str]) -> Effects | None:
        """Return the effects of calls of programs, and of what they call; None where they are not known."""
        found, waiting, seen = Effects(), [name.upper() for name in names], set[str]()
        while waiting:
            name = waiting.pop()
            if name in seen:
                continue
            seen.add(name)
            if (effects := self.programs.get(name)) is None:
                return None
            frames = found.frames + effects.frames
            written, read = found.written | effects.written, found.read | effects.read
            found = Effects(written, read, frames=frames, moves=found.moves or effects.moves)
            waiting += effects.calls
        return found

    def macros(self) -> Effects | None:
        """Return the effects of any macro; None where none is known, so that an instruction may be any."""
        names = [name for name, effects in self.programs.items() if effects.macro]
        return self.behind(names) if names else None


def _by_use(uses: Iterable[tuple[str, frozenset[_Used]]]) -> dict[_Used, list[str]]:
    found: dict[_Used, list[str]] = {}
    for name, used in uses:
        for one in used:
            found.setdefault(one, []).append(name)
    return found


def effects_of(data: bytes) -> Effects:
    """Return the use that a program makes of registers, from the text of its instructions."""
    written: set[tuple[Kind, int | None]] = set()
    ways = _Ways()
    calls: set[str] = set()
    frames: list[tuple[int, bytes]] = []
    constants = _Constants()
    start, end = data.find(b"/MN"), data.find(b"/POS")
    done = data.find(b"\n", max(start, 0)) + 1
    for line in _RELEVANT.finditer(data, max(start, 0), end if end >= 0 else len(data)):
        m = NUMBERED.match(line[0])
        code = _TEXT.sub(b"", line[0][m.end() :] if m else line[0])
        if REMARK.match(code):
            continue
        if _OTHER.search(data, done, line.start()):  # such as a macro
            constants.forget_all()
        done = line.end()
        if _FRAME.search(code):
            number = data.count(b"\n", 0, line.start()) + 1
            frames.append((number, code))
            constants.set_frame(code, number)
        written |= writes_in(code)
        calls |= {name.decode("latin-1").upper() for name in CALL.findall(code)}
        ways.take(code)
        constants.take(code)
    moves = _MOVES.search(data, max(start, 0), end if end >= 0 else len(data)) is not None
    changes = tuple([one for one in frames if _CHANGE.search(one[1])])
    macro = re.search(rb"/PROG[^\r\n]*\bMacro\b", data[: max(start, 0)], re.I) is not None
    return Effects(
        frozenset(written),
        frozenset(ways.read),
        frozenset(calls),
        macro,
        tuple(frames),
        changes,
        moves,
        frozenset(constants.set_to),
        frozenset(constants.computed),
        tuple(constants.found),
    )


class _Constants:
    """Follows the position registers that a program sets to constants, as far as one instruction follows another."""

    def __init__(self) -> None:
        self.set_to: set[tuple[int, int, float]] = set()
        self.computed: set[int | None] = set()
        self.found: list[tuple[int, tuple[float, ...]]] = []
        self._known: dict[int, list[float | None]] = {}

    def take(self, code: bytes) -> None:
        """Take the next instruction."""
        if _ELSEWHERE.search(code):
            self._known.clear()
        one = assignment_in(without_comments(code, 1))
        if one is None or one.kind != "PR" or one.number is None or one.axis == -1:
            for number in {number for kind, number in writes_in(code) if kind == "PR"}:
                self._forget(number)
            return
        number, axis = one.number, one.axis
        if axis is None and is_zero(one.value):
            self._known[number] = [0.0] * 6
            self.set_to |= {(number, k, 0.0) for k in range(6)}
        elif axis is None:
            self._forget(number)
        elif (m := _CONSTANT.fullmatch(one.value)) is not None:
            value = float(m[1].replace(b" ", b""))
            self._known.setdefault(number, [None] * 6)[axis] = value
            self.set_to.add((number, axis, value))
        else:
            self._forget(number)

    def forget_all(self) -> None:
        """Note that other instructions stand before the next one."""
        self._known.clear()

    def set_frame(self, code: bytes, line: int) -> None:
        """Note the constants to which an instruction sets a tool or user frame."""
        m = _FROM_REGISTER.fullmatch(without_comments(code, 1).strip(b" \t;"))
        values = self._known.get(int(m[1]), []) if m else []
        known = tuple([value for value in values if value is not None])
        if len(known) == 6:
            self.found.append((line, known))

    def _forget(self, number: int | None) -> None:
        self.computed.add(number)
        if number is None:
            self._known.clear()
        else:
            self._known.pop(number, None)


class _Ways:
    """Finds the position registers that a program may read before it has set them."""

    def __init__(self) -> None:
        self.read: set[int | None] = set()
        self._own: set[int | None] = set()
        self._blocks: list[set[int | None]] = []
        self._at_jumps: set[int | None] | None = None

    def take(self, code: bytes) -> None:
        """Take the next instruction."""
        mentioned = [int(m[1]) if m[1] else None for m in _MENTIONED.finditer(code)]
        whole = _WHOLE.match(code)
        set_here = int(whole[1]) if whole and int(whole[1]) not in mentioned[1:] else None
        self.read |= set(mentioned[1:] if set_here is not None else mentioned) - self._own
        if set_here is not None:
            self._own.add(set_here)
        if _LABEL.match(code):
            self._own = set() if self._blocks else self._own & (self._own if self._at_jumps is None else self._at_jumps)
        elif _JUMP.search(code):
            self._at_jumps = self._own & (self._own if self._at_jumps is None else self._at_jumps)
        self._block(code.strip(b" \t;").upper())

    def _block(self, code: bytes) -> None:
        if _OPENS.match(code):
            self._blocks.append(set(self._own))
        elif code == b"ELSE" and self._blocks:
            self._own = set(self._blocks[-1])
        elif code in (b"ENDIF", b"ENDFOR") and self._blocks:
            self._own &= self._blocks.pop()


def writes_in(code: bytes) -> set[tuple[Kind, int | None]]:
    """Return the registers that an instruction may write."""
    found: set[tuple[Kind, int | None]] = set()
    if b"=" in code:
        # what stands before the comma of a condition is compared
        action = code.partition(b",")[2] if _CONDITION.match(code) else code
        for m in _WRITTEN.finditer(action):
            found.add(("PR" if m[1].upper() == b"PR" else "R", int(m[2]) if m[2] else None))
    if _OUTPUT.search(code):
        found |= {("PR" if m[1].upper() == b"PR" else "R", int(m[2]) if m[2] else None) for m in _NAMED.finditer(code)}
    return found
