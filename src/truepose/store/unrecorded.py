"""Corrections whose files are written and whose rows are not yet: a run that is killed in between loses no row.

The contents of the files are in the store before they are written. A note is written together with them, all or none:
``.truepose-TOKEN.rows`` in their folder names the store and the records, and is removed when the rows are in the store.
The next run that uses the store and finds the note writes the rows: in the folder, or by the list of notes in the
user's state folder (``unrecorded.jsonl``; see `truepose.programs.history`).
"""

from __future__ import annotations

import json
import os
import secrets
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa

from truepose._io.commits import Commit, recover
from truepose.errors import FileError, RecoveryWarning, RefusedError, StoreError, TrueposeError
from truepose.programs import history
from truepose.programs.corrected import NOTES, CorrectedProgram
from truepose.programs.record import head_of
from truepose.store import audit, schema
from truepose.store.access import Identity, changing
from truepose.store.change import Change
from truepose.store.recording import add_corrections
from truepose.store.store import Store, blob_content

FORMAT: Final = "truepose rows 1"


@dataclass
class RowsNote:
    """The note of one run; see `prepare`.

    Attributes
    ----------
    store : str
        The hash of the first entry of the store's audit trail, which names the store.
    shown : str
        Its address for messages.
    by : str
        Who corrects.
    paths : list of Path
        Where the note was written.
    """

    store: str
    shown: str
    by: str
    paths: list[Path] = field(default_factory=list)

    def write(self, commit: Commit, folder: Path, records: Sequence[Path]) -> None:
        """Write the note in a folder as a part of a commit, and list it."""
        path = folder / f".truepose-{secrets.token_hex(8)}.rows"
        for notes in _lists():
            with suppress(OSError):  # the note in the folder remains
                history.append(notes, f"\n{json.dumps({'store': self.store, 'note': os.path.realpath(path)})}\n")
        names = [os.path.relpath(record, folder) for record in records]
        content = {"format": FORMAT, "store": self.store, "address": self.shown, "by": self.by, "records": names}
        with commit.open(path) as file:
            file.write(json.dumps(content, indent=1).encode())
        self.paths.append(path)

    def remove(self) -> None:
        """Remove the note, as the rows are in the store."""
        for path in self.paths:
            path.unlink(missing_ok=True)
        _shorten()


def prepare(store: Store, by: Identity, corrected: Iterable[CorrectedProgram]) -> RowsNote:
    """Store the contents of programs before and after their correction; return the note to write with the files.

    Raises
    ------
    RefusedError
        If `by` may not correct.
    StoreError
        If the store is lost; nothing must be written then.
    """
    with changing(store, by, "correct") as change:
        for one in corrected:
            for source in one.program.sources:
                change.blob(b"".join(source.stored([source.data])))
                change.blob(b"".join(one.content(source)))
        return RowsNote(_identity(change.connection), store.backend.shown, by.name)


def settle(store: Store, by: Identity, folders: Iterable[Path] = ()) -> None:
    """Write the rows of runs that were interrupted, by the notes in some folders and by the list; warn about each."""
    with store.reading() as connection:
        own = _identity(connection)
    inside = [path for folder in folders for path in notes_in(folder)]
    for path in dict.fromkeys([*(Path(os.path.realpath(path)) for path in inside), *_listed(own)]):
        try:
            said = _settle(store, by, own, path)
        except StoreError:
            raise
        except (TrueposeError, OSError) as error:
            said = f"{path.parent}: corrections of an interrupted run have no row in the store: {error}"
        if said:
            warnings.warn(said, RecoveryWarning, stacklevel=2)
    _shorten()


def notes_in(folder: Path) -> list[Path]:
    """Return the notes in a folder."""
    return sorted(folder.glob(NOTES))


def _settle(store: Store, by: Identity, own: str, path: Path) -> str:
    """Write the rows of a note, and remove it; return a sentence about it."""
    recover(path.parent)  # of a run that was killed while it wrote the files
    try:
        note = json.loads(path.read_text(encoding="utf-8"))
        named, address, records = note["store"], str(note["address"]), [path.parent / name for name in note["records"]]
    except FileNotFoundError:  # the files were not written, or another run was quicker
        return ""
    except (ValueError, KeyError, TypeError):
        raise FileError(path, "is not readable; import the folder with 'truepose store import'") from None
    if named != own:
        return f"{path.parent}: corrections of an interrupted run have no row in the store {address}; use that store"
    try:
        with changing(store, by, "correct") as change:
            made = [
                row
                for record in records
                for row in add_corrections(
                    change, record.read_bytes(), head_of(record), lambda sha: _content(store, change, sha)
                )
            ]
    except RefusedError as error:
        raise RefusedError(f"{error}; somebody who may correct records them with the next run") from None
    except FileNotFoundError as error:
        raise FileError(error.filename, f"is missing; put it back, or remove {path}") from None
    path.unlink(missing_ok=True)
    n = f"{len(made)} correction{'s' if len(made) != 1 else ''}"
    return f"{path.parent}: recorded {n} of {note.get('by')}, whose run was interrupted before"


def _content(store: Store, change: Change, sha256: str) -> bytes | None:
    known = change.connection.execute(sa.select(schema.blob.c.size).where(schema.blob.c.sha256 == sha256)).scalar()
    return None if known is None else blob_content(store, change.connection, sha256)


def _identity(connection: sa.Connection) -> str:
    """Return what names a store wherever it lies: the hash of the first entry of its audit trail."""
    return str(audit.hash_at(connection, 1))


def _lists() -> list[Path]:
    return [path.with_name("unrecorded.jsonl") for path in history.stores(None)]


def _entries(notes: Path) -> Iterator[dict[str, Any]]:
    with suppress(OSError):
        for line in notes.read_text(encoding="utf-8", errors="replace").splitlines():
            with suppress(ValueError):
                found = json.loads(line)
                if isinstance(found, dict) and isinstance(found.get("note"), str):
                    yield found


def _listed(own: str) -> list[Path]:
    """Return the notes of a store that the list names and that are still there."""
    named = [Path(one["note"]) for notes in _lists() for one in _entries(notes) if one.get("store") == own]
    return [path for path in named if path.is_file()]


def _shorten() -> None:
    """Remove the list when none of its notes is left."""
    for notes in _lists():
        if notes.is_file() and not any(Path(one["note"]).is_file() for one in _entries(notes)):
            with suppress(OSError):
                notes.unlink()
