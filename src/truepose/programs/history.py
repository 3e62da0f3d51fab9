"""Lists of corrected programs, so that a program with corrected digits is recognised by its content.

Every correction that is written adds a line of JSON to two files: ``MAP.corrected`` beside the map, and
``corrected.jsonl`` in the user's own state folder (``TRUEPOSE_STATE``, or else the usual place of the system). A line
holds the hash of the program before and after, and a hash of each corrected position. So a copy under another name, in
another folder, for another map, or with some lines edited is recognised.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from truepose._typing import FloatArray, IntArray
from truepose.errors import FileError, RefusedError
from truepose.programs.core.outcomes import Outcomes
from truepose.programs.core.program import Program

HashArray = NDArray[np.uint64]
_KEPT: Final = 1024
"""Largest number of listed positions of a program: those of the smallest hashes, which are the same in every copy."""
_ENOUGH: Final = 3
"""Number of corrected positions that identify a corrected program; of up to four targets, half of them."""
_REMEDY: Final = "do not correct it twice: take the original"


@dataclass(frozen=True, eq=False)
class _Entry:
    date: str
    file: str
    after: str


@dataclass(frozen=True, eq=False)
class _List:
    """The entries of a list; the hashes of all their positions in order, and the number of the entry of each."""

    entries: tuple[_Entry, ...] = ()
    positions: HashArray = field(default_factory=lambda: np.empty(0, np.uint64))
    owner: IntArray = field(default_factory=lambda: np.empty(0, np.int64))

    @cached_property
    def number(self) -> Mapping[str, int]:
        """The number of the first entry of each corrected file, by its hash."""
        return {entry.after: i for i, entry in reversed(list(enumerate(self.entries)))}

    def shared(self, positions: HashArray) -> IntArray:
        """Return how many of the positions (n,) each entry has: (number of entries,)."""
        first, end = (np.searchsorted(self.positions, positions, side) for side in ("left", "right"))
        counts = end - first
        at = np.arange(counts.sum()) + np.repeat(end - np.cumsum(counts), counts)
        return np.bincount(self.owner[at], minlength=len(self.entries))


class Remembered(Protocol):
    """The parts of a corrected program that are remembered; see `truepose.programs.CorrectedProgram`."""

    @property
    def targets(self) -> Outcomes:
        """The outcomes of all targets."""

    @property
    def hashes(self) -> Mapping[Path, str]:
        """The SHA-256 of each corrected file."""

    @property
    def map_path(self) -> Path | None:
        """The file of the map; None if it was not read from one."""


def stores(map_path: Path | None) -> list[Path]:
    """Return the list in the user's state folder, and the list beside the map if it was read from a file."""
    beside = [] if map_path is None else [map_path.with_name(f"{map_path.name}.corrected")]
    return [*_own(), *beside]


def _own() -> list[Path]:
    if stated := os.environ.get("TRUEPOSE_STATE"):
        return [Path(stated) / "corrected.jsonl"]
    variable, usual = (
        ("LOCALAPPDATA", "AppData/Local") if sys.platform == "win32" else ("XDG_STATE_HOME", ".local/state")
    )
    try:
        folder = Path(os.environ.get(variable) or Path.home() / usual)
    except RuntimeError:  # a user without a home
        return []
    return [folder / "truepose" / "corrected.jsonl"]


def remember(corrected: Sequence[Remembered]) -> None:
    """Add programs to the lists. This comes before they are written, so that none is ever written without it.

    Raises
    ------
    FileError
        If no list can be written.
    """
    for one in corrected:
        if not (lines := "".join(_lines(one))):
            continue
        failed: list[FileError] = []
        paths = stores(one.map_path)
        for path in paths:
            try:
                append(path, lines)
            except OSError as error:
                what = f"cannot be written ({error.strerror or error}), and corrected programs are remembered there"
                failed.append(FileError(path, f"{what}; set TRUEPOSE_STATE to a folder that can be written"))
        if len(failed) == len(paths):
            raise (failed[0] if failed else FileError("~", "is not known; set TRUEPOSE_STATE to a folder"))
        for problem in failed:
            warnings.warn(str(problem), UserWarning, stacklevel=2)


def _lines(corrected: Remembered) -> Iterator[str]:
    """Yield one line per file that changes."""
    date = datetime.now(UTC).isoformat(timespec="seconds")
    for source in corrected.targets.program.sources:
        if (after := corrected.hashes[source.path]) == source.sha256:
            continue
        entry = {
            "date": date,
            "file": source.path.name,
            "sha256_before": source.sha256,
            "sha256_after": after,
            "positions": base64.b64encode(_written(corrected, source.path).astype("<u8").tobytes()).decode(),
        }
        # what a killed run left of a line ends before this one
        yield f"\n{json.dumps(entry)}\n"


def _written(corrected: Remembered, path: Path) -> HashArray:
    """Return the smallest hashes of the positions that changed in a file."""
    kept = np.empty(0, np.uint64)
    for first, columns in corrected.targets.program.targets.chunks(path):
        after = corrected.targets.after[first : first + len(columns), :3]
        changed = np.isfinite(after).all(axis=1) & (after != columns.values[:, :3]).any(axis=1)
        q, joints = np.empty((0, 6)), corrected.targets.joints
        if joints is not None and columns.joints is not None:
            q = joints.after[first : first + len(columns)]
            q = q[(np.isfinite(q) & (q != columns.joints)).any(axis=1)]
        kept = np.unique(np.concatenate([kept, _hashes(after[changed]), _hashes(q)]))[:_KEPT]
    return kept


def _hashes(p: FloatArray) -> HashArray:
    """Return a hash of each position (n, 3) [mm] or row of joints (n, 6) [the controller's unit] to six decimals."""
    mixed = np.zeros(len(p), np.uint64)
    for column in np.rint(np.nan_to_num(p) * 1e6).astype(np.int64).astype(np.uint64).T:
        mixed = (mixed ^ column) + np.uint64(0x9E3779B97F4A7C15)  # splitmix64
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed ^= mixed >> np.uint64(31)
    return mixed


def append(path: Path, lines: str) -> None:
    """Add lines to a list and flush them to the disk."""
    if path.exists() and not path.is_file():
        raise OSError("it is no plain file")
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    try:
        data = memoryview(lines.encode())
        while data:
            data = data[os.write(descriptor, data) :]
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def check(program: Program, map_path: Path | None, remedy: str = _REMEDY) -> None:
    """Refuse a program that holds corrected targets; `remedy` ends the message.

    Raises
    ------
    RefusedError
        If a file of it is the result of a correction, or if three of its positions are (of up to four targets, half of
        them).
    FileError
        If a list exists and cannot be read.
    """
    after = {source.sha256: source.path for source in program.sources}
    found = [_hashes(columns.values[:, :3]) for _, columns in program.correctable_columns()]
    found += [_hashes(columns.joints) for _, columns in program.joint_columns() if columns.joints is not None]
    own = np.unique(np.concatenate([np.empty(0, np.uint64), *found]))
    enough = min(_ENOUGH, max(1, (len(own) + 1) // 2))
    for store in stores(map_path):
        listed = _listed(store)
        shared = listed.shared(own)
        known = [listed.number[sha256] for sha256 in after if sha256 in listed.number]
        if not (numbers := [*np.flatnonzero(shared >= enough).tolist(), *known]):
            continue
        entry = listed.entries[number := min(numbers)]
        where = after.get(entry.after, program.path)
        same = f"holds {shared[number]} positions that were corrected"
        what = "was corrected already" if entry.after in after else same
        raise RefusedError(f"{where}: {what} ({entry.file}, {entry.date[:10]}, listed in {store}); {remedy}")


def _listed(store: Path) -> _List:
    """Return what a list says; it is read again only if the file has changed."""
    try:
        status = store.stat() if store.is_file() else None
        return _List() if status is None else _read(store, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise FileError(
            store, f"cannot be read: {error.strerror or error}; corrected programs are listed there"
        ) from None


@lru_cache(maxsize=4)
def _read(store: Path, _changed: int, _size: int) -> _List:
    entries: dict[tuple[str, bytes], _Entry] = {}  # what was corrected again in the same way is listed again
    positions = [np.empty(0, np.uint64)]
    with store.open("rb") as file:
        for number, line in enumerate(file, 1):
            if not line.strip():
                continue
            try:
                entry, places = _entry(json.loads(line))
            except (ValueError, KeyError, TypeError, RecursionError):
                warnings.warn(f"{store}:{number}: is no readable record of a correction and was left out", stacklevel=2)
            else:
                if entries.setdefault((entry.after, hashlib.sha256(places.tobytes()).digest()), entry) is entry:
                    positions.append(places)
    owner = np.repeat(np.arange(len(entries)), [len(places) for places in positions[1:]])
    flat = np.concatenate(positions)
    order = np.argsort(flat, kind="stable")
    return _List(tuple(entries.values()), flat[order], owner[order])


def _entry(fields: dict[str, Any]) -> tuple[_Entry, HashArray]:
    positions = np.frombuffer(base64.b64decode(fields["positions"]), "<u8").astype(np.uint64)
    return _Entry(str(fields["date"]), str(fields["file"]), str(fields["sha256_after"])), positions
