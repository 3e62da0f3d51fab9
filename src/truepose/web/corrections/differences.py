"""The differences between a program and its correction, line by line, as a code review shows them.

A correction changes digits within lines and nothing else; so both versions have the same lines, and a difference is
the list of changed lines with some lines around them. The places of all lines are kept on the disk, so that any part of
the difference of a file with a million lines is read at once.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from itertools import zip_longest
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from truepose._io.files import read_bytes
from truepose._io.zips import on_disk
from truepose._typing import IntArray
from truepose.errors import FileError
from truepose.programs.core.packed import PackedSource
from truepose.programs.core.source import NUMBER, Source
from truepose.programs.languages import language_of
from truepose.web.corrections.texts import mapped

HEADER, CONTEXT, OLD, NEW = range(4)
KINDS: Final = ("header", "context", "old", "new")
_AROUND: Final = 3
_PLACE: Final = np.dtype("<u8")
_ROW: Final = np.dtype("<u4")
_WORDS: Final = re.compile(NUMBER.decode() + r"|\s+|\w+|.")
_LONGEST: Final = 2000
_JAPANESE: Final = ("inform", "tp")


@dataclass(frozen=True)
class Pair:
    """A file of a program, and where its versions are.

    Attributes
    ----------
    name : str
        The file as the record names it.
    before, after : Path or None
        The original and the corrected file; None where no file of the cell has the hash that the record states.
    """

    name: str
    before: Path | None
    after: Path | None


def find_pairs(record: Path, files: Iterable[Mapping[str, Any]], cell: Path) -> list[Pair]:
    """Return the original and corrected files of a record, recognised by their hashes; never from outside the cell.

    The record names the originals as the command was given them. The corrected files lie beside the record, below it,
    or (of a backup) below a folder above it; those of a correction in place are the named files, with the originals
    beside them.
    """
    above = folders_above(record, cell)
    found = []
    for one in files:
        name = str(one["file"])
        before = _first(_candidates(name, [cell, *above], ".original"), str(one["sha256_before"]), cell)
        after = _first(_candidates(name, above), str(one["sha256_after"]), cell)
        found.append(Pair(name, before, after))
    return found


def folders_above(record: Path, cell: Path) -> list[Path]:
    """Return the folder of a record and those above it, up to that of the cell."""
    return [folder for folder in record.parents if folder.is_relative_to(cell)]


def _candidates(name: str, folders: Iterable[Path], ending: str = "") -> Iterator[Path]:
    """Yield where a file may be: the ends of its path, the longest first, below some folders."""
    parts = [part for part in PurePosixPath(name.replace("\\", "/")).parts if part not in ("/", "..", ".")]
    for folder in folders:
        for k in range(len(parts)):
            place = folder.joinpath(*parts[k:])
            yield place
            if ending:
                yield place.with_name(place.name + ending)


def _first(candidates: Iterable[Path], sha256: str, cell: Path) -> Path | None:
    """Return the first of some files below a folder that has a hash."""
    for path in dict.fromkeys(candidates):
        try:
            outer = on_disk(path)
            inside = outer.is_file() and outer.resolve().is_relative_to(cell.resolve())
            if inside and hashlib.sha256(read_bytes(path)).hexdigest() == sha256:
                return path
        except (OSError, FileError):
            continue
    return None


def _source(path: Path) -> Source:
    return PackedSource.read(path) if language_of(path) == "urp" else Source.read(path)


def write_differences(pairs: Iterable[Pair], folder: Path) -> list[dict[str, Any]]:
    """Write the places of the lines and the rows of each difference to a folder; return the files, for JSON."""
    found = []
    for k, pair in enumerate(pairs):
        entry: dict[str, Any] = {"file": pair.name, "rows": 0, "changed": 0, "lines": 0}
        entry |= {"before": _told(pair.before), "after": _told(pair.after), "encoding": ""}
        if pair.before is not None and pair.after is not None:
            entry |= _write_difference(pair.before, pair.after, folder, f"difference-{k}")
        found.append(entry)
    return found


def _told(path: Path | None) -> str:
    return "" if path is None else str(path)


def _write_difference(before: Path, after: Path, folder: Path, name: str) -> dict[str, Any]:
    old, new = _source(before), _source(after)
    starts = [_starts(one) for one in (old, new)]
    changed = _changed(old.data, new.data)
    for which, places in zip(("old", "new"), starts, strict=True):
        places.tofile(folder / f"{name}.{which}")
    rows = _rows(changed, len(starts[0]) - 1)
    rows.astype(_ROW).tofile(folder / f"{name}.rows")
    encoding = _encoding(old)
    return {"rows": len(rows), "changed": len(changed), "lines": len(starts[0]) - 1, "encoding": encoding}


def _starts(source: Source) -> NDArray[np.uint64]:
    """Return the first byte of each line, and the end of the file behind them."""
    starts = np.array(source.line_starts, _PLACE)
    size = len(source.data)
    return np.append(starts[: -1 if starts[-1] == size and size else None], _PLACE.type(size))


def _changed(old: bytes, new: bytes) -> IntArray:
    """Return the changed lines, from 0; lines that only one version has count as changed."""
    lines = zip_longest(old.splitlines(keepends=True), new.splitlines(keepends=True))
    return np.flatnonzero(np.fromiter((a != b for a, b in lines), np.bool_))


def _rows(changed: IntArray, lines: int) -> NDArray[np.uint32]:
    """Return the rows of a difference, (n, 2): the kind, and the line from 0.

    Changed lines stand with `_AROUND` lines before and behind them, each as the old and the new one; a header precedes
    each stretch of lines.
    """
    if not len(changed):
        return np.empty((0, 2), np.uint32)
    around = changed[:, None] + np.arange(-_AROUND, _AROUND + 1)
    shown = np.unique(np.clip(around, 0, max(lines - 1, int(changed[-1]))))
    new = np.isin(shown, changed)
    first = np.diff(shown, prepend=-2) > 1
    count = 1 + first.astype(np.int64) + new
    line = np.repeat(shown, count)
    ends = np.cumsum(count)
    kind = np.full(len(line), CONTEXT)
    kind[ends[new] - 1], kind[ends[new] - 2] = NEW, OLD
    kind[(ends - count)[first]] = HEADER
    return np.column_stack([kind, line]).astype(np.uint32)


def _encoding(source: Source) -> str:
    """Return the encoding of a file, to show it: UTF-8, or what its controller writes."""
    data = source.data
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    for encoding in ("utf-8", *(["cp932"] if language_of(source.path) in _JAPANESE else [])):
        try:
            data.decode(encoding)
        except UnicodeDecodeError:
            continue
        return encoding
    return "latin-1"


class Difference:
    """The difference of a file that `write_differences` wrote.

    Parameters
    ----------
    folder : Path
        The folder.
    number : int
        The number of the file.
    entry : mapping
        What is known of the file, as `write_differences` returned it.
    """

    def __init__(self, folder: Path, number: int, entry: Mapping[str, Any]) -> None:
        self._entry = entry
        name = f"difference-{number}"
        self._rows = mapped(folder / f"{name}.rows", _ROW).reshape(-1, 2)
        self._starts = {which: mapped(folder / f"{name}.{which}", _PLACE) for which in ("old", "new")}

    def page(self, offset: int, limit: int) -> list[dict[str, Any]]:
        """Return some rows: kind, line from 1, and the text in parts, every second one of which changed."""
        rows = np.asarray(self._rows[offset : offset + limit]).astype(np.int64).tolist()
        found = []
        with _opened(self._entry["before"]) as before, _opened(self._entry["after"]) as after:
            for kind, line in rows:
                parts: list[str] = []
                if kind != HEADER:
                    old, new = self._line("old", line, before), self._line("new", line, after)
                    parts = [new] if kind == CONTEXT else _marked(old, new)[kind == NEW]
                found.append({"kind": KINDS[kind], "line": line + 1, "parts": parts})
        return found

    def row_of(self, line: int) -> int:
        """Return the first row that shows a line, from 1, or one behind it."""
        return int(np.searchsorted(self._rows[:, 1], line - 1))

    def _line(self, which: str, line: int, file: BinaryIO) -> str:
        starts = self._starts[which]
        if line + 1 >= len(starts):
            return ""
        start = int(starts[line])
        file.seek(start)
        data = file.read(min(int(starts[line + 1]) - start, 4 * _LONGEST))
        text = data.rstrip(b"\r\n").decode(self._entry["encoding"], "replace")
        return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _opened(name: str) -> BinaryIO:
    """Open the text of a file; that of a packed one, or one in a .zip, is held in memory."""
    path = Path(name)
    outer = on_disk(path)
    if outer == path and language_of(path) != "urp":
        return path.open("rb")
    return BytesIO(_whole(path, outer.stat().st_mtime_ns))


@lru_cache(maxsize=2)
def _whole(path: Path, _changed: int) -> bytes:
    return _source(path).data


def _marked(old: str, new: str) -> tuple[list[str], list[str]]:
    """Return two versions of a line in parts that are alike and that differ in turn, word by word."""
    a, b = _WORDS.findall(old), _WORDS.findall(new)
    if len(a) != len(b):
        return ["", old], ["", new]
    found: tuple[list[str], list[str]] = ([""], [""])
    for x, y in zip(a, b, strict=True):
        differs = x != y and x.strip() + y.strip() != ""
        if differs == (len(found[0]) % 2 == 1):
            for parts in found:
                parts.append("")
        for parts, word in zip(found, (x, y), strict=True):
            parts[-1] += word
    return found
