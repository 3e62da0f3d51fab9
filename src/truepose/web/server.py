"""The server on this machine: address, token, browser."""

from __future__ import annotations

import socket
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from contextvars import Context
from pathlib import Path

import uvicorn
from anyio import to_thread

from truepose.errors import DataError
from truepose.jobs import JobQueue
from truepose.web.app import create_app
from truepose.web.security import Guard
from truepose.web.workspace import Workspace

HOST = "127.0.0.1"


class _Server(uvicorn.Server):
    """A server that stops the jobs first, so that pages see their end and close the connections to them."""

    def __init__(self, config: uvicorn.Config, jobs: JobQueue) -> None:
        super().__init__(config)
        self._jobs = jobs

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        await to_thread.run_sync(self._jobs.stop)
        await super().shutdown(sockets)


def serve(root: Path, *, port: int, workers: int, browser: bool, announce: Callable[[str], None]) -> None:
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

    Raises
    ------
    DataError
        If the port is taken.
    FileError
        If another application has the workspace.
    """
    # in a context of its own: a command never overwrites what it has read, but requests read and save the same file
    Context().run(_serve, root, port, workers, browser, announce)


def _serve(root: Path, port: int, workers: int, browser: bool, announce: Callable[[str], None]) -> None:
    listening = _listen(port)
    guard = Guard(port=listening.getsockname()[1])
    app = create_app(Workspace(root), guard, workers=workers, ready=True)
    how = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=1,  # pages hold a connection open for the progress of jobs
    )
    with app.state.jobs:
        announce(guard.start_url)
        if browser:
            threading.Timer(0.3, webbrowser.open, [guard.start_url]).start()
        with suppress(KeyboardInterrupt):  # the way to stop it
            _Server(how, app.state.jobs).run(sockets=[listening])


def _listen(port: int) -> socket.socket:
    """Return a socket that listens already, so that the start URL works as soon as it is shown."""
    try:
        listening = socket.create_server((HOST, port))
    except OSError as error:
        raise DataError(f"port {port} of {HOST} cannot be used: {error.strerror}; choose another with --port") from None
    # asyncio sends small answers at once only if the socket states its protocol; else each waits for 40 ms
    return socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP, fileno=listening.detach())
