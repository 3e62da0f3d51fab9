"""Programs: checks and corrections run as commands, with the results and the refusals of the command line."""

from __future__ import annotations

import inspect
import io
import json
import os
import re
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main
from fastapi.testclient import TestClient
from pydantic import BaseModel
from scipy.spatial.transform import Rotation

from truepose.cli import app as truepose_app
from truepose.error_map import fit_cell
from truepose.geometry import euler
from truepose.simulation import VirtualCell
from truepose.web import Workspace, create_app
from truepose.web.programs import commands as program_commands
from truepose.web.programs.commands import CorrectionOptions, ReadingOptions, arguments
from truepose.web.security import CSRF_HEADER, Guard

BASE = "http://127.0.0.1:8765"
LONG = 120.0


def krl(virtual: VirtualCell, n: int, name: str = "panel", comment: str = "") -> bytes:
    """Return a program in the region of the map; its first target is in a base that is not known."""
    lines = [f"DEF {name}( )", f"; {comment}", "$TOOL=TOOL_DATA[1]", "$BASE=BASE_DATA[9]"]
    lines += ["LIN {X 1500,Y 0,Z 900,A 0,B 90,C 0}", "$BASE=$NULLFRAME"]
    offsets = np.random.default_rng(3).uniform(-0.3, 0.3, (n, 3))
    for p in np.asarray(virtual.preset.centre_mm) + offsets * virtual.preset.size_mm:
        lines.append("LIN {{X {:.3f},Y {:.3f},Z {:.3f},A {},B {},C {}}}".format(*p, *virtual.preset.abc_deg))
    return "\r\n".join([*lines, "END", ""]).encode("latin-1")


@pytest.fixture(scope="module")
def virtual() -> VirtualCell:
    return VirtualCell("paper", seed=1)


@pytest.fixture(scope="module")
def made(virtual: VirtualCell, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a cell with a map."""
    folder = tmp_path_factory.mktemp("cell")
    x, y, z = virtual.tf_flange_tool[:3, 3]
    a, b, c = euler("kuka", Rotation.from_matrix(virtual.tf_flange_tool[:3, :3]))
    tool = f"[frames.tools.1]\nx_mm = {x}\ny_mm = {y}\nz_mm = {z}\na_deg = {a}\nb_deg = {b}\nc_deg = {c}\n"
    (folder / "cell.toml").write_text(f"{virtual.cell.to_toml()}\n{tool}")
    (folder / "maps").mkdir()
    error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(120, seed=1)), "ordinary-kriging")
    error_map.save(folder / "maps" / "a.truepose")
    return folder


@pytest.fixture
def root(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path / "state"))
    shutil.copytree(made, tmp_path / "work" / "cell")
    return tmp_path / "work"


@pytest.fixture
def client(root: Path) -> Iterator[TestClient]:
    guard = Guard(port=8765)
    with TestClient(create_app(Workspace(root), guard), base_url=BASE) as inside:
        inside.cookies.set(guard.cookie, guard.session)
        inside.headers[CSRF_HEADER] = guard.csrf
        yield inside


def cell(client: TestClient, name: str = "cell") -> str:
    return next(f"/api/v1/cells/{one.id}" for one in client.app.state.workspace.cells() if one.name == name)  # type: ignore[attr-defined]


def sent(client: TestClient, name: str, content: bytes, where: str = "cell") -> str:
    answer = client.post(f"{cell(client, where)}/programs", files=[("files", (name, content))])
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]  # type: ignore[no-any-return]


def ended(client: TestClient, answer: Any) -> dict[str, Any]:
    assert answer.status_code == 202, answer.text
    job = client.app.state.jobs.wait(answer.json()["id"], timeout=LONG)  # type: ignore[attr-defined]
    return client.get(f"/api/v1/jobs/{job.id}").json()  # type: ignore[no-any-return]


def sha(client: TestClient) -> str:
    workspace: Workspace = client.app.state.workspace  # type: ignore[attr-defined]
    return next(workspace.hash_of(file) for _, file in workspace.maps())


def correct(client: TestClient, program: str, where: str = "cell", **options: Any) -> dict[str, Any]:
    body = {"map": sha(client), "program": program, "options": {"on_guard": "skip", **options}}
    return ended(client, client.post(f"{cell(client, where)}/corrections", json=body))


def test_a_check_says_why_targets_stay_and_what_to_give(client: TestClient, virtual: VirtualCell) -> None:
    program = sent(client, "panel.src", krl(virtual, 20))
    job = ended(client, client.post(f"{cell(client)}/programs/{program}/check", json={}))
    assert job["state"] == "done", job["problem"]
    assert job["command"][:2] == ["check", "programs/panel/panel.src"]
    assert job["result"]["coverage"]["correctable"] == 20
    (reason,) = job["result"]["coverage"]["reasons"]
    assert (reason["count"], reason["option"]) == (1, "[frames] of the cell file")
    assert job["result"]["missing_frames"][0].startswith("[frames.bases.9]")
    assert "targets" not in job["result"]


def test_a_correction_is_that_of_the_command_and_never_replaces_one(
    client: TestClient, root: Path, virtual: VirtualCell
) -> None:
    content = krl(virtual, 20)
    program = sent(client, "panel.src", content)
    first, second = correct(client, program), correct(client, program)
    assert first["state"] == second["state"] == "done", (first["problem"], second["problem"])
    outs = [next(word for word in job["command"] if word.startswith("--out=")) for job in (first, second)]
    assert outs == ["--out=corrected/panel", "--out=corrected/panel-2"]
    assert (root / "cell/programs/panel/panel.src").read_bytes() == content
    found = client.get(f"{cell(client)}/corrections").json()
    assert {one["folder"] for one in found} == {"corrected/panel", "corrected/panel-2"}
    assert {one["map_sha256"] for one in found} == {sha(client)}
    assert found[0]["summary"]["corrected"] + found[0]["summary"]["below_uncertainty"] > 10
    assert "targets" not in first["result"]["programs"][0]
    detail = client.get(f"/api/v1/corrections/{found[0]['id']}").json()
    assert detail["files"][0]["found"]


@pytest.mark.exhaustive
def test_a_preview_writes_nothing(client: TestClient, root: Path, virtual: VirtualCell) -> None:
    job = correct(client, sent(client, "panel.src", krl(virtual, 20)), dry_run=True)
    assert job["state"] == "done", job["problem"]
    assert job["result"]["programs"][0]["summary"]["targets"] == 21
    (listed,) = job["result"]["written"]
    assert listed.startswith("../.truepose/previews/")
    assert not (root / "cell/corrected").exists()


@pytest.mark.exhaustive
def test_targets_are_listed_before_anything_is_written(client: TestClient, root: Path, virtual: VirtualCell) -> None:
    program = sent(client, "panel.src", krl(virtual, 20))
    check = ended(client, client.post(f"{cell(client)}/programs/{program}/check", json={}))
    preview = correct(client, program, dry_run=True)
    made = correct(client, program)
    assert [one["state"] for one in (check, preview, made)] == ["done"] * 3
    state = client.get(f"/api/v1/previews/{check['id']}").json()
    assert (state["index"]["ready"], state["corrected"], state["positions"]) == (True, False, True)
    assert state["verdicts"] == {"correct": 20, "refuse": 1}
    (kind,) = [one for one in state["kinds"] if one["reason"]]
    assert kind["counts"] == {"refuse": 1}
    read = client.get(f"/api/v1/previews/{check['id']}/targets").json()["rows"]
    assert all(one["change"] is None and one["std"] is None and one["after_mm"] is None for one in read)
    assert [one["before_mm"][0] for one in read[:1]] == [1500.0]
    correction = client.get(f"{cell(client)}/corrections").json()[0]["id"]
    for part in ("targets", "targets?verdict=skip", "targets?sort=std&descending=true", "targets?search=:7"):
        shown, written = (
            client.get(f"/api/v1/{place}/{part}").json()
            for place in (f"previews/{preview['id']}", f"corrections/{correction}")
        )
        assert shown == written
        assert shown["rows"]
    assert client.get(f"/api/v1/previews/{preview['id']}").json()["corrected"]
    path, other = (
        client.get(f"/api/v1/{place}/path.bin").content
        for place in (f"previews/{preview['id']}", f"corrections/{correction}")
    )
    assert path == other
    assert client.get(f"/api/v1/previews/{made['id']}").status_code == 404
    assert client.get(f"/api/v1/previews/{check['id']}/targets?sort=size").status_code == 422
    assert not any(path.suffix == ".json" for path in (root / "cell/programs").rglob("*"))


def test_a_check_that_runs_again_lists_its_targets_again(client: TestClient, virtual: VirtualCell) -> None:
    program = sent(client, "panel.src", krl(virtual, 3))
    first = ended(client, client.post(f"{cell(client)}/programs/{program}/check", json={}))
    again = ended(client, client.post(f"/api/v1/jobs/{first['id']}/run"))
    assert again["state"] == "done", again["problem"]
    assert client.get(f"/api/v1/previews/{again['id']}/targets").json()["total"] == 4


def test_old_lists_of_targets_are_removed(client: TestClient, root: Path, virtual: VirtualCell) -> None:
    program = sent(client, "panel.src", krl(virtual, 3))
    first = ended(client, client.post(f"{cell(client)}/programs/{program}/check", json={}))
    (listed,) = (root / ".truepose/previews").iterdir()
    os.utime(listed, (1e9, 1e9))
    ended(client, client.post(f"{cell(client)}/programs/{program}/check", json={}))
    assert not listed.exists()
    assert client.get(f"/api/v1/previews/{first['id']}").status_code == 404


def test_a_list_of_targets_is_only_read_from_the_own_folder(client: TestClient, root: Path) -> None:
    jobs = client.app.state.jobs  # type: ignore[attr-defined]
    (root / "cell/other.json").write_text("{}")
    command = ["check", "none.src", "--targets=other.json"]
    job = jobs.submit(command, folder=root / "cell", cell="", title="")
    assert client.get(f"/api/v1/previews/{job.id}").status_code == 404
    assert client.get("/api/v1/previews/00000001-00000000").status_code == 404


def inform(virtual: VirtualCell, n: int) -> bytes:
    """Return a job in the base of the robot, with comments in Japanese and lines that end as controllers write them."""
    offsets = np.random.default_rng(4).uniform(-0.3, 0.3, (n, 3))
    points = np.asarray(virtual.preset.centre_mm) + offsets * virtual.preset.size_mm
    rx, ry, rz = Rotation.from_euler("ZYX", virtual.preset.abc_deg, degrees=True).as_euler("xyz", degrees=True)
    lines = ["/JOB", "//NAME PANEL", "//POS", f"///NPOS {n},0,0,0,0,0", "///TOOL 1", "///POSTYPE ROBOT", "///RECTAN"]
    lines += ["///RCONF 0,0,0,0,0,0,0,0", *(_inform_point(k, [*p, rx, ry, rz]) for k, p in enumerate(points))]
    lines += ["//INST", "///DATE 2026/01/01 00:00", "///COMM 穴あけ作業", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    lines += ["'位置決め", *(f"MOVL C{k:05d} V=100.0" for k in range(n)), "END", ""]
    return "\r\n".join(lines).encode("cp932")


def _inform_point(k: int, values: list[float]) -> str:
    return f"C{k:05d}=" + ",".join(f"{value:.3f}" if i < 3 else f"{value:.4f}" for i, value in enumerate(values))


def in_other_bytes(name: str, virtual: VirtualCell) -> bytes:
    if name.endswith(".jbi"):
        return inform(virtual, 6)
    text = krl(virtual, 6, comment="REMARK").decode("latin-1")
    if name.startswith("sjis"):
        return text.replace("REMARK", "穴あけ作業ソ").encode("cp932")
    return text.replace("\r\n", "\n").replace("REMARK", "Prüfbohrung").encode("utf-8")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["sjis.src", "lines.src", "panel.jbi"])
def test_no_byte_outside_the_digits_changes(client: TestClient, virtual: VirtualCell, name: str) -> None:
    given = in_other_bytes(name, virtual)
    job = correct(client, sent(client, name, given), other_maker=True)
    assert job["state"] == "done", job["problem"]
    (found,) = client.get(f"{cell(client)}/corrections").json()
    packed = client.get(f"/api/v1/corrections/{found['id']}/files.zip")
    with zipfile.ZipFile(io.BytesIO(packed.content)) as archive:
        written = next(archive.read(one) for one in archive.namelist() if one.endswith(name))
    assert written != given
    digits = re.compile(rb"-?[0-9]+\.[0-9]+")
    assert digits.sub(b"#", written) == digits.sub(b"#", given)
    for before, after in zip(digits.findall(given), digits.findall(written), strict=True):
        assert abs(float(after) - float(before)) < 3.0
    page = client.get(f"/api/v1/corrections/{found['id']}/diff")
    assert page.status_code == 200, page.text


@pytest.mark.exhaustive
def test_a_program_that_was_corrected_before_is_refused_with_the_words_of_the_command_line(
    client: TestClient, root: Path, virtual: VirtualCell
) -> None:
    assert correct(client, sent(client, "panel.src", krl(virtual, 20)))["state"] == "done"
    again = sent(client, "copy.src", (root / "cell/corrected/panel/panel.src").read_bytes())
    job = correct(client, again)
    assert job["state"] == "failed"
    assert "do not correct it twice: take the original" in job["problem"]["detail"]
    assert not (root / "cell/corrected/copy").exists()


def test_a_map_of_another_cell_is_refused(client: TestClient, root: Path, virtual: VirtualCell) -> None:
    other = VirtualCell("hard", seed=2)
    (root / "other").mkdir()
    text = other.cell.to_toml()
    (root / "other/cell.toml").write_text(text.replace(other.robot.name, "kuka-kr10-r1420", 1))
    job = correct(client, sent(client, "panel.src", krl(virtual, 20), where="other"), where="other")
    assert job["state"] == "failed"
    assert job["command"][1] == "../cell/maps/a.truepose"
    assert "take the cell file of this map" in job["problem"]["detail"]
    assert not (root / "other/corrected").exists()


def test_what_is_no_program_is_told_in_words(client: TestClient) -> None:
    bad = {"utf16.src": "DEF a()\nEND\n".encode("utf-16"), "noise.ls": bytes(range(256)) * 40, "empty.jbi": b""}
    files = [("files", (name, content)) for name, content in bad.items()]
    program = client.post(f"{cell(client)}/programs", files=files).json()
    job = ended(client, client.post(f"{cell(client)}/programs/{program['id']}/check", json={}))
    assert job["state"] == "failed"
    assert "Traceback" not in json.dumps(job)
    for name in ("utf16.src", "noise.ls"):  # what is empty is left out, and is no error
        assert name in job["problem"]["detail"]


def test_no_name_is_an_option_or_a_command(client: TestClient, virtual: VirtualCell) -> None:
    names = ("溶接.src", "<b onload=x>.src", "-rf.src", "--help.src", "a;b $(x) 'c'.src")
    comment = "溶接".encode("cp932").decode("latin-1")
    files = [("files", (name, krl(virtual, 3, f"p{k}", comment))) for k, name in enumerate(names)]
    program = client.post(f"{cell(client)}/programs", files=files).json()
    job = ended(client, client.post(f"{cell(client)}/programs/{program['id']}/check", json={}))
    assert job["state"] == "done", job["problem"]
    assert job["result"]["coverage"]["targets"] == 4 * len(names)
    alone = sent(client, "--help.src", krl(virtual, 3))
    job = ended(client, client.post(f"{cell(client)}/programs/{alone}/check", json={}))
    assert job["result"]["coverage"]["targets"] == 4


def test_a_backup_is_read_where_it_is(client: TestClient, root: Path, virtual: VirtualCell, tmp_path: Path) -> None:
    path = tmp_path / "backup.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("am.ini", "[Archive]\nName=x\n[Roboter]\nIRSerialNr=1\n")
        archive.writestr("KRC/R1/Program/panel.src", krl(virtual, 20))
        archive.writestr("KRC/R1/System/$config.dat", "DEFDAT $CONFIG\r\nENDDAT\r\n")
    job = correct(client, sent(client, "backup.zip", path.read_bytes()), whole=True)
    assert job["state"] == "done", job["problem"]
    with zipfile.ZipFile(root / "cell/corrected/backup/backup.zip") as archive:
        assert archive.read("KRC/R1/Program/panel.src") != krl(virtual, 20)
    assert [path.name for path in (root / "cell/programs/backup").iterdir()] == ["backup.zip"]


def test_files_that_belong_together_are_read_together(client: TestClient, root: Path) -> None:
    module = (
        b"MODULE %s\nCONST robtarget p:=[[1500,0,900],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n%sENDMODULE\n"
    )
    files = [
        ("TASK1/PROGMOD/a.mod", module % (b"A", b"PROC main()\nMoveL p,v100,fine,tool0;\nENDPROC\n")),
        ("TASK1/PROGMOD/b.mod", module.replace(b" p:=", b" q:=") % (b"B", b"")),
    ]
    address = f"{cell(client)}/programs"
    kept = client.post(address, files=[("files", (f"line/{name}", content)) for name, content in files]).json()
    assert kept["given"] == ["programs/line"]
    job = ended(client, client.post(f"{address}/{kept['id']}/check", json={}))
    assert len(job["result"]["programs"]) == 1  # one task
    pair = [("files", ("a.src", b"DEF a()\nEND\n")), ("files", ("a.dat", b"DEFDAT a\nENDDAT\n"))]
    assert client.post(address, files=pair).json()["given"] == ["programs/a/a.src"]


@pytest.mark.parametrize(
    "options",
    [
        {"tool": "1\n--in-place"},
        {"in_place": True},
        {"on_guard": "ask"},
        {"controller": ["x"] * 51},
        {"frame_tolerance": "x" * 300},
    ],
)
def test_options_that_are_none_are_refused(client: TestClient, options: dict[str, Any]) -> None:
    body = {"map": "0" * 64, "program": "0" * 12, "options": options}
    assert client.post(f"{cell(client)}/corrections", json=body).status_code == 422


def test_options_are_no_place_for_a_long_body(client: TestClient) -> None:
    for address in ("programs/0123456789ab/check", "corrections"):
        answer = client.post(f"{cell(client)}/{address}", content=b" " * (5 << 20))
        assert answer.status_code == 413


def test_what_is_not_in_the_workspace_is_not_found(client: TestClient, virtual: VirtualCell) -> None:
    program = sent(client, "panel.src", krl(virtual, 3))
    missing = {"map": "0" * 64, "program": program}
    assert client.post(f"{cell(client)}/corrections", json=missing).status_code == 404
    assert client.post(f"{cell(client)}/corrections", json={**missing, "program": "../.."}).status_code == 404
    assert client.post(f"{cell(client)}/programs/0123456789ab/check", json={}).status_code == 404


def options_of(command: str) -> dict[str, Any]:
    group: Any = typer.main.get_command(truepose_app)
    params = group.commands[command].params
    return {one.opts[-1].lstrip("-"): one for one in params if one.param_type_name == "option"}


ELSEWHERE = {"cell", "config-dat", "out", "in-place", "report", "targets", "force", "no-targets", "json", "help"}
ELSEWHERE |= {"store", "released-only", "workers", "cluster", "cluster-folder"}
ELSEWHERE |= {"cluster-ca", "cluster-cert", "cluster-key"}
"""Options that the application states itself, that belong to its server, or that write over files."""


@pytest.mark.parametrize(("command", "model"), [("check", ReadingOptions), ("correct", CorrectionOptions)])
def test_a_page_has_the_options_of_the_command_line(command: str, model: type[BaseModel]) -> None:
    names = {name.replace("_", "-") for name in model.model_fields}
    known = options_of(command)
    assert names == set(known) - ELSEWHERE
    for name, field in model.model_fields.items():
        option = known[name.replace("_", "-")]
        assert option.is_flag == (field.annotation is bool)
        assert option.multiple == isinstance(field.default, list)


def test_every_option_reaches_the_command_line_as_one_word() -> None:
    given: dict[str, Any] = {}
    for name, field in CorrectionOptions.model_fields.items():
        value = field.default
        given[name] = True if value is False else ["--json", "b c"] if isinstance(value, list) else "skip"
    words = arguments(CorrectionOptions(**given))
    assert len(words) == sum(len(value) if isinstance(value, list) else 1 for value in given.values())
    assert all(word.startswith("--") and "\n" not in word for word in words)
    assert arguments(CorrectionOptions()) == []
    assert "--controller=--json" in words
    assert inspect.getdoc(program_commands.arguments)
