"""Statements that set tool, base and IPO_MODE: $TOOL, $BASE, BAS(…), FDAT_ACT, WITH."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, Literal

from truepose.programs.core.flow import Flow
from truepose.programs.core.source import Source, shown, strip
from truepose.programs.core.state import UNSET, FdatFrames, InForce
from truepose.programs.krl.constants import NO_CONSTANTS, Constants, key_of
from truepose.programs.krl.lexer import BLANK, CARTESIAN, closing_brace, parse_aggregate
from truepose.programs.krl.names import read_fdat

Which = Literal["tool", "base"]
SYSTEM: Final[dict[str, Which]] = {"$TOOL": "tool", "$BASE": "base"}
_DATA: Final = {"tool": "TOOL_DATA", "base": "BASE_DATA"}
_PLAIN: Final = rb"[^()]*+"
_ONE: Final = _PLAIN + rb"(?:\(" + _PLAIN + rb"\)" + _PLAIN + rb")*+"
_TWO: Final = _PLAIN + rb"(?:\(" + _ONE + rb"\)" + _PLAIN + rb")*+"  # arguments with two levels of brackets in them
_CALL: Final = re.compile(rb"(?<![\w$])(\w+)[ \t]*\((?=(" + _TWO + rb")\))")
_TABLE: Final = re.compile(rb"(TOOL|BASE)_DATA[ \t]*(?:\[[ \t]*([^\]]*?)[ \t]*\])?", re.I)
_CONSTANT = re.compile(rb"(TOOL_DATA|BASE_DATA)\s*\[\s*([A-Za-z]?\w{1,40})\s*\]", re.I)
_WITH_FUNCTION = re.compile(
    rb"(STOOL2?|SBASE|SIPO_MODE)\s*\(\s*(\w+)\s*(?:\.\s*(?:TOOL_NO|BASE_NO|IPO_FRAME)\s*)?\)", re.I
)
_BAS = re.compile(rb"\(\s*#\s*(\w+)\s*(?:,([^,]*))?\)\s*", re.I)


def frame_value(
    source: Source,
    start: int,
    end: int,
    line: int,
    which: Which,
    fdats: Mapping[str, FdatFrames],
    constants: Constants = NO_CONSTANTS,
) -> InForce:
    """Return the value of an expression on the right of $TOOL or $BASE: a constant, or unknown until run time."""
    start, end = strip(source.data, start, end, BLANK)
    code = source.data[start:end]
    unknown = InForce("unknown", f"${which.upper()}={shown(source.data, start, end)} (line {line})")
    if (m := _CONSTANT.fullmatch(code)) and m[1].decode().upper() == _DATA[which]:
        number = constants.integer(m[2])
        return unknown if number is None else _numbered(which, number)
    if (pose := constants.frame(code)) is not None:
        return InForce("literal", shown(source.data, start, end), None, pose)
    if which == "base" and (pose := constants.stored.get(key_of(code))) is not None:
        return InForce("unknown", f"$BASE={shown(source.data, start, end)}", None, pose)
    if code.upper() == b"$NULLFRAME" or (which == "base" and code.upper() == b"$WORLD"):
        return _numbered(which, 0)
    if m := _WITH_FUNCTION.fullmatch(code):
        if m[2].isdigit():
            return _numbered(which, int(m[2])) if len(m[2]) < 5 else unknown
        frames = fdats.get(m[2].decode().upper())
        return unknown if frames is None else getattr(frames, which)
    if code.startswith(b"{") and closing_brace(source, start, end, line) == end:
        aggregate = parse_aggregate(source, start, end, line)
        if set(aggregate.values) == set(CARTESIAN) and not aggregate.loose:
            pose = tuple(aggregate.values[key] for key in CARTESIAN)
            return InForce("literal", shown(source.data, start, end), None, pose)
    return unknown


def ipo_value(code: bytes, fdats: Mapping[str, FdatFrames]) -> str:
    """Return ``BASE``, ``TCP``, or the code if only the run time knows."""
    code = code.strip().upper()
    if m := _WITH_FUNCTION.fullmatch(code):
        frames = fdats.get(m[2].decode())
        return code.decode("latin-1") if frames is None else frames.ipo
    return code.decode("latin-1").lstrip("# ")


def fdat_value(source: Source, start: int, end: int, line: int, fdats: Mapping[str, FdatFrames]) -> FdatFrames:
    """Return the frames of a value that is assigned to FDAT_ACT."""
    start, end = strip(source.data, start, end, BLANK)
    code = source.data[start:end]
    known = fdats.get(code.decode("latin-1").upper())
    if known is not None:
        return known
    if code.startswith(b"{") and closing_brace(source, start, end, line) == end:
        return read_fdat(parse_aggregate(source, start, end, line), "FDAT_ACT")
    unknown = InForce("unknown", f"FDAT_ACT={shown(source.data, start, end)} (line {line})")
    return FdatFrames(unknown, unknown, "BASE")


def bas(flow: Flow, source: Source, start: int, end: int, line: int, constants: Constants = NO_CONSTANTS) -> None:
    """Follow a call of BAS, `start` behind its name: the commands of the basis package that set frames."""
    m = _BAS.fullmatch(source.data, start, end)
    command = m[1].decode().upper() if m else ""
    argument = (m[2] or b"").strip() if m else b""
    unknown = InForce("unknown", f"BAS{shown(source.data, start, end)} (line {line})")
    if command in ("TOOL", "BASE"):
        which: Which = "tool" if command == "TOOL" else "base"
        number = constants.integer(argument)
        flow.change(**{which: unknown if number is None else _numbered(which, number)})
    elif command in ("PTP_PARAMS", "CP_PARAMS", "FRAMES"):
        flow.apply_fdat()
    elif command == "INITMOV":
        flow.change(tool=UNSET, base=UNSET, ipo="BASE")
    elif command == "EX_BASE":
        flow.change(
            base=InForce("unknown", f"a base on an external axis, BAS{shown(source.data, start, end)} (line {line})")
        )
    elif not command:
        flow.change(tool=unknown, base=unknown, fdat=FdatFrames(unknown, unknown, "BASE"))


def _numbered(which: Which, number: int) -> InForce:
    return InForce("number", f"{_DATA[which]}[{number}]", number)


def handed(data: bytes, start: int, end: int, kept: Callable[[str], Sequence[bool] | None]) -> Iterator[bytes]:
    """Yield the arguments that a statement hands to routines which may change them.

    `kept` gives, by the name of a routine in upper case, whether it leaves each of its arguments as it is; None: all.
    """
    for call in _CALL.finditer(data, start, end):
        if (by_value := kept(call[1].decode("latin-1").upper())) is None:
            continue
        by_value = () if b"(" in call[2] else by_value
        for k, argument in enumerate(call[2].split(b",")):
            if k >= len(by_value) or not by_value[k]:
                yield argument.strip()


def entry_of(argument: bytes) -> tuple[Which, int | None] | None:
    """Return the tool or base that an argument names, by its number (None: any); None where it is no such argument."""
    if (m := _TABLE.match(argument)) is None:
        return None
    which: Which = "tool" if m[1].upper() == b"TOOL" else "base"
    return which, int(m[2]) if (m[2] or b"").isdigit() and len(m[2]) < 5 else None
