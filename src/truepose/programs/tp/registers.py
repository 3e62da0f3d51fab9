"""Registers of a FANUC controller: their stored values, and which programs of a backup write them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from truepose.programs.tp.sections import NUMBERED, REMARK

Kind = Literal["R", "PR"]
_TEXT = re.compile(rb"'[^']*'|\"[^\"]*\"")
_WRITTEN = re.compile(
    rb"(?<![\w$])(P?R)[ \t]*\[[ \t]*(?:GP\d[ \t]*:[ \t]*)?"
    rb"(?:(\d{1,5})[^\]\[=]*|[^\]=]*(?:\[[^\]]*\][^\]=\[]*)*)\][ \t]*=(?!=)",
    re.I,
)
_SEARCH = re.compile(rb"\b(?:SEARCH|TOUCH)\b|(?<![\w$])(?:Skip|SKIP),[^;]*\bPR[ \t]*\[", re.I)
"""Touch sensing and skipped motions write position registers."""
_OUTPUT = re.compile(rb"\bVISION\b|\bGET_OFFSET\b|\bFIND\b|(?<![\w$])(?:CALL|RUN)[ \t]+(?:AR|SR)[ \t]*\[", re.I)
_CALL = re.compile(rb"(?<![\w$])(?:CALL|RUN)[ \t]+(\w+)", re.I)
_RELEVANT = re.compile(rb"^[^\r\n]*(?:[=]|CALL|RUN|SEARCH|TOUCH|Skip,|VISION|OFFSET|FIND)[^\r\n]*", re.I | re.M)
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
    """Registers that a program writes, and the programs that it calls.

    Attributes
    ----------
    written : frozenset of ("R" or "PR", int or None)
        The registers; None: any of them.
    calls : frozenset of str
        The names of the programs, in upper case.
    """

    written: frozenset[tuple[Kind, int | None]]
    calls: frozenset[str]


ANYTHING: Final = Effects(frozenset([("R", None), ("PR", None)]), frozenset())


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
        The programs of the backup, by their names in upper case.
    """

    positions: Mapping[tuple[int, int], StoredRegister] = field(default_factory=dict)
    values: Mapping[int, float] = field(default_factory=dict)
    programs: Mapping[str, Effects] = field(default_factory=dict)

    def writer(self, kind: Kind, number: int) -> str:
        """Return the name of a program that may write a register; empty where none does."""
        for name, (written, calls) in self.programs.items():
            if written & {(kind, number), (kind, None)}:
                return name
            if unknown := sorted(calls - self.programs.keys()):
                return unknown[0]
        return ""

    def written_by(self, name: str) -> frozenset[tuple[Kind, int | None]] | None:
        """Return the registers that a call of a program may write; None where they are not known."""
        found: set[tuple[Kind, int | None]] = set()
        waiting, seen = [name.upper()], {name.upper()}
        while waiting:
            if (effects := self.programs.get(waiting.pop())) is None:
                return None
            found |= effects.written
            waiting += effects.calls - seen
            seen |= effects.calls
        return frozenset(found)


def effects_of(data: bytes) -> Effects:
    """Return the effects of a program on registers, from the text of its instructions."""
    written: set[tuple[Kind, int | None]] = set()
    calls: set[str] = set()
    end = data.find(b"/POS")
    for line in _RELEVANT.finditer(data, max(data.find(b"/MN"), 0), end if end >= 0 else len(data)):
        text = line[0]
        m = NUMBERED.match(text)
        code = _TEXT.sub(b"", text[m.end() :] if m else text)
        if REMARK.match(code):
            continue
        written |= writes_in(code)
        calls |= {name.decode("latin-1").upper() for name in _CALL.findall(code)}
    return Effects(frozenset(written), frozenset(calls))


def writes_in(code: bytes) -> set[tuple[Kind, int | None]]:
    """Return the registers that an instruction may write."""
    found: set[tuple[Kind, int | None]] = set()
    if b"=" in code:
        # what stands before the comma of a condition is compared
        action = code.partition(b",")[2] if _CONDITION.match(code) else code
        for m in _WRITTEN.finditer(action):
            found.add(("PR" if m[1].upper() == b"PR" else "R", int(m[2]) if m[2] else None))
    if _SEARCH.search(code):
        found.add(("PR", None))
    if _OUTPUT.search(code):
        found |= {("R", None), ("PR", None)}
    return found
