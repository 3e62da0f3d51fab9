"""The server on this machine: address, token, browser."""

from __future__ import annotations

import socket
import threading
import webbrowser
from collections.abc import Callable
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
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning", access_log=False, server_header=False))
    announce(guard.start_url)
    if browser:
        threading.Timer(0.3, webbrowser.open, [guard.start_url]).start()
    server.run(sockets=[listening])


def _listen(port: int) -> socket.socket:
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
    except OSError as error:
        listening.close()
        raise DataError(f"port {port} of {HOST} cannot be used: {error.strerror}; choose another with --port") from None
    return listening
