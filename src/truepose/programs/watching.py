"""Correct the programs that are put into a folder."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Protocol

from truepose._io import files
from truepose.cell import Cell
from truepose.errors import FileError, StoreError, TrueposeError
from truepose.programs.core.outcomes import CorrectedShare
from truepose.programs.core.program import Program, ReadOptions
from truepose.programs.correct import correct_program
from truepose.programs.corrected import CorrectedProgram, Note, names, write
from truepose.programs.corrector import Corrector
from truepose.programs.frame_table import FrameTable
from truepose.programs.languages import language_of
from truepose.programs.leftovers import find_leftovers
from truepose.programs.reading import read_program
from truepose.programs.record import SUFFIX, hashes_of

SETTLE_S: Final = 2.0
"""The default time [s] for which the files of a program must be unchanged."""
_ROUNDED: Final = 1e-6  # [s] above the rounding of times
_Signature = tuple[tuple[str, int, int], ...]


@dataclass(frozen=True)
class WatchEvent:
    """The result of one program.

    Attributes
    ----------
    path : Path
        The program.
    written : tuple of Path
        The files that were written; empty if the program is refused.
    coverage : CorrectedShare, optional
        The number of motion targets, and of those that are corrected.
    refused : str
        The reason why it is refused, or an empty string.
    """

    path: Path
    written: tuple[Path, ...] = ()
    coverage: CorrectedShare | None = None
    refused: str = ""

    def __str__(self) -> str:
        return f"{self.path}: {self.coverage}" if not self.refused else f"refused: {self.refused}"

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "file": str(self.path),
            "written": [str(path) for path in self.written],
            "coverage": None if self.coverage is None else self.coverage._asdict(),
            "refused": self.refused,
        }


class Keeper(Protocol):
    """What decides whether programs may be corrected, and keeps what was: a store.

    Each method raises a StoreError if it is lost.
    """

    def check(self) -> None:
        """Raise a RefusedError if the map must not be used any more."""

    def has(self, program: Program) -> bool:
        """Return whether the correction of a program with the map is kept."""

    def allow(self, program: Program) -> None:
        """Raise a RefusedError if a program must not be corrected."""

    def marked(self, corrected: CorrectedProgram) -> CorrectedProgram:
        """Return a corrected program whose record states what is known of its map."""

    def prepare(self, corrected: CorrectedProgram) -> Note:
        """Return what is written with the files, so that the correction is kept whatever happens."""

    def keep(self, corrected: CorrectedProgram, written: Sequence[Path]) -> None:
        """Keep the correction of a program whose files are written."""


@dataclass
class FolderWatch:
    """Programs of a folder that are corrected when they are new or have changed.

    Every program is read alone: a file, or the .src and .dat of a KRL module. Tables (.csv), names that begin with a
    dot, links, and a .dat without its .src are ignored.

    Attributes
    ----------
    in_dir, out_dir : Path
        The folder with the programs, and that of the results, which get the same folders.
    error_map : Corrector
        The error map.
    cell, frames, options
        As in `correct_program`.
    settings : dict
        The other options of `correct_program`.
    settle_s : float [s]
        The time for which all files of a program must be unchanged, so that no half-copied file is taken.
    force : bool
        Whether to overwrite results that another program wrote, or that were changed.
    keeper : Keeper, optional
        A store. While it cannot be reached, programs wait, and `poll` raises a StoreError.
    """

    in_dir: Path
    out_dir: Path
    error_map: Corrector
    cell: Cell | None = None
    frames: FrameTable | None = None
    options: ReadOptions | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    settle_s: float = SETTLE_S
    force: bool = False
    keeper: Keeper | None = None
    _seen: dict[Path, tuple[_Signature, float]] = field(default_factory=dict, init=False, repr=False)
    _done: dict[Path, str] = field(default_factory=dict, init=False, repr=False)
    _unkept: list[tuple[WatchEvent, CorrectedProgram]] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.in_dir.is_dir():
            raise FileError(self.in_dir, "is no folder; name the folder to watch")
        if self.in_dir.resolve().is_relative_to(self.out_dir.resolve()):
            raise FileError(self.out_dir, "holds the watched folder; write the results elsewhere")

    @property
    def n_programs(self) -> int:
        """The number of programs that the last look found, those without a change included."""
        return len(self._seen)

    def poll(self, now: float | None = None) -> Iterator[WatchEvent]:
        """Yield the results of the programs that are complete and new or changed; `now` [s] is a monotonic time.

        Raises
        ------
        RefusedError
            If the keeper says that the map must not be used any more.
        StoreError
            If the keeper is lost; the next look takes the programs that wait, and keeps what is written.
        """
        now = time.monotonic() if now is None else now
        yield from self._keep()
        found = self._programs()
        self._seen = {path: seen for path, seen in self._seen.items() if path in found}
        for path, members in sorted(found.items()):
            try:
                signature = _signature(members)
                before, since = self._seen.setdefault(path, (signature, now))
                if before != signature:
                    self._seen[path] = (signature, now)
                elif now - since >= self.settle_s:
                    digest = _digest(members)
                    if _signature(members) == signature and self._done.get(path) != digest:
                        if self.keeper is not None:
                            self.keeper.check()
                        yield from self._correct(path, members)
                        self._done[path] = digest
            except OSError:  # removed or replaced in the meantime; the next look decides
                self._seen.pop(path, None)

    def once(self, sleep: Callable[[float], None] = time.sleep) -> list[WatchEvent]:
        """Correct the programs that do not change during the settle time, and return their results."""
        start = time.monotonic()
        first = list(self.poll(start))
        sleep(self.settle_s)
        return [*first, *self.poll(start + self.settle_s + _ROUNDED)]

    def _programs(self) -> dict[Path, list[Path]]:
        """Return the files of each program by its main file."""
        found: dict[Path, list[Path]] = {}
        out = self.out_dir.resolve()
        for place, folders, members in os.walk(self.in_dir):
            here = Path(place)
            folders[:] = [f for f in folders if not f.startswith(".") and (here / f).resolve() != out]
            paths = [here / name for name in members if not name.startswith(".")]
            known = {path for path in paths if language_of(path) not in ("", "table") and not path.is_symlink()}
            data = {path.with_suffix("").name.lower(): path for path in known if path.suffix.lower() == ".dat"}
            for path in known - set(data.values()):
                partner = data.get(path.with_suffix("").name.lower()) if path.suffix.lower() == ".src" else None
                found[path] = [path] if partner is None else [path, partner]
        return found

    def _correct(self, path: Path, members: list[Path]) -> Iterator[WatchEvent]:
        try:
            with files.watched():
                options = replace(
                    self.options or ReadOptions(), orientation=bool(self.settings.get("orientation", False))
                )
                program = replace(read_program(path, self.frames, options), root=self.in_dir)
                if self._is_written(path, members) and (self.keeper is None or self.keeper.has(program)):
                    return
                if self.keeper is not None:
                    self.keeper.allow(program)
                corrected = correct_program(program, self.error_map, self.cell, **self.settings)
                files.overwrite(force := self._may_overwrite(corrected))
                note = None
                if self.keeper is not None:  # again, as the correction took its time
                    self.keeper.check()
                    corrected = self.keeper.marked(corrected)
                    note = self.keeper.prepare(corrected)
                written = write([corrected], self.out_dir, force=force, note=note)
        except StoreError:
            raise
        except TrueposeError as error:
            yield WatchEvent(path, refused=str(error))
        else:
            self._unkept.append((WatchEvent(path, tuple(written), corrected.coverage), corrected))
            yield from self._keep()

    def _keep(self) -> Iterator[WatchEvent]:
        """Let the keeper keep the corrections that are written, also those of earlier looks; yield their results."""
        while self._unkept:
            event, corrected = self._unkept[0]
            if self.keeper is not None:
                self.keeper.keep(corrected, event.written)
            del self._unkept[0]
            yield event

    def _is_written(self, path: Path, members: list[Path]) -> bool:
        """Return whether an earlier run wrote the results of these very files."""
        record = (self.out_dir / path.relative_to(self.in_dir)).with_suffix("")
        record = record.with_name(f"{record.name}{SUFFIX}")
        if not record.is_file():
            return False
        before = {digest for digest, _ in hashes_of(record)}
        return {hashlib.sha256(member.read_bytes()).hexdigest() for member in members} == before

    def _may_overwrite(self, corrected: CorrectedProgram) -> bool:
        """Return whether all results that exist are those of an earlier run, unchanged."""
        goals = {self.out_dir / name for name in names(corrected.program)}
        ours = set(find_leftovers(self.out_dir, []).unchanged)
        return self.force or all(goal in ours for goal in goals if goal.exists())


def _signature(members: list[Path]) -> _Signature:
    return tuple((path.name, status.st_size, status.st_mtime_ns) for path in members for status in [path.stat()])


def _digest(members: list[Path]) -> str:
    whole = hashlib.sha256()
    for path in members:
        whole.update(hashlib.sha256(path.read_bytes()).digest())
    return whole.hexdigest()
