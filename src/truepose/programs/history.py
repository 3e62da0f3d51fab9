"""Lists of corrected programs, so that a program with corrected digits is recognised by its content.

Every correction that is written adds a line of JSON to two files: ``MAP.corrected`` beside the map, and
``corrected.jsonl`` in the user's own state folder (``TRUEPOSE_STATE``, or else the usual place of the system). A line
holds the hash of the program before and after, and a hash of each corrected position. So a copy under another name, in
another folder, for another map, or with some lines edited is recognised. Records and stores keep some of these hashes,
too, for other users and machines.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from truepose._typing import FloatArray, IntArray
from truepose.errors import FileError, RefusedError
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.joint_targets import MOST_JOINTS
from truepose.programs.core.outcomes import Outcomes
from truepose.programs.core.program import Program

HashArray = NDArray[np.uint64]
_KEPT: Final = 1024
"""Largest number of listed positions of a program: those of the smallest hashes, which are the same in every copy."""
RECORDED: Final = 64
"""Largest number of positions of a file that a record and a store keep, chosen in the same way."""
_ENOUGH: Final = 3
"""Number of corrected positions that identify a corrected program; of up to four targets, half of them."""
REMEDY: Final = "do not correct it twice: take the original"
_NAMED: Final = 3  # targets that a message names


class Entry(NamedTuple):
    """A correction of a file: its time, the name of the file or of its record, and the SHA-256 of the result."""

    date: str
    file: str
    after: str


NamesEntry = Callable[[Entry], str]


@dataclass(frozen=True, eq=False)
class KnownCorrections:
    """Corrections; the hashes of all their positions in order, and the number of the entry of each."""

    entries: tuple[Entry, ...] = ()
    positions: HashArray = field(default_factory=lambda: np.empty(0, np.uint64))
    owner: IntArray = field(default_factory=lambda: np.empty(0, np.int64))

    @classmethod
    def of(cls, found: Iterable[tuple[Entry, HashArray]]) -> KnownCorrections:
        """Return corrections with the hashes of their positions; what is there twice counts once."""
        entries: dict[tuple[str, bytes], Entry] = {}
        positions = [np.empty(0, np.uint64)]
        for entry, hashes in found:
            if entries.setdefault((entry.after, hashlib.sha256(hashes.tobytes()).digest()), entry) is entry:
                positions.append(hashes)
        owner = np.repeat(np.arange(len(entries)), [len(hashes) for hashes in positions[1:]])
        flat = np.concatenate(positions)
        order = np.argsort(flat, kind="stable")
        return cls(tuple(entries.values()), flat[order], owner[order])

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


@dataclass(frozen=True, eq=False)
class ProgramPositions:
    """The hashes of the positions and joints of a program's targets that can be corrected, by its files."""

    program: Program
    files: Mapping[Path, HashArray]

    @classmethod
    def of(cls, program: Program) -> ProgramPositions:
        """Return those of a program."""
        found: dict[Path, list[HashArray]] = {}
        for columns, numbers in _numbers(program):
            found.setdefault(columns.path, []).append(hash_rows(numbers))
        return cls(program, {path: np.unique(np.concatenate(hashes)) for path, hashes in found.items()})

    @cached_property
    def all(self) -> HashArray:
        """Those of all files together."""
        return np.unique(np.concatenate([np.empty(0, np.uint64), *self.files.values()]))

    def find(self, known: KnownCorrections) -> Match | None:
        """Return the correction that made the program or a file of it, or that some of its positions are from."""
        after = {source.sha256: source.path for source in self.program.sources}
        if numbers := [known.number[sha256] for sha256 in after if sha256 in known.number]:
            entry = known.entries[number := min(numbers)]
            return Match(number, entry, after[entry.after], 0, True)
        counts = known.shared(self.all)
        if not counts.any():
            return None
        same = counts >= _enough(len(self.all))
        for own in self.files.values() if not same.any() else ():  # a small module of a large project
            same |= known.shared(own) >= max(2, _enough(len(own)))  # one position may be the same by chance
        number = int(np.flatnonzero(same)[0]) if same.any() else int(np.argmax(counts))
        its = known.positions[known.owner == number]
        where = max(self.files, key=lambda path: np.isin(self.files[path], its).sum())
        return Match(number, known.entries[number], where, int(counts[number]), bool(same.any()))

    def names(self, known: KnownCorrections) -> str:
        """Return the names of the first targets whose positions are among those of corrections."""
        found: list[str] = []
        for columns, numbers in _numbers(self.program):
            rows = np.flatnonzero(np.isin(hash_rows(numbers), known.positions)).tolist()
            found += [f"{columns.name(i)} in line {columns.line[i]}" for i in rows]
        return ", ".join(found[:_NAMED]) + (" and others" if len(found) > _NAMED else "")


class Match(NamedTuple):
    """A correction whose result a program holds.

    Attributes
    ----------
    number : int
        The number of the correction among those that were compared.
    entry : Entry
        The correction.
    where : Path
        The file, or the program.
    shared : int
        The number of its positions; 0 if a file is the result as it was written.
    same : bool
        Whether this is enough to refuse the program.
    """

    number: int
    entry: Entry
    where: Path
    shared: int
    same: bool

    def words(self, which: str, positions: ProgramPositions, known: KnownCorrections, remedy: str = REMEDY) -> str:
        """Return why the program is refused, or what to know of it; `which` names the correction."""
        if self.same:
            what = f"holds {self.shared} positions that were corrected" if self.shared else "was corrected already"
            return f"{self.where}: {what}{which}; {remedy}"
        return (
            f"{self.where}: {self.shared} of its {len(positions.all)} positions are results of a correction{which} and "
            f"are corrected a second time: {positions.names(known)}; take them from the original"
        )


def _enough(n: int) -> int:
    """Return how many of n positions identify a corrected program."""
    return min(_ENOUGH, max(1, (n + 1) // 2))


def is_enough(count: int, n: int) -> bool:
    """Return whether a number of corrected positions among n identifies a corrected program."""
    return count >= _enough(n)


def _numbers(program: Program) -> Iterator[tuple[TargetColumns, FloatArray]]:
    """Yield the targets that can be corrected with their positions (n, 3) [mm] or joints (n, 6)."""
    for _, columns in program.correctable_columns():
        yield columns, columns.values[:, :3]
    for _, columns in program.joint_columns():
        if columns.joints is not None:
            yield columns, columns.joints


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
            "positions": to_text(written_positions(corrected.targets, source.path)),
        }
        # what a killed run left of a line ends before this one
        yield f"\n{json.dumps(entry)}\n"


def written_positions(targets: Outcomes, path: Path, most: int = _KEPT) -> HashArray:
    """Return the smallest hashes of the positions and joints that a correction changed in a file."""
    kept = np.empty(0, np.uint64)
    for first, columns in targets.program.targets.chunks(path):
        after = targets.after[first : first + len(columns), :3]
        changed = np.isfinite(after).all(axis=1) & (after != columns.values[:, :3]).any(axis=1)
        q, joints = np.empty((0, MOST_JOINTS)), targets.joints
        if joints is not None and columns.joints is not None:
            q = joints.after[first : first + len(columns)]
            q = q[(np.isfinite(q) & (q != columns.joints)).any(axis=1)]
        kept = np.unique(np.concatenate([kept, hash_rows(after[changed]), hash_rows(q)]))[:most]
    return kept


def recorded_positions(targets: Iterable[Mapping[str, Any]], *, after: bool = True) -> dict[str, HashArray]:
    """Return the hashes of the positions and joints that a correction changed, by file, from the lines of its record.

    `after`: whether those after the correction, the smallest ones; otherwise all those before it.
    """
    rows: dict[str, tuple[list[Any], list[Any]]] = {}
    for one in targets:
        at = int("joints" in one)
        names = ("joints", "joints_after") if at else ("before_mm", "after_mm")
        before, changed = (list(one.get(name) or []) for name in names)
        if before != changed and None not in before and None not in changed:
            rest = [0.0] * (MOST_JOINTS - len(changed)) if at else []
            rows.setdefault(str(one["file"]), ([], []))[at].append([*(changed if after else before), *rest])
    most = RECORDED if after else None
    return {
        file: np.unique(np.concatenate([hash_rows(np.array(p).reshape(-1, 3)), hash_rows(np.array(q).reshape(-1, 6))]))[
            :most
        ]
        for file, (p, q) in rows.items()
    }


def hash_rows(p: FloatArray) -> HashArray:
    """Return a hash of each position (n, 3) [mm] or row of joints (n, 6) [the controller's unit] to six decimals."""
    mixed = np.zeros(len(p), np.uint64)
    for column in np.rint(np.nan_to_num(p) * 1e6).astype(np.int64).astype(np.uint64).T:
        mixed = (mixed ^ column) + np.uint64(0x9E3779B97F4A7C15)  # splitmix64
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed ^= mixed >> np.uint64(31)
    return mixed


def to_text(positions: HashArray) -> str:
    """Return hashes of positions as text."""
    return base64.b64encode(positions.astype("<u8").tobytes()).decode()


def from_text(text: str) -> HashArray:
    """Return the hashes of positions that `to_text` wrote."""
    return np.frombuffer(base64.b64decode(text), "<u8").astype(np.uint64)


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


def check(program: Program, map_path: Path | None, remedy: str = REMEDY) -> None:
    """Refuse a program that holds corrected targets; `remedy` ends the message.

    Raises
    ------
    RefusedError
        If a file of it is the result of a correction, or if three of its positions are (of up to four targets, half of
        them).
    FileError
        If a list exists and cannot be read.
    """
    check_known(program, listed(map_path), remedy)


def check_known(
    program: Program, lists: Iterable[tuple[KnownCorrections, NamesEntry]], remedy: str = REMEDY
) -> list[str]:
    """Refuse a program that a listed correction made; return warnings of those that some of its targets are from.

    Each list has a function that names one of its corrections; see `check`.
    """
    own = ProgramPositions.of(program)
    told: dict[str, str] = {}
    for known, which in lists:
        if (match := own.find(known)) is None:
            continue
        words = match.words(which(match.entry), own, known, remedy)
        if match.same:
            raise RefusedError(words)
        told.setdefault(match.entry.after, words)
    return list(told.values())


def listed(map_path: Path | None) -> Iterator[tuple[KnownCorrections, NamesEntry]]:
    """Yield the lists of `stores`, each with a function that names one of its corrections."""
    for store in stores(map_path):
        yield _listed(store), partial(_in_list, store)


def _in_list(store: Path, entry: Entry) -> str:
    return f" ({entry.file}, {entry.date[:10]}, listed in {store})"


def _listed(store: Path) -> KnownCorrections:
    """Return what a list says; it is read again only if the file has changed."""
    try:
        status = store.stat() if store.is_file() else None
        return KnownCorrections() if status is None else _read(store, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise FileError(
            store, f"cannot be read: {error.strerror or error}; corrected programs are listed there"
        ) from None


@lru_cache(maxsize=4)
def _read(store: Path, _changed: int, _size: int) -> KnownCorrections:
    return KnownCorrections.of(_entries(store))


def _entries(store: Path) -> Iterator[tuple[Entry, HashArray]]:
    with store.open("rb") as file:
        for number, line in enumerate(file, 1):
            if not line.strip():
                continue
            try:
                fields = json.loads(line)
                entry = Entry(str(fields["date"]), str(fields["file"]), str(fields["sha256_after"]))
                positions = from_text(fields["positions"])
            except (ValueError, KeyError, TypeError, RecursionError):
                warnings.warn(f"{store}:{number}: is no readable record of a correction and was left out", stacklevel=2)
            else:
                yield entry, positions
