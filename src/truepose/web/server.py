"""The server on this machine: address, token, browser."""

from __future__ import annotations

import gc
import logging
import os
import socket
import threading
import warnings
import webbrowser
from collections.abc import Callable
from contextlib import ExitStack, suppress
from contextvars import Context
from dataclasses import dataclass
from pathlib import Path

import uvicorn
from anyio import to_thread

from truepose.errors import DataError
from truepose.jobs import JobQueue
from truepose.web.app import create_app
from truepose.web.security import Gate, Guard
from truepose.web.team.address import Address
from truepose.web.team.guard import TeamGuard
from truepose.web.team.oidc import OIDC_CALLBACK, Provider, Settings
from truepose.web.team.team import Team
from truepose.web.workspace import Workspace

HOST = "127.0.0.1"


@dataclass(frozen=True)
class WithUsers:
    """A server with users.

    Attributes
    ----------
    store : str
        The address of the store.
    host : str
        The address that the server is bound to.
    url : str or None
        The address by which people reach the server; that of `host` if None.
    """

    store: str
    host: str = HOST
    url: str | None = None


class _Server(uvicorn.Server):
    """A server that stops the jobs first, so that pages see their end and close the connections to them."""

    def __init__(self, config: uvicorn.Config, jobs: JobQueue) -> None:
        super().__init__(config)
        self._jobs = jobs

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        await to_thread.run_sync(self._jobs.stop)
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)  # an answer that is cut off now is no error
        await super().shutdown(sockets)


def serve(
    root: Path,
    *,
    port: int,
    workers: int,
    browser: bool,
    announce: Callable[[str], None],
    users: WithUsers | None = None,
) -> None:
    """Serve a workspace until Ctrl-C.

    Parameters
    ----------
    root : Path
        The folder of the workspace.
    port : int
        The port; 0 for a free one.
    workers : int
        The largest number of jobs that run at once.
    browser : bool
        Whether to open the browser.
    announce : callable
        A function of the start URL.
    users : WithUsers, optional
        The store of the users, who log in; without it, who has the start URL is the one user.

    Raises
    ------
    DataError
        If the port is taken, or the address cannot be used.
    FileError
        If another application has the workspace.
    StoreError
        If the store cannot be used, or another server has it.
    """
    # in a context of its own: a command never overwrites what it has read, but requests read and save the same file
    Context().run(_serve, root, port, workers, browser, announce, users)


def _serve(
    root: Path, port: int, workers: int, browser: bool, announce: Callable[[str], None], users: WithUsers | None
) -> None:
    with ExitStack() as closing:
        team = None if users is None else _team(users, closing)
        listening = closing.enter_context(_listen(port, HOST if users is None else users.host))
        guard = _guard(listening.getsockname()[1], users, team)
        if team is not None and isinstance(guard, TeamGuard) and (settings := Settings.of(os.environ)) is not None:
            team.provider = Provider(settings, guard.address.url.rstrip("/") + OIDC_CALLBACK)
        app = create_app(Workspace(root), guard, workers=workers, ready=True, team=team)
        how = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=1,  # pages hold a connection open for the progress of jobs
        )
        closing.enter_context(app.state.jobs)
        gc.collect()
        gc.freeze()  # what was imported stays: looking through it again stops answers for a tenth of a second
        announce(guard.start_url)
        if browser:
            threading.Timer(0.3, webbrowser.open, [guard.start_url]).start()
        with suppress(KeyboardInterrupt):  # the way to stop it
            _Server(how, app.state.jobs).run(sockets=[listening])


def _team(users: WithUsers, closing: ExitStack) -> Team:
    """Return the users of a store that no other server has."""
    from truepose.store.store import Store
    from truepose.store.users import has_users

    store = closing.enter_context(Store.open(users.store))
    closing.enter_context(store.serve_lock())
    if not has_users(store):
        raise DataError("the store has no users; add the first one with: truepose store user add NAME --role admin")
    return Team(store, users.store)


def _guard(port: int, users: WithUsers | None, team: Team | None) -> Gate:
    if users is None or team is None:
        return Guard(port=port)
    address = Address.of(users.url, users.host, port)
    if address.in_clear:
        warnings.warn(
            f"{address.url} has no TLS: passwords cross the network in the clear; put a reverse proxy for TLS in front "
            "and state its address with --url https://NAME, see docs/administration.md",
            UserWarning,
            stacklevel=2,
        )
    return TeamGuard(address, team)


def _listen(port: int, host: str = HOST) -> socket.socket:
    """Return a socket that listens already, so that the start URL works as soon as it is shown."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listening = socket.create_server((host, port), family=family)
    except OSError as error:
        other = "choose another with --port" if host == HOST else "choose others with --port and --host"
        raise DataError(f"port {port} of {host} cannot be used: {error.strerror}; {other}") from None
    # asyncio sends small answers at once only if the socket states its protocol; else each waits for 40 ms
    return socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP, fileno=listening.detach())
