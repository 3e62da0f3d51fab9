"""Uploads of programs: names, limits, and what is left of an upload that ends early."""

from __future__ import annotations

import errno
import io
import os
import shutil
import stat
import subprocess
import sys
import threading
import tracemalloc
import zipfile
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any, ClassVar, cast

import anyio
import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request

from truepose.cli.setup import init  # the same file that the command writes
from truepose.web import Workspace, create_app, multipart, uploads
from truepose.web.security import CSRF_HEADER, Guard

BASE = "http://127.0.0.1:8765"
KRL = b"DEF a()\r\n$TOOL=$NULLFRAME\r\n$BASE=$NULLFRAME\r\nLIN {X 1500,Y 0,Z 900,A 0,B 90,C 0}\r\nEND\r\n"
BOUNDARY = "truepose-test"
FORM = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    root = tmp_path / "work"
    (root / "cell").mkdir(parents=True)
    init(root / "cell", robot="kuka-kr210-r2700-extra")
    return root


@pytest.fixture
def client(root: Path) -> TestClient:
    guard = Guard(port=8765)
    client = TestClient(create_app(Workspace(root), guard), base_url=BASE, raise_server_exceptions=False)
    client.get(f"/?token={guard.token}")
    client.headers[CSRF_HEADER] = guard.csrf
    return client


@pytest.fixture
def cell(root: Path) -> str:
    return Workspace(root).cells()[0].id


Files = list[tuple[str, bytes]]


def body(files: Files, *, ended: bool = True) -> bytes:
    """Return a multipart body as a browser writes it: names in UTF-8, quotes escaped."""
    parts = []
    for name, content in files:
        quoted = name.replace('"', "%22").replace("\r", "%0D").replace("\n", "%0A").encode("utf-8", "surrogateescape")
        head = b'Content-Disposition: form-data; name="files"; filename="' + quoted + b'"\r\n\r\n'
        parts.append(f"--{BOUNDARY}\r\n".encode() + head + content + b"\r\n")
    return b"".join(parts) + (f"--{BOUNDARY}--\r\n".encode() if ended else b"")


def send(client: TestClient, cell: str, files: Files, **how: Any) -> Any:
    return client.post(f"/api/v1/cells/{cell}/programs", content=body(files, **how), headers=FORM)


def tree(root: Path) -> list[str]:
    """Return all files below the cell's programs, hidden ones included."""
    folder = root / "cell" / "programs"
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir())


def zipped(names: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, content in names.items():
            archive.writestr(zipfile.ZipInfo(name), content, method)
    return file.getvalue()


def test_a_dropped_folder_keeps_its_files_together(client: TestClient, cell: str, root: Path) -> None:
    answer = send(client, cell, [("line 1/R1/a.src", KRL), ("line 1/R1/a.dat", b"DEFDAT a\r\nENDDAT\r\n")])
    assert answer.status_code == 201
    assert answer.json()["name"] == "line 1"
    assert answer.json()["files"] == ["R1/a.dat", "R1/a.src"]
    assert tree(root) == ["line 1/R1/a.dat", "line 1/R1/a.src"]
    assert (root / "cell/programs/line 1/R1/a.src").read_bytes() == KRL
    listed = client.get(f"/api/v1/cells/{cell}/programs").json()
    assert [(one["id"], one["languages"]) for one in listed] == [(answer.json()["id"], ["krl"])]


def test_loose_files_get_a_folder_that_is_named_after_a_program(client: TestClient, cell: str, root: Path) -> None:
    files = [("$config.dat", b"DEFDAT $CONFIG\nENDDAT\n"), ("list.txt", b""), ("weld.src", KRL), ("weld.dat", b"")]
    assert send(client, cell, files).json()["name"] == "weld"
    assert len(tree(root)) == 4


def test_an_upload_never_replaces_an_earlier_one(client: TestClient, cell: str, root: Path) -> None:
    names = [send(client, cell, [("a.src", KRL + bytes([65 + k]))]).json()["name"] for k in range(3)]
    names.append(send(client, cell, [("A.SRC", KRL)]).json()["name"])  # one folder on some systems
    assert names == ["a", "a-2", "a-3", "A-4"]
    assert (root / "cell/programs/a/a.src").read_bytes() == KRL + b"A"


@pytest.mark.parametrize(
    ("name", "stored"),
    [
        ("../../../evil.src", "evil/evil.src"),
        ("/etc/cron.d/evil.src", "etc/cron.d/evil.src"),
        ("C:\\Windows\\evil.src", "evil/evil.src"),
        ("up/..\\..\\evil.src", "up/evil.src"),
        ("a\x00b.src", "a_b/a_b.src"),
        ("<img src=x onerror=alert(1)>.src", "_img src=x onerror=alert(1)_/_img src=x onerror=alert(1)_.src"),
        ("con.src", "_con/_con.src"),
        (".hidden.src", "hidden/hidden.src"),
        ("ロボット.jbi", "ロボット/ロボット.jbi"),
        ("\udc83\udc8d.jbi", None),  # Shift-JIS bytes: no text, but a name all the same
        ("x" * 400 + ".src", None),
    ],
)
def test_names_are_never_paths(client: TestClient, cell: str, root: Path, name: str, stored: str | None) -> None:
    before = {path for path in root.parent.rglob("*") if path.is_file()}
    answer = send(client, cell, [(name, KRL)])
    assert answer.status_code == 201
    new = {path for path in root.parent.rglob("*") if path.is_file()} - before
    assert len(new) == 1
    assert new.pop().is_relative_to(root / "cell" / "programs")
    if stored is not None:
        assert tree(root) == [stored]


@pytest.mark.parametrize(
    "names", [("u/a.src", "u/A.SRC"), ("u/a.src", "u/a.src"), ("u/a", "u/a/b.src"), ("u/a/b.src", "u/A")]
)
def test_names_that_are_one_file_on_some_systems_are_refused(
    client: TestClient, cell: str, root: Path, names: tuple[str, ...]
) -> None:
    answer = send(client, cell, [(name, KRL) for name in names])
    assert answer.status_code == 422
    assert "case" in answer.json()["detail"] or "folder" in answer.json()["detail"]
    assert tree(root) == []


def bomb() -> bytes:
    return zipped({"a.src": b"0" * (200 << 20)})


def with_link() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        link = zipfile.ZipInfo("KRC/R1/link.src")
        link.create_system, link.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
        archive.writestr(link, "/etc/passwd")
        archive.writestr("KRC/R1/a.src", KRL)
    return file.getvalue()


REFUSED: dict[str, tuple[Callable[[], bytes], str]] = {
    "bomb": (bomb, "more than 100 times its size"),
    "upwards": (lambda: zipped({"../../evil.src": KRL}), "leads out of the .zip"),
    "absolute": (lambda: zipped({"/etc/evil.src": KRL}), "leads out of the .zip"),
    "drive": (lambda: zipped({"C:/evil.src": KRL}), "leads out of the .zip"),
    "case": (lambda: zipped({"a.src": KRL, "A.src": KRL}), "differ only in case"),
    "no zip": (lambda: b"PK\x03\x04 and nothing else", "is no .zip"),
    "truncated": (lambda: zipped({"a.src": KRL})[:-30], "is no .zip"),
    "many": (lambda: zipped({f"{k}.src": b"" for k in range(20_001)}, zipfile.ZIP_STORED), "20,001 files"),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("which", REFUSED)
def test_a_zip_that_is_no_backup_is_refused_and_not_kept(client: TestClient, cell: str, root: Path, which: str) -> None:
    make, words = REFUSED[which]
    answer = send(client, cell, [("backup <b>.zip", make())])
    assert answer.status_code == 422
    assert words in answer.json()["detail"]
    assert answer.json()["detail"].startswith("backup <b>.zip: ")
    assert str(root) not in answer.text
    assert tree(root) == []


def test_a_link_in_a_zip_is_never_followed(client: TestClient, cell: str, root: Path) -> None:
    answer = send(client, cell, [("backup.zip", with_link())])
    assert answer.status_code == 201
    assert answer.json()["languages"] == ["zip"]
    assert tree(root) == ["backup/backup.zip"]  # read in place, nothing is unpacked


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.999])
def test_an_upload_that_is_cut_off_leaves_nothing(client: TestClient, cell: str, root: Path, share: float) -> None:
    whole = body([("u/a.src", KRL * 100), ("u/b.src", KRL * 100)], ended=True)
    answer = client.post(f"/api/v1/cells/{cell}/programs", content=whole[: int(len(whole) * share)], headers=FORM)
    assert answer.status_code == 400
    assert tree(root) == []
    assert client.get(f"/api/v1/cells/{cell}/programs").json() == []


def test_a_body_that_is_no_form_is_refused(client: TestClient, cell: str, root: Path) -> None:
    address = f"/api/v1/cells/{cell}/programs"
    assert client.post(address, json={"files": []}).status_code == 415
    assert client.post(address, content=b"no form at all", headers=FORM).status_code == 400
    assert client.post(address, content=body([]), headers=FORM).status_code in (400, 422)
    assert tree(root) == []


def test_files_beyond_the_limits_are_refused(
    client: TestClient, cell: str, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uploads, "LARGEST_FILE", 1 << 20)
    answer = send(client, cell, [("a.src", b" " * (1 << 20)), ("b.src", b" " * ((1 << 20) + 1))])
    assert answer.status_code == 413
    assert answer.json()["detail"].startswith("b.src has more than 1 MB")
    monkeypatch.setattr(multipart, "MOST_FILES", 3)
    assert send(client, cell, [(f"{k}.src", KRL) for k in range(4)]).status_code == 413
    assert tree(root) == []


def test_two_gigabytes_are_refused_by_their_stated_size(client: TestClient, cell: str, root: Path) -> None:
    headers = {**FORM, "Content-Length": str(2 << 30)}
    assert client.post(f"/api/v1/cells/{cell}/programs", content=b"", headers=headers).status_code == 413


class _Arriving:
    """A request whose body arrives in pieces of 64 KiB, as from a socket."""

    headers: ClassVar = {"content-type": f"multipart/form-data; boundary={BOUNDARY}"}

    def __init__(self, size: int) -> None:
        self.size = size

    async def stream(self) -> AsyncIterator[bytes]:
        yield body([("a.src", b"")], ended=False)[:-2]
        for _ in range(self.size >> 16):
            yield bytes(1 << 16)
        yield b"\r\n" + f"--{BOUNDARY}--\r\n".encode()


def test_a_long_body_is_not_held_in_memory(tmp_path: Path) -> None:
    async def receive() -> None:
        async with multipart.received(cast(Request, _Arriving(48 << 20)), tmp_path / "programs") as upload:
            assert [path.stat().st_size for path in upload.paths()] == [48 << 20]

    tracemalloc.start()
    try:
        anyio.run(receive)
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()
    assert list(tmp_path.rglob("*")) == []  # nothing was kept


class _Full(io.RawIOBase):
    def writable(self) -> bool:
        return True

    def write(self, _data: Any) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_leaves_nothing(client: TestClient, cell: str, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = Path.open

    def full(self: Path, mode: str = "r", *rest: Any, **more: Any) -> Any:
        return _Full() if mode == "xb" and self.name == "b.src" else opened(self, mode, *rest, **more)

    monkeypatch.setattr(Path, "open", full)
    answer = send(client, cell, [("a.src", KRL), ("b.src", KRL)])
    assert answer.status_code == 507
    assert "disk is full" in answer.json()["detail"]
    assert tree(root) == []


_KILLED = """
import asyncio, os, signal, sys
from pathlib import Path
from truepose.web import multipart

class Request:
    headers = {"content-type": "multipart/form-data; boundary=b"}
    async def stream(self):
        yield b'--b\\r\\nContent-Disposition: form-data; name="files"; filename="a.src"\\r\\n\\r\\n' + bytes(3 << 20)
        yield bytes(3 << 20)
        os.kill(os.getpid(), signal.SIGKILL)

async def main():
    async with multipart.received(Request(), Path(sys.argv[1])):
        pass

asyncio.run(main())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_server_that_is_killed_during_an_upload_shows_nothing(client: TestClient, cell: str, root: Path) -> None:
    folder = root / "cell" / "programs"
    subprocess.run([sys.executable, "-c", _KILLED, str(folder)], check=False)
    (draft,) = folder.iterdir()  # really killed in the middle
    assert (draft / "a.src").stat().st_size >= 3 << 20
    assert client.get(f"/api/v1/cells/{cell}/programs").json() == []
    assert [one for one in Workspace(root).cells()[0].files() if one.kind == "program"] == []
    for path in (draft, draft / "a.src"):
        os.utime(path, (0, 0))
    assert send(client, cell, [("b.src", KRL)]).status_code == 201
    assert tree(root) == ["b/b.src"]


def test_uploads_of_one_name_at_the_same_time_get_folders_of_their_own(
    client: TestClient, cell: str, root: Path
) -> None:
    answers: list[int] = []
    threads = [
        threading.Thread(target=lambda k=k: answers.append(send(client, cell, [("a.src", bytes([k]))]).status_code))
        for k in range(6)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answers == [201] * 6
    kept = {(root / "cell/programs" / name).read_bytes() for name in tree(root)}
    assert kept == {bytes([k]) for k in range(6)}


def test_an_upload_that_ends_meanwhile_is_no_fault_of_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / ".upload-other").mkdir()
    walk = os.walk

    def gone(folder: Any) -> Any:
        shutil.rmtree(folder)
        return walk(folder)

    monkeypatch.setattr(os, "walk", gone)
    assert multipart._draft(tmp_path).is_dir()
