"""A PostgreSQL server of the ``pgserver`` wheel, in a folder of its own."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any, Self

import sqlalchemy as sa
from tests.needs import needed


class OwnServer:
    """A server that runs in the block, and that may be stopped and started in it."""

    def __enter__(self) -> Self:
        needed("psycopg", "'truepose[postgres]'")
        needed("pgserver", "pgserver, or set TRUEPOSE_POSTGRES_URL")
        # not in pytest's folder, which another run closes for the user that root's server runs as
        self._folder = Path(tempfile.mkdtemp(prefix="truepose-postgres-"))
        self._server = _started(self._folder / "data")
        self._server.psql("ALTER SYSTEM SET fsync = off")  # the machine itself does not crash here
        self._server.psql("SELECT pg_reload_conf()")
        self.url = sa.make_url(self._server.get_uri()).set(drivername="postgresql+psycopg")
        return self

    def __exit__(self, *_: object) -> None:
        self.start()
        self._server.cleanup()
        shutil.rmtree(self._folder, ignore_errors=True)

    def make_database(self, name: str) -> str:
        """Make a database and return its address."""
        self._server.psql(f"CREATE DATABASE {name}")
        return self.url.set(database=name).render_as_string(hide_password=False)

    def stop(self) -> None:
        """Stop the server at once, as a crash of it would."""
        from pgserver._commands import pg_ctl

        how = ["-w", "-m", "immediate", "stop"]
        with contextlib.suppress(subprocess.CalledProcessError):  # it is stopped already
            pg_ctl(how, pgdata=self._server.pgdata, user=self._server.system_user)

    def start(self) -> None:
        """Start the server again if it does not run."""
        self._server.ensure_postgres_running()


def _started(folder: Path) -> Any:
    """Start a server; it waits 10 s only, which a busy machine may exceed."""
    import pgserver

    for _ in range(10):
        with contextlib.suppress(subprocess.SubprocessError):
            return pgserver.get_server(folder, cleanup_mode="delete")
    return pgserver.get_server(folder, cleanup_mode="delete")
