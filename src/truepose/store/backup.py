"""A backup of a store: one .zip with the rows of each table as JSON lines, and the blobs, each with its SHA-256.

It names no engine, so a backup of SQLite restores into PostgreSQL and back. The rows are of one moment, whatever is
written meanwhile; blobs never change.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any, BinaryIO, Final

import sqlalchemy as sa

from truepose._io import files
from truepose._io.commits import sync_folder
from truepose._version import version
from truepose.errors import FileError
from truepose.store import audit, migrate, schema
from truepose.store.audit import Head
from truepose.store.change import Change
from truepose.store.corrected import list_positions
from truepose.store.hashing import line_writer
from truepose.store.progress import SILENT, Progress
from truepose.store.store import Store, blob_content
from truepose.store.verify import check_trail

FORMAT: Final = "truepose store backup"
_MANIFEST: Final = "manifest.json"
_MANY: Final = 1000  # rows read or inserted at once
_PART: Final = 2**20
_TABLES: Final = (schema.blob, *schema.AUDITED, schema.position, schema.audit)
_SHA: Final = re.compile(r"[0-9a-f]{64}")
_DAMAGED: Final = "use another backup"


@dataclass(frozen=True)
class Moved:
    """What a backup holds.

    Attributes
    ----------
    rows, blobs : int
        The number of rows, without those of the audit trail, and of blobs.
    head : Head
        The last entry of the audit trail.
    """

    rows: int
    blobs: int
    head: Head


def backup(store: Store, path: str | Path, *, progress: Progress = SILENT) -> Moved:
    """Write a backup, and read it again before it gets its name.

    Raises
    ------
    FileError
        If it cannot be written, or a blob of the store is missing or was changed.
    StoreError
        If the store cannot be read.
    """
    path = Path(path)
    files.check_outputs(path)
    with _replacing(path) as draft:
        with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            _write(store, archive, progress)
        progress("Checking the backup")
        with draft.open("rb+") as file:
            moved = _checked(file, path)
            os.fsync(file.fileno())
    return moved


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Make a file beside a path that takes its name at the end, or is removed by an exception."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
        os.close(descriptor)
        try:
            yield Path(name)
            os.replace(name, path)  # noqa: PTH105 - the name is text
            sync_folder(path.parent)
        finally:
            Path(name).unlink(missing_ok=True)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}; choose another output path") from error


def _write(store: Store, archive: zipfile.ZipFile, progress: Progress) -> None:
    """Write all members of a backup; the manifest is the last one."""
    hashes, counts = {}, {}
    with store.reading() as connection:
        head = audit.head(connection)
        for table in _TABLES:
            progress(f"Writing {table.name}")
            hashes[table.name], counts[table.name] = _write_rows(archive, connection, table, progress)
        progress(f"Writing {counts['blob']} blobs")
        for sha in _shas(connection):
            archive.writestr(f"blobs/{sha}", blob_content(store, connection, sha))
    manifest = {
        "format": FORMAT,
        "schema": schema.VERSION,
        "written_by": f"truepose {version()}",
        "time": audit.now(),
        "sequence": head.sequence,
        "head": head.hash,
        "sha256": hashes,
        "rows": counts,
    }
    archive.writestr(_MANIFEST, json.dumps(manifest, indent=1))


def restore(path: str | Path, address: str | Path, *, progress: Progress = SILENT) -> Moved:
    """Make a store from a backup.

    Parameters
    ----------
    path : str or Path
        The backup.
    address : str or Path
        The place of the new store; see `Store.open`.
    progress : Progress
        A function that is called with each step, and how far it is.

    Raises
    ------
    FileError
        If the backup is damaged, is of a newer program, or its rows are not those that its audit trail describes.
    StoreError
        If there is a store already, or it cannot be made.
    """
    path = Path(path)
    files.check_regular(path, largest=2**63) if files.path_exists(path) else _missing(path)
    with path.open("rb") as file:
        progress("Checking the backup")
        moved = _checked(file, path)
        with zipfile.ZipFile(file) as archive, Store.making(address) as (store, connection):
            manifest = _manifest(archive, path)
            migrate.upgrade(connection, manifest["schema"])
            change = Change(connection, "truepose", store.blobs)
            progress("Restoring blobs")
            with nullcontext() if store.blobs is None else store.blobs.synced_at_end():
                for sha in _members(archive):
                    change.blob(archive.read(f"blobs/{sha}"))
            with _indexed_after(connection):
                for table in (table for table in _TABLES[1:] if table.name in manifest["rows"]):
                    progress(f"Restoring {table.name}")
                    done, total = 0, manifest["rows"].get(table.name, 0)
                    for some in _read_rows(archive, store, connection, table.name):
                        progress.count(done := done + some, max(done, total))
                progress("Making the indexes")
            if faults := check_trail(connection, progress).faults:
                raise FileError(path, f"{len(faults)} faults, first: {faults[0]}; {_DAMAGED}")
            migrate.upgrade(connection)
            if schema.position.name not in manifest["rows"]:
                list_positions(connection, partial(blob_content, store, connection))
            note = {"head": moved.head.hash, "from": manifest["schema"], "to": schema.VERSION, "program": version()}
            change = Change(connection, "truepose", store.blobs)
            change.note("store.restore", note)
    return moved


def _missing(path: Path) -> None:
    raise FileError(path, "no such file")


def _write_rows(
    archive: zipfile.ZipFile, connection: sa.Connection, table: sa.Table, progress: Progress
) -> tuple[str, int]:
    """Write a table without the content of blobs; return the SHA-256 of what was written, and the number of rows."""
    digest, count = hashlib.sha256(), 0
    columns = [column for column in table.columns if column is not schema.blob.c.content]
    query = sa.select(*columns).order_by(*table.primary_key.columns)
    line = line_writer([column.name for column in columns])
    total = int(connection.execute(sa.select(sa.func.count()).select_from(table)).scalar() or 0)
    with archive.open(_member(table.name), "w", force_zip64=True) as out:
        found = connection.execute(query, execution_options={"yield_per": _MANY})
        for rows in found.partitions():
            lines = [line(row) for row in rows]
            data = "\n".join([*lines, ""]).encode()
            digest.update(data)
            out.write(data)
            progress.count(count := count + len(lines), max(count, total))
    return digest.hexdigest(), count


@contextmanager
def _indexed_after(connection: sa.Connection) -> Iterator[None]:
    """Make the indexes after the rows, sorted once; constraints hold all the time."""
    reflected = sa.MetaData()
    reflected.reflect(connection)
    indexes = [index for table in reflected.tables.values() for index in table.indexes if not index.unique]
    for index in indexes:
        index.drop(connection)
    yield
    for index in indexes:
        index.create(connection)


def _read_rows(archive: zipfile.ZipFile, store: Store, connection: sa.Connection, name: str) -> Iterator[int]:
    """Insert the rows of a table as they are, in the version of the schema that the backup has; yield their numbers."""
    with archive.open(_member(name)) as member:
        for batch in _lines(member):
            rows = json.loads(b"[%s]" % b",".join(batch))
            columns = list(rows[0])
            if not all(list(row) == columns for row in rows):
                raise FileError(archive.filename or "", f"has rows of {name} with different columns; {_DAMAGED}")
            store.backend.insert_rows(connection, name, columns, [tuple(row.values()) for row in rows])
            yield len(rows)


def _lines(member: IO[bytes]) -> Iterator[list[bytes]]:
    """Yield the lines of a member, some thousand at a time."""
    rest = b""
    while part := member.read(_PART):
        *lines, rest = (rest + part).split(b"\n")
        if lines:
            yield lines
    if rest:
        yield [rest]


def _shas(connection: sa.Connection) -> Iterator[str]:
    query = sa.select(schema.blob.c.sha256).order_by(schema.blob.c.sha256)
    yield from connection.execute(query, execution_options={"yield_per": _MANY}).scalars()


def _member(table: str) -> str:
    return f"tables/{table}.jsonl"


def _members(archive: zipfile.ZipFile) -> list[str]:
    """Return the hashes of the blobs in a backup."""
    names = (name.removeprefix("blobs/") for name in archive.namelist() if name.startswith("blobs/"))
    return [name for name in names if _SHA.fullmatch(name)]


def _checked(file: BinaryIO, path: Path) -> Moved:
    """Read a complete backup and compare all hashes; return what it holds."""
    file.seek(0)
    try:
        with zipfile.ZipFile(file) as archive:
            manifest = _manifest(archive, path)
            for name, expected in manifest["sha256"].items():
                if _digest(archive, _member(name)) != expected:
                    raise FileError(path, f"the rows of {name} were changed after it was written; {_DAMAGED}")
            shas = _members(archive)
            for sha in shas:
                if _digest(archive, f"blobs/{sha}") != sha:
                    raise FileError(path, f"blob {sha} was changed after it was written; {_DAMAGED}")
            if len(shas) != manifest["rows"]["blob"]:
                raise FileError(path, f"has {len(shas)} blobs, expected {manifest['rows']['blob']}; {_DAMAGED}")
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError, NotImplementedError, OSError) as error:
        raise FileError(path, f"is not a complete backup ({error}); {_DAMAGED}") from error
    rows = sum(count for name, count in manifest["rows"].items() if name not in ("audit", "blob", "position"))
    return Moved(rows, len(shas), Head(manifest["sequence"], manifest["head"]))


def _manifest(archive: zipfile.ZipFile, path: Path) -> Mapping[str, Any]:
    """Return the manifest after a check of its form."""
    try:
        found = json.loads(archive.read(_MANIFEST))
        if found["format"] != FORMAT:
            raise ValueError
        version, names = int(found["schema"]), {table.name for table in _TABLES}
        if not (set(found["sha256"]) == set(found["rows"]) and set(found["rows"]) <= names):
            raise FileError(path, f"holds tables that this program does not know; update truepose, or {_DAMAGED}")
        if version > schema.VERSION:
            raise FileError(path, f"has schema version {version}, known are up to {schema.VERSION}; update truepose")
        int(found["sequence"]), str(found["head"]), int(found["rows"]["blob"])
    except (KeyError, ValueError, TypeError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(path, "is not a backup of a store; name a .zip that 'truepose store backup' wrote") from None
    return dict(found)


def _digest(archive: zipfile.ZipFile, name: str) -> str:
    digest = hashlib.sha256()
    with archive.open(name) as member:
        while part := member.read(_PART):
            digest.update(part)
    return digest.hexdigest()
