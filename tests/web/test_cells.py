"""Cells: the cell file as a form and as a text, with two tabs, hostile names and a full disk."""

from __future__ import annotations

import errno
import json
import os
import tomllib
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.tiers import examples

from truepose._io import commits
from truepose.cell import Cell, template
from truepose.web import Workspace, create_app
from truepose.web.cells.text import Change, changed
from truepose.web.security import CSRF_HEADER, Guard

API = "/api/v1"
BASE = "http://127.0.0.1:8765"
ROBOT = "kuka-kr150-2"
MARKUP = ["<img src=x onerror=alert(1)>", "</script><b>", "&lt;b&gt;", '"quoted"', "{{7*7}}", "$(reboot)", "[bold]x[/]"]
TRICKS = [
    "../../outside",
    "..",
    ".",
    "/etc/passwd",
    "C:\\temp\\x",
    "a/../../b",
    "\0null",
    "con",
    " ",
    "~root",
    ".hidden",
]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "work"


@pytest.fixture
def client(root: Path) -> TestClient:
    guard = Guard(port=8765)
    inside = TestClient(create_app(Workspace(root), guard), base_url=BASE, raise_server_exceptions=False)
    inside.cookies.set(guard.cookie, guard.session)
    inside.headers[CSRF_HEADER] = guard.csrf
    return inside


@pytest.fixture
def cell(client: TestClient) -> str:
    answer = client.post(f"{API}/cells", data={"name": "hall 3", "robot": ROBOT})
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


def read(client: TestClient, cell: str) -> tuple[dict[str, Any], str]:
    answer = client.get(f"{API}/cells/{cell}")
    assert answer.status_code == 200, answer.text
    return answer.json(), answer.headers["etag"]


def save(client: TestClient, cell: str, etag: str, **edit: Any) -> Any:
    return client.put(f"{API}/cells/{cell}", json=edit, headers={"If-Match": etag})


def test_a_new_cell_is_the_file_of_the_command_line(client: TestClient, root: Path, cell: str) -> None:
    written = (root / "hall 3" / "cell.toml").read_text("utf-8")
    assert written == template(ROBOT, robot_id=Cell.from_toml(written).robot_id)
    document, _ = read(client, cell)
    assert document["problems"] == []
    assert document["controller"] == "kuka"
    assert document["angles"] == ["a_deg", "b_deg", "c_deg"]
    assert document["values"]["robot"]["model"] == ROBOT
    assert document["schema"]["properties"].keys() == Cell.model_fields.keys()
    assert document["command"] == f'truepose init "hall 3" --robot {ROBOT}'
    (listed,) = client.get(f"{API}/cells").json()
    assert (listed["id"], listed["robot"], listed["problem"]) == (cell, "KUKA KR 150-2", None)


def test_a_cell_takes_the_robot_of_a_file(client: TestClient, root: Path) -> None:
    text = client.get(f"{API}/robots").json()
    assert {"name", "maker", "model", "reach_mm", "axes"} == text[0].keys()
    from truepose.robots import load_robot, to_toml

    content = to_toml(load_robot(ROBOT)).encode()
    files = {"file": ("../cell.toml", content)}
    answer = client.post(f"{API}/cells", data={"name": "own"}, files=files)
    assert answer.status_code == 201, answer.text
    assert sorted(path.name for path in (root / "own").iterdir()) == ["cell.toml", "robot.toml"]
    assert tomllib.loads((root / "own" / "cell.toml").read_text("utf-8"))["robot"]["model"] == "robot.toml"


@pytest.mark.parametrize(
    ("data", "files"),
    [
        ({"robot": "no-such-robot"}, None),
        ({"robot": "/etc/passwd"}, None),
        ({"robot": "../robot.toml"}, None),
        ({}, None),
        ({}, {"file": ("arm.exe", b"MZ")}),
        ({}, {"file": ("arm.toml", b"not a robot")}),
        ({}, {"file": ("arm.urdf", b"<robot><<")}),
        ({}, {"file": ("arm.toml", "größe = 1".encode("utf-16"))}),
    ],
)
def test_a_cell_without_a_robot_leaves_nothing(client: TestClient, root: Path, data: Any, files: Any) -> None:
    answer = client.post(f"{API}/cells", data={"name": "none", **data}, files=files)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert list(root.iterdir()) == []


@pytest.mark.parametrize("name", [*MARKUP, *TRICKS, "Zelle 1", "单元", "ゼル"])
def test_names_of_cells_are_never_paths(client: TestClient, root: Path, name: str) -> None:
    answer = client.post(f"{API}/cells", data={"name": name, "robot": ROBOT})
    assert answer.status_code == 201, answer.text
    (folder,) = root.iterdir()
    assert folder.is_dir()
    assert folder.parent == root
    assert not set('<>:"/\\|?*') & set(folder.name)
    assert not folder.name.startswith(".")  # hidden folders are not shown
    assert list(root.parent.iterdir()) == [root]
    (listed,) = client.get(f"{API}/cells").json()
    assert listed["id"] == answer.json()["id"]


def test_names_that_differ_in_case_only_are_two_cells(client: TestClient, root: Path) -> None:
    for name in ("Cell", "cell", "CELL"):
        assert client.post(f"{API}/cells", data={"name": name, "robot": ROBOT}).status_code == 201
    names = [path.name for path in root.iterdir()]
    assert len({name.lower() for name in names}) == 3


def test_two_tabs_lose_nothing(client: TestClient, root: Path, cell: str) -> None:
    document, etag = read(client, cell)
    first = document["text"].replace("max_correction_mm = 5.0", "max_correction_mm = 4.0")
    second = document["text"].replace("max_correction_mm = 5.0", "max_correction_mm = 3.0")
    assert save(client, cell, etag, text=first).status_code == 200
    answer = save(client, cell, etag, text=second)
    assert answer.status_code == 412
    problem = answer.json()
    assert (problem["current"], problem["yours"]) == (first, second)
    assert (root / "hall 3" / "cell.toml").read_text("utf-8") == first
    assert save(client, cell, problem["etag"], text=second).status_code == 200
    assert (root / "hall 3" / "cell.toml").read_text("utf-8") == second


def test_a_save_needs_the_version_that_was_changed(client: TestClient, cell: str) -> None:
    document, _ = read(client, cell)
    assert client.put(f"{API}/cells/{cell}", json={"text": document["text"]}).status_code == 428
    assert save(client, cell, '"of-nothing"', text=document["text"]).status_code == 412


def test_the_version_is_that_of_the_content_and_no_clock(client: TestClient, root: Path, cell: str) -> None:
    path = root / "hall 3" / "cell.toml"
    document, etag = read(client, cell)
    os.utime(path, (0, 0))  # a clock that was set back
    assert read(client, cell)[1] == etag
    before = path.stat()
    path.write_text(document["text"].replace("max_tool_mm = 50.0", "max_tool_mm = 51.0"), "utf-8")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert read(client, cell)[1] != etag
    assert save(client, cell, etag, text=document["text"]).status_code == 412


BAD_TEXTS = {
    "not TOML": "[robot\nmodel = 1",
    "no robot": "",
    "NaN": f'[robot]\nmodel = "{ROBOT}"\n[tool]\nx_mm = nan\n',
    "unknown key": f'[robot]\nmodel = "{ROBOT}"\n[tool]\nx_m = 1.0\n',
    "two tolerances": f'[robot]\nmodel = "{ROBOT}"\n[report]\ntolerance_mm = 1\n[correction]\ntolerance_mm = 2\n',
    "deep": "a = " + "[" * 200 + "]" * 200,
    "a robot that is no file": '[robot]\nmodel = "missing.toml"\n',
    "a robot with markup": '[robot]\nmodel = "<script>"\n',
}


@pytest.mark.parametrize("text", BAD_TEXTS.values(), ids=BAD_TEXTS.keys())
def test_refused_text_is_not_written(client: TestClient, root: Path, cell: str, text: str) -> None:
    path = root / "hall 3" / "cell.toml"
    before, (_, etag) = path.read_bytes(), read(client, cell)
    answer = save(client, cell, etag, text=text)
    assert answer.status_code == 422
    assert answer.json()["errors"]
    assert answer.json()["errors"] == client.post(f"{API}/cells/{cell}/check", json={"text": text}).json()["problems"]
    assert path.read_bytes() == before


def test_live_validation_names_every_key_with_its_line_and_remedy(client: TestClient, cell: str) -> None:
    text = template(ROBOT).replace("x_mm = 0.0", "x_mm = nan", 1).replace('fit = "pose"', 'fit = "posse"', 1)
    text += '\n[obstacles."my table"]\nx_mm = [5.0, 1.0]\ny_mm = [0.0, 1.0]\nz_mm = [0.0, 1.0]\n'
    lines = text.splitlines()
    found = client.post(f"{API}/cells/{cell}/check", json={"text": text}).json()["problems"]
    shown = {(one["table"], one["key"]): lines[one["line"] - 1] for one in found}
    assert {place: line.split("=")[0].strip() for place, line in shown.items()} == {
        ("tool", "x_mm"): "x_mm",
        ("tracker", "fit"): "fit",
        ("obstacles.my table", "x_mm"): "x_mm",
    }
    assert all(one["message"] for one in found)
    with pytest.raises(ValueError, match=found[0]["message"][:20]):
        Cell.from_toml(text)


def test_changes_of_keys_keep_comments_and_order(client: TestClient, cell: str) -> None:
    document, etag = read(client, cell)
    changes = [
        {"path": ["tool", "z_mm"], "value": 250},
        {"path": ["obstacles", "table"], "value": {"x_mm": [1, 2], "y_mm": [0, 1], "z_mm": [0, 1]}},
        {"path": ["report", "measured"], "value": "2026-03-31"},
        {"path": ["correction", "max_tool_mm"], "value": None},
    ]
    answer = save(client, cell, etag, changes=changes)
    assert answer.status_code == 200, answer.text
    text = answer.json()["text"]
    stated = tomllib.loads(text)
    assert isinstance(stated["tool"]["z_mm"], float)
    assert stated["report"]["measured"].isoformat() == "2026-03-31"
    assert "max_tool_mm" not in stated["correction"]
    kept = [line for line in document["text"].splitlines() if line.lstrip().startswith("#")]
    assert [line for line in text.splitlines() if line.lstrip().startswith("#")] == kept
    assert "z_mm = 250.0" in text
    old = [line for line in document["text"].splitlines() if not line.startswith(("z_mm", "max_tool_mm"))]
    assert [line for line in text.splitlines() if line in old][: len(old)] == old


@given(
    st.dictionaries(
        st.sampled_from(["x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"]),
        st.one_of(st.none(), st.floats(-1e5, 1e5), st.integers(-100000, 100000)),
        max_size=4,
    )
)
@settings(max_examples=examples(40))
def test_changed_keys_have_their_values_and_others_theirs(values: dict[str, float | None]) -> None:
    before = tomllib.loads(template(ROBOT))
    after = tomllib.loads(
        changed(template(ROBOT), [Change(path=["tool", key], value=value) for key, value in values.items()])
    )
    expected = {key: value for key, value in {**before["tool"], **values}.items() if value is not None}
    assert after == {**before, "tool": expected}


def test_a_check_writes_nothing_and_shows_the_changed_text(client: TestClient, root: Path, cell: str) -> None:
    before = (root / "hall 3" / "cell.toml").read_bytes()
    edit = {"text": template(ROBOT), "changes": [{"path": ["tool", "x_mm"], "value": 12.5}]}
    answer = client.post(f"{API}/cells/{cell}/check", json=edit).json()
    assert answer["values"]["tool"]["x_mm"] == 12.5
    assert answer["problems"] == []
    assert (root / "hall 3" / "cell.toml").read_bytes() == before


@pytest.mark.parametrize(
    "body",
    [
        '{"changes": [{"path": ["tool", "x_mm"], "value": NaN}]}',
        '{"changes": [{"path": ["tool", "x_mm"], "value": -Infinity}]}',
        '{"changes": [{"path": ["tool", "x_mm"], "value": 1e999}]}',
        '{"changes": [{"path": [], "value": 1}]}',
        '{"changes": [{"path": ["robot", "model", "deeper"], "value": 1}]}',
        '{"changes": [{"path": ["tool", "x_mm"], "value": "\\ud800"}]}',
        '{"text": "\\ud800"}',
        '{"text": 5}',
        "{}",
        "[",
        "",
    ],
)
def test_values_that_no_cell_file_can_hold_are_refused(client: TestClient, root: Path, cell: str, body: str) -> None:
    before, (_, etag) = (root / "hall 3" / "cell.toml").read_bytes(), read(client, cell)
    headers = {"If-Match": etag, "Content-Type": "application/json"}
    for call in (client.put, client.post):
        address = f"{API}/cells/{cell}" + ("/check" if call == client.post else "")
        answer = call(address, content=body, headers=headers)
        assert answer.status_code in (200, 422) if call == client.post else answer.status_code == 422, answer.text
        json.loads(answer.text, parse_constant=pytest.fail)
    assert (root / "hall 3" / "cell.toml").read_bytes() == before


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_line_ends_and_mark_of_a_file_from_windows_survive(
    client: TestClient, root: Path, cell: str, mark: bytes
) -> None:
    path = root / "hall 3" / "cell.toml"
    path.write_bytes(mark + template(ROBOT).replace("\n", "\r\n").encode())
    document, etag = read(client, cell)
    assert "\r" not in document["text"]  # as a page's text field holds it
    answer = save(client, cell, etag, text=document["text"].replace("max_tool_mm = 50.0", "max_tool_mm = 51.0"))
    assert answer.status_code == 200
    expected = template(ROBOT).replace("max_tool_mm = 50.0", "max_tool_mm = 51.0").replace("\n", "\r\n").encode()
    assert path.read_bytes() == mark + expected
    etag = answer.headers["etag"]
    assert save(client, cell, etag, changes=[{"path": ["tool", "x_mm"], "value": 1}]).status_code == 200
    assert path.read_bytes().count(b"\n") == path.read_bytes().count(b"\r\n")


@pytest.mark.parametrize(
    "content", [template(ROBOT).encode("utf-16"), b"\xff\xfe\x00", "größe".encode("shift-jis", "replace") + b"\x83\x65"]
)
def test_a_cell_file_that_cannot_be_read_is_listed_with_the_reason(
    client: TestClient, root: Path, cell: str, content: bytes
) -> None:
    (root / "hall 3" / "cell.toml").write_bytes(content)
    (listed,) = client.get(f"{API}/cells").json()
    assert listed["robot"] is None
    assert "UTF-8" in listed["problem"]
    assert client.get(f"{API}/cells/{cell}").status_code == 422


def test_a_full_disk_changes_nothing(
    client: TestClient, root: Path, cell: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = root / "hall 3" / "cell.toml"
    before, (document, etag) = path.read_bytes(), read(client, cell)

    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(commits.os, "fsync", full)
        answer = save(client, cell, etag, text=document["text"].replace("50.0", "51.0"))
        assert answer.status_code == 507
        assert "free some space" in answer.json()["detail"]
        assert client.post(f"{API}/cells", data={"name": "more", "robot": ROBOT}).status_code == 507
    assert path.read_bytes() == before
    assert sorted(entry.name for entry in root.iterdir()) == ["hall 3"]
    assert [entry.name for entry in path.parent.iterdir()] == ["cell.toml"]
    assert save(client, cell, etag, text=document["text"]).status_code == 200


def test_links_lead_nowhere(client: TestClient, root: Path, cell: str, tmp_path: Path) -> None:
    secret = tmp_path / "secret.csv"
    secret.write_text("row,x_meas_mm,y_meas_mm,z_meas_mm\nsecret", "utf-8")
    (root / "linked").mkdir()
    (root / "linked" / "cell.toml").symlink_to(secret)
    (root / "elsewhere").symlink_to(tmp_path)
    (root / "hall 3" / "samples.csv").symlink_to(secret)
    (root / "hall 3" / "maps").symlink_to(tmp_path)
    assert [one["id"] for one in client.get(f"{API}/cells").json()] == [cell]
    assert client.get(f"{API}/cells/{cell}/files").json() == []


def test_the_picture_of_an_unsaved_text_writes_nothing(client: TestClient, root: Path, cell: str) -> None:
    before = (root / "hall 3" / "cell.toml").read_bytes()
    text = template(ROBOT) + "\n[obstacles.post]\nx_mm = [1.0, 2.0]\ny_mm = [0.0, 1.0]\nz_mm = [0.0, 1.0]\n"
    picture = client.post(f"{API}/cells/{cell}/arm", json={"text": text}).json()
    assert [box["name"] for box in picture["obstacles"]] == ["post"]
    assert client.get(f"{API}/cells/{cell}/arm").json()["obstacles"] == []
    assert client.post(f"{API}/cells/{cell}/arm", json={"text": "[robot"}).status_code == 422
    assert (root / "hall 3" / "cell.toml").read_bytes() == before


def test_files_are_found_by_what_they_are_and_sent_as_downloads(client: TestClient, root: Path, cell: str) -> None:
    folder = root / "hall 3"
    (folder / "deep" / "er").mkdir(parents=True)
    (folder / "deep" / "er" / "a <b>.csv").write_text("row,x_meas_mm,y_meas_mm,z_meas_mm\n", "utf-8")
    (folder / "plan.csv").write_text("row,q1_deg\n0,1\n", "utf-8")
    (folder / "notes.csv").write_text("a,b\n", "utf-8")
    found = {one["name"]: one for one in client.get(f"{API}/cells/{cell}/files").json()}
    assert {name: one["kind"] for name, one in found.items()} == {"deep/er/a <b>.csv": "samples", "plan.csv": "plan"}
    answer = client.get(f"{API}/cells/{cell}/files/{found['plan.csv']['id']}")
    assert answer.content == b"row,q1_deg\n0,1\n"
    assert answer.headers["content-disposition"].startswith("attachment")
    assert client.get(f"{API}/cells/{cell}/files/000000000000").status_code == 404
    assert client.get(f"{API}/cells/{cell}/files/..%2F..%2Fetc%2Fpasswd").status_code == 404


def test_names_of_another_encoding_do_not_break_the_list(client: TestClient, root: Path, cell: str) -> None:
    name = os.fsdecode("セル".encode("shift-jis"))
    try:
        (root / name).mkdir()
        (root / name / "cell.toml").write_text(template(ROBOT), "utf-8")
        (root / "hall 3" / f"{name}.csv").write_text("row,q1_deg\n", "utf-8")
    except OSError:
        pytest.skip("this file system takes UTF-8 names only")
    listed = client.get(f"{API}/cells").json()
    assert len(listed) == 2
    other = next(one["id"] for one in listed if one["id"] != cell)
    assert client.get(f"{API}/cells/{other}").status_code == 200
    (file,) = client.get(f"{API}/cells/{cell}/files").json()
    assert client.get(f"{API}/cells/{cell}/files/{file['id']}").status_code == 200
