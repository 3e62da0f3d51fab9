"""Modules of a controller that are read for their effects and never corrected.

System modules, technology packages, submits and lists of global data act on the programs that a user writes: they
change tools and bases, write points and move the robot. Those that no program calls do not matter.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from truepose.errors import FileError
from truepose.programs.core.points import Problem
from truepose.programs.core.source import Source
from truepose.programs.krl.words import KEEPS_FRAMES

NOT_WRITTEN: Final = Problem(
    "skip",
    "its numbers are in a system file of the controller, which is never written; declare it in a data list of its own",
)
HALF_CIRCLE: Final = Problem("skip", "the other point of its circle has no numbers in the programs")
_CALLED: Final = re.compile(rb"([A-Za-z_$][\w$]*+)[ \t]*+\(")
_DEFINED: Final = re.compile(
    rb"^[ \t]*+GLOBAL[ \t]++(?:DEF|DEFFCT[ \t]++\w++(?:\[[^\]]*+\])?+)[ \t]++([A-Za-z_$][\w$]*+)", re.I | re.M
)
_ANY_DEFINED: Final = re.compile(
    rb"^[ \t]*+(?:GLOBAL[ \t]++)?+(?:DEF|DEFFCT[ \t]++\w++(?:\[[^\]]*+\])?+)[ \t]++([A-Za-z_$][\w$]*+)", re.I | re.M
)
_SHARED: Final = re.compile(rb"^[ \t]*+(?:DECL[ \t]++)?+GLOBAL\b", re.I | re.M)
_KNOWN: Final = KEEPS_FRAMES | {"BAS"}
"""Routines of the system whose effects are known without reading them."""


def needed(programs: Iterable[Path], libraries: Iterable[Path]) -> list[Path]:
    """Return the libraries that act on programs: those that they call, submits, ``$config.dat``, lists of global data.

    A file that cannot be read counts as one that shares data; reading it again gives the reason.
    """
    files: dict[str, list[Path]] = {}
    texts: dict[Path, bytes] = {}
    for path in libraries:
        files.setdefault(path.stem.upper(), []).append(path)
        try:
            texts[path] = Source.read(path).data
        except FileError:
            texts[path] = b"GLOBAL"
    modules_of: dict[str, set[str]] = {}
    for stem, paths in files.items():
        for name in {stem}.union(*[defined_in(stem, texts[path]) for path in paths]):
            modules_of.setdefault(name, set()).add(stem)
    found: set[str] = {stem for stem, paths in files.items() if any(_always(path, texts[path]) for path in paths)}
    waiting = [modules_of.get(name, set()) for path in programs for name in _calls(path)] + [found]
    done: set[str] = set()
    while waiting:
        for stem in waiting.pop() - done:
            done.add(stem)
            waiting += [
                modules_of.get(name, set()) for path in files[stem] for name in _names(_CALLED, texts[path]) - _KNOWN
            ]
    return [path for stem, paths in files.items() if stem in done for path in paths]


def defined_in(module: str, text: bytes) -> set[str]:
    """Return the routines of a module that others may call."""
    return {module, *_names(_DEFINED, text)}


def all_defined_in(text: bytes) -> set[str]:
    """Return all routines that a module defines, those that only it calls included."""
    return _names(_ANY_DEFINED, text)


def _always(path: Path, text: bytes) -> bool:
    """Return whether a library acts on programs that do not call it."""
    if path.suffix.lower() == ".sub" or path.name.lower() == "$config.dat" or is_encoded(text):
        return True
    return path.suffix.lower() == ".dat" and _SHARED.search(text) is not None


def is_encoded(text: bytes) -> bool:
    """Return whether a file is no text."""
    return b"\0" in text[: 1 << 16]


def _calls(path: Path) -> set[str]:
    try:
        return _names(_CALLED, Source.read(path).data) - _KNOWN
    except FileError:
        return set()  # reading the program gives the reason


def _names(pattern: re.Pattern[bytes], text: bytes) -> set[str]:
    return {name.decode("latin-1").upper() for name in set(pattern.findall(text))}
