"""Long runs of motions of one form, such as ``LIN {X 1.5,Y -2.25,Z 300,A 0,B 90,C 180} C_DIS``, line after line.

Programs of offline systems are almost nothing else. A run is recognised by one expression and its numbers are found in
arrays. `krl.lexer` and `krl.motions` read the same lines to the same targets (tests/programs/test_krl_runs.py).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose._typing import IntArray
from truepose.programs.core.columns import CHUNK, TargetColumns
from truepose.programs.core.digits import values_at
from truepose.programs.core.source import Source
from truepose.programs.core.target import Target

FEWEST: Final = 16
"""Lines of a run; fewer are read one by one."""
# small enough for any limit on values and lengths, and no number that adheres to a letter
_NUMBER = rb"(?:[ \t]++|(?=[-+]))[-+]?+[0-9]{1,6}+(?:\.[0-9]{0,15}+)?+(?:[eE]-[0-9]{1,2}+)?+"
_POSE = rb",[ \t]*+".join(key + _NUMBER for key in (b"X", b"Y", b"Z", b"A", b"B", b"C"))
# Status without bit 4 (an absolutely accurate robot), Turn
_BRANCH = rb",[ \t]*+S[ \t]++(?:1[0-5]|[0-9]),[ \t]*+T[ \t]++[0-9]{1,3}+"
_END = rb"\}(?:[ \t]++C_(?:PTP|DIS|VEL|ORI|SPL)\b)*+[ \t]*+(?:;[^\r\n]*+)?+\r?+\n"
_RUNS: Final = tuple(
    re.compile(
        rb"[ \t]*+(S?(?:PTP|LIN)|SPL)[ \t]*+\{" + pose + _END
        + rb"(?:[ \t]*+\1[ \t]*+\{" + pose + _END + rb"){0,%d}+" % (CHUNK - 1),
        re.I,
    )
    for pose in (_POSE, _POSE + _BRANCH)
)  # fmt: skip
_OF_NUMBERS: Final = np.zeros(256, bool)
_OF_NUMBERS[list(b"0123456789+-.eE")] = True


@dataclass(frozen=True, eq=False)
class Run:
    """Lines of one motion word, each with a complete pose; all with Status and Turn, or all without.

    Attributes
    ----------
    source : Source
        The file.
    start, end : int
        The first byte, and the byte behind the last; whole lines.
    line : int
        The first line.
    count : int
        The number of lines.
    like : Target
        The first target, judged.
    """

    source: Source
    start: int
    end: int
    line: int
    count: int
    like: Target

    def __len__(self) -> int:
        return self.count

    @property
    def likes(self) -> tuple[Target]:
        """The first target, which is the only kind."""
        return (self.like,)

    def columns(self, alike: Sequence[Target], kinds: Sequence[int]) -> TargetColumns:
        """Return the targets, read from the file's bytes."""
        spans = number_spans(self.source.data, self.start, self.end)
        values = values_at(self.source.data, spans.reshape(-1, 2)).reshape(spans.shape[:2])
        nothing = np.full(self.count, -1)
        whole = values[:, 6:].astype(np.int64)
        status, turn = (whole[:, 0], whole[:, 1]) if whole.size else (nothing, nothing)
        line = np.arange(self.line, self.line + self.count)
        kind = np.full(self.count, kinds[0])
        return TargetColumns(alike, kind, line, status, turn, values[:, :6], spans[:, :6], [None] * self.count)


def find_run(data: bytes, position: int) -> tuple[int, int]:
    """Return the end of a run that starts at a line's start, and its number of lines; 0 lines where there is none."""
    for pattern in _RUNS:
        if m := pattern.match(data, position):
            return m.end(), data.count(b"\n", position, m.end())
    return position, 0


def number_spans(data: bytes, start: int, end: int) -> IntArray:
    """Return the spans of the numbers between each line's first pair of braces, (lines, numbers, 2)."""
    text = np.frombuffer(data, np.uint8, end - start, start)
    starts = np.flatnonzero(text == ord("\n"))
    starts = np.concatenate([[0], starts[:-1] + 1])
    opening, closing = np.flatnonzero(text == ord("{")), np.flatnonzero(text == ord("}"))
    depth = np.zeros(len(text) + 1, np.int8)
    depth[opening[np.searchsorted(opening, starts)]] = 1
    depth[closing[np.searchsorted(closing, starts)]] = -1
    inside = np.zeros(len(text) + 2, np.int8)
    inside[1:-1] = _OF_NUMBERS[text] & (np.cumsum(depth[:-1], dtype=np.int8) > 0)
    step = np.diff(inside)
    spans = np.column_stack([np.flatnonzero(step == 1), np.flatnonzero(step == -1)]) + start
    return spans.reshape(len(starts), -1, 2)
