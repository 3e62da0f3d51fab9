"""KRL's names: declared points with their numbers, FDATs, and their uses in statements."""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Callable, Mapping, Sequence
from typing import Final, Literal

from truepose.programs.core.source import Source, shown, strip
from truepose.programs.core.state import FdatFrames, InForce
from truepose.programs.krl.constants import NO_CONSTANTS
from truepose.programs.krl.derived import NumberVariable, numbers_of
from truepose.programs.krl.lexer import (
    BLANK,
    CARTESIAN,
    Aggregate,
    closing_brace,
    parse_aggregate,
    parse_point,
    split_commas,
)
from truepose.programs.krl.points import JOINTS, POSES, Index, Numbers, PointVariable
from truepose.programs.krl.words import IDENTIFIER, KEEPS_FRAMES, READS

_DECLARATION = re.compile(rb"((?:(?:DECL|GLOBAL|CONST|PUBLIC|IMPORT)\b\s*+)*+)([A-Za-z_]\w*+)\s*+", re.I)
_DECLARATOR = re.compile(rb"([A-Za-z_$][\w$]*+)\s*+(\[[^\]]*\])?\s*+(=)?\s*+")
_IS_PATH = re.compile(rb"\bIS\b", re.I)
_IMPORTED = re.compile(rb"/R\d/(?:\w+/)*([\w$]+)\.\.([\w$]+)(?:\[\])?", re.I)
_CALLS: Final = re.compile(rb"\"[^\"]*+\"|'[^'\r\n]*+'|(?:(?<![\w#.])([A-Za-z_$][\w$]*+)[ \t]*+)?+\(|\)")
_POINT_TYPES: Final = frozenset([*POSES, *JOINTS])
_NUMBER_TYPES: Final = ("INT", "REAL")


class Names:
    """Symbol table of a module: its .dat, and the routine that is being read.

    Attributes
    ----------
    numbers : list of Numbers
        Every literal that may be a target, in the order of reading.
    fdats : mapping of str to FdatFrames
        The FDATs of the .dat by name, then the GLOBAL ones of other modules.
    public : bool
        Whether the data list is PUBLIC, so that other modules may import its points.
    constants : Constants
        The numbers and frames that no statement changes.
    routines : mapping of str to sequence of bool
        The routines of the program by name in upper case: whether each of its parameters is IN. One with the name of a
        function of the system is no such function.
    escape : callable
        A function that is told of every use of a point other than by a motion: the point, the element, the line and a
        phrase.
    """

    def __init__(
        self,
        numbers: list[Numbers],
        everywhere: dict[str, PointVariable] | None = None,
        fdats: dict[str, FdatFrames] | None = None,
    ) -> None:
        self.escape: Callable[[PointVariable, Index, int, str], object] = lambda *_: None
        self.routines: Mapping[str, Sequence[bool]] = {}
        self.own_numbers: dict[str, NumberVariable] = {}
        self.local_numbers: dict[str, NumberVariable] = {}
        self.module: dict[str, PointVariable] = {}
        self.local: dict[str, PointVariable] = {}
        self.elsewhere: dict[str, PointVariable] = {}
        self.everywhere = everywhere
        self.numbers = numbers
        self._global_fdats = {} if fdats is None else fdats
        self.fdats: ChainMap[str, FdatFrames] = ChainMap({}, self._global_fdats)
        self.public = False
        self.constants = NO_CONSTANTS
        self._imports: list[tuple[str, str, str]] = []

    def find(self, name: str) -> PointVariable | None:
        """Return the point with a name in upper case; None if the name is of anything else."""
        found = self.local.get(name) or self.module.get(name)
        return found or (self.everywhere or {}).get(name) or self.elsewhere.get(name)

    def take_imports(self, modules: Mapping[str, Names]) -> None:
        """Resolve imported names to the points of other modules, where those are known."""
        for name, module, original in self._imports:
            if module in modules and (variable := modules[module].module.get(original)) is not None:
                self.module[name] = variable

    def forget_fdat(self, name: str, unknown: FdatFrames) -> None:
        """Replace an FDAT that the program sets at run time."""
        for table in self.fdats.maps:
            if name in table:
                table[name] = unknown
                break

    def declare(self, source: Source, start: int, end: int, line: int, origin: Literal["dat", "src"]) -> None:
        """Read a declaration, with its initial values."""
        data = source.data
        m = _DECLARATION.match(data, start, end)
        if m is None:
            return
        kind, words = m[2].decode().upper(), m[1].upper()
        imported = b"IMPORT" in words
        if imported and (path := _IS_PATH.search(data, m.end(), end)):
            if known := _IMPORTED.fullmatch(data[path.end() : end].strip()):
                alias = data[m.end() : path.start()].strip(b" \t[]").decode("latin-1").upper()
                self._imports.append((alias, known[1].decode().upper(), known[2].decode().upper()))
            end = path.start()
        if kind in _NUMBER_TYPES:
            self._declare_numbers(source, m.end(), end, line, kind, outside=imported or b"GLOBAL" in words)
            return
        if kind not in _POINT_TYPES and kind != "FDAT":
            return
        is_global = b"GLOBAL" in words or source.path.name.lower() == "$config.dat"
        for a, b in _pieces(source, m.end(), end, line):
            d = _DECLARATOR.match(data, a, b)
            if d is None:
                raise source.error(line, f"declaration {shown(data, start, end)}: expected a name; correct the file")
            name = d[1].decode().upper()
            if kind == "FDAT":
                if d[3] and data[d.end() : d.end() + 1] == b"{":
                    close = closing_brace(source, d.end(), b, line)
                    table_of_fdats = self._global_fdats if is_global else self.fdats
                    table_of_fdats[name] = read_fdat(parse_aggregate(source, d.end(), close, line), name)
                continue
            table = self.module if origin == "dat" else self.local
            if name in table and table[name].type:  # a parameter has none yet
                raise source.error(line, f"{name} is declared twice, first in line {table[name].line}; keep one")
            parameter = name in table  # the type of a parameter that the head of the routine names
            variable = table[name] = PointVariable(
                d[1].decode(), kind, line, "import" if imported else origin, is_global, array=d[2] is not None
            )
            variable.parameter = parameter
            variable.fdats = self.fdats if origin == "dat" else None
            variable.is_public = self.public and origin == "dat"
            shared = self.everywhere if is_global and self.everywhere is not None else {}
            if (old := shared.setdefault(name, variable)) is not variable:
                raise source.error(line, f"{name} is GLOBAL here and in line {old.line} of another file; keep one")
            if d[3]:
                self.assign(source, variable, (), d.end(), b, line, declared=True)

    def _declare_numbers(self, source: Source, start: int, end: int, line: int, kind: str, *, outside: bool) -> None:
        """Read a declaration of numbers; `outside`: other modules may change them."""
        try:
            pieces = split_commas(source.data, start, end)
        except ValueError:
            return  # what is declared here is not known
        local = self.local_numbers if source.path.suffix.lower() == ".src" else self.own_numbers
        for a, b in pieces:
            if d := _DECLARATOR.match(source.data, a, b):
                variable = NumberVariable(kind, d[1].decode(), handed=outside or self.public)
                local[d[1].decode().upper()] = variable
                value = numbers_of(source.data[d.end() : b]) if d[3] else None
                if d[3] and value is None:
                    self.scan(source.data, d.end(), b, line)
                if value is not None and not d[2] and local is self.own_numbers:
                    variable.values[()] = value

    def number(self, name: str) -> NumberVariable | None:
        """Return the number with a name in upper case, as this module or the routine declares it."""
        if name in self.local or name in self.module:
            return None  # a point, or a parameter of the routine
        return self.local_numbers.get(name) or self.own_numbers.get(name)

    def hand_numbers(self, data: bytes, start: int, end: int) -> None:
        """Note that code may change the numbers that it names."""
        for m in IDENTIFIER.finditer(data, start, end):
            if m[1] is not None and (number := self.number(m[1].decode().upper())) is not None:
                number.handed = True

    def assign(
        self,
        source: Source,
        variable: PointVariable,
        index: Index,
        start: int,
        end: int,
        line: int,
        *,
        declared: bool = False,
    ) -> None:
        """Take the value of a point: numbers that may be corrected, or a value that only the run time knows.

        `declared`: it is an initial value, and nothing else notes what it reads.
        """
        start, end = strip(source.data, start, end, BLANK)
        literal = source.data[start : start + 1] == b"{" and closing_brace(source, start, end, line) == end
        if not literal or variable.parameter:
            if declared:
                self.scan(source.data, start, end, line)
            variable.writes[index].append((line, "assigned"))
            return
        aggregate = parse_point(source, start, end, line)
        if declared:
            self.scan_parts(aggregate, line)
        in_program = source.path.suffix.lower() != ".dat"
        if not in_program and (old := variable.literals.get(index)) and old[0].source is source:
            raise source.error(line, f"{variable.name} already has a value in line {old[0].line}; keep one")
        if in_program and is_partial(aggregate):
            variable.writes[index].append((line, "some of its components are set"))
        suffix = "" if index == () else "[" + (",".join(map(str, index)) if index else "…") + "]"
        numbers = Numbers(variable.name + suffix, source, line, aggregate, variable, index)
        variable.literals[index].append(numbers)
        self.numbers.append(numbers)

    def scan(self, data: bytes, start: int, end: int, line: int, how: str = "read by arithmetic") -> list[str]:
        """Note the points that code reads; return the subprograms that it calls, in the order of the calls."""
        for m in IDENTIFIER.finditer(data, start, end):
            if m[1] is None or m[2] == b"(":
                continue
            name = m[1].decode().upper()
            if (variable := self.find(name)) is not None:
                index = element(variable, m[2])
                variable.reads[index].append((line, how))
                self.escape(variable, index, line, how)
        return self.calls(data, start, end)

    def scan_parts(self, aggregate: Aggregate, line: int) -> None:
        """Note the points that the expressions in an aggregate read."""
        for code in aggregate.loose.values():
            self.scan(code, 0, len(code), line)

    def calls(self, data: bytes, start: int, end: int) -> list[str]:
        """Return the subprograms that code calls, in the order of the calls: arguments come first."""
        if data.find(b"(", start, end) < 0:
            return []
        found, waiting = list[str](), list[str]()
        for m in _CALLS.finditer(data, start, end):
            if m[0] != b")" and m[0][:1] not in (b'"', b"'"):
                waiting.append(m[1].decode().upper() if m[1] else "")
            elif m[0] == b")" and waiting:
                found.append(waiting.pop())
        return [name for name in (*found, *reversed(waiting)) if name and not self.is_known(name)]

    def kept(self, name: str) -> Sequence[bool] | None:
        """Return whether a routine leaves each frame that it is given as it is; None: all of them."""
        return self.routines.get(name, None if name in READS else ())

    def is_known(self, name: str) -> bool:
        """Return whether a name before a parenthesis is of the system, and leaves tool and base unchanged."""
        return name in KEEPS_FRAMES and name not in self.routines


def is_partial(aggregate: Aggregate) -> bool:
    """Return whether an aggregate leaves some of X to C as before."""
    return not {*aggregate.values, *aggregate.loose}.issuperset(CARTESIAN)


def element(variable: PointVariable, brackets: bytes | None) -> Index:
    """Return the element that ``[3]`` names; None if only the run time knows it, or if the whole array is meant."""
    if brackets is not None and brackets.startswith(b"["):
        try:
            return tuple([int(n) for n in brackets.strip(b"[] \t").split(b",")])
        except ValueError:
            return None
    return None if variable.array else ()


def read_fdat(aggregate: Aggregate, name: str) -> FdatFrames:
    """Return the frames that an FDAT names."""

    def number(key: str, data: str) -> InForce:
        value = aggregate.integer(key)
        return (
            InForce("unknown", f"{name} has no {key}")
            if value is None
            else InForce("number", f"{data}[{value}]", value)
        )

    ipo = aggregate.loose.get("IPO_FRAME", b"#BASE").decode("latin-1").upper().lstrip("# ")
    return FdatFrames(number("TOOL_NO", "TOOL_DATA"), number("BASE_NO", "BASE_DATA"), ipo)


def _pieces(source: Source, start: int, end: int, line: int) -> list[tuple[int, int]]:
    try:
        return split_commas(source.data, start, end)
    except ValueError as error:
        raise source.error(line, f"{shown(source.data, start, end)}: {error}; correct the file") from None
