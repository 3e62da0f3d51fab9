"""Long runs of RAPID lines of one form, such as ``MoveL [[1.5,2,3],[1,0,0,0],[0,0,0,0],[9E9,…]],v100,fine,tool0;``.

Declarations of robtargets and motions to them by name are further forms. The general reader reads the first line of
each (tests/programs/test_runs.py compares all).
"""

from __future__ import annotations

import re
from typing import Final, Literal

import numpy as np

from truepose.programs.core.forms import BLANKS, NUMBER, Form, Lines, Run, RunFinder, configured
from truepose.programs.core.source import Source
from truepose.programs.core.target import Target

RunKind = Literal["inline", "declared", "named"]
_PLAIN: Final = rb"(?:0|-?+[1-9][0-9]?+)"  # a number that is written in one way only
_COMMA: Final = BLANKS + b"," + BLANKS


def _list(*patterns: bytes) -> bytes:
    return rb"\[" + BLANKS + _COMMA.join(patterns) + BLANKS + rb"\]"


_GROUP: Final = b"(" + NUMBER + b")"
_ROBTARGET: Final = _list(
    _list(*[_GROUP] * 3), _list(*[_GROUP] * 4), _list(*[b"(" + _PLAIN + b")"] * 4), rb"\[[^\r\n\[\](){};:!\"%]*+\]"
)
_WORD: Final = rb"[A-Za-z_]\w*+"
_SPEED: Final = rb"(?:v([0-9]{1,5}+)|" + _WORD + rb")" + _COMMA + rb"(?:z([0-9]{1,3}+)|" + _WORD + rb")"
_TAIL: Final = rb"\b[^\r\n\[\](){};!\"%]*+;[ \t]*+\r?+\n"
_INLINE: Final = re.compile(BLANKS + rb"Move[LJ]" + BLANKS + _ROBTARGET + _COMMA + _SPEED + _TAIL, re.I)
_NUMBERED: Final = rb"[A-Za-z_](?:\w*[A-Za-z_])?([0-9]{1,9}+)"  # the number is all digits at the end
_DECLARED: Final = re.compile(
    BLANKS + rb"(?:LOCAL[ \t]++)?+CONST[ \t]++robtarget[ \t]++" + _NUMBERED + BLANKS + rb":=" + BLANKS + _ROBTARGET
    + BLANKS + rb";[ \t]*+\r?+\n",
    re.I,
)  # fmt: skip
_NAMED: Final = re.compile(BLANKS + rb"Move[LJ][ \t]++" + _NUMBERED + _COMMA + _SPEED + _TAIL, re.I)
_DIGITS: Final = rb"[0-9]{1,9}+"
_PATTERNS: Final = {**dict.fromkeys(range(8, 12), _PLAIN), 12: rb"[0-9]{1,5}+", 13: rb"[0-9]{1,3}+"}
NUMBERS: Final = slice(0, 7)
"""The holes of the numbers of a robtarget in a motion."""
OF_NAMED: Final = slice(1, 8)
"""The holes of the numbers of a declared robtarget, behind that of its name."""


class RapidRuns:
    """Finds the runs of a file: declared robtargets, motions to numbers, motions to names.

    Parameters
    ----------
    source : Source
        The file.
    named : bool
        Whether runs of declarations and of motions to names are looked for.
    """

    def __init__(self, source: Source, *, named: bool = True) -> None:
        self._inline = RunFinder(source, _INLINE, _PATTERNS)
        declared = {1: _DIGITS, **{k + 1: pattern for k, pattern in _PATTERNS.items() if k < 12}}
        self._declared = RunFinder(source, _DECLARED, declared) if named else None
        self._named = RunFinder(source, _NAMED, {1: _DIGITS, 2: _PATTERNS[12], 3: _PATTERNS[13]}) if named else None
        self._kinds: dict[Form, RunKind] = {}

    def find(self, position: int) -> Lines | None:
        """Return the run that starts at a line's start."""
        for kind, finder in (("inline", self._inline), ("declared", self._declared), ("named", self._named)):
            if finder is not None and (lines := finder.find(position)) is not None:
                self._kinds[lines.form] = kind  # type: ignore[assignment]  # one of the three words above
                return lines
        return None

    def kind(self, lines: Lines) -> RunKind:
        """Return the kind of a run."""
        return self._kinds[lines.form]


def run_of(source: Source, lines: Lines, like: Target, holes: slice = NUMBERS, prefix: str = "") -> Run:
    """Return the targets of a run, from its first; only their configurations may differ beside their numbers.

    `prefix` is the text in front of the number in their names; empty where the motion names them.
    """
    words = lines.columns(source.data, slice(holes.stop, holes.stop + 4))[0].astype(int)
    code = words @ [1_000_000, 10_000, 100, 1]  # each is within ±99
    _, first, which = np.unique(code, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    texts = [",".join(map(str, words[i])) for i in first[order].tolist()]
    several = None if len(texts) == 1 else place[which].astype(np.int16)
    return Run(source, lines, configured(like, texts), holes, several, (prefix, "") if prefix else ())
