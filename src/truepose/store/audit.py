"""The audit trail: a chain of entries, each with the hash of the one before it, written with the change it describes.

The hash of an entry covers its number, time, user, action, object and payload, and the previous hash. So the last hash,
the head, covers the complete history: an entry that is edited, removed or inserted later changes every head after it.
The chain itself cannot show that its last entries were removed; therefore the head also stands outside of the database:
on reports, in the answer of ``truepose store head``, and in a file beside the database or the blobs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

import sqlalchemy as sa

from truepose.store.hashing import canonical, canonical_list, row_hasher, sha256
from truepose.store.progress import SILENT, Progress, counted
from truepose.store.schema import audit

START: Final = "0" * 64
"""The previous hash of the first entry."""
_MANY: Final = 5000  # rows fetched at once


@dataclass(frozen=True)
class Head:
    """The last entry of an audit trail.

    Attributes
    ----------
    sequence : int
        The number of the entry; 0 of an empty trail.
    hash : str
        The hash of the entry, which covers all earlier ones.
    """

    sequence: int
    hash: str


def now() -> str:
    """Return the present time as the store writes it: UTC, ISO 8601 with microseconds."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def row_hash(table: sa.Table, row: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a row without its empty columns; see `truepose.store.hashing.row_hasher`."""
    return row_hasher(table)([row.get(column.name) for column in table.columns])


def entry_hash(entry: Sequence[Any]) -> str:
    """Return the hash of an entry from its columns but the last one, which is the hash."""
    return sha256(canonical_list(entry[:-1]))


def head(connection: sa.Connection) -> Head:
    """Return the last entry."""
    last = sa.select(audit.c.sequence, audit.c.hash).order_by(audit.c.sequence.desc()).limit(1)
    row = connection.execute(last).first()
    return Head(0, START) if row is None else Head(row.sequence, row.hash)


@dataclass(frozen=True)
class Entry:
    """What an entry says: the action on an object, and more about it."""

    action: str
    payload: Mapping[str, Any]
    object: str = ""
    object_id: int | None = None


def append(connection: sa.Connection, before: Head, user: str, entries: Iterable[Entry]) -> Head:
    """Append entries in the transaction of their change, which holds the writer's lock; return the new head."""
    time, sequence, previous = now(), before.sequence, before.hash
    rows = []
    for entry in entries:
        sequence += 1
        row: dict[str, Any] = {
            "sequence": sequence,
            "time": time,
            "user": user,
            "action": entry.action,
            "object": entry.object,
            "object_id": entry.object_id,
            "payload": canonical(entry.payload),
            "previous": previous,
        }
        row["hash"] = previous = entry_hash([*row.values(), ""])
        rows.append(row)
    if rows:
        connection.execute(sa.insert(audit), rows)
    return Head(sequence, previous)


def broken_links(connection: sa.Connection, progress: Progress = SILENT) -> Iterator[str]:
    """Yield what is wrong in the chain: an entry that was edited, removed or inserted."""
    before, previous, total = 0, START, head(connection).sequence
    rows = connection.execute(sa.select(audit).order_by(audit.c.sequence), execution_options={"yield_per": _MANY})
    for row in counted(rows, total, progress):
        sequence, *_, linked, hashed = row
        if sequence != before + 1:
            missing = f"{before + 1} to {sequence - 1}"
            yield f"entries {missing} of the audit trail are missing before entry {sequence} ({_described(row)})"
        elif linked != previous:
            yield f"entry {sequence} ({_described(row)}) does not continue the chain: entry {before} was replaced"
        if entry_hash(row) != hashed:
            yield f"entry {sequence} ({_described(row)}) was changed after it was written"
        before, previous = sequence, hashed


def _described(row: sa.Row[Any]) -> str:
    return describe(dict(row._mapping))


def describe(row: Mapping[str, Any]) -> str:
    """Return an entry's action and object in words."""
    named = "" if row["object_id"] is None else f" {row['object']} {row['object_id']}"
    return f"{row['action']}{named} by {row['user']}, {row['time']}"


def hash_at(connection: sa.Connection, sequence: int) -> str | None:
    """Return the hash of an entry; None without it."""
    return connection.execute(sa.select(audit.c.hash).where(audit.c.sequence == sequence)).scalar()
