"""Instructions that choose a tool or user frame, or that change one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final, Literal

from truepose.programs.core.points import Frame, Problem
from truepose.programs.core.program import Key
from truepose.programs.core.state import InForce, State
from truepose.programs.tp.positions import IN_FORCE, Taught, frame_of

Which = Literal["tool", "base"]
_CHOSEN = re.compile(
    rb"(?:\bU(?P<a>FRAME|TOOL)_NUM\s*(?:\[(?P<groups>[^\]]*)\]\s*)?"
    rb"|\$MNU(?P<b>FRAME|TOOL)NUM\s*\[\s*(?P<group>\d*)[^\]]*\]\s*)=\s*(?P<value>.*)",
    re.I,
)
_SET = re.compile(
    rb"(?<![\w$])U(?P<a>FRAME|TOOL)\s*\[\s*(?:GP(?P<ga>\d+)\s*:\s*)?(?P<na>\d{0,9})[^=]*\][\s.$\w]*="
    rb"|\$MNU(?P<b>FRAME|TOOL)\s*\[\s*(?P<gb>\d*)(?:[^\]\[,=]|\[[^\]]*\])*,\s*(?P<nb>\d{0,9})[^=]*\][\s.$\w]*="
    rb"|\$GROUP\s*\[\s*(?P<gc>\d*)[^=]*\]\s*\.\s*\$U(?P<c>FRAME|TOOL)\b[^=]*=",
    re.I,
)
"""A frame that is set, also as a system variable. Without a number it may be any."""
_GROUP: Final = re.compile(rb"GP(\d)", re.I)
_WHICH: Final[dict[bytes, Which]] = {b"TOOL": "tool", b"FRAME": "base"}
_NUMBERS: Final = {"tool": ("UTOOL_NUM", "UT"), "base": ("UFRAME_NUM", "UF")}


def chosen(code: bytes, group: int) -> Iterator[tuple[Which, InForce]]:
    """Yield the tools and frames that an instruction puts in force for a motion group."""
    for m in _CHOSEN.finditer(code):
        listed = [int(g) for g in _GROUP.findall(m["groups"] or b"")]
        if (listed and group not in listed) or (m["group"] and int(m["group"]) != group):
            continue
        certain = bool(listed) or not m["groups"] if m["a"] else bool(m["group"])
        which, digits = _WHICH[(m["a"] or m["b"]).upper()], m["value"].strip(b" \t;")
        text = f"{_NUMBERS[which][0]}={digits.decode('latin-1')}"
        if certain and digits.isdigit() and len(digits) < 10:
            yield which, InForce("number", text, int(digits))
        else:
            yield which, InForce("unknown", text[:40])


def changed(code: bytes, group: int) -> Iterator[tuple[Which, Key | None]]:
    """Yield the keys of the tools and frames of a motion group that an instruction changes; None: any of them."""
    for m in _SET.finditer(code):
        owner = m["ga"] or m["gb"] or m["gc"]
        if owner and int(owner) != group:
            continue
        which, digits = _WHICH[(m["a"] or m["b"] or m["c"]).upper()], m["na"] or m["nb"] or b""
        frame = frame_of(digits, which, group)
        yield which, None if frame is None else frame.key


def frames_at(taught: Taught, state: State, group: int, line: int) -> tuple[Frame | None, Frame | None, Problem | None]:
    """Return the tool and frame of a motion to a position, and what is against them.

    The frames of the position count unless others are certainly in force: then the controller stops. A position
    without numbers takes those in force.
    """
    problem: Problem | None = None
    found: list[Frame | None] = []
    frames: tuple[tuple[Which, Frame | None], ...] = (("tool", taught.tool), ("base", taught.base))
    for which, frame in frames:
        values = state.tool if which == "tool" else state.base
        numbers = {v.number for v in values if v.kind == "number"}
        certain = bool(numbers) and len(numbers) == len(values)
        other, own = _NUMBERS[which]
        if frame is IN_FORCE:
            frame = in_force(values, which, group)
            if frame is None and any(v.kind != "unset" for v in values):
                reason = f"{own} : F, the one in force, which is not certain here; teach it in a number"
                problem = problem or Problem("refuse", reason)
        elif frame and certain and frame.key not in {_key(number, which, group) for number in numbers}:
            reason = f"{other} {min(filter(None, numbers), default=0)} is in force (line {line}), "
            problem = problem or Problem("refuse", f"{reason}but it was taught in {own} {frame.key}")
        found.append(frame)
    return found[0], found[1], problem


def in_force(values: frozenset[InForce], which: Which, group: int) -> Frame | None:
    """Return the frame that is certainly in force; None where there is none."""
    if len(values) != 1 or (number := next(iter(values)).number) is None:
        return None
    return frame_of(b"%d" % number, which, group)


def _key(number: int | None, which: Which, group: int) -> Key | None:
    frame = frame_of(b"%d" % (number or 0), which, group)
    return frame and frame.key
