"""Reports: the same file as from the command line, shown in a frame that can reach nothing."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient
from tests.web.conftest import ended

from truepose.web import Workspace


def ids(workspace: Workspace, kind: Any) -> list[str]:
    return [file.id for file in workspace.cells()[0].files(kind)]


@pytest.mark.exhaustive
def test_a_report_holds_what_was_chosen(client: TestClient, cell: str, workspace: Workspace) -> None:
    order = {"map": ids(workspace, "map")[0], "language": "de", "records": ids(workspace, "record")}
    job = ended(client, client.post(f"{cell}/reports", json=order))
    assert job["state"] == "done", job
    made = client.get(f"{cell}/reports").json()["reports"][0]
    assert made["name"] in job["command"]
    text = (workspace.cells()[0].folder / made["name"]).read_text("utf-8")
    assert '<html lang="de">' in text
    assert "panel" in text


def test_a_report_never_replaces_another(client: TestClient, cell: str, workspace: Workspace) -> None:
    (first,) = workspace.cells()[0].files("map")
    orders = [{"map": first.id}, {"map": first.id, "records": ids(workspace, "record")}]
    jobs = [client.post(f"{cell}/reports", json=order).json() for order in orders]
    names = [job["command"][job["command"].index("--out") + 1] for job in jobs]
    for job in jobs:
        client.delete(f"/api/v1/jobs/{job['id']}")
    taken = workspace.cells()[0].folder / names[0]
    taken.parent.mkdir(exist_ok=True)
    taken.write_text("signed")
    job = client.post(f"{cell}/reports", json=orders[0]).json()
    client.delete(f"/api/v1/jobs/{job['id']}")
    assert len({*names, job["command"][job["command"].index("--out") + 1]}) == 3


def test_a_preview_may_show_itself_and_ask_nobody(client: TestClient, cell: str, workspace: Workspace) -> None:
    (report,) = client.get(f"{cell}/reports").json()["reports"]
    answer = client.get(f"{cell}/reports/{report['id']}/preview")
    policy = dict(part.strip().partition(" ")[::2] for part in answer.headers["content-security-policy"].split(";"))
    assert policy["sandbox"] == "allow-scripts"  # no origin: neither cookies nor the page's address
    assert policy["default-src"] == "'none'"
    assert policy["frame-ancestors"] == "'self'"
    assert not any(source.startswith("http") or "*" in source for source in policy.values())
    assert answer.headers["x-frame-options"] == "SAMEORIGIN"
    assert answer.text == (workspace.cells()[0].folder / report["name"]).read_text("utf-8")
    file = client.get(f"{cell}/reports/{report['id']}/file")
    assert file.headers["content-disposition"].startswith("attachment")
    assert "sandbox" not in file.headers["content-security-policy"]
    assert file.headers["x-frame-options"] == "DENY"


@pytest.mark.parametrize("what", ["map", "test", "records", "verifications"])
def test_files_of_another_kind_or_cell_are_refused(
    client: TestClient, cell: str, workspace: Workspace, what: str
) -> None:
    wrong = ids(workspace, "plan")[0]
    order: dict[str, Any] = {"map": ids(workspace, "map")[0]}
    order[what] = wrong if what in ("map", "test") else [wrong]
    answer = client.post(f"{cell}/reports", json=order)
    assert answer.status_code == 404
    assert client.get("/api/v1/jobs").json() == []


def test_an_interactive_pdf_is_refused_before_a_job_starts(client: TestClient, cell: str, workspace: Workspace) -> None:
    order = {"map": ids(workspace, "map")[0], "format": "pdf", "interactive": True}
    answer = client.post(f"{cell}/reports", json=order)
    assert answer.status_code == 422
    assert "HTML" in answer.json()["detail"]


def test_a_map_of_a_stranger_in_the_folder_is_a_refusal_and_no_crash(
    client: TestClient, cell: str, workspace: Workspace
) -> None:
    (workspace.cells()[0].folder / "strange.truepose").write_bytes(b"PK\x03\x04 not a map")
    wrong = next(file.id for file in workspace.cells()[0].files("map") if file.name == "strange.truepose")
    job = ended(client, client.post(f"{cell}/reports", json={"map": wrong}))
    assert job["state"] == "failed"
    assert "strange.truepose" in job["problem"]["detail"]
