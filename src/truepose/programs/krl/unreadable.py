"""Modules of a project that cannot be read: what they may do to the others is assumed of what they name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from truepose._io.files import read_bytes
from truepose.programs.core import shifts
from truepose.programs.core.points import FileLine
from truepose.programs.core.state import FdatFrames, InForce
from truepose.programs.krl.libraries import defined_in, is_encoded
from truepose.programs.krl.module import FRAME_TABLES, KrlModule, Shared
from truepose.programs.krl.words import KEEPS_FRAMES

_WORD: Final = re.compile(rb"[A-Za-z_$][\w$]*+")
_FRAME_USED: Final = re.compile(
    rb"\$(?:TOOL|BASE)[ \t]*+=[ \t]*+(?:TOOL|BASE)_DATA\b|\b(TOOL|BASE)_DATA[ \t]*+(?=[\[.=,)])", re.I
)
_WORLD_SET: Final = re.compile(rb"\$(?:ROBROOT|WORLD)\b[ \t]*+(?:\.[ \t]*+\w++[ \t]*+)?+=(?!=)", re.I)
_DECLARED: Final = re.compile(rb"^[ \t]*+DECL[ \t]++(?:GLOBAL[ \t]++)?+\w++[ \t]++([A-Za-z_$][\w$]*+)", re.I | re.M)
_INTERRUPT: Final = re.compile(
    rb"^[ \t]*+(GLOBAL[ \t]++)?+INTERRUPT\b[^\r\n;]*?\bDO[ \t]++([A-Za-z_$][\w$]*+)[ \t]*+\(", re.I | re.M
)


def assume_all_of(
    name: str, files: Iterable[Path], modules: Sequence[KrlModule], shared: Shared, *, copy: bool = False
) -> None:
    """Let a module that cannot be read do whatever its words allow.

    GLOBAL points that it names are not corrected, and neither are targets in frames that it may change. Its routines
    leave tool and base unknown, may begin the shifts that it names, and may call the routines that it names. An encoded
    module may name every GLOBAL point. A copy of a module that can be read hides the points that it declares itself.
    """
    for path in files:
        text, place = read_bytes(path), FileLine(path.name, 1)
        encoded = is_encoded(text)
        words = set() if encoded else {word.decode("latin-1").upper() for word in set(_WORD.findall(text))}
        taught = {f"X{fdat[1:]}" for fdat in words & shared.fdats.keys()}
        if copy:
            words -= {m[1].decode("latin-1").upper() for m in _DECLARED.finditer(text)}
        for point in shared.points if encoded else (words | taught) & shared.points.keys():
            shared.points[point].reads[None].append((place, f"named by {name}, which cannot be read"))
        if encoded:
            continue
        for module in modules if "IMPORT" in words else ():
            for variable in module.names.module.values() if module.name in words else ():
                variable.reads[None].append((place, f"perhaps imported by {name}, which cannot be read"))
        for m in _FRAME_USED.finditer(text):
            if m[1] and path.name.lower() != "$config.dat":  # which states them, and is read for that
                shared.changed.setdefault((FRAME_TABLES[f"{m[1].decode().upper()}_DATA"], None), place)
        if world := _WORLD_SET.search(text):
            shared.moved.append(f"{world[0].decode('latin-1')} of {name}, which cannot be read")
        _take_routines(name, text, words, place, shared)


def _take_routines(name: str, text: bytes, words: set[str], place: FileLine, shared: Shared) -> None:
    """Define the routines of a module that cannot be read as ones that may do everything that it names."""
    flow = shared.flow
    others = sorted(words & set(flow.routines) - KEEPS_FRAMES)
    handlers = {m[2].decode().upper() for m in _INTERRUPT.finditer(text) if m[1] or others} - KEEPS_FRAMES
    flow.handlers += sorted(handlers)
    for routine in sorted(defined_in(name, text) - set(flow.routines)):
        flow.begin_routine(routine, outside=False)
        flow.motion()
        unknown = InForce("call", f"{routine}() was called, which cannot be read")
        flow.change(tool=unknown, base=unknown, fdat=FdatFrames(unknown, unknown, "BASE"))
        if "$IPO_MODE" in words:
            flow.change(ipo=f"$IPO_MODE of {routine}()")
        for line in filter(None, text.splitlines()):
            shifts.follow(flow, [kind._replace(ends=None) for kind in shifts.KRL], line, place)
        for called in others:
            flow.call(called, "")
        flow.end_routine()
