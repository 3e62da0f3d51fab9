"""Programs as bytes: positions and lines, patches in place, and the proof that nothing else changed.

A dialect gives its lexer: a compiled pattern over bytes, without groups, that matches at every byte of any file and
never across a line end. So the tokens joined are the file again, and two versions compare token by token.
"""

from __future__ import annotations

import bisect
import hashlib
import math
import operator
import re
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from itertools import accumulate, chain
from pathlib import Path
from typing import Final, Self

import numpy as np

from truepose._io import files
from truepose.errors import FileError, RefusedError


class NotAProgramError(FileError):
    """An error of a file that has the ending of programs and holds none: a log, an include, data without a value."""


Span = tuple[int, int]
NUMBER: Final = rb"[+-]?+(?:[0-9]++\.?+[0-9]*+|\.[0-9]++)(?:[eE][+-]?+[0-9]++)?+(?![\w.])"
"""Pattern of a number without adhering characters: `1.2.3` does not match."""
UNICODE_BLANK: Final = (
    rb"(?:\xc2[\x85\xa0]|\xe1\x9a\x80|\xe2\x80[\x80-\x8b\xa8\xa9\xaf]|\xe2\x81[\x9f\xa0]"
    rb"|\xe3\x80\x80|\xef\xbb\xbf|(?<![\x80-\xff])(?:\xa0|\xa1\xa1))"
)
"""Pattern of one blank of Unicode (UTF-8), of Latin 1 or of GBK."""
BLANK: Final = rb"(?:[ \t\r\n\f\v\x00\x1a]|" + UNICODE_BLANK + rb")"
"""Pattern of one blank or line end, those of Unicode (UTF-8), of Latin 1 and of GBK included."""
LARGEST: Final = 1e6
"""Largest coordinate [mm] or angle [deg]; more is a mistake."""

LONGEST_LINE: Final = 2**16
"""Largest number of bytes of a line; no controller accepts more."""

LONGEST: Final = 40
"""Largest number of characters of a number; 17 digits determine a double."""

_NUMBER = re.compile(NUMBER)
PLAIN_LEXER: Final = re.compile(rb"\r\n|[\r\n]|[ \t]++|" + NUMBER + rb"|[A-Za-z_$][\w$]*+|\w++|[^\r\n]")
"""Words, numbers, blanks and single characters: enough for the proof in most languages."""
_LINE_BREAK: Final = re.compile(rb"\s*[\r\n]\s*")
_LINE_END = re.compile(rb"\r\n|\n|\r")
_ARITHMETIC = re.compile(rb"[+-]?\s*[\d.]+(?:[eE][+-]?\d+)?(?:\s*[-+*/]\s*[\d.]+(?:[eE][+-]?\d+)?)*")
_DIGITS = re.compile(rb"[-+\d.eE\s]+")
_BROKEN = re.compile(
    rb"\d\.\d*\.|(?<![\w.$'])\d[\d.]*(?:(?![eE][+-]?\d)[A-Za-z_$]|\s+(?!(?:B_)?(?:AND|OR|EXOR)\b)\w)", re.I
)
_CONTEXT: Final = 3
_SHOWN: Final = 40
_BLOCK: Final = 1 << 20
_REPLACED: ContextVar[Mapping[Path, bytes] | None] = ContextVar("replaced", default=None)


@contextmanager
def replaced(contents: Mapping[Path, bytes]) -> Iterator[None]:
    """Let `Source.read` find other bytes than those on the disk, by path, while the context is open."""
    token = _REPLACED.set(contents)
    try:
        yield
    finally:
        _REPLACED.reset(token)


def replacement(path: Path) -> bytes | None:
    """Return the text that `replaced` gives for a file; None where it gives none."""
    return (_REPLACED.get() or {}).get(path)


@dataclass(frozen=True, eq=False)
class Source:
    r"""One file of a program, as it is on the disk.

    Parameters
    ----------
    path : Path
        The path as the user gave it.
    data : bytes
        The bytes of the file.

    Examples
    --------
    >>> Source(Path("a.src"), b"DEF a()\r\nLIN P1\rEND").line(16)
    3
    """

    path: Path
    data: bytes

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a file; see `truepose._io.files.read_bytes` for the errors, and `replaced`."""
        contents = _REPLACED.get() or {}
        source = cls(Path(path), contents[Path(path)] if Path(path) in contents else files.read_bytes(path))
        starts = np.frombuffer(source.line_starts, np.uint32 if source.line_starts.typecode == "I" else np.uint64)
        length = np.diff(starts, append=starts.dtype.type(len(source.data)))
        if length.max() > LONGEST_LINE:
            line = int(length.argmax()) + 1
            raise source.error(line, f"has {length[line - 1]} characters, at most {LONGEST_LINE} are read; break it")
        return source

    @cached_property
    def sha256(self) -> str:
        """Hash of the file's bytes."""
        return hashlib.sha256(self.data).hexdigest()

    def stored(self, text: Iterable[bytes]) -> Iterator[bytes]:
        """Yield the bytes of the file that holds a text: the text itself, where the file is not packed."""
        yield from text

    @cached_property
    def line_starts(self) -> array[int]:
        """The first byte of each line; lines end at LF, CR LF or CR."""
        starts = array("I" if len(self.data) < 2**32 else "Q", [0])
        text = np.frombuffer(self.data, np.uint8)
        for start in range(0, len(text), _BLOCK):  # one byte more than the block, which shows whether LF follows CR
            block = text[start : start + _BLOCK + 1]
            ends = block[:_BLOCK] == ord("\n")
            returns = block[:_BLOCK] == ord("\r")
            if returns.any():
                returns[: len(block) - 1] &= block[1:] != ord("\n")
                ends |= returns
            starts.frombytes((np.flatnonzero(ends) + (start + 1)).astype(f"u{starts.itemsize}").tobytes())
        return starts

    def line(self, offset: int) -> int:
        """Return the line of a byte, counted from 1; lines end at LF, CR LF or CR."""
        return bisect.bisect_right(self.line_starts, offset)

    def lines(self, start: int = 0, end: int | None = None) -> Iterator[tuple[int, int, int]]:
        """Yield each line's number, start and end, without its line end; `start` and `end` are starts of lines."""
        end = len(self.data) if end is None else end
        number = self.line(start)
        for m in _LINE_END.finditer(self.data, start, end):
            yield number, start, m.start()
            start, number = m.end(), number + 1
        if start < end:
            yield number, start, end

    def error(self, line: int, message: str) -> FileError:
        """Return an error that names the file and a line, itself on one line whatever the message quotes."""
        return FileError(self.path, printable(message), line=line)


def printable(text: str) -> str:
    """Return a text with a ``?`` for every character that is not printed."""
    return text if text.isprintable() else "".join(c if c.isprintable() else "?" for c in text)


def shown(code: bytes, start: int = 0, end: int | None = None) -> str:
    """Return code for a message: without blanks at its ends, at most 40 characters, on one line."""
    text = _LINE_BREAK.sub(b" ", code[start:end].strip()).decode("latin-1")
    return printable(text[:_SHOWN]) + ("…" if len(text) > _SHOWN else "")


def strip(data: bytes, start: int, end: int, blank: bytes = b" \t\r\n") -> Span:
    """Return a span without the blanks at its ends."""
    while start < end and data[start] in blank:
        start += 1
    while end > start and data[end - 1] in blank:
        end -= 1
    return start, end


def parse_number(token: bytes) -> float:
    """Return the value of a number token.

    Raises
    ------
    ValueError
        With a message, if it is broken, longer than any real number, or not finite and below `LARGEST`.
    """
    if len(token) <= LONGEST and _NUMBER.fullmatch(token) and -LARGEST <= (value := float(token)) <= LARGEST:
        return value
    shown = token[:20].decode("latin-1") + ("…" if len(token) > 20 else "")
    if len(token) > LONGEST:
        raise ValueError(f"number {shown} has {len(token)} characters, at most {LONGEST} were expected")
    if not _NUMBER.fullmatch(token):
        raise ValueError(f"{shown} is not a number")
    raise ValueError(f"number {shown} is beyond {LARGEST:g}: no position or angle")


def is_broken(text: bytes) -> bool:
    """Return whether a text in place of a number is neither a number nor an expression, such as ``1.2.3`` or ``12mm``.

    Examples
    --------
    >>> is_broken(b"1.2.3"), is_broken(b"x+1.5"), is_broken(b"2*10")
    (True, False, False)
    """
    text = text.strip()
    return bool(not text or _BROKEN.search(text) or (_DIGITS.fullmatch(text) and not _ARITHMETIC.fullmatch(text)))


def format_number(token: bytes, delta: float, resolution: float = 1e-3) -> bytes:
    """Return a number token moved by `delta`, in the style of the original.

    Decimals are kept, and gained if the correction needs them at the resolution. A token keeps an explicit plus and a
    missing leading zero. Leading blanks, if the token includes its column, take up the change of width. An exponent
    becomes plain decimals. If the change is none at the resolution, the token itself is returned.

    Parameters
    ----------
    token : bytes
        The number, with blanks in front where a column is to be kept.
    delta : float
        The change in the token's unit.
    resolution : float
        The step of corrections, unless the token is finer.

    Examples
    --------
    >>> format_number(b"300", 0.25), format_number(b"-0.0", 0.0), format_number(b"-40.250000", 0.1234567)
    (b'300.25', b'-0.0', b'-40.126543')
    """
    return token if round(delta / resolution) == 0 else moved_token(token, delta, resolution)


def moved_token(token: bytes, delta: float, resolution: float) -> bytes:
    """Return a number token moved by `delta`, which is known to be a change; see `format_number`."""
    number = token.lstrip()
    digits, _, exponent = number.lower().partition(b"e")
    kept = 0 if exponent else len(digits.partition(b".")[2])
    step = min(Decimal(1).scaleb(-kept), Decimal(repr(resolution)))
    value, moved = Decimal(number.decode()) / step, Decimal(repr(delta)) / step
    if value == value.to_integral_value():  # steps are counted as `digits.moved` counts them
        moved = Decimal(round(delta / float(step)))
    value = (value + moved).to_integral_value() * step
    if value == 0:
        value = abs(value)
    text = f"{value:f}"
    whole, _, fraction = text.partition(".")
    fraction = fraction.rstrip("0").ljust(kept, "0")
    if fraction and re.match(rb"[+-]?\.", digits) and whole in ("0", "-0"):
        whole = whole[:-1]
    sign = "+" if number.startswith(b"+") and value >= 0 else ""
    written = f"{sign}{whole}.{fraction}" if fraction else f"{sign}{whole}"
    if len(number) == len(token):
        return written.encode()
    return b" " + written.encode().rjust(len(token) - 1)


def decimals_of(resolution: float) -> int | None:
    """Return the decimals of a resolution that is a power of ten; None of any other.

    Examples
    --------
    >>> decimals_of(0.001), decimals_of(0.05)
    (3, None)
    """
    decimals = round(-math.log10(resolution))
    return decimals if 0 <= decimals < 10 and math.isclose(resolution, float(f"1e-{decimals}"), rel_tol=1e-9) else None


def apply_patches(
    data: bytes, spans: Sequence[Span], texts: Sequence[bytes], start: int = 0, end: int | None = None
) -> bytes:
    """Return the bytes from `start` to `end` with the bytes of each span replaced by a text.

    Raises
    ------
    ValueError
        If spans overlap, are outside, or are not in order.
    """
    end = len(data) if end is None else end
    borders = [start, *chain.from_iterable(spans), end]
    if any(map(operator.gt, borders, borders[1:])):
        raise ValueError("spans of patches overlap or lie outside")
    parts = [b""] * (2 * len(spans) + 1)
    parts[::2] = [data[a:b] for a, b in zip(borders[::2], borders[1::2], strict=True)]
    parts[1::2] = texts
    return b"".join(parts)


def prove(
    original: Source, start: int, end: int, patched: bytes, spans: Sequence[Span], lexer: re.Pattern[bytes]
) -> None:
    """Read a patched piece of a file again and require that every token outside the patches is unchanged.

    Parameters
    ----------
    original : Source
        The original file.
    start, end : int
        The piece of the original; it ends at a line end or with the file.
    patched : bytes
        The new bytes of the piece.
    spans : sequence of (start, end)
        The spans of the patches in the original, in order.
    lexer : pattern
        The lexer of the language; see the module.

    Raises
    ------
    RefusedError
        If a token changed that is not a corrected number, or if tokens were joined or split.
    """
    if not spans and memoryview(original.data)[start:end] == patched:
        return
    before, after = lexer.findall(original.data, start, end), lexer.findall(patched)
    if before == after:
        return
    changed = [i for i, (a, b) in enumerate(zip(before, after, strict=False)) if a != b]
    starts = list(accumulate(map(len, before), initial=start))
    if len(before) != len(after):
        raise _unproven(original, starts[changed[0]] if changed else start, "the number of words changed")
    k = 0
    for i in changed:
        while k < len(spans) and spans[k][1] <= starts[i]:
            k += 1
        inside = k < len(spans) and spans[k][0] <= starts[i] and starts[i + 1] <= spans[k][1]
        if not inside or not (_both(_NUMBER, before[i], after[i]) or not (before[i] + after[i]).strip(b" \t")):
            raise _unproven(original, starts[i], f"{before[i]!r} became {after[i]!r}")


def _both(pattern: re.Pattern[bytes], a: bytes, b: bytes) -> bool:
    return pattern.fullmatch(a) is not None and pattern.fullmatch(b) is not None


def _unproven(source: Source, offset: int, what: str) -> RefusedError:
    return RefusedError(
        f"{source.path}:{source.line(offset)}: the proof failed that only corrected numbers change ({what}); "
        "nothing was written; please report this program"
    )


def unified_diff(path: Path, original: bytes, patched: bytes) -> str:
    """Return a unified diff of two versions that have the same lines one by one, decoded as latin-1; empty if equal."""
    old, new = original.splitlines(keepends=True), patched.splitlines(keepends=True)
    changed = [i for i, (a, b) in enumerate(zip(old, new, strict=True)) if a != b]
    if not changed:
        return ""
    hunks: list[list[int]] = []
    for i in changed:
        first, last = max(0, i - _CONTEXT), min(len(old), i + _CONTEXT + 1)
        if hunks and first <= hunks[-1][1]:
            hunks[-1][1] = last
        else:
            hunks.append([first, last])
    lines = [f"--- {path}\n", f"+++ {path} (corrected)\n"]
    for first, last in hunks:
        lines.append(f"@@ -{first + 1},{last - first} +{first + 1},{last - first} @@\n")
        i = first
        while i < last:
            run = i
            while run < last and old[run] != new[run]:
                run += 1
            lines += [_diff_line("-", line) for line in old[i:run]] + [_diff_line("+", line) for line in new[i:run]]
            if run < last:
                lines.append(_diff_line(" ", old[run]))
            i = run + 1
    return "".join(lines)


def _diff_line(mark: str, line: bytes) -> str:
    text = line.decode("latin-1")
    return mark + (
        text.rstrip("\r\n") + "\n" if text.endswith(("\r", "\n")) else text + "\n\\ No newline at end of file\n"
    )
