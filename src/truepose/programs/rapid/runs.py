"""Long runs of RAPID lines of one form, such as ``MoveL [[1.5,2,3],[1,0,0,0],[0,0,0,0],[9E9,…]],v100,fine,tool0;``.

The general reader reads the first line of each (tests/programs/test_runs.py compares all).
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from truepose.programs.core.forms import BLANKS, NUMBER, Lines, Run, RunFinder, configured
from truepose.programs.core.source import Source
from truepose.programs.core.target import Target

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
_INLINE: Final = re.compile(
    BLANKS + rb"Move[LJ]" + BLANKS + _ROBTARGET + _COMMA + _SPEED + rb"\b[^\r\n\[\](){};!\"%]*+;[ \t]*+\r?+\n", re.I
)
_PATTERNS: Final = {**dict.fromkeys(range(8, 12), _PLAIN), 12: rb"[0-9]{1,5}+", 13: rb"[0-9]{1,3}+"}
NUMBERS: Final = slice(0, 7)
_CONFIGURATION: Final = slice(7, 11)


def inline_runs(source: Source) -> RunFinder:
    """Return the finder of motions to robtargets that stand in the motions themselves."""
    return RunFinder(source, _INLINE, _PATTERNS)


def run_of(source: Source, lines: Lines, like: Target) -> Run:
    """Return the targets of a run, from its first; only their configurations may differ beside their numbers."""
    words = lines.columns(source.data, _CONFIGURATION)[0].astype(int)
    code = words @ [1_000_000, 10_000, 100, 1]  # each is within ±99
    _, first, which = np.unique(code, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    texts = [",".join(map(str, words[i])) for i in first[order].tolist()]
    several = None if len(texts) == 1 else place[which].astype(np.int16)
    return Run(source, lines, configured(like, texts), NUMBERS, several)
