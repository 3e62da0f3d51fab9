"""Jobs of the pages: list, progress as it happens, cancelling, running again, and the end of the server."""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import httpx2
import pytest
from fastapi.testclient import TestClient

from truepose.jobs import JobQueue
from truepose.web import Workspace, create_app
from truepose.web.jobs import _REPEAT, _events
from truepose.web.security import CSRF_HEADER, Guard

API = "/api/v1"
SLOW = ("study", "--seeds", "1000", "--per-axis", "4")
QUICK = ("robots", "kuka-kr150-2")
LONG = 120.0


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    guard = Guard(port=8765)
    app = create_app(Workspace(tmp_path / "work"), guard)
    with TestClient(app, base_url="http://127.0.0.1:8765", raise_server_exceptions=False) as inside:
        inside.cookies.set(guard.cookie, guard.session)
        inside.headers[CSRF_HEADER] = guard.csrf
        yield inside


@pytest.fixture
def queue(client: TestClient) -> JobQueue:
    made: JobQueue = client.app.state.jobs  # type: ignore[attr-defined]
    return made


def submit(queue: JobQueue, *command: str, cell: str = "a") -> str:
    return queue.submit(command, folder=queue._workspace, cell=cell, title=" ".join(command)).id


def events(text: str) -> list[tuple[str, Any]]:
    """Return the ids and the data of server-sent events."""
    return [(one, json.loads(data)) for one, data in re.findall(r"^id: (.*)\ndata: (.*)\n\n", text, re.MULTILINE)]


def test_jobs_are_listed_newest_first_and_filtered(client: TestClient, queue: JobQueue) -> None:
    first, second = submit(queue, *QUICK), submit(queue, *QUICK, cell="b")
    queue.wait(second, timeout=LONG)
    listed = client.get(f"{API}/jobs").json()
    assert [job["id"] for job in listed] == [second, first]
    assert all(job["result"] is None for job in listed)
    assert [job["id"] for job in client.get(f"{API}/jobs", params={"cell": "b"}).json()] == [second]
    assert [job["id"] for job in client.get(f"{API}/jobs", params={"limit": 1}).json()] == [second]
    assert client.get(f"{API}/jobs", params={"state": ["queued", "failed"]}).json() == []
    assert len(client.get(f"{API}/jobs", params={"state": ["done", "failed"]}).json()) == 2
    assert client.get(f"{API}/jobs", params={"state": "flying"}).status_code == 422


def test_a_job_has_its_command_and_its_result(client: TestClient, queue: JobQueue, run: Any) -> None:
    job = submit(queue, *QUICK)
    queue.wait(job, timeout=LONG)
    shown = client.get(f"{API}/jobs/{job}").json()
    assert (shown["state"], shown["command"], shown["folder"]) == ("done", list(QUICK), ".")
    assert shown["result"] == run(*QUICK, "--json").json
    whole = client.get(f"{API}/jobs/{job}/result")
    assert whole.json() == shown["result"]
    assert len(whole.content) == shown["result_bytes"]


@pytest.mark.parametrize("job", ["00000001-00000000", "..", "%2e%2e%2f", "lock", "<b>"])
@pytest.mark.parametrize(("method", "rest"), [("GET", ""), ("GET", "/result"), ("GET", "/events"), ("DELETE", "")])
def test_unknown_jobs_are_not_found(client: TestClient, method: str, rest: str, job: str) -> None:
    answer = client.request(method, f"{API}/jobs/{job}{rest}")
    assert answer.status_code in (404, 405), answer.text
    assert answer.headers["content-type"] == "application/problem+json"


def test_a_job_is_cancelled_and_run_again(client: TestClient, queue: JobQueue) -> None:
    job = submit(queue, *SLOW)
    refused = client.post(f"{API}/jobs/{job}/run")
    assert (refused.status_code, refused.json()["type"]) == (409, "RefusedError")
    assert client.delete(f"{API}/jobs/{job}").json()["state"] == "cancelled"
    again = client.post(f"{API}/jobs/{job}/run")
    assert again.status_code == 202
    assert again.json()["id"] > job
    assert again.json()["command"] == list(SLOW)


def test_a_refusal_is_a_problem_document(client: TestClient, queue: JobQueue) -> None:
    (queue._workspace / "cell.toml").write_text("[robot\n")
    job = submit(queue, "plan", "cell.toml", "--n", "5", "--out", "plan")
    queue.wait(job, timeout=LONG)
    shown = client.get(f"{API}/jobs/{job}").json()
    assert shown["state"] == "failed"
    assert {"type": "FileError", "status": 422, "file": "cell.toml", "line": 1}.items() <= shown["problem"].items()


@pytest.mark.exhaustive
def test_every_change_is_an_event_and_the_last_one_holds_the_result(client: TestClient, queue: JobQueue) -> None:
    job = submit(queue, "warm-up")
    answer = client.get(f"{API}/jobs/{job}/events")
    assert answer.headers["content-type"].startswith("text/event-stream")
    found = events(answer.text)
    *earlier, (last_id, last) = found
    assert all(data["state"] in ("queued", "running") for _, data in earlier)
    assert (last["state"], last["result"]) == ("done", queue.get(job).result)
    assert any(data["done"] for _, data in found)
    revisions = [data["revision"] for _, data in found]
    assert revisions == sorted(revisions)
    seen = client.get(f"{API}/jobs/{job}/events", headers={"Last-Event-ID": last_id})
    assert (seen.status_code, seen.text) == (204, "")
    earlier_end = client.get(f"{API}/jobs/{job}/events", headers={"Last-Event-ID": "3-running"})
    assert events(earlier_end.text) == [(last_id, last)]


async def _first(queue: JobQueue, job: str, seen: str | None, count: int) -> str:
    """Return the text of the first events of a job."""
    text = ""
    async for part in _events(queue, queue.get(job), seen):
        text += part.decode()
        if len(events(text)) + text.count(": still") >= count:
            break
    return text


@pytest.mark.exhaustive
def test_a_running_job_has_two_events_a_second_without_any_change(
    queue: JobQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    import anyio

    job = submit(queue, *SLOW)
    revision = -1
    while queue.get(job).step is None:
        revision = queue.wait(job, after=revision, timeout=LONG).revision
    with monkeypatch.context() as patch:
        patch.setattr("truepose.jobs.run.Run.take", lambda *_: {})
        text = anyio.run(_first, queue, job, None, 5)
    assert _REPEAT <= 0.5
    assert len({one for one, _ in events(text)}) < 5
    queue.cancel(job)


def test_a_waiting_job_keeps_the_connection_alive(queue: JobQueue, monkeypatch: pytest.MonkeyPatch) -> None:
    import anyio

    monkeypatch.setattr("truepose.web.jobs._BEAT", 0.2)
    first, waiting = submit(queue, *SLOW), submit(queue, *QUICK)
    text = anyio.run(_first, queue, waiting, f"{queue.revision(waiting)}-queued", 2)
    assert text.count(": still there\n\n") == 2
    assert events(text) == []
    queue.cancel(first)


# --- the real server -------------------------------------------------------------------------------------------


class Server:
    """``truepose app`` in a process, and a client that has opened its start URL."""

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-m", "truepose", "app", str(folder), "--port", "0", "--no-browser"]
        environment = {**os.environ, "COLUMNS": "200", "PYTHONUNBUFFERED": "1"}
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
        )
        assert self.process.stdout is not None
        url = self.process.stdout.readline().removeprefix("Open ").strip()
        assert url, self.process.communicate()
        self.client = httpx2.Client(base_url=url.partition("/?")[0], timeout=LONG)
        self.client.get(f"/?token={url.partition('token=')[2]}")
        self.client.headers[CSRF_HEADER] = self.client.get(f"{API}/session").json()["csrf"]

    def start(self, folder: Path) -> dict[str, Any]:
        """Run a slow job again that an earlier queue has left there."""
        (job,) = self.client.get(f"{API}/jobs").json()
        answer = self.client.post(f"{API}/jobs/{job['id']}/run")
        assert answer.status_code == 202
        return dict(answer.json())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A workspace with a cancelled job, which can be run again."""
    (tmp_path / "work").mkdir()
    with JobQueue(tmp_path / "work", ready=False) as queue:
        queue.cancel(submit(queue, *SLOW))
    return tmp_path / "work"


@pytest.fixture
def server(folder: Path) -> Iterator[Server]:
    made = Server(folder)
    yield made
    made.process.kill()
    made.process.communicate()


posix = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")


@pytest.mark.exhaustive
@posix
def test_an_interrupt_ends_jobs_pages_and_server(server: Server, folder: Path) -> None:
    job = server.start(folder)
    seen: list[str] = []

    def follow() -> None:
        with (
            contextlib.suppress(httpx2.HTTPError),
            server.client.stream("GET", f"{API}/jobs/{job['id']}/events") as stream,
        ):
            seen.extend(stream.iter_text())

    page = threading.Thread(target=follow)
    page.start()
    while not any('"state":"running"' in text for text in seen):
        time.sleep(0.05)
    server.process.send_signal(signal.SIGINT)
    _, errors = server.process.communicate(timeout=LONG)
    page.join(LONG)
    assert (server.process.returncode, errors) == (0, "")
    assert events("".join(seen))[-1][1]["state"] == "interrupted"


@pytest.mark.exhaustive
@posix
def test_a_job_of_a_killed_server_is_interrupted_and_runs_again(server: Server, folder: Path) -> None:
    job = server.start(folder)
    while server.client.get(f"{API}/jobs/{job['id']}").json()["state"] != "running":
        time.sleep(0.05)
    server.process.kill()
    server.process.communicate()
    later = Server(folder)
    try:
        shown = later.client.get(f"{API}/jobs/{job['id']}").json()
        assert shown["state"] == "interrupted"
        assert "run it again" in shown["problem"]["detail"]
        again = later.client.post(f"{API}/jobs/{job['id']}/run").json()
        assert later.client.delete(f"{API}/jobs/{again['id']}").json()["state"] == "cancelled"
    finally:
        later.process.kill()
        later.process.communicate()


@pytest.mark.exhaustive
def test_a_second_server_in_the_workspace_is_refused_in_one_line(server: Server, folder: Path, run: Any) -> None:
    message = run("app", folder, "--port", "0", "--no-browser").failed()
    assert f"in use by another truepose app (process {server.process.pid})" in message


@pytest.mark.exhaustive
def test_the_real_server_may_save_a_file_that_it_has_read_or_written(server: Server) -> None:
    made = server.client.post(f"{API}/cells", data={"name": "hall", "robot": "kuka-kr150-2"})
    assert made.status_code == 201, made.text
    address = f"{API}/cells/{made.json()['id']}"
    for _ in range(2):
        read = server.client.get(address)
        text = read.json()["text"] + "# changed\n"
        saved = server.client.put(address, json={"text": text}, headers={"If-Match": read.headers["etag"]})
        assert saved.status_code == 200, saved.text


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform != "linux", reason="reads the memory from /proc")
def test_two_gigabytes_are_refused_while_they_stream_and_take_neither_memory_nor_disk(
    server: Server, folder: Path
) -> None:
    made = server.client.post(f"{API}/cells", data={"name": "hall", "robot": "kuka-kr150-2"}).json()
    programs, before = folder / "hall" / "programs", _memory(server)
    headers = {
        "Content-Type": "multipart/form-data; boundary=b",
        "Cookie": "; ".join(f"{name}={value}" for name, value in server.client.cookies.items()),
        CSRF_HEADER: server.client.headers[CSRF_HEADER],
        "Transfer-Encoding": "chunked",  # no length is stated
    }
    sent, on_disk, memory, piece = 0, 0, 0, bytes(1 << 20)
    with contextlib.closing(HTTPConnection("127.0.0.1", server.client.base_url.port, timeout=LONG)) as connection:
        connection.putrequest("POST", f"{API}/cells/{made['id']}/programs")
        for header in headers.items():
            connection.putheader(*header)
        head = b'--b\r\nContent-Disposition: form-data; name="files"; filename="a.src"\r\n\r\n'
        connection.endheaders()
        connection.send(b"%x\r\n%b\r\n" % (len(head), head))
        while sent < 2 << 30 and not select.select([connection.sock], [], [], 0)[0]:
            connection.send(b"%x\r\n%b\r\n" % (len(piece), piece))
            sent += len(piece)
            on_disk = max(on_disk, sum(_size(path) for path in programs.rglob("*")))
            memory = max(memory, _memory(server))
        answer = connection.getresponse()
        assert answer.status == 413
        assert "a.src has more than 64 MB" in json.loads(answer.read())["detail"]
    assert 64 << 20 <= sent < 128 << 20
    assert 0 < on_disk <= 64 << 20
    assert memory - before < 32 << 20
    assert server.client.get(f"{API}/cells/{made['id']}/programs").json() == []
    assert [path for path in programs.rglob("*") if path.is_file()] == []


def _size(path: Path) -> int:
    """Return the size of a file, which may have gone."""
    with contextlib.suppress(FileNotFoundError):
        return path.stat().st_size if path.is_file() else 0
    return 0


def _memory(server: Server) -> int:
    """Return the resident memory of the server in bytes."""
    (line,) = re.findall(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{server.process.pid}/status").read_text("ascii"))
    return int(line) << 10
