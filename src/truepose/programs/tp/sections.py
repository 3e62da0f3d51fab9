"""The sections of a FANUC program: its header, its instructions in lines or runs, and the place of its positions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from truepose.errors import FileError
from truepose.programs.core.forms import Lines, RunFinder
from truepose.programs.core.reader import Instruction
from truepose.programs.core.source import NotAProgramError, Source
from truepose.programs.tp.positions import NAME
from truepose.programs.tp.words import check_header

_SECTION = re.compile(rb"[ \t]*/(PROG|ATTR|APPL|MN|POS|END)\b", re.I)
_HEAD_WORD = re.compile(rb"/(?:PROG|ATTR|APPL|MN|POS|END)\b", re.I)
_REST = re.compile(rb"[^\r\n]*+(?:\r\n|[\r\n])")
NUMBERED: Final = re.compile(rb"[ \t]*(\d*)[ \t]*:")
_LABELS = re.compile(rb"'[^']*'|\"[^\"]*\"|\[[^\]\[]*\]")
"""Texts and brackets, whose comments may hold anything."""
_TRACKED = re.compile(rb"[ \t]*(\w*_TRACK)\b", re.I)
"""A header of line tracking: the whole program follows a conveyor."""
REMARK: Final = re.compile(rb"\s*(?:!|//|--)")
_MASK = re.compile(rb"^[ \t]*DEFAULT_GROUP[ \t]*=[ \t]*([^;\r\n]*)", re.I | re.M)
_CAM_MOTION: Final = re.compile(
    rb"[ \t]*+([0-9]{1,9}+)[ \t]*+:[ \t]*+[JL][ \t]++P\[([1-9][0-9]{0,8}+)\]"
    rb"[ \t]++([0-9]{1,9}+)(?:%|mm/sec|cm/min|deg/sec)[ \t]++(?:FINE|CNT[ \t]*+([0-9]{1,3}+))"
    rb"(?:[ \t]++COORD)?+[ \t]*+;[ \t]*+\r?+\n"
)
_WHOLE: Final = rb"[0-9]{1,9}+"


class Sections(NamedTuple):
    """A program in sections.

    Attributes
    ----------
    instructions : list of Instruction or Lines
        The instructions and runs of motions under /MN.
    start, end : int
        The bytes between which the positions stand.
    tracked : str
        The line tracking that the header names; empty where there is none.
    groups : frozenset of int
        The motion groups that the header names.
    """

    instructions: list[Instruction | Lines]
    start: int
    end: int
    tracked: str
    groups: frozenset[int]


def read_sections(source: Source) -> Sections:
    """Return the sections of a program; a FileError names what is missing, given twice, or in another language."""
    data, seen = source.data, set()
    instructions: list[Instruction | Lines] = []
    start = end = len(data)
    tracked, groups = "", frozenset[int]()
    heads = list(_section_heads(data))
    for head, border in zip(heads, [*(head.start() for head in heads[1:]), len(data)], strict=False):
        section = head[1].upper()
        if section in seen and section != b"APPL":  # one for each application
            line = source.line(head.start())
            raise source.error(line, f"/{section.decode()} is given a second time; keep one")
        seen.add(section)
        first = m.end() if (m := _REST.match(data, head.end())) else len(data)
        if section == b"POS":
            start = min(first, border)
        elif section == b"END":
            end = head.start()
            break
        elif section == b"ATTR":
            groups = _groups(source, first, border)
        elif section == b"APPL":
            tracked = tracked or _tracking(source, first, border)
        elif section == b"MN":
            _add_main(instructions, source, first, border)
    if b"PROG" not in seen:
        error = FileError if seen or b"\0" in data else NotAProgramError  # a log has no section
        raise error(source.path, "has no /PROG: it is not a FANUC program in text form (.ls)")
    if b"END" not in seen:
        raise FileError(source.path, "has no /END: the file is truncated")
    return Sections(instructions, min(start, end), end, tracked, groups)


def _groups(source: Source, start: int, end: int) -> frozenset[int]:
    """Return the motion groups of the header, whose keywords must be English."""
    check_header(source, start, end)
    mask = _MASK.search(source.data, start, end)
    marks = mask[1].split(b",") if mask else []
    return frozenset(k for k, mark in enumerate(marks, 1) if mark.strip() == b"1")


def _tracking(source: Source, start: int, end: int) -> str:
    lines = ((line, _TRACKED.match(source.data, a, b)) for line, a, b in source.lines(start, end))
    found = next(((line, m[1]) for line, m in lines if m), None)
    return f"{found[1].decode().upper()} (line {found[0]})" if found else ""


def _add_main(instructions: list[Instruction | Lines], source: Source, start: int, end: int) -> None:
    """Add the instructions between two starts of lines, and the runs of motions among them."""
    data, finder = source.data, RunFinder(source, _CAM_MOTION, {1: _WHOLE, 2: NAME, 3: _WHOLE, 4: _WHOLE})
    goes_on, position = False, start
    while position < end:
        for line, a, b in source.lines(position, end):
            if not goes_on and (lines := finder.find(a)) is not None and lines.end <= end:
                instructions.append(lines)
                position = lines.end
                break
            goes_on = add_line(instructions, line, data[a:b], goes_on)
        else:
            break


def add_line(instructions: list[Instruction | Lines], line: int, text: bytes, goes_on: bool) -> bool:
    """Add a line to the instructions; return whether the last instruction has no ``;`` yet.

    A line without a number continues an instruction only if that is open (`goes_on`); else it is one of its own.
    """
    if not text.strip():
        return goes_on
    m = NUMBERED.match(text)
    code = text[m.end() :] if m else text
    if goes_on and not (m and m[1]):
        before = instructions.pop()
        assert isinstance(before, Instruction)  # a run is not open
        line, code = before.line, before.code + b" " + code
    instructions.append(Instruction(line, code))
    return not REMARK.match(code) and b";" not in _LABELS.sub(b"", code)


def _section_heads(data: bytes) -> Iterator[re.Match[bytes]]:
    """Yield the lines that begin a section; the match starts with the line."""
    for m in _HEAD_WORD.finditer(data):
        start = m.start()
        while start and data[start - 1] in b" \t":
            start -= 1
        if (not start or data[start - 1] in b"\r\n") and (head := _SECTION.match(data, start)):
            yield head
