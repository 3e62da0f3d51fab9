"""Stores on shares, two servers, truncated files, killed processes, and servers that go away."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path, PurePosixPath

import pytest
import sqlalchemy as sa

from truepose.errors import StoreError
from truepose.store import records, schema
from truepose.store.engines import file_systems
from truepose.store.store import Store
from truepose.store.verify import verify

KILLS = 100
WRITER = Path(__file__).with_name("writing.py")


@pytest.mark.parametrize("kind", ["nfs", "nfs4", "cifs", "smb3", "fuse.sshfs", "fuse.rclone", "9p", "ceph"])
def test_a_database_on_a_share_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    with Store.open(tmp_path / "store", create=True):
        pass
    monkeypatch.setattr(file_systems, "kind_of", lambda path: kind)
    with pytest.raises(StoreError, match=f"network share .{re.escape(kind)}.*PostgreSQL"):
        Store.open(tmp_path / "store")
    with pytest.raises(StoreError, match="network share"):
        Store.open(tmp_path / "another", create=True)
    assert not (tmp_path / "another").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc/mounts")
def test_the_deepest_mount_counts_and_names_with_blanks_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    share = tmp_path / "a share"
    mounts = tmp_path / "mounts"
    name = str(share).replace(" ", "\\040")
    mounts.write_text(f"/dev/sda / ext4 rw 0 0\nserver:/x {name} nfs4 rw 0 0\n")
    monkeypatch.setattr(file_systems, "_MOUNTS", mounts)
    assert file_systems.kind_of(share / "plant" / "store.sqlite3") == "nfs4"
    assert file_systems.kind_of(tmp_path / "a share beside" / "x") == "ext4"


def test_a_later_mount_at_the_same_place_hides_the_earlier_one() -> None:
    mounts = [("/", "ext4"), ("/data", "nfs"), ("/data", "ext4")]
    assert file_systems.kind_in(mounts, PurePosixPath("/data/x")) == "ext4"
    assert file_systems.kind_in([], PurePosixPath("/data/x")) == ""


def test_one_server_serves_a_file(tmp_path: Path) -> None:
    with Store.open(tmp_path, create=True) as first, Store.open(tmp_path) as second:
        with first.serve_lock(), pytest.raises(StoreError, match="another server"), second.serve_lock():
            pass
        with second.serve_lock():  # free again
            pass


def test_the_lock_of_a_server_that_was_killed_is_free(tmp_path: Path) -> None:
    code = (
        "import sys, time; from truepose.store.store import Store\n"
        "with Store.open(sys.argv[1]) as store, store.serve_lock():\n    print('held', flush=True); time.sleep(600)"
    )
    with Store.open(tmp_path, create=True) as store:
        with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE) as server:
            assert server.stdout is not None
            assert server.stdout.readline() == b"held\n"
            with pytest.raises(StoreError, match="another server"), store.serve_lock():
                pass
            server.kill()
        with store.serve_lock():
            pass


def test_several_servers_share_postgresql(database: Callable[[], str]) -> None:
    address = database()
    Store.open(address, create=True).close()
    with Store.open(address) as first, Store.open(address) as second, first.serve_lock(), second.serve_lock():
        assert first.head() == second.head()


@pytest.mark.parametrize("part", [0.0, 0.2, 0.5, 0.9])
def test_a_truncated_write_ahead_log_is_found(tmp_path: Path, part: float) -> None:
    """SQLite drops what is not complete and says nothing; the head outside of the database shows it."""
    with Store.open(tmp_path / "store", create=True) as store:
        for i in range(5):
            with store.transaction("a") as change:
                records.put_cell(change, f"cell {i}", b"%d" % i)
        shutil.copytree(tmp_path / "store", tmp_path / "crashed")  # the last changes are in the log only
    wal = tmp_path / "crashed" / "store.sqlite3-wal"
    data = wal.read_bytes()
    wal.write_bytes(data[: int(part * len(data))])
    try:
        with Store.open(tmp_path / "crashed") as store:
            found = "; ".join(verify(store).faults)
    except StoreError as error:  # nothing of the store had left the log
        found = str(error)
    assert re.search("are missing at the end of the audit trail|there is no store", found)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("part", [0.0, 0.1, 0.5, 0.9])
def test_a_truncated_database_is_refused_or_found(tmp_path: Path, part: float) -> None:
    with Store.open(tmp_path, create=True) as store, store.transaction("a") as change:
        for i in range(50):
            records.put_cell(change, f"cell {i}", b"%d" % i)
    path = tmp_path / "store.sqlite3"
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    try:
        with Store.open(tmp_path) as store:
            found = "; ".join(verify(store).faults)
    except StoreError as error:
        found = str(error)
    assert re.search("damaged|not an SQLite database|no store|missing", found)


def test_a_lost_server_leaves_nothing_half_done(database: Callable[[], str]) -> None:
    address = database()

    def lose(store: Store) -> None:
        with store.transaction("a") as change:
            records.put_cell(change, "cell 1", b"1")
            with other.backend.engine.begin() as connection:
                connection.exec_driver_sql(
                    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                    "WHERE datname = current_database() AND pid <> pg_backend_pid()"
                )
            records.put_cell(change, "cell 2", b"2")

    with Store.open(address, create=True) as store, Store.open(address) as other:
        before = store.head()
        with pytest.raises(StoreError, match=r"connection to the store was lost.*try again"):
            lose(store)
        assert store.head() == before
        with store.transaction("a") as change:  # the next change connects again
            records.put_cell(change, "cell 1", b"1")
        assert verify(store).faults == []


def test_the_application_s_role_may_append_but_not_change(database: Callable[[], str]) -> None:
    address = database()
    role = f"clerk_{time.monotonic_ns()}"
    with Store.open(address, create=True) as owner:
        with owner.backend.engine.begin() as connection:
            connection.exec_driver_sql(f"CREATE ROLE {role} LOGIN PASSWORD 'x'")
        try:
            owner.grant(role)
            url = sa.make_url(address).set(username=role, password="x").render_as_string(hide_password=False)
            with Store.open(url) as store:
                with store.transaction("a") as change:
                    records.put_cell(change, "cell", b"1")
                for statement in ("UPDATE audit SET action = 'x'", "DELETE FROM audit", "DELETE FROM blob"):
                    with pytest.raises(sa.exc.ProgrammingError, match="permission denied"):
                        _execute(store, statement)
        finally:
            with owner.backend.engine.begin() as connection:
                connection.exec_driver_sql(f"DROP OWNED BY {role}")
                connection.exec_driver_sql(f"DROP ROLE {role}")


def _execute(store: Store, statement: str) -> None:
    with store.backend.engine.begin() as connection:
        connection.exec_driver_sql(statement)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="writers are forked, so that 100 of them start fast")
@pytest.mark.exhaustive
def test_a_store_is_whole_after_its_writers_were_killed(address: str) -> None:
    """Two writers at once; each is killed at a random moment, and what it said was stored must be there."""
    halves = [[sys.executable, str(WRITER), address, str(KILLS // 2), str(seed)] for seed in (17, 18)]
    started = [subprocess.Popen(half, stdout=subprocess.PIPE, text=True) for half in halves]
    told = [line.split()[1] for one in started for line in one.communicate()[0].splitlines()]
    assert [one.returncode for one in started] == [0, 0]
    with Store.open(address) as store:
        assert verify(store).faults == []
        with store.reading() as connection:
            known = set(connection.execute(sa.select(schema.audit.c.hash)).scalars())
            cells, maps = (
                connection.execute(sa.select(sa.func.count()).select_from(table)).scalar()
                for table in (schema.cell, schema.map)
            )
    assert len(told) >= KILLS
    assert set(told) <= known
    assert cells == maps  # both rows of a change, or none
