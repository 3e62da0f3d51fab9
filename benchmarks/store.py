"""The team's store on SQLite and PostgreSQL: writers at once, long lists, recall, check, backup, and sizes."""

from __future__ import annotations

import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import sqlalchemy as sa

from benchmarks.harness import cpu, version_of
from benchmarks.pages import Row
from truepose.store import audit, records, rows, schema
from truepose.store.backup import backup, restore
from truepose.store.store import Store
from truepose.store.verify import verify

PAGE: Final = "store"
PACKAGES: Final = ("sqlalchemy", "psycopg")
WRITERS: Final = 8
APPENDS: Final = 25
CORRECTIONS: Final = 1_000_000
MAPS: Final = 100
PROGRAMS: Final = 1000
_MANY: Final = 20_000  # corrections in one transaction


def report(path: Path | None, *, quick: bool) -> None:
    """Measure, print, and write the page if it is wanted."""
    lines = [_head()]
    print(lines[0])
    with tempfile.TemporaryDirectory(prefix="truepose-store-") as folder, _addresses(Path(folder)) as addresses:
        for engine, address in addresses.items():
            for row in _rows(engine, address, Path(folder), CORRECTIONS // (1000 if quick else 1)):
                lines.append(f"{row}\n")
                print(row, flush=True)
                if path is not None:  # the table of 10⁶ corrections takes long: what is measured is kept
                    path.write_text("".join(lines), "utf-8")


def _head() -> str:
    versions = ", ".join(f"{name} {version_of(name)}" for name in PACKAGES)
    return (
        "# The store\n\nSQLite as in Python, and the PostgreSQL server of the `pgserver` wheel, both with their "
        "files on the same disk; each correction has its entry in the audit trail. Times of pages are medians. "
        f"{cpu()}; {os.cpu_count()} processors; {versions}. Made by `python -m benchmarks store --write`.\n\n"
        "| what | measured | wanted |\n|---|---|---|\n"
    )


@contextmanager
def _addresses(folder: Path) -> Iterator[dict[str, str]]:
    """Yield the address of a new store on each engine that this machine has."""
    addresses = {"SQLite": str(folder / "sqlite")}
    try:
        import pgserver
    except ImportError:
        print("PostgreSQL is left out: pip install pgserver")
        yield addresses
        return
    data = Path(tempfile.mkdtemp(prefix="truepose-postgres-"))
    server = pgserver.get_server(data / "data", cleanup_mode="delete")
    try:
        yield {**addresses, "PostgreSQL": server.get_uri()}
    finally:
        server.cleanup()
        shutil.rmtree(data, ignore_errors=True)


def _rows(engine: str, address: str, folder: Path, corrections: int) -> Iterator[Row]:
    Store.open(address, create=True).close()
    appends = f"{WRITERS * APPENDS} changes by {WRITERS} writers, each committed and flushed"
    yield Row(f"{engine}: {appends}", f"{_write_at_once(address):.2f} s", "2 s")
    with Store.open(address) as store:
        taken = _timed(lambda: _fill(store, corrections))
        yield Row(f"{engine}: {corrections:,} corrections added, in transactions of {_MANY:,}", f"{taken:.0f} s")
        yield from _lists(engine, store)
        taken = _timed(lambda: _whole(store))
        yield Row(f"{engine}: check of all rows, entries and blobs (`store verify`)", f"{taken:.0f} s")
        yield Row(f"{engine}: size of the database", f"{_size(store) / 1e6:.0f} MB")
        out = folder / f"{engine}.zip"
        yield Row(f"{engine}: backup, checked after writing", f"{_timed(lambda: backup(store, out)):.0f} s")
        yield Row(f"{engine}: size of the backup", f"{out.stat().st_size / 1e6:.0f} MB")
    if engine == "SQLite":
        yield Row(f"{engine}: restored and compared", f"{_timed(lambda: restore(out, folder / 'restored')):.0f} s")


def _write_at_once(address: str) -> float:
    """Return the time of all writers, each with connections of its own."""
    stores = [Store.open(address) for _ in range(WRITERS)]

    def write(writer: int) -> None:
        for i in range(APPENDS):
            with stores[writer].transaction(f"writer {writer}") as change:
                change.note("benchmark", {"n": i})

    try:
        with ThreadPoolExecutor(WRITERS) as pool:
            return _timed(lambda: list(pool.map(write, range(WRITERS))))
    finally:
        for store in stores:
            store.close()


def _fill(store: Store, corrections: int) -> None:
    """Add corrections of all programs with all maps; programs and outputs share a few blobs."""
    with store.transaction("benchmark") as change:
        cell = records.put_cell(change, "cell", b"[cell]")
        robot = records.put_robot(change, "cell")
        maps = [
            records.put_map(change, records.NewMap(cell, f"map {i}", b"map %d" % i, "idw", {})) for i in range(MAPS)
        ]
        programs = [records.put_program(change, robot, f"P{i}", b"DEF P()") for i in range(PROGRAMS)]
        shas = [change.blob(b"record %d" % i) for i in range(1 + corrections // (MAPS * PROGRAMS))]
    for first in range(0, corrections, _MANY):
        with store.transaction("benchmark") as change:
            numbers = range(first, min(first + _MANY, corrections))
            change.insert_many(schema.correction, (_correction(n, programs, maps, shas) for n in numbers))


def _correction(n: int, programs: list[int], maps: list[int], shas: list[str]) -> dict[str, Any]:
    sha = shas[n // (MAPS * PROGRAMS)]
    return {
        "program_id": programs[n % PROGRAMS],
        "map_id": maps[n // PROGRAMS % MAPS],
        "options": "{}",
        "output_sha256": sha,
        "record_sha256": sha,
        "targets": 100,
        "corrected": 98,
        "refused": 2,
        "draft": True,
    }


def _lists(engine: str, store: Store) -> Iterator[Row]:
    """Time pages at the start, in the middle and at the end of the list, and all corrections with one map."""
    with store.reading() as connection:
        last = int(connection.execute(sa.select(sa.func.max(schema.correction.c.id))).scalar() or 0)
        for where, after in (("first", None), ("middle", last // 2), ("last", 51)):
            taken = _median(lambda after=after: rows.page(connection, schema.correction, after=after))  # type: ignore[misc]
            yield Row(f"{engine}: {where} page of 50 corrections", f"{1000 * taken:.1f} ms", "100 ms")
        taken = _median(lambda: rows.recall(connection, MAPS // 2))
        yield Row(f"{engine}: first page of a recall", f"{1000 * taken:.1f} ms", "100 ms")
        found = _recalled(connection)
        taken = _median(lambda: _recalled(connection), 5)
        yield Row(f"{engine}: complete recall of a map, {found:,} corrections", f"{taken:.2f} s", "1 s")
        taken = _median(lambda: audit.head(connection))
        yield Row(f"{engine}: head of the audit trail", f"{1000 * taken:.1f} ms")


def _recalled(connection: sa.Connection) -> int:
    """Read all pages of a recall; return the number of corrections."""
    count, after = 0, None
    while True:
        page = rows.recall(connection, MAPS // 2, after=after, limit=rows.LONGEST_PAGE)
        count += len(page.rows)
        if (after := page.following) is None:
            return count


def _whole(store: Store) -> None:
    if faults := verify(store).faults:
        raise AssertionError(faults[0])


def _size(store: Store) -> int:
    with store.reading() as connection:
        if connection.dialect.name == "postgresql":
            return int(connection.execute(sa.text("SELECT pg_database_size(current_database())")).scalar_one())
    return sum(path.stat().st_size for path in Path(store.backend.shown).parent.glob("store.sqlite3*"))


def _timed(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def _median(work: Callable[[], object], times: int = 20) -> float:
    return statistics.median(_timed(work) for _ in range(times))
