"""Keywords of FANUC programs, which the controller prints in its own language: only English ones are read."""

from __future__ import annotations

import re
from typing import Final

from truepose.errors import FileError
from truepose.programs.core.source import Source, shown

_HEADER = re.compile(rb"^[ \t]*([^\W\d][\w.]*)[ \t]*=", re.M)
_ENGLISH: Final = frozenset(
    b"OWNER COMMENT PROG_SIZE CREATE MODIFIED FILE_NAME VERSION LINE_COUNT MEMORY_SIZE PROTECT DEFAULT_GROUP"
    b" CONTROL_CODE STACK_SIZE TASK_PRIORITY".split()
)
_TRANSLATED: Final = re.compile(
    rb"(?<![A-Za-z_])(?:KONFIG[ \t]*:|BENUTZER_NUM\b|WKZ_NUM\b|AUFRUF\b|ZEIT[ \t]+VOR\b|(?:mm|deg)/sek\b)"
)
"""Words of the German copy of a program."""


def check_header(source: Source, start: int, end: int) -> None:
    """Refuse a header (/ATTR) none of whose keywords is English."""
    keys = list(_HEADER.finditer(source.data, start, end))
    if keys and not any(m[1].upper() in _ENGLISH for m in keys):
        raise translated(source, source.line(keys[0].start(1)), keys[0][1])


def is_english(data: bytes) -> bool:
    """Return whether the keywords of a program are English, as far as its header and positions show it."""
    head, _, _ = data.partition(b"/MN")
    keys = {m[1].upper() for m in _HEADER.finditer(head)}
    return (not keys or bool(keys & _ENGLISH)) and not _TRANSLATED.search(data, data.find(b"/POS"))


def check_language(source: Source, line: int, code: bytes) -> None:
    """Refuse code with keywords of another language than English."""
    if m := _TRANSLATED.search(code):
        raise translated(source, line, m[0])


def translated(source: Source, line: int, word: bytes) -> FileError:
    """Return the error of a program whose keywords are translated."""
    reason = f"{shown(word)} is a keyword of another language; give the English copy of this program"
    return source.error(line, reason)
