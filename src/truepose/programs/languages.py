"""The languages of robot programs, and the files that they are read from."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from truepose._io.folders import is_blank
from truepose.programs.core.program import Program, ReadOptions
from truepose.programs.core.scales import refuse_off_scale

KRL: Final = (".src", ".dat")
_OF_PROJECTS: Final = (".installation", ".pjx", ".tp")
"""Endings of files that tell a backup from a folder of programs."""
RAPID: Final = (".mod", ".prg", ".sys", ".modx", ".sysx")


class Language(NamedTuple):
    """A language of programs.

    Attributes
    ----------
    reader : str
        The module of its reader; `read` takes a path, the frames and the options, and returns a `Program`.
    endings : tuple of str
        The endings of its files, in lower case.
    maker : str
        The maker of its controllers; empty if it belongs to no maker.
    """

    reader: str
    endings: tuple[str, ...]
    maker: str = ""


LANGUAGES: Final = {
    "krl": Language("truepose.programs.krl.reader", KRL, "KUKA"),
    "rapid": Language("truepose.programs.rapid.reader", RAPID, "ABB"),
    "tp": Language("truepose.programs.tp.reader", (".ls",), "FANUC"),
    "urscript": Language("truepose.programs.urscript.reader", (".script", ".urscript"), "Universal Robots"),
    "urp": Language("truepose.programs.urp.reader", (".urp",), "Universal Robots"),
    "inform": Language("truepose.programs.inform.reader", (".jbi",), "Yaskawa"),
    "val3": Language("truepose.programs.val3.reader", (".dtx",), "Stäubli"),
    "table": Language("truepose.programs.table", (".csv",)),
    "apt": Language("truepose.programs.apt", (".apt", ".cls")),
    "gcode": Language("truepose.programs.gcode", (".nc", ".ngc", ".gcode", ".tap", ".cnc")),
}
"""The languages by name, which is that of the language, not of the maker."""


def language_of(path: Path) -> str:
    """Return the name of the language of a file, by its ending; empty where the ending is not known."""
    return next((name for name, language in LANGUAGES.items() if path.suffix.lower() in language.endings), "")


def without_blank(files: Iterable[Path]) -> tuple[list[Path], list[str]]:
    """Return files without those of programs and projects that are empty, which are named; those of KRL may be."""
    kept, told = [], []
    for file in files:
        ending = file.suffix.lower()
        counts = ending in _OF_PROJECTS or language_of(file) not in ("", "krl")
        if counts and is_blank(file):
            told.append(f"{file}: is empty and is left out")
        else:
            kept.append(file)
    return kept, told


def all_endings() -> str:
    """Return the endings of all languages in words."""
    return ", ".join(ending for language in LANGUAGES.values() for ending in language.endings)


def again_by(reader: Callable[[], Program], options: ReadOptions, language: str) -> Program:
    """Read a program that knows how to read itself again."""
    return refuse_off_scale(replace(reader(), options=options, again=reader, language=language))
