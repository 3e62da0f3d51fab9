"""The option ``--store`` of commands that make files: what they make is recorded in a store, too.

The log-in and the right are checked before any work, and again before files are written, so a command that may not
record or has lost the store writes nothing. The files are written first. If the store is lost after that, they stay,
and the command fails with a message that names how to record them later. Corrected programs are written with a note, by
which the next run records them (`truepose.store.unrecorded`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose._extras import needed
from truepose.cli.store import opened
from truepose.cli.store_login import identify
from truepose.errors import DataError, FileError, RefusedError, StoreError, TrueposeError

if TYPE_CHECKING:
    from truepose.cell import Cell
    from truepose.error_map import ErrorMap
    from truepose.programs import CorrectedProgram, ProgramVerification
    from truepose.programs.core.program import Program
    from truepose.report.evidence import StoreEntry
    from truepose.samples import Samples
    from truepose.store.access import Identity
    from truepose.store.change import Change
    from truepose.store.corrected import EarlierPrograms
    from truepose.store.roles import Action
    from truepose.store.store import Store
    from truepose.store.unrecorded import RowsNote

RecordIn = Annotated[
    str | None,
    typer.Option(
        "--store",
        envvar="TRUEPOSE_STORE",
        help="Record the result in this store, too: a folder, sqlite:///FILE or postgresql://…; see 'truepose store'.",
    ),
]
ReleasedOnly = Annotated[bool, typer.Option("--released-only", help="With --store: refuse a map that is not released.")]


@dataclass(frozen=True)
class Recorder:
    """A store that a command records in, as somebody with the right to.

    Attributes
    ----------
    store : Store
        The store.
    by : Identity
        Who runs the command.
    address : str
        The address as it was given.
    action : str
        What the command does.
    """

    store: Store
    by: Identity
    address: str
    action: Action

    def check(self) -> None:
        """Check the store and the right to record again, before files are written.

        Raises
        ------
        RefusedError
            If the user may not record any more.
        StoreError
            If the store was lost.
        """
        from truepose.store.access import check

        with self.store.reading() as connection:
            check(connection, self.by, self.action)

    def record(self, files: Sequence[Path], write: Callable[[Change], Any], *, remedy: str | None = None) -> None:
        """Write rows about files that have been written.

        Parameters
        ----------
        files : sequence of Path
            The files.
        write : callable
            Writes the rows.
        remedy : str, optional
            How the files are recorded later; by default the command that takes them in.

        Raises
        ------
        StoreError
            If the store refuses or is lost; the files stay, and the message names the remedy.
        """
        from truepose.store.access import changing

        try:
            with changing(self.store, self.by, self.action) as change:
                write(change)
        except TrueposeError as error:
            if not files:
                raise
            more = f" and {len(files) - 1} more" if len(files) > 1 else ""
            place = files[0] if len(files) == 1 else _common(files)
            later = remedy or f"take it in with 'truepose store import {place} --store {self._shown}'"
            written = f"{files[0]}{more} {'are' if more else 'is'} written, but the store has no row of it"
            raise StoreError(f"{error}; {written}: {later}") from error

    @property
    def _shown(self) -> str:
        """The address for messages: as it was given, but without a password."""
        with needed("a store", "store"):
            import sqlalchemy as sa

        url = "://" in self.address
        return sa.make_url(self.address).render_as_string(hide_password=True) if url else self.address

    def map_row(self, named: Path, sha256: str | None = None) -> dict[str, Any]:
        """Return the row of a map by its hash, or by a name or part of a hash."""
        from truepose.store.access import viewing
        from truepose.store.releases import find_map

        with viewing(self.store, self.by) as connection:
            try:
                return find_map(connection, sha256 or str(named))
            except DataError:
                if sha256 is None:
                    raise
                remedy = f"add it with 'truepose store import {named} --store {self._shown}'"
                raise RefusedError(f"{named}: this map is not in the store; {remedy}") from None

    def check_map(self, row: Mapping[str, Any], *, released_only: bool = False) -> dict[str, Any]:
        """Check the store, the right, and the state of a map again, before what it corrected is written; return it."""
        from truepose.store.access import viewing
        from truepose.store.releases import check_usable, find_map

        self.check()
        with viewing(self.store, self.by) as connection:
            found = find_map(connection, row["sha256"])
        check_usable(found, released_only=released_only)
        return found

    def check_robot(self, row: Mapping[str, Any], path: Path | None, cell: Cell | None, reason: str) -> None:
        """Refuse a cell that the store, or its id, knows as of another robot than a map, unless a reason is given."""
        import hashlib

        from truepose.store.access import viewing
        from truepose.store.robots import other_robot

        if cell is None or reason:
            return
        sha = None if path is None else hashlib.sha256(path.read_bytes()).hexdigest()
        with viewing(self.store, self.by) as connection:
            if (other := other_robot(connection, row["id"], cell.robot_id, sha)) is not None:
                remedy = "take the map of this robot, or accept it with --other-robot REASON"
                raise RefusedError(f"{other}: each robot has errors of its own; {remedy}")

    def prepare(self, corrected: Sequence[CorrectedProgram]) -> RowsNote:
        """Store what is needed for the rows of corrections; return the note to write with their files."""
        from truepose.store.unrecorded import prepare

        return prepare(self.store, self.by, corrected)

    def corrected_already(self, programs: Sequence[Program]) -> EarlierPrograms:
        """Return the programs that hold what a correction of the store wrote."""
        from truepose.store.access import viewing
        from truepose.store.corrected import earlier_programs

        with viewing(self.store, self.by) as connection:
            return earlier_programs(connection, programs)

    def load_map(self, named: Path) -> tuple[ErrorMap, dict[str, Any]]:
        """Return a map that a file holds, or that the store has under a name or hash, with its row."""
        from truepose.error_map import ErrorMap, load_map
        from truepose.error_map.encoding import from_bytes

        if named.is_file():
            error_map = load_map(named)
            return error_map, self.map_row(named, error_map.hash)
        try:
            row = self.map_row(named)
        except DataError as error:
            raise FileError(named, f"no such file, and {error}") from None
        return from_bytes(self.store.read_blob(row["sha256"]), named, ErrorMap), row

    def entry(self, row: Mapping[str, Any]) -> StoreEntry:
        """Return the head of the audit trail and the state of a map, for a report."""
        from truepose.report.evidence import StoreEntry

        head = self.store.head()
        return StoreEntry(head.sequence, head.hash, row["state"])


def map_to_use(
    record: Recorder | None, named: Path, *, released_only: bool = False
) -> tuple[ErrorMap, dict[str, Any] | None]:
    """Return the map of a file or of the store, and its row in the store; refuse one that must not be used.

    Raises
    ------
    RefusedError
        If it is withdrawn, or not released with `released_only`, or a file that the store does not have.
    """
    from truepose.error_map import load_map

    if record is None:
        return load_map(named), None
    from truepose.store.releases import check_usable

    error_map, row = record.load_map(named)
    check_usable(row, released_only=released_only)
    return error_map, row


@contextmanager
def recorder(address: str | None, action: Action, folders: Sequence[Path] = ()) -> Iterator[Recorder | None]:
    """Open the store of a command, and check that its user may record; None without a store.

    The rows of runs that were interrupted are written: those of some folders, and of the user's other runs.
    """
    if address is None:
        yield None
        return
    with opened(address) as store:
        from truepose.store.unrecorded import settle

        made = Recorder(store, identify(store), address, action)
        made.check()
        settle(store, made.by, folders)
        yield made


def record_samples(
    to: Recorder, cell_path: Path, out: Path, readings: Path, samples: Samples, figures: Mapping[str, Any]
) -> None:
    """Record an imported table of samples, with the tracker's file and the tests of the campaign."""
    from truepose.cell import load_cell
    from truepose.store.recording import CellFile, add_cell, add_samples

    def write(change: Change) -> None:
        cell_id = add_cell(change, CellFile.of(cell_path, load_cell(cell_path)))
        add_samples(change, cell_id, out, samples, source=readings, figures=figures)

    to.record([out], write)


def record_map(
    to: Recorder, cell_path: Path, out: Path, error_map: ErrorMap, samples_path: Path, samples: Samples
) -> None:
    """Record a fitted map with its cell and its samples."""
    from truepose.store.recording import CellFile, add_cell, add_map, add_samples

    def write(change: Change) -> None:
        cell_id = add_cell(change, CellFile.of(cell_path, error_map.cell))
        reading_set = add_samples(change, cell_id, samples_path, samples)
        add_map(change, cell_id, out, error_map, reading_sets=(reading_set,))

    to.record([out], write)


def record_update(
    to: Recorder, parent: Mapping[str, Any], out: Path, error_map: ErrorMap, samples_path: Path, samples: Samples
) -> None:
    """Record an updated map with the map that it was made from, and the new samples."""
    from truepose.store.recording import add_map, add_samples
    from truepose.store.rows import reading_sets_of

    def write(change: Change) -> None:
        before = [row["id"] for row in reading_sets_of(change.connection, parent["id"])]
        reading_set = add_samples(change, parent["cell_id"], samples_path, samples)
        sets = (*before, reading_set)
        add_map(change, parent["cell_id"], out, error_map, reading_sets=sets, parent_id=parent["id"])

    to.record([out], write)


def record_corrections(
    to: Recorder, corrected: Sequence[CorrectedProgram], written: Sequence[Path], *, remedy: str | None = None
) -> None:
    """Record corrected programs by the records that were written; `remedy` if the store is lost, by default --force."""
    from truepose.programs.corrected import ORIGINAL
    from truepose.programs.record import SUFFIX, head_of
    from truepose.store.recording import add_corrections

    before = {s.sha256: b"".join(s.stored([s.data])) for one in corrected for s in one.program.sources}
    after = {one.hashes[s.path]: b"".join(one.content(s)) for one in corrected for s in one.program.sources}
    known = {**after, **before}

    def write(change: Change) -> None:
        for path in (path for path in written if path.name.endswith(SUFFIX)):
            add_corrections(change, path.read_bytes(), head_of(path), known.get)

    in_place = any(path.suffix == ORIGINAL for path in written)  # their originals lie beside them
    later = None if in_place else "run the same command again with --force"
    to.record(written, write, remedy=remedy or later)


def record_verification(to: Recorder, found: ProgramVerification, data: bytes, program: Path, out: Path | None) -> None:
    """Record the verification of a program."""
    import hashlib

    from truepose._io.files import read_bytes
    from truepose.store.recording import add_verification

    sha = hashlib.sha256(read_bytes(program)).hexdigest() if program.is_file() else None
    files = [out] if out is not None and out.suffix.lower() == ".json" else []
    to.record(files, lambda change: add_verification(change, found, data, output_sha256=sha))


def record_validation(
    to: Recorder, row: Mapping[str, Any], samples_path: Path, samples: Samples, figures: Mapping[str, Any]
) -> None:
    """Record the validation of a map with samples that were not in the fit, and these samples."""
    from truepose.store.recording import add_samples
    from truepose.store.records import put_verification

    def write(change: Change) -> None:
        reading_set = add_samples(change, row["cell_id"], samples_path, samples)
        put_verification(change, "map", figures, map_id=row["id"], reading_set_id=reading_set)

    to.record([], write)


def record_report(to: Recorder, out: Path, row: Mapping[str, Any], head: str) -> None:
    """Record that a report was made: the hash of its file, its map and the head that it shows."""

    def write(change: Change) -> None:
        sha = change.blob_file(out)
        change.note("report.add", {"sha256": sha, "name": out.name, "map_id": row["id"], "head": head})

    to.record([out], write)


def _common(files: Sequence[Path]) -> Path:
    """Return the folder that holds all files."""
    import os

    return Path(os.path.commonpath([path.resolve().parent for path in files]))
