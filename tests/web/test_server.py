"""``truepose app``: start, address, token, stop."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from truepose.web import server
from truepose.web.security import Guard


@pytest.fixture
def running(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    command = [sys.executable, "-m", "truepose", "app", str(tmp_path / "work"), "--port", "0", "--no-browser"]
    environment = {**os.environ, "COLUMNS": "200", "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        yield process, line.removeprefix("Open ").strip()
        process.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT for another process")
def test_the_command_prints_the_address_with_the_token_and_stops_by_interrupt(
    running: tuple[subprocess.Popen[str], str],
) -> None:
    process, url = running
    address = url.partition("?")[0]
    assert address.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(f"{address}version") as answer:
        assert answer.status == 200
    with pytest.raises(urllib.error.HTTPError, match="401"):
        urllib.request.urlopen(f"{address}api/v1/session")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 0
    assert errors == ""


def test_a_port_that_is_taken_is_named(run, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind((server.HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = run("app", tmp_path, "--port", port, "--no-browser")
    assert f"port {port} of 127.0.0.1 cannot be used" in result.failed()
    assert "--port" in result.err


def test_two_servers_have_two_tokens_and_two_cookies() -> None:
    one, other = Guard(port=1), Guard(port=2)
    assert len({one.token, other.token, one.session, other.session, one.csrf, other.csrf}) == 6
    assert one.cookie != other.cookie


def test_small_answers_are_sent_at_once() -> None:
    """asyncio switches the delay of small packets off only for sockets that state their protocol."""
    with server._listen(0) as listening, socket.create_connection(listening.getsockname()) as client:
        accepted, _ = listening.accept()
        with accepted:
            assert accepted.proto == socket.IPPROTO_TCP
            client.close()
