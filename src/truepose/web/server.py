"""The server on this machine: address, token, browser."""

from __future__ import annotations

import socket
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import uvicorn

from truepose.errors import DataError
from truepose.web.app import create_app
from truepose.web.security import Guard
from truepose.web.workspace import Workspace

HOST = "127.0.0.1"


def serve(root: Path, *, port: int, browser: bool, announce: Callable[[str], None]) -> None:
    """Serve a workspace until Ctrl-C.

    Parameters
    ----------
    root : Path
        The folder of the workspace.
    port : int
        The port; 0 for a free one.
    browser : bool
        Whether to open the browser.
    announce : callable
        A function of the start URL.

    Raises
    ------
    DataError
        If the port is taken.
    """
    listening = _listen(port)
    guard = Guard(port=listening.getsockname()[1])
    app = create_app(Workspace(root), guard)
    how = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=1,  # pages hold a connection open for the progress of jobs
    )
    announce(guard.start_url)
    if browser:
        threading.Timer(0.3, webbrowser.open, [guard.start_url]).start()
    with suppress(KeyboardInterrupt):  # the way to stop it
        uvicorn.Server(how).run(sockets=[listening])


def _listen(port: int) -> socket.socket:
    """Return a socket that listens already, so that the start URL works as soon as it is shown."""
    try:
        return socket.create_server((HOST, port))
    except OSError as error:
        raise DataError(f"port {port} of {HOST} cannot be used: {error.strerror}; choose another with --port") from None
