"""Check a store: its chain, that rows are those that the audit trail describes, references, and blobs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

import sqlalchemy as sa

from truepose.errors import FileError, StoreError
from truepose.store import anchor, audit, schema
from truepose.store.audit import Head
from truepose.store.hashing import row_hasher
from truepose.store.progress import SILENT, Progress, counted
from truepose.store.store import Store, blob_content

_MANY: Final = 5000  # rows fetched at once
_ROW: Final = '{"row":"'
_ROW_END: Final = len(_ROW) + 64


@dataclass
class Verification:
    """The result of `verify`.

    Attributes
    ----------
    head : Head
        The last entry of the audit trail.
    rows, blobs : int
        The number of rows and of blobs that were compared.
    faults : list of str
        What was changed, removed or is missing, with the entry and the object.
    notes : list of str
        What is worth knowing and no fault.
    """

    head: Head
    rows: int = 0
    blobs: int = 0
    faults: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def verify(
    store: Store, *, head: str | None = None, contents: bool = True, progress: Progress = SILENT
) -> Verification:
    """Compare a store with its audit trail.

    Parameters
    ----------
    store : Store
        The store.
    head : str, optional
        A head that was noted elsewhere, such as on a report; the chain must contain it.
    contents : bool
        Whether blobs are read and their hashes compared; otherwise only their presence and size are checked.
    progress : Progress
        A function that is called with each step, and how far it is.
    """
    with store.reading() as connection:
        found = Verification(audit.head(connection))
        progress("Checking the database")
        found.faults += store.backend.damage(connection)
        progress("Checking the audit trail")
        found.faults += audit.broken_links(connection, progress)
        found.faults += _wrong_heads(store, connection, head, found)
        _compare(connection, schema.AUDITED, found, progress)
        progress("Checking blobs")
        found.faults += _wrong_blobs(store, connection, contents, found, progress)
    return found


def check_trail(connection: sa.Connection, progress: Progress = SILENT) -> Verification:
    """Check the chain and the rows of an open transaction, also of an older schema, without what is outside of it."""
    progress("Checking the audit trail")
    found = Verification(audit.head(connection), faults=list(audit.broken_links(connection, progress)))
    names = sa.inspect(connection).get_table_names()
    _compare(connection, [table for table in schema.AUDITED if table.name in names], found, progress)
    return found


def _compare(connection: sa.Connection, tables: Iterable[sa.Table], found: Verification, progress: Progress) -> None:
    """Compare all rows of some tables with their entries, and their references."""
    for table in tables:
        progress(f"Comparing the rows of {table.name} with their entries")
        found.faults += _wrong_rows(connection, table, found, progress)
        found.faults += _wrong_references(connection, table)


def _wrong_heads(store: Store, connection: sa.Connection, head: str | None, found: Verification) -> Iterator[str]:
    """Yield heads outside of the database that the chain does not contain: its last entries were removed."""
    if head is not None:
        at = sa.select(schema.audit.c.sequence).where(schema.audit.c.hash == head.strip().lower())
        if (sequence := connection.execute(at).scalar()) is None:
            yield f"no entry has the head {head}: entries were removed or replaced after it was noted"
        else:
            found.notes.append(f"the head given is that of entry {sequence}; the last entry is {found.head.sequence}")
    if (path := store.backend.anchor) is None:
        found.notes.append("no file keeps the head; compare it with the one on a report (--head)")
    elif (kept := anchor.read(path)) is None:
        found.notes.append(f"{path}: keeps no head; it is written with the next change")
    elif kept.sequence > found.head.sequence:
        first = found.head.sequence + 1
        yield f"entries {first} to {kept.sequence} are missing at the end of the audit trail: {path} names a later head"
    elif audit.hash_at(connection, kept.sequence) != kept.hash:
        yield f"entry {kept.sequence} is not the one whose head {path} keeps: the audit trail was replaced"


def _wrong_rows(connection: sa.Connection, table: sa.Table, found: Verification, progress: Progress) -> Iterator[str]:
    """Yield rows that are not as their last entry describes them; both are read once, in the order of their ids."""
    entries, hashed = _last_entries(connection, table), row_hasher(table)
    entry = next(entries, None)
    total = int(connection.execute(sa.select(sa.func.count()).select_from(table)).scalar() or 0)
    rows = connection.execute(sa.select(table).order_by(table.c.id), execution_options={"yield_per": _MANY})
    for row in counted(rows, total, progress):
        found.rows += 1
        row_id = row.id
        while entry is not None and entry[0] < row_id:
            yield from _removed(table, *entry)
            entry = next(entries, None)
        if entry is None or entry[0] != row_id:
            yield f"{table.name} {row_id} has no entry in the audit trail: it was added to the database directly"
            continue
        if hashed(row) != entry[2]:
            yield f"{table.name} {row_id} was changed after entry {entry[1]}, without an entry"
        entry = next(entries, None)
    while entry is not None:
        yield from _removed(table, *entry)
        entry = next(entries, None)


def _removed(table: sa.Table, row_id: int, sequence: int, expected: str | None) -> Iterator[str]:
    if expected is not None:
        yield f"{table.name} {row_id} of entry {sequence} was removed without an entry"


def _last_entries(connection: sa.Connection, table: sa.Table) -> Iterator[tuple[int, int, str | None]]:
    """Yield the id, the last entry and the hash of each row that entries describe, by id."""
    entries = schema.audit
    query = (
        sa.select(entries.c.object_id, entries.c.sequence, entries.c.payload)
        .where(entries.c.object == table.name, entries.c.object_id.is_not(None))
        .order_by(entries.c.object_id, entries.c.sequence)
    )
    last: tuple[int, int, str] | None = None
    for object_id, sequence, payload in connection.execute(query, execution_options={"yield_per": _MANY}):
        if last is not None and last[0] != object_id:
            yield last[0], last[1], _row_of(last[2])
        last = object_id, sequence, payload
    if last is not None:
        yield last[0], last[1], _row_of(last[2])


def _row_of(payload: str) -> str | None:
    """Return the hash of the row in a payload; an entry that was edited may hold anything."""
    if payload.startswith(_ROW) and payload[_ROW_END : _ROW_END + 2] == '",':  # as the store writes it: row comes first
        return payload[len(_ROW) : _ROW_END]
    try:
        row = json.loads(payload)["row"]
    except (ValueError, KeyError, TypeError):
        return ""
    return row if isinstance(row, str) or row is None else ""


def _wrong_references(connection: sa.Connection, table: sa.Table) -> Iterator[str]:
    """Yield rows that name a row or blob which does not exist."""
    for key in sorted(table.foreign_keys, key=lambda key: key.parent.name):
        target = key.column.table.alias()
        column, goal = key.parent, target.c[key.column.name]
        exists = sa.select(goal).where(goal == column).exists()
        query = sa.select(table.c.id, column).where(column.is_not(None), ~exists).order_by(table.c.id)
        for row_id, value in connection.execute(query):
            yield f"{table.name} {row_id} names {key.column.table.name} {value}, which does not exist"


def _wrong_blobs(
    store: Store, connection: sa.Connection, contents: bool, found: Verification, progress: Progress
) -> Iterator[str]:
    """Yield blobs that are missing or were changed, with the objects that name them."""
    known: set[str] = set()
    blob = schema.blob
    columns = sa.select(blob.c.sha256, blob.c.size).order_by(blob.c.sha256)
    total = int(connection.execute(sa.select(sa.func.count()).select_from(blob)).scalar() or 0)
    for sha, size in counted(connection.execute(columns, execution_options={"yield_per": _MANY}), total, progress):
        found.blobs += 1
        known.add(sha)
        if (why := _blob_fault(store, connection, sha, size, contents)) is not None:
            yield f"blob {sha} {why}; it belongs to {_owners(connection, sha)}"
    if store.blobs is not None and (loose := sum(sha not in known for sha in store.blobs.list())):
        found.notes.append(f"{loose} blobs belong to no row: left by changes that were not completed; they do no harm")


def _blob_fault(store: Store, connection: sa.Connection, sha: str, size: int, contents: bool) -> str | None:
    """Return what is wrong with a blob."""
    if store.blobs is None:
        stored = sa.select(sa.func.length(schema.blob.c.content)).where(schema.blob.c.sha256 == sha)
        length = connection.execute(stored).scalar()
    else:
        path = store.blobs.path(sha)
        length = path.stat().st_size if path.is_file() else None
    if length is None:
        return "is missing"
    if length != size:
        return f"has {length} bytes, expected {size}"
    try:
        if contents:
            blob_content(store, connection, sha)
    except (FileError, StoreError):
        return "was changed: its content does not match its name"
    return None


def _owners(connection: sa.Connection, sha: str) -> str:
    """Return the objects that name a blob, each with its last entry."""
    owners = []
    for table in schema.AUDITED:
        columns = [key.parent for key in table.foreign_keys if key.column.table is schema.blob]
        if not columns:
            continue
        for row_id in connection.execute(sa.select(table.c.id).where(sa.or_(*(c == sha for c in columns)))).scalars():
            entries = schema.audit
            of = sa.select(sa.func.max(entries.c.sequence))
            sequence = connection.execute(
                of.where(entries.c.object == table.name, entries.c.object_id == row_id)
            ).scalar()
            owners.append(f"{table.name} {row_id} (entry {sequence})")
    return ", ".join(owners) or "no row"
