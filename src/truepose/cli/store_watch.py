"""The store of ``truepose watch``: it decides before each program, and records each correction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from truepose.cli.store_record import Recorder, record_corrections
from truepose.errors import RefusedError

if TYPE_CHECKING:
    from truepose.programs import CorrectedProgram
    from truepose.programs.core.program import Program
    from truepose.programs.corrected import Note
    from truepose.store.unrecorded import RowsNote


@dataclass
class StoreKeeper:
    """A store as the `truepose.programs.watching.Keeper` of a watch.

    Attributes
    ----------
    record : Recorder
        The store, with somebody who may correct.
    row : mapping
        The row of the map, as at the last check.
    released_only : bool
        Whether the map must be the released one of its cell.
    """

    record: Recorder
    row: Mapping[str, Any]
    released_only: bool = False
    _warnings: tuple[str, ...] = ()
    _notes: dict[int, RowsNote] = field(default_factory=dict)

    def check(self) -> None:
        """Read the state of the map again, and refuse one that must not be used any more."""
        self.row = self.record.check_map(self.row, released_only=self.released_only)

    def has(self, program: Program) -> bool:
        """Return whether the store has a correction of the program with the map."""
        from truepose.store.access import viewing
        from truepose.store.corrected import is_corrected

        hashes = [source.sha256 for source in program.sources]
        with viewing(self.record.store, self.record.by) as connection:
            return is_corrected(connection, self.row["id"], hashes)

    def allow(self, program: Program) -> None:
        """Refuse a program that a correction of the store made; keep the warning of single targets for its record."""
        again = self.record.corrected_already([program])
        if program in again.refused:
            raise RefusedError(again.refused[program])
        self._warnings = tuple(again.warnings.values())

    def marked(self, corrected: CorrectedProgram) -> CorrectedProgram:
        """Return the corrected program with the state of the map, and what the store knows of it, in its record."""
        return replace(corrected, map_state=self.row["state"], warnings=(*corrected.warnings, *self._warnings))

    def prepare(self, corrected: CorrectedProgram) -> Note:
        """Store what is needed for the row of a correction; return the note to write with its files."""
        note = self.record.prepare([corrected])
        self._notes[id(corrected)] = note
        return note

    def keep(self, corrected: CorrectedProgram, written: Sequence[Path]) -> None:
        """Record the correction."""
        record_corrections(self.record, [corrected], written, remedy="the watch records it when the store is back")
        if (note := self._notes.pop(id(corrected), None)) is not None:
            note.remove()
