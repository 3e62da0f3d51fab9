"""Meshes of arms over the web: uploads, their bad cases, the store, and the process that computes them."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from tests.web.arm_files import GOOD, MODEL, Files, sphere, stl, urdf, visual

from truepose.cell import load_cell, template
from truepose.web import Workspace, create_app, uploads
from truepose.web.meshes import build as mesh_build
from truepose.web.meshes import store as mesh_store
from truepose.web.meshes.build import BUDGET, Task, build
from truepose.web.security import CSRF_HEADER, Guard


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "cell.toml").write_text(template(MODEL), "utf-8")
    return tmp_path


@pytest.fixture
def client(root: Path) -> TestClient:
    guard = Guard(port=8765)
    client = TestClient(
        create_app(Workspace(root), guard), base_url="http://127.0.0.1:8765", raise_server_exceptions=False
    )
    client.get(f"/?token={guard.token}")
    client.headers[CSRF_HEADER] = guard.csrf
    return client


@pytest.fixture
def address(root: Path) -> str:
    return f"/api/v1/cells/{Workspace(root).cells()[0].id}/meshes"


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> list[Task]:
    """Compute in this process; return the tasks."""
    tasks = []

    def run(task: Task) -> Any:
        tasks.append(task)
        with task.out.open("xb") as out:
            return build(load_cell(task.cell).load_robot(), task.files, out)

    monkeypatch.setattr(mesh_store, "_in_own_process", run)
    return tasks


def send(client: TestClient, address: str, files: Files) -> Any:
    return client.post(address, files=[("files", (name, content)) for name, content in files.items()])


def zipped(files: Files) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return file.getvalue()


def kept(root: Path) -> list[str]:
    folder = root / ".truepose" / "meshes"
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_upload_again_and_remove(client: TestClient, address: str, root: Path, here: list[Task]) -> None:
    assert client.get(address).json()["hash"] is None
    assert client.get(f"{address}.bin").status_code == 404
    answer = send(client, address, GOOD)
    assert answer.status_code == 201
    index = answer.json()
    assert client.get(address).json() == index
    data = client.get(f"{address}.bin", params={"version": index["hash"]})
    assert len(data.content) == index["size"]
    assert "immutable" in data.headers["cache-control"]
    assert "immutable" not in client.get(f"{address}.bin", params={"version": "0"}).headers["cache-control"]
    assert send(client, address, GOOD).json() == index
    assert len(here) == 1
    assert len(kept(root)) == 3
    other = send(client, address, {"arm.zip": zipped(GOOD)}).json()
    assert other["hash"] != index["hash"]
    assert other["parts"] == index["parts"]
    assert len(kept(root)) == 3  # those that no cell uses are gone
    assert client.delete(address).status_code == 204
    assert client.delete(address).status_code == 204
    assert client.get(address).json()["hash"] is None
    assert kept(root) == []


def test_a_refused_upload_changes_nothing(client: TestClient, address: str, root: Path, here: list[Task]) -> None:
    index = send(client, address, GOOD).json()
    before = kept(root)
    answer = send(client, address, {"a.urdf": b"<robot>"})
    assert answer.status_code == 422
    assert answer.json()["line"] == 1
    assert str(root) not in answer.text
    assert client.get(address).json() == index
    assert kept(root) == before


@pytest.mark.parametrize("damage", ["index", "data", "pointer"])
def test_damaged_caches_are_as_good_as_none(
    client: TestClient, address: str, root: Path, here: list[Task], damage: str
) -> None:
    index = send(client, address, GOOD).json()
    folder = root / ".truepose" / "meshes"
    pointer = next((folder / "cells").iterdir())
    path = {
        "index": folder / index["hash"] / "index.json",
        "data": folder / index["hash"] / "mesh.bin",
        "pointer": pointer,
    }
    path[damage].write_bytes(b"../../../one" if damage == "pointer" else b"[")
    assert client.get(address).json()["hash"] is None
    assert client.get(f"{address}.bin").status_code == 404
    assert send(client, address, GOOD).json() == index
    assert len(client.get(f"{address}.bin").content) == index["size"]


def test_meshes_of_another_robot_are_stale(client: TestClient, address: str, root: Path, here: list[Task]) -> None:
    index = send(client, address, GOOD).json()
    file = root / "one" / "cell.toml"
    text = file.read_text("utf-8")
    file.write_text(text.replace(MODEL, "kuka-kr210-r2700-extra"), "utf-8")
    now = client.get(address).json()
    assert (now["hash"], now["stale"], now["parts"]) == (None, True, [])
    assert client.get(f"{address}.bin").status_code == 404
    file.write_text(text, "utf-8")
    assert client.get(address).json() == index


def test_two_cells_share_meshes(client: TestClient, address: str, root: Path, here: list[Task]) -> None:
    (root / "two").mkdir()
    (root / "two" / "cell.toml").write_text(template(MODEL), "utf-8")
    first, second = (f"/api/v1/cells/{cell.id}/meshes" for cell in Workspace(root).cells())
    assert send(client, first, GOOD).json() == send(client, second, GOOD).json()
    assert len(here) == 1
    client.delete(first)
    assert client.get(second).json()["hash"] is not None


def bad_zip(name: str, content: bytes = stl()) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for given, data in GOOD.items():
            archive.writestr(given, data)
        info = zipfile.ZipInfo(name)
        info.compress_type = zipfile.ZIP_DEFLATED
        archive.writestr(info, content)
    return file.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (bad_zip("../up.stl"), "leads out of the .zip"),
        (bad_zip("/etc/up.stl"), "leads out of the .zip"),
        (bad_zip("C:\\up.stl"), "leads out of the .zip"),
        (bad_zip("arm/meshes/BOX.stl"), "differ only in case"),
        (bad_zip("bomb.stl", bytes(200 << 20)), "more than 100 times its size"),
        (b"PK", "is no .zip"),
    ],
)
def test_a_bad_zip_is_refused_whole(
    client: TestClient, address: str, root: Path, here: list[Task], content: bytes, words: str
) -> None:
    answer = send(client, address, {"arm.zip": content})
    assert answer.status_code == 422
    assert words in answer.json()["detail"]
    assert kept(root) == []


def test_a_link_in_a_zip_is_not_followed(client: TestClient, address: str, here: list[Task]) -> None:
    files = {"a.urdf": urdf({"link_1": visual("secret.stl"), "link_2": visual("box.stl")}), "box.stl": stl()}
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
        info = zipfile.ZipInfo("secret.stl")
        info.create_system, info.external_attr = 3, 0o120777 << 16
        archive.writestr(info, "/etc/passwd")
    notes = send(client, address, {"arm.zip": file.getvalue()}).json()["notes"]
    assert [note["kind"] for note in notes] == ["link", "missing"]
    assert "secret.stl" in notes[0]["name"]


def test_names_of_a_dropped_folder_are_never_paths(
    client: TestClient, address: str, root: Path, here: list[Task]
) -> None:
    files = {"../../arm/urdf/a.urdf": GOOD["arm/urdf/a.urdf"], "C:\\x\\arm\\meshes\\box.stl": stl()}
    before = {path for path in root.parent.rglob("*") if ".truepose" not in path.parts}
    index = send(client, address, files).json()
    assert index["notes"] == []
    assert {path for path in root.parent.rglob("*") if ".truepose" not in path.parts} == before
    answer = send(client, address, {"a/x.urdf": b"1", "a/X.urdf": b"2"})
    assert answer.status_code == 422
    assert "case" in answer.json()["detail"]


def test_a_large_upload_is_refused(client: TestClient, address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploads, "LARGEST_FILE", 1000)
    answer = send(client, address, {"a.stl": bytes(2000)})
    assert answer.status_code == 413


@pytest.mark.exhaustive
def test_the_work_is_done_in_another_process(
    client: TestClient, address: str, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Readers and the reduction hold Python's lock for seconds, in which a server would answer nobody."""

    def here(*_: Any) -> None:
        raise AssertionError("computed in the process of the server")

    monkeypatch.setattr(mesh_build, "build", here)
    points, faces = sphere(250)  # more than the budget
    answer = send(client, address, GOOD | {"arm/meshes/box.stl": stl(points, faces)})
    assert answer.status_code == 201
    index = answer.json()
    assert index["source_triangles"] == len(faces)
    assert 0 < index["triangles"] <= BUDGET
    assert len(client.get(f"{address}.bin").content) == index["size"]
    broken = send(client, address, {"a.urdf": b"<robot>"})
    assert (broken.status_code, broken.json()["file"], broken.json()["line"]) == (422, "a.urdf", 1)
    assert broken.json()["detail"].count("a.urdf") == 1


def test_a_process_that_dies_or_hangs_is_told(
    client: TestClient, address: str, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_store, "_DEADLINE_S", 0.01)
    answer = send(client, address, GOOD)
    assert answer.status_code == 422
    assert "take more than" in answer.json()["detail"]
    monkeypatch.undo()
    monkeypatch.setattr(mesh_store.sys, "executable", "/bin/false")
    answer = send(client, address, GOOD)
    assert answer.status_code == 422
    assert "lower resolution" in answer.json()["detail"]
    assert kept(root) == []
