"""G-code of robots in machining: ``G1 X Y Z A B C`` in the frame and with the orientation rule that the user states.

The frame is ``--base``, or G54 … G59 by name in the frame table. `ReadOptions.angles` names the convention of A, B, C.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from truepose.errors import FileError
from truepose.programs.core.held import leave_held
from truepose.programs.core.points import AS_MEASURED, NOT_HERE, Frame, Point, Problem, Use
from truepose.programs.core.program import KnownFrames, Program, ReadOptions, frame_key
from truepose.programs.core.reader import Reader
from truepose.programs.core.source import NotAProgramError, Source, Span, is_broken, parse_number

_NUMBER = rb"[+-]?+(?:[0-9]++\.?+[0-9]*+|\.[0-9]++)"
_EXPONENT = rb"[EeDd][+-]?+[0-9]*+"
LEXER: Final = re.compile(rb"\r\n|[\r\n]|[ \t]++|" + _NUMBER + rb"(?:[EeDd][+-]?+[0-9]++)?+|[^\r\n]")
"""A number with an exponent is one word here, whatever the reader takes it for."""
_WORD = re.compile(rb"([A-Za-z])[ \t]*+(" + _NUMBER + rb")(?![.\d])")
_WITH_EXPONENT = re.compile(rb"([XYZABCxyzabc])[ \t]*+(" + _NUMBER + _EXPONENT + rb")")
"""An axis and `1.2E+02` or `20.D5`: one number, or a number and another word, depending on the control."""
_ADHERING: Final = b"%+-*/_#[=,'\":<>@&$^"
"""Characters that make the number before them part of an expression."""
_EXPRESSION = re.compile(
    rb"([A-Za-z])[ \t]*+(=[^\r\n;(]*+(?:\([^)]*\))?|[+-]?[ \t]*+[#\[][^\r\nXYZABCIJKFxyzabcijkf]*+|[+-]?R\d++)"
)
_NAME = re.compile(rb"[A-Za-z_][A-Za-z_]++\w*+(?:[ \t]*+\([^\r\n()]*+\)|[ \t]*+=[^\r\n]*+)?")
_BROKEN = re.compile(rb"([A-Za-z])[ \t]*+([^A-Za-z\s]*+)")
_VARIABLE = re.compile(rb"(?:#(?:\d++|<[^>\r\n]*>|\[[^\]\r\n]*\])|R\d++(?:\[[^\]\r\n]*\])?)[ \t]*+=[^\r\n]*+", re.I)
"""A variable that is set: `#100=5`, `R1=2.5`."""
_CONTROL = re.compile(
    rb"[ \t/]*+(?:N\d++[ \t]*+)?(?:[A-Z_]\w++:[ \t]*+)?"
    rb"((?:IF|ELSEIF|WHILE|GOTO[BFCS]?|FOR|LOOP|REPEATB?|UNTIL|CASE)\b"
    rb"|(?:ELSE|END(?:IF|FOR|WHILE|LOOP)|(?:END|DO)\d)(?=[ \t]*+$))",
    re.I,
)
_VECTOR = re.compile(rb"(?:[ABC]\d|LEAD|TILT|THETA)[ \t]*+=[ \t]*+[-+.\w]*+(?:\([^\r\n()]*+\))?+", re.I)
"""Other forms of an orientation."""
_JUMP = re.compile(rb"(?:GOTO[BFCS]?|REPEATB?)\b[ \t]*+([A-Z_]\w*+|\d++(?![ \t]*+[-+*/.]))?+", re.I)
_LABEL = re.compile(rb"[ \t/]*+(?:N?+(\d++)|([A-Z_]\w++):)", re.I)
_AXIS = re.compile(rb"(?<![\w#<])[XYZ][ \t]*+[-+=#\[.\d]", re.I)
_COMMENT = re.compile(rb"\([^\r\n)]*\)|;[^\r\n]*")
_AXES: Final = "XYZABC"
_WHOLE: Final = (0, 1, 2, 3, 4, 9, *range(17, 22), 28, 30, *range(40, 44), 49, *range(53, 63), 64, 70, 71, 80, 90, 91)
_SMOOTHING: Final = ("5.1", "8", "61.1", "450", "451", "601", "602", "603", *map(str, range(641, 646)))
_KNOWN: Final = frozenset([*map(str, (*_WHOLE, *range(93, 100), 500)), "43.4", "43.5", *_SMOOTHING])
_CHANGES: Final = frozenset(["10", "16", "50", "51", "51.1", "52", "54.1", "68", "68.2", "92"])
_CALLS: Final = frozenset(["M98", "M97", "G65", "G66"])
_TRANSFORMS: Final = tuple(
    b"TRANS ATRANS ROT AROT SCALE MIRROR AMIRROR ASCALE CYCLE800 PLANE TOFRAME SUPA DIAM TRACYL TRAANG FTOC".split()
)
_STRAY: Final = [b"%c" % c for c in b":,*\"'@$&.<>_-"]
_CURVES: Final = (b"CIP", b"CT", b"ASPLINE", b"BSPLINE", b"CSPLINE", b"POLY", b"INVCW", b"INVCCW")
_EXPONENTS: Final = "exponent "
"""Prefix of an axis with an exponent among the words that are not understood."""
_MODAL: Final = ("_offset", "_motion", "_relative", "_unit", "_problem", "_compensated")
"""Attributes of the reader that hold from one line to the next, besides the orientation."""
_RETURNS: Final = 20
"""Largest number of labels that jumps are followed to; more count as one jump to the beginning."""
_ANGLES: Final = ("kuka", "fanuc", "staubli", "yaskawa")


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read G-code; a FileError names the line if it is broken."""
    return _Reader(Source.read(path), frames, options).read()


@dataclass(frozen=True)
class _Return:
    """A jump that may go back: to a label, or to the beginning."""

    line: int
    word: str
    label: str | None
    state: dict[str, Any]


_ANY_WORD: Final = re.compile(rb"(?mi)^[ \t/]*+(?:N\d++[ \t]*+)?+[GM]\d")
"""A line that begins with a preparatory or miscellaneous function, as at least one of each program does."""


class _Reader(Reader):
    def __init__(self, source: Source, frames: KnownFrames, options: ReadOptions) -> None:
        super().__init__(source, frames, options)
        self._offset = ""
        self._offsets: set[str] = set()
        self._motion = ""
        self._relative = False
        self._angles: dict[str, float] = {}
        self._unit = 0.0
        self._problem: Problem | None = None
        self._compensated = 0
        self._words = 0
        self._returns: list[_Return] = []
        self._jumps = _JUMP.search(source.data) is not None

    def read(self) -> Program:
        none = NotAProgramError(self.source.path, "has no word such as G1 or M30: it is no G-code")
        try:
            for line, start, end in self.source.lines():
                self._line(line, start, end)
        except FileError:
            if not _ANY_WORD.search(self.source.data):
                raise none from None
            raise
        self._follow_returns()
        if not self._words:
            raise none
        if self.options.orientation:
            leave_held(self.points)
        for point in self.points:
            point.uses = [self._in_frame(use) for use in point.uses]
        known = self.options.angles if self.options.angles in _ANGLES else "kuka"
        return self.program(known, unit=self._unit or 1.0, tool=Frame(AS_MEASURED), lexer=LEXER)

    def _follow_returns(self) -> None:
        """Read again the lines that a jump back repeats, with its settings; refuse targets that then differ."""
        returns = {back.label: back for back in self._returns}  # of many to one label, the last
        if self.options.calls_keep_frames or not returns:
            return
        if len(returns) > _RETURNS:
            self._come_back(self._returns[-1].line, self._returns[-1].word, None, anywhere=True)
            returns = {None: self._returns[-1]}
        for back in returns.values():
            again = _Reader(self.source, self.frames, self.options)
            again.__dict__.update(back.state)
            begun = back.label is None
            for line, start, end in self.source.lines():
                if line > back.line:
                    break
                begun = begun or _label(self.source.data[start:end]) == back.label
                if begun:
                    again._line(line, start, end)
            repeated = {point.line: point for point in again.points}
            for point in self.points:
                other = repeated.get(point.line)
                if point.problem is None and other is not None and not self._alike(point, other):
                    reason = f"line {back.line} ({back.word}) returns here with other settings in force"
                    point.problem = Problem("refuse", reason)

    def _alike(self, one: Point, other: Point) -> bool:
        frames = [[self._in_frame(use).frame for use in point.uses] for point in (one, other)]
        return other.problem is None and one.values == other.values and frames[0] == frames[1]

    def _come_back(self, line: int, word: str, label: str | None, *, anywhere: bool = False) -> None:
        """Note a jump that may go back to a label, or to any line."""
        state = {name: getattr(self, name) for name in _MODAL} | {"_angles": dict(self._angles)}
        if anywhere:
            state["_problem"] = Problem("refuse", f"line {line} ({word}) may come to any line")
        self._returns.append(_Return(line, word, label, state))

    def _in_frame(self, use: Use) -> Use:
        """Replace the work offset by the user's base if the program has only one and the table does not name it."""
        named = use.frame is not None and use.frame.key is not None and frame_key(use.frame.key) in self.frames.bases
        return use if named or len(self._offsets) > 1 else use._replace(frame=None)

    def _line(self, line: int, start: int, end: int) -> None:
        if self._jumps and _label(self.source.data[start:end]) is not None:
            self.flow.may_move()  # control may come from elsewhere
        code = _COMMENT.sub(lambda m: b" " * len(m[0]), self.source.data[start:end])
        if control := _CONTROL.match(code):
            self._control(line, control[1].decode().upper(), code)
            self.flow.may_move()
            return
        words, spans, strange = self._parse(line, code, start)
        self._words += sum(key in "GM" for key, _ in words)
        codes = [f"{key}{_plain(value)}" for key, value in words if key in "GMO"]
        axes = {key: value for key, value in words if key in _AXES}
        loose = [key.removeprefix(_EXPONENTS) for key in strange if key.removeprefix(_EXPONENTS) in _AXES]
        if any(_VECTOR.match(name) for name in strange.values()):
            loose += [key for key in "ABC" if key not in loose]
        if [key for key, _ in words if key in _AXES] != list(dict.fromkeys(key for key, _ in words if key in _AXES)):
            raise self.source.error(line, "names an axis twice; correct the file")
        self._modal(line, codes, words)
        if any(name.startswith(_TRANSFORMS) for name in strange.values()):
            self._problem = Problem("refuse", f"coordinates are changed in line {line}")
        if curves := [name for name in strange.values() if name in _CURVES]:
            self._problem = Problem("refuse", f"{curves[0].decode()} (line {line}) is a motion that is not supported")
        gs = [c[1:] for c in codes if c[0] == "G"]
        if "4" in gs or not (axes or loose):
            return
        position = [key for key in "XYZ" if key in axes]
        if not position and not [key for key in loose if key in "XYZ"] and not {"28", "30"} & set(gs):
            self._turn(axes, loose)
            if self._motion:
                self._add(line, Problem("skip", "an orientation alone: the position stays as before"))
            return
        self._turn(axes, loose)
        problem = _ambiguous(strange) or self._judge(line, gs, axes, loose)
        point = self._add(line, problem)
        if all(key in axes for key in "XYZ") and all(key in self._angles for key in "ABC"):
            point.values = tuple(axes[key] for key in "XYZ") + tuple(self._angles[key] for key in "ABC")
            point.spans = tuple([spans.get(key, NOT_HERE) for key in _AXES])

    def _control(self, line: int, word: str, code: bytes) -> None:
        """Take a jump, loop or condition; the settings behind it depend on the way."""
        for jump in _JUMP.finditer(code):
            label = _name(jump[1])
            computed = label is None and jump[0].upper() != b"GOTOS"
            self._come_back(line, word, label, anywhere=computed)
        if not self.options.calls_keep_frames:
            self._problem = Problem("refuse", f"what is in force after line {line} ({word}) is not known")
        self._angles = {}
        self._words += 1
        if _AXIS.search(code, code.upper().index(word.encode()) + len(word)):
            self._add(line, Problem("refuse", f"a motion behind {word} that is not understood"))

    def _judge(self, line: int, gs: list[str], axes: dict[str, float], loose: list[str]) -> Problem | None:
        unknown = [g for g in gs if g not in _KNOWN and g not in _CHANGES]
        if unknown:
            return Problem("refuse", f"G{unknown[0]} is not known here")
        if {"28", "30"} & set(gs):
            return Problem("skip", "a reference point of the machine")
        if self._relative:
            return Problem("skip", "G91: it starts from a target that is corrected already")
        if self._motion not in ("0", "1", "2", "3"):
            what = f"G{self._motion} is a motion that is not supported" if self._motion else "no G0 or G1 before it"
            return Problem("refuse", what)
        if self._problem:
            return self._problem
        if loose:
            return Problem("skip", f"{', '.join(loose)}: an expression, known at run time only")
        missing = [key for key in "XYZ" if key not in axes]
        if missing:
            return Problem("skip", f"partial: {', '.join(missing)} as before, from another target")
        if self._motion in ("2", "3"):
            return Problem("skip", "an arc by its centre or radius, which would no longer fit")
        if "53" in gs:
            return Problem("refuse", "G53: coordinates of the machine")
        if self._compensated:
            return Problem("refuse", f"tool radius compensation since line {self._compensated}")
        if self.options.angles not in _ANGLES:
            return Problem("refuse", f"name the convention of A, B, C (--angles {', '.join(_ANGLES)})")
        without = [key for key in "ABC" if key not in self._angles]
        if without:
            return Problem("refuse", f"no {', '.join(without)} on this line or before: its orientation is not known")
        return None

    def _turn(self, axes: dict[str, float], loose: list[str]) -> None:
        """Follow the modal orientation."""
        for key in "ABC":
            if key in loose or (self._relative and key in axes):
                self._angles.pop(key, None)
            elif key in axes:
                self._angles[key] = axes[key]

    def _modal(self, line: int, codes: list[str], words: list[tuple[str, float]]) -> None:
        for code in codes:
            number = code[1:]
            if code[0] == "O" or code in _CALLS:
                self.flow.may_move()
                if not self.options.calls_keep_frames and (code[0] != "O" or self.points):
                    self._problem = Problem("refuse", f"what is in force after line {line} ({code}) is not known")
            elif code == "M99":
                to = [_plain(value) for key, value in words if key == "P"]
                self._come_back(line, code, to[0] if to else None)
            elif code[0] != "G":
                continue
            elif number in ("90", "91"):
                self._relative = number == "91"
            elif number in ("20", "21", "70", "71"):
                unit = 25.4 if number in ("20", "70") else 1.0
                if self.points and unit != (self._unit or 1.0):
                    raise self.source.error(line, f"{code} changes the unit within the program; split it")
                self._unit = unit
            elif number in ("54", "55", "56", "57", "58", "59"):
                self._offset = code
                self._offsets.add(code)
            elif number in ("41", "42"):
                self._compensated = line
            elif number == "40":
                self._compensated = 0
            elif number in _CHANGES:
                self._problem = Problem("refuse", f"{code} changes the coordinates in line {line}")
            elif number == "80":
                self._motion = ""
            elif number in ("0", "1", "2", "3") or re.fullmatch(r"5|6\.\d|33|7[346]|8[1-9]", number):
                self._motion = number
            elif number not in _KNOWN and self._problem is None:
                self._problem = Problem("refuse", f"{code} (line {line}) is not known here; it may change what follows")

    def _add(self, line: int, problem: Problem | None) -> Point:
        word = f"G{self._motion}" if self._motion else "move"
        frame = Frame(self._offset, self._offset) if self._offset else None
        point = Point(f"{word}:{line}", self.source, line, problem=problem, uses=[self.use(word, line, None, frame)])
        if self._motion in ("2", "3") and self.points:
            self.circles.append([self.points[-1], point])  # the arc starts at the target before it
        self.points.append(point)
        return point

    def _parse(
        self, line: int, code: bytes, start: int
    ) -> tuple[list[tuple[str, float]], dict[str, Span], dict[str, bytes]]:
        """Return the words with numbers, the spans of the axes, and all other texts in place of numbers or words."""
        words: list[tuple[str, float]] = []
        spans: dict[str, Span] = {}
        strange: dict[str, bytes] = {}
        position = 0
        while position < len(code):
            if code[position : position + 1] in (b" ", b"\t", b"/", b"%", b"\x1a"):
                position += 1
            elif m := _VARIABLE.match(code, position):
                position = m.end()
            elif m := _VECTOR.match(code, position):
                strange[f"name{position}"] = m[0].upper()
                position = m.end()
            elif m := _WITH_EXPONENT.match(code, position):
                strange[_EXPONENTS + m[1].decode().upper()] = m[2]
                position = m.end()
            elif m := _WORD.match(code, position):
                key = m[1].decode().upper()
                if key in _AXES and _adheres(code, m.end()):
                    shown = code[m.start(2) : m.end() + 10].decode("latin-1")
                    raise self.source.error(line, f"{key} {shown} is not a number; correct the file")
                try:
                    value = float(m[2]) if key not in _AXES else parse_number(m[2])
                except ValueError as error:
                    raise self.source.error(line, f"{key}: {error}; correct the file") from None
                words.append((key, value))
                spans[key] = (start + m.start(2), start + m.end(2))
                position = m.end()
            elif m := _EXPRESSION.match(code, position):
                strange[m[1].decode().upper()] = m[2]
                position = m.end()
            elif m := _NAME.match(code, position):
                strange[f"name{position}"] = m[0].upper()
                position = m.end()
            elif (m := _BROKEN.match(code, position)) and m[1].decode().upper() in _AXES and is_broken(m[2]):
                shown = m[2][:20].decode("latin-1")
                raise self.source.error(line, f"{m[1].decode()} {shown} is not a number; correct the file")
            elif code[position : position + 1] in _STRAY or code[position : position + 1].isalpha():
                position += 1
            else:
                raise self.source.error(
                    line, f"is not understood: {code[position : position + 20].decode('latin-1')!r}"
                )
        return words, spans, strange


def _adheres(code: bytes, position: int) -> bool:
    """Return whether something behind a number belongs to it and is no word of its own."""
    c = code[position : position + 1]
    return (c != b"" and c in _ADHERING) or (
        c.isalpha() and not _WORD.match(code, position) and not _EXPRESSION.match(code, position)
    )


def _ambiguous(strange: dict[str, bytes]) -> Problem | None:
    """Return why a line with an exponent is refused; None without one."""
    for key, text in strange.items():
        if key.startswith(_EXPONENTS):
            shown = f"{key.removeprefix(_EXPONENTS)}{text.decode()}"
            return Problem("refuse", f"{shown}: one number or two words; write it without exponent, or a blank between")
    return None


def _label(code: bytes) -> str | None:
    """Return the number or name of a line; None without one."""
    m = _LABEL.match(code)
    return _name(m[1] or m[2]) if m else None


def _name(label: bytes | None) -> str | None:
    """Return a label as it is compared; None for one that is computed, or for none."""
    if label is None or re.fullmatch(rb"R\d+", label, re.I):
        return None
    text = label.decode("latin-1").upper()
    number = text.removeprefix("N")
    return (number.lstrip("0") or "0") if number.isdigit() else text


def _plain(value: float) -> str:
    return f"{value:g}"
