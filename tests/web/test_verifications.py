"""Verifications: readings of a corrected program are judged as on the command line, whatever they are called."""

from __future__ import annotations

import json
from typing import Any

import pytest
from fastapi.testclient import TestClient
from tests.web.conftest import ended

from truepose.web import Workspace

READINGS = "panel_corrected_readings.txt"


def order(client: TestClient, cell: str, content: bytes, name: str = "readings.txt", **fields: Any) -> Any:
    (program,) = client.get(f"{cell}/verifiable").json()
    data = {"record": program["record"], **fields}
    return client.post(f"{cell}/verifications", data=data, files={"readings": (name, content)})


def test_a_corrected_program_can_be_verified_with_the_map_that_corrected_it(
    client: TestClient, cell: str, workspace: Workspace
) -> None:
    (program,) = client.get(f"{cell}/verifiable").json()
    assert program["program"] == "corrected/panel.src"
    assert program["known"]
    (file,) = workspace.cells()[0].files("map")
    file.path.unlink()
    (program,) = client.get(f"{cell}/verifiable").json()
    assert not program["known"]
    answer = order(client, cell, b"")
    assert answer.status_code == 404
    assert "map" in answer.json()["detail"]


def test_the_result_is_that_of_the_command_line(client: TestClient, cell: str, workspace: Workspace, run: Any) -> None:
    folder = workspace.cells()[0].folder
    job = ended(client, order(client, cell, (folder / READINGS).read_bytes()))
    assert job["state"] == "done", job
    (entry,) = client.get(f"{cell}/verifications").json()
    one = client.get(f"{cell}/verifications/{entry['id']}").json()
    typed = run("verify", folder / "map.truepose", folder / "corrected" / "panel.src", folder / READINGS, "--json").json
    for ours, theirs in zip(one["found"]["targets"], typed["targets"], strict=True):
        assert {**ours, "file": ""} == {**theirs, "file": ""}
    assert entry["decision"] == typed["decision"] == one["found"]["decision"]
    assert entry["max_mm"] == typed["figures"]["after"]["max_mm"]
    assert entry["before_max_mm"] == typed["figures"]["before"]["max_mm"]
    assert (folder / entry["name"]).is_file()


def test_a_failed_tolerance_is_a_result_and_no_failure_of_the_job(
    client: TestClient, cell: str, workspace: Workspace
) -> None:
    content = (workspace.cells()[0].folder / READINGS).read_bytes()
    job = ended(client, order(client, cell, content, tolerance_mm="0.001"))
    assert job["state"] == "done", job
    (entry,) = client.get(f"{cell}/verifications").json()
    assert entry["decision"] == "fail"
    assert entry["failed"] > 0


@pytest.mark.exhaustive
def test_readings_of_before_replace_the_predicted_errors(client: TestClient, cell: str, workspace: Workspace) -> None:
    folder = workspace.cells()[0].folder
    (program,) = client.get(f"{cell}/verifiable").json()
    files = {
        "readings": ("same.txt", (folder / READINGS).read_bytes()),
        "before": ("same.txt", (folder / "panel_original_readings.txt").read_bytes()),
    }
    job = ended(client, client.post(f"{cell}/verifications", data={"record": program["record"]}, files=files))
    assert job["state"] == "done", job
    (entry,) = client.get(f"{cell}/verifications").json()
    one = client.get(f"{cell}/verifications/{entry['id']}").json()
    assert one["found"]["before"] == "measured"


def test_verifying_twice_keeps_both_results(client: TestClient, cell: str) -> None:
    jobs = [order(client, cell, b"1 2 3").json() for _ in range(2)]
    outputs = {job["command"][job["command"].index("--out") + 1] for job in jobs}
    assert len(outputs) == 2
    for job in jobs:
        client.delete(f"/api/v1/jobs/{job['id']}")


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "name",
    [
        "../../outside.txt",
        "/etc/cron.d/x",
        "--force",
        "a\r\nb.txt",
        "<img src=x onerror=alert(1)>.txt",
        "..",
        "con",
        "-",
    ],
)
def test_names_of_readings_are_never_paths_or_options(
    client: TestClient, cell: str, workspace: Workspace, name: str
) -> None:
    folder = workspace.cells()[0].folder
    before = set(workspace.root.parent.rglob("*"))
    job = order(client, cell, b"1 2 3", name).json()
    made = {path for path in set(workspace.root.parent.rglob("*")) - before if path.is_file()}
    (stored,) = (path for path in made if ".truepose" not in path.parts)
    assert stored.parent == folder / "readings"
    assert job["command"][:4] == ["verify", "map.truepose", "corrected/panel.src", f"readings/{stored.name}"]
    client.delete(f"/api/v1/jobs/{job['id']}")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("content", [b"\x00\x01\x02" * 99, "座標,値\n".encode("shift-jis")])
def test_readings_that_cannot_be_read_are_refused_with_a_remedy(client: TestClient, cell: str, content: bytes) -> None:
    job = ended(client, order(client, cell, content))
    assert job["state"] == "failed"
    assert "readings.txt" in job["problem"]["detail"]
    assert "Traceback" not in json.dumps(job)
    assert client.get(f"{cell}/verifications").json() == []


@pytest.mark.parametrize("value", ["nan", "inf", "-1", "0", "1e400", "x"])
def test_a_tolerance_that_is_no_length_is_refused(client: TestClient, cell: str, value: str) -> None:
    answer = order(client, cell, b"", tolerance_mm=value)
    assert answer.status_code == 422
    assert "tolerance_mm" in answer.json()["detail"]


def test_a_file_that_only_claims_to_be_a_verification_is_listed_with_its_problem(
    client: TestClient, cell: str, workspace: Workspace
) -> None:
    folder = workspace.cells()[0].folder
    (folder / "bad.json").write_text('{"format": "truepose verification", "targets": 3}')
    (folder / "odd.corrections.json").write_text("[1, 2")
    (entry,) = client.get(f"{cell}/verifications").json()
    assert "is not the verification of a program" in entry["problem"]
    assert client.get(f"{cell}/verifications/{entry['id']}").status_code == 422
    assert [one["program"] for one in client.get(f"{cell}/verifiable").json()] == ["corrected/panel.src"]
