"""The audit trail: a chain of entries, each with the hash of the one before it, written with the change it describes.

The hash of an entry covers its number, time, user, action, object and payload, and the previous hash. So the last hash,
the head, covers the complete history: an entry that is edited, removed or inserted later changes every head after it.
The chain itself cannot show that its last entries were removed; therefore the head also stands outside of the database:
on reports, in the answer of ``truepose store head``, and in a file beside the database or the blobs.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

import sqlalchemy as sa

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


def canonical(value: Any) -> str:
    """Return a value as JSON text: one text for one value.

    Examples
    --------
    >>> canonical({"b": 1, "a": None})
    '{"a":null,"b":1}'
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def row_hash(table: sa.Table, row: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a row without its empty columns, so that a later schema can add columns."""
    kept = {
        column.name: value
        for column in table.columns
        if (value := row.get(column.name)) is not None and column.info.get("audited", True)
    }
    return hashlib.sha256(canonical(kept).encode()).hexdigest()


def entry_hash(entry: Mapping[str, Any]) -> str:
    """Return the hash of an entry from its other columns."""
    text = canonical([entry[column.name] for column in audit.columns if column.name != "hash"])
    return hashlib.sha256(text.encode()).hexdigest()


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
        row["hash"] = previous = entry_hash(row)
        rows.append(row)
    if rows:
        connection.execute(sa.insert(audit), rows)
    return Head(sequence, previous)


def broken_links(connection: sa.Connection) -> Iterator[str]:
    """Yield what is wrong in the chain: an entry that was edited, removed or inserted."""
    expected = Head(0, START)
    rows = connection.execute(sa.select(audit).order_by(audit.c.sequence), execution_options={"yield_per": _MANY})
    for found in rows.mappings():
        row = dict(found)
        sequence, where = row["sequence"], describe(row)
        if sequence != expected.sequence + 1:
            missing = f"{expected.sequence + 1} to {sequence - 1}"
            yield f"entries {missing} of the audit trail are missing before entry {sequence} ({where})"
        elif row["previous"] != expected.hash:
            yield f"entry {sequence} ({where}) does not continue the chain: entry {sequence - 1} was replaced"
        if entry_hash(row) != row["hash"]:
            yield f"entry {sequence} ({where}) was changed after it was written"
        expected = Head(sequence, row["hash"])


def describe(row: Mapping[str, Any]) -> str:
    """Return an entry's action and object in words."""
    named = "" if row["object_id"] is None else f" {row['object']} {row['object_id']}"
    return f"{row['action']}{named} by {row['user']}, {row['time']}"


def hash_at(connection: sa.Connection, sequence: int) -> str | None:
    """Return the hash of an entry; None without it."""
    return connection.execute(sa.select(audit.c.hash).where(audit.c.sequence == sequence)).scalar()
