"""Measuring in the browser: plans, previews and imports say what the command line says, for any file."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from truepose import VirtualCell
from truepose.error_map.fit import fit_cell
from truepose.error_map.importing import import_samples
from truepose.planning import expected_accuracy
from truepose.samples import Mask, Poses, Samples, read_samples, write_samples
from truepose.trackers import read_plan, write_readings
from truepose.web import Workspace, create_app
from truepose.web.security import CSRF_HEADER, Guard

API = "/api/v1"
BASE = "http://127.0.0.1:8765"
N = 24
GROSS = 11
REASON = 'beam was cut, "twice"'


@dataclass
class Bench:
    """A client, and the folder of a cell with a plan and a measurement file that is not sent yet."""

    client: TestClient
    cell: str
    folder: Path
    readings: Path
    plan: str
    virtual: VirtualCell

    def get(self, path: str, **options: Any) -> Any:
        answer = self.client.get(f"{API}/cells/{self.cell}/{path}", **options)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def send(
        self, *, preview: bool = True, content: bytes | None = None, name: str = "tracker.csv", **form: Any
    ) -> Any:
        files = {"file": (name, self.readings.read_bytes() if content is None else content)}
        options = {"plan": self.plan, **form}
        return self.client.post(
            f"{API}/cells/{self.cell}/readings",
            params={"preview": preview},
            files=files,
            data={"options": json.dumps({key: value for key, value in options.items() if value is not None})},
        )

    def left(self) -> list[str]:
        """Return the files below the cell's folder."""
        return sorted(path.relative_to(self.folder).as_posix() for path in self.folder.rglob("*") if path.is_file())


@pytest.fixture(scope="module")
def virtual() -> VirtualCell:
    return VirtualCell("paper")


@pytest.fixture(scope="module")
def measured(virtual: VirtualCell) -> Samples:
    return virtual.measure(virtual.design(N))


@pytest.fixture
def bench(tmp_path: Path, virtual: VirtualCell, measured: Samples) -> Bench:
    folder = tmp_path / "work" / "hall"
    (folder / "plans").mkdir(parents=True)
    (folder / "cell.toml").write_text(virtual.cell.to_toml(), "utf-8")
    names = np.array([f"P{i:03d}" for i in range(N)])
    write_samples(folder / "plans" / "plan.csv", Poses(q=measured.q, name=names))
    p = measured.p_meas.copy()
    p[GROSS] += [25.0, -15.0, 10.0]
    readings = tmp_path / "tracker.csv"
    write_readings(readings, Samples(p, q=measured.q, name=names), "tidy")
    guard = Guard(port=8765)
    client = TestClient(create_app(Workspace(tmp_path / "work"), guard), base_url=BASE, raise_server_exceptions=False)
    client.cookies.set(guard.cookie, guard.session)
    client.headers[CSRF_HEADER] = guard.csrf
    (cell,) = client.get(f"{API}/cells").json()
    (plan,) = client.get(f"{API}/cells/{cell['id']}/plans").json()
    return Bench(client, cell["id"], folder, readings, plan["id"], virtual)


@pytest.fixture
def running(bench: Bench) -> Iterator[Bench]:
    """Return the bench with a queue that runs jobs."""
    with bench.client.app.state.jobs:  # type: ignore[attr-defined]
        yield bench


def wait(bench: Bench, answer: Any) -> Any:
    """Return a job that has ended."""
    assert answer.status_code == 202, answer.text
    return bench.client.app.state.jobs.wait(answer.json()["id"], timeout=120)  # type: ignore[attr-defined]


def test_a_preview_says_what_the_import_says_and_writes_nothing(bench: Bench) -> None:
    before = bench.left()
    answer = bench.send()
    assert answer.status_code == 200, answer.text
    preview = answer.json()
    plan = read_plan(bench.folder / "plans" / "plan.csv")
    found = import_samples(bench.virtual.cell, bench.readings, plan)
    assert preview["problem"] is None
    assert preview["readings"]["count"] == N
    assert preview["matched"]["by_name"] is True
    assert preview["registered"]["mean_mm"] == pytest.approx(found.figures["mean_mm"])
    assert [row["outlier"] for row in preview["registered"]["rows"]] == [row["outlier"] for row in found.rows()]
    shown = [row["residual_mm"] for row in preview["registered"]["rows"]]
    np.testing.assert_allclose(shown, [row["residual_mm"] for row in found.rows()])
    assert bench.left() == before
    assert ".upload-" not in answer.text


@pytest.mark.exhaustive
def test_a_masked_point_is_left_out_with_its_reason_and_stays_in_the_samples(running: Bench) -> None:
    mask = [{"row": GROSS, "point": f"P{GROSS:03d}", "reason": REASON}]
    shown = running.send(mask=mask).json()["registered"]
    plan = read_plan(running.folder / "plans" / "plan.csv")
    found = import_samples(running.virtual.cell, running.readings, plan, mask=Mask({GROSS: REASON}))
    assert shown["mean_mm"] == pytest.approx(found.figures["mean_mm"])
    assert shown["rows"][GROSS]["masked"] == REASON
    job = wait(running, running.send(preview=False, mask=mask))
    assert job.state == "done", job.problem
    samples = read_samples(running.folder / job.result["samples"])
    assert len(samples) == N - 1
    assert [(one["point"], one["reason"]) for one in samples.excluded] == [(f"P{GROSS:03d}", f"masked: {REASON}")]
    (entry,) = running.get("samples")
    assert (entry["count"], entry["masked"]) == (N, 1)
    table = running.get(f"samples/{entry['id']}")
    assert table["rows"][GROSS]["masked"] == REASON
    np.testing.assert_allclose(table["rows"][0]["p_meas_mm"], samples.p_meas[0])
    part = running.get(f"samples/{entry['id']}", params={"offset": GROSS, "limit": 2})
    assert [row["name"] for row in part["rows"]] == [f"P{GROSS:03d}", f"P{GROSS + 1:03d}"]
    assert part["total"] == N


def test_rows_of_a_table_are_masked_and_unmasked_in_a_new_one(running: Bench) -> None:
    mask = [{"row": GROSS, "point": f"P{GROSS:03d}", "reason": REASON}]
    assert wait(running, running.send(preview=False, mask=mask)).state == "done"
    (first,) = running.get("samples")
    before = (running.folder / first["name"]).read_bytes()

    def masked(entry: Any, reasons: dict[int, str]) -> Any:
        address = f"{API}/cells/{running.cell}/samples/{entry['id']}/mask"
        job = wait(running, running.client.post(address, json={"reasons": reasons}))
        assert job.state == "done", job.problem
        return job, next(one for one in running.get("samples") if one["name"] == job.result["samples"])

    job, second = masked(first, {3: "vibration"})
    assert job.command[:2] == ("mask", first["name"])
    assert [row["masked"] for row in running.get(f"samples/{second['id']}")["rows"] if row["masked"]] == [
        "vibration",
        REASON,
    ]
    _, third = masked(second, {3: "", GROSS: ""})
    assert (third["masked"], third["count"]) == (0, N)
    assert len({first["name"], second["name"], third["name"]}) == 3
    assert (running.folder / first["name"]).read_bytes() == before


def test_a_row_that_holds_no_number_is_shown_and_can_be_masked(running: Bench) -> None:
    assert wait(running, running.send(preview=False)).state == "done"
    (first,) = running.get("samples")
    path = running.folder / first["name"]
    header, *rows = path.read_text("utf-8").splitlines()
    column = header.split(",").index("x_meas_mm")
    fields = rows[3].split(",")
    fields[column : column + 2] = ["nan", "no reading"]
    path.write_text("\n".join([header, *rows[:3], ",".join(fields), *rows[4:]]) + "\n", "utf-8")
    (entry,) = running.get("samples")
    assert (entry["count"], entry["masked"]) == (N, 0)
    assert ":5: " in entry["problem"]
    shown = running.get(f"samples/{entry['id']}")["rows"]
    assert shown[3]["p_meas_mm"][:2] == [None, None]
    assert None not in [*shown[3]["p_mm"], *shown[2]["p_meas_mm"]]
    address = f"{API}/cells/{running.cell}/samples/{entry['id']}/mask"
    job = wait(running, running.client.post(address, json={"reasons": {3: "no reading"}}))
    assert job.state == "done", job.problem
    masked = next(one for one in running.get("samples") if one["name"] == job.result["samples"])
    assert (masked["count"], masked["masked"], masked["problem"]) == (N, 1, None)
    assert len(read_samples(running.folder / masked["name"])) == N - 1
    unmasked = running.client.post(address.replace(entry["id"], masked["id"]), json={"reasons": {3: ""}})
    assert wait(running, unmasked).state == "failed"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("reasons", [{N: "not in the table"}, {0: "x" * 300}, {"a": "b"}])
def test_masks_that_make_no_sense_write_nothing(running: Bench, reasons: dict[Any, str]) -> None:
    assert wait(running, running.send(preview=False)).state == "done"
    (entry,) = running.get("samples")
    before = running.left()
    answer = running.client.post(f"{API}/cells/{running.cell}/samples/{entry['id']}/mask", json={"reasons": reasons})
    assert answer.status_code == 422
    assert running.left() == before


@pytest.mark.exhaustive
def test_a_file_is_sent_once_and_then_named_by_its_hash(running: Bench, tmp_path: Path) -> None:
    content = running.readings.read_bytes()
    first = running.send().json()
    address = f"{API}/cells/{running.cell}/readings"

    def again(preview: bool = True, **form: Any) -> Any:
        data = {"options": json.dumps({"stored": first["stored"], "plan": running.plan, **form})}
        empty = {"options": (None, data["options"])}
        return running.client.post(address, params={"preview": preview}, files=empty)

    assert again().json() == first
    masked = again(mask=[{"row": GROSS, "point": f"P{GROSS:03d}", "reason": REASON}]).json()
    assert masked["stored"] == first["stored"]
    assert masked["registered"]["rows"][GROSS]["masked"] == REASON
    job = wait(running, again(preview=False))
    assert job.state == "done", job.problem
    kept = running.folder / "readings" / "tracker.csv"
    assert kept.read_bytes() == content
    kept.write_bytes(b"changed by hand")
    assert again().json()["registered"] == first["registered"]
    (stored,) = (running.folder.parent / ".truepose" / "uploads").iterdir()
    assert stored.name == first["stored"]
    os.utime(stored, (1e9, 1e9))
    assert running.send(name="other.csv").json()["stored"] != first["stored"]
    assert not stored.exists()
    gone = again()
    assert (gone.status_code, "choose it again" in gone.json()["detail"]) == (410, True)


def test_a_plan_that_is_sent_is_kept_as_well(bench: Bench) -> None:
    address, plan = f"{API}/cells/{bench.cell}/readings", (bench.folder / "plans" / "plan.csv").read_bytes()
    files = {"file": ("a.csv", bench.readings.read_bytes()), "plan": ("a plan.csv", plan)}
    options = {"plan_file": "a plan.csv"}
    first = bench.client.post(address, params={"preview": True}, files=files, data={"options": json.dumps(options)})
    known = {**options, "stored": first.json()["stored"], "stored_plan": first.json()["stored_plan"]}
    again = bench.client.post(address, params={"preview": True}, files={"options": (None, json.dumps(known))})
    assert again.json() == first.json()
    assert again.json()["matched"]["samples"] == N


@pytest.mark.parametrize("stored", ["../../cell", "0" * 64, "A" * 64, ""])
def test_a_hash_that_is_none_finds_no_file(bench: Bench, stored: str) -> None:
    before = bench.left()
    body = {"options": (None, json.dumps({"stored": stored, "plan": bench.plan}))}
    answer = bench.client.post(f"{API}/cells/{bench.cell}/readings", params={"preview": True}, files=body)
    assert answer.status_code in (410, 422)
    assert bench.left() == before


def test_an_import_never_writes_over_another(running: Bench) -> None:
    first = wait(running, running.send(preview=False))
    second = wait(running, running.send(preview=False, name="TRACKER.CSV"))
    assert first.state == second.state == "done", second.problem
    names = [name.lower() for name in running.left()]
    assert len(set(names)) == len(names)
    assert first.result["samples"].lower() != second.result["samples"].lower()


def test_columns_and_unit_are_chosen_where_a_file_is_not_understood(running: Bench) -> None:
    measured = running.virtual.measure(running.virtual.design(N))
    rows = "".join(
        f"x|P{i:03d};{'7' * 3};{x / 1e3:.7f};{y / 1e3:.7f};{z / 1e3:.7f};ok;2\n"
        for i, (x, y, z) in enumerate(measured.p_meas)
    )
    content = ("today\n" + rows).encode()
    unknown = running.send(content=content).json()
    assert unknown["readings"] is None
    assert "--columns" in unknown["problem"]
    assert unknown["rows"][1]["fields"][1] == "777"
    chosen = {"x": 3, "y": 4, "z": 5, "skip": unknown["skip"]}
    known = running.send(content=content, columns=chosen, unit="m").json()
    assert known["problem"] is None, known["problem"]
    assert known["columns"] == {"x": [3], "y": [4], "z": [5]}
    assert known["matched"]["by_name"] is False
    job = wait(running, running.send(preview=False, content=content, columns=chosen, unit="m"))
    assert job.state == "done", job.problem
    assert "--columns" in job.command
    assert len(read_samples(running.folder / job.result["samples"])) == N


@pytest.mark.exhaustive
def test_what_the_import_would_refuse_is_said_with_its_remedy(running: Bench) -> None:
    lines = running.readings.read_text("utf-8").splitlines(keepends=True)
    content = "".join(lines[:4] + lines[5:]).encode()
    refused = running.send(content=content).json()
    assert "--missing" in refused["problem"]
    assert len(refused["matched"]["missing"]) == 1  # what it would be with the permission
    allowed = running.send(content=content, missing=True).json()
    assert allowed["problem"] is None
    job = wait(running, running.send(preview=False, content=content))
    assert job.state == "failed"
    assert "--missing" in job.problem["detail"]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("encoding", "ends"), [("utf-8", b"\r\n"), ("utf-8-sig", b"\n"), ("utf-16", b"\r\n")])
def test_encodings_and_line_ends_make_no_difference(bench: Bench, encoding: str, ends: bytes) -> None:
    text = bench.readings.read_text("utf-8").replace("\n", ends.decode())
    same, other = bench.send().json(), bench.send(content=text.encode(encoding)).json()
    assert other["problem"] is None
    assert other["registered"] == same["registered"]


NAMES = [
    "../../../outside.csv",
    "/etc/cron.d/x.csv",
    "C:\\temp\\x.csv",
    "..",
    "<img src=x onerror=alert(1)>.csv",
    "a;rm -rf ~;.csv",
    "--force.csv",
    "-x.csv",
    "セル.csv",
    "x" * 400 + ".csv",
    "nul.csv",
    " .csv",
    "a\nb.csv",
    "file.xlsx#Sheet.csv",
]


@pytest.mark.parametrize("name", NAMES)
def test_names_of_files_are_never_paths_or_options(bench: Bench, name: str) -> None:
    outside = set(bench.folder.parent.parent.iterdir())
    answer = bench.send(name=name, plan=None)
    assert answer.status_code == 200, answer.text
    assert answer.json()["readings"]["count"] == N
    assert set(bench.folder.parent.parent.iterdir()) == outside


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["-x.csv", "セル.csv"])
def test_odd_names_of_files_are_imported(running: Bench, name: str) -> None:
    job = wait(running, running.send(preview=False, name=name))
    assert job.state == "done", job.problem
    assert name in {Path(path).name for path in running.left()}


def test_a_name_in_the_bytes_of_shift_jis_is_taken(running: Bench) -> None:
    name = "計測.csv".encode("shift-jis")
    body = (
        b'--b\r\nContent-Disposition: form-data; name="options"\r\n\r\n' + json.dumps({"plan": running.plan}).encode()
    )
    body += b'\r\n--b\r\nContent-Disposition: form-data; name="file"; filename="' + name + b'"\r\n\r\n'
    body += running.readings.read_bytes() + b"\r\n--b--\r\n"
    headers = {"Content-Type": "multipart/form-data; boundary=b"}
    address = f"{API}/cells/{running.cell}/readings"
    assert running.client.post(address, params={"preview": True}, content=body, headers=headers).status_code == 200
    job = wait(running, running.client.post(address, content=body, headers=headers))
    assert job.state == "done", job.problem


@pytest.mark.parametrize("cut", [0.3, 0.9, 0.999])
def test_an_upload_that_is_cut_off_leaves_nothing(bench: Bench, cut: float) -> None:
    before = bench.left()
    body = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.csv"\r\n\r\n'
    body += bench.readings.read_bytes() + b"\r\n--b--\r\n"
    answer = bench.client.post(
        f"{API}/cells/{bench.cell}/readings",
        content=body[: int(cut * len(body))],
        headers={"Content-Type": "multipart/form-data; boundary=b"},
    )
    assert answer.status_code == 400
    assert "upload again" in answer.json()["detail"]
    assert bench.left() == before


def test_two_gigabytes_are_refused_by_their_stated_and_their_true_size(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = bench.left()
    address = f"{API}/cells/{bench.cell}/readings"
    headers = {"Content-Type": "multipart/form-data; boundary=b", "Content-Length": str(2 << 30)}
    assert bench.client.post(address, content=b"--b", headers=headers).status_code == 413
    monkeypatch.setattr("truepose.web.measure.routes.LARGEST_READINGS", 1000)
    monkeypatch.setattr("truepose.web.measure.routes.largest_file", lambda name: 0)
    answer = bench.send(preview=False)
    assert answer.status_code == 413
    assert bench.left() == before


@pytest.mark.parametrize(
    "options",
    [
        '{"mask": [{"row": NaN, "reason": "x"}]}',
        '{"mask": [{"row": 1, "reason": ""}]}',
        '{"mask": [{"row": 1, "reason": "\\ud800"}]}',
        '{"mask": [{"row": -1, "reason": "x"}]}',
        '{"columns": {"x": 0, "y": 1, "z": 2}}',
        '{"columns": {"x": 1, "y": 2}}',
        '{"columns": {"x": 1, "y": 2, "z": 3, "unit": "m, name=1"}}',
        '{"unit": "furlong"}',
        '{"plan": "../../plan"}',
        '{"plan": "000000000000"}',
        '{"plan_file": "../plans/plan.csv"}',
        '{"out": "/etc/passwd"}',
        "[1, 2]",
        "{",
        "NaN",
    ],
)
def test_statements_that_make_no_sense_are_refused(bench: Bench, options: str) -> None:
    before = bench.left()
    for preview in (True, False):
        answer = bench.client.post(
            f"{API}/cells/{bench.cell}/readings",
            params={"preview": preview},
            files={"file": ("a.csv", bench.readings.read_bytes())},
            data={"options": options},
        )
        assert answer.status_code in (404, 422), answer.text
        assert answer.headers["content-type"] == "application/problem+json"
    assert bench.left() == before


@pytest.mark.exhaustive
def test_a_plan_may_come_with_the_readings(running: Bench) -> None:
    plan = (running.folder / "plans" / "plan.csv").read_bytes()
    (running.folder / "plans" / "plan.csv").unlink()
    files = [("file", ("tracker.csv", running.readings.read_bytes())), ("file", ("today.csv", plan))]
    options = {"options": json.dumps({"plan_file": "today.csv"})}
    address = f"{API}/cells/{running.cell}/readings"
    assert running.client.post(address, params={"preview": True}, files=files, data=options).json()["problem"] is None
    job = wait(running, running.client.post(address, files=files, data=options))
    assert job.state == "done", job.problem
    assert {"readings/today.csv", "readings/tracker.csv", "samples/tracker.csv"} <= set(running.left())


def test_a_plan_is_that_of_the_command_line(running: Bench) -> None:
    answer = running.client.post(f"{API}/cells/{running.cell}/plans", json={"n": 8, "method": "sobol", "seed": 3})
    job = wait(running, answer)
    assert job.state == "done", job.problem
    assert job.command[:2] == ("plan", "cell.toml")
    made = next(plan for plan in running.get("plans") if plan["id"] != running.plan)
    assert made["count"] == 8
    table = running.get(f"plans/{made['id']}")
    q = np.array([row["q_deg"] for row in table["rows"]])
    poses = read_plan(running.folder / made["name"])
    assert poses.q is not None
    assert poses.p_cmd is not None
    np.testing.assert_allclose(np.deg2rad(q), poses.q)
    np.testing.assert_allclose([row["p_mm"] for row in table["rows"]], poses.p_cmd, atol=1e-6)
    expected = running.get(f"plans/{made['id']}/expected")
    assert expected["n"] == 8
    cell = Workspace(running.folder.parent).cell(running.cell).load()
    assert expected["rows"] == expected_accuracy(cell, poses.q)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("truepose.web.measure.routes.expected_accuracy", lambda *_: [])
        assert running.get(f"plans/{made['id']}/expected") == expected  # kept: it takes seconds
        settings = running.folder / "cell.toml"
        before = settings.read_text("utf-8")
        settings.write_text(f"{before}\n[measuring]\nrepeatability_mm = 0.123\n", "utf-8")
        assert running.get(f"plans/{made['id']}/expected")["rows"] == []  # of another cell
        settings.write_text(before, "utf-8")
    program = running.client.get(f"{API}/cells/{running.cell}/plans/{made['id']}/program")
    assert program.headers["content-disposition"].startswith("attachment")
    beside = next((running.folder / made["name"]).parent.glob("measure.*"))
    motions = [line for line in beside.read_text("utf-8").splitlines() if "P001" in line]
    assert [line for line in program.text.splitlines() if "P001" in line] == motions


@pytest.mark.exhaustive
def test_a_plan_is_chosen_after_a_map_and_from_candidates(running: Bench, measured: Samples) -> None:
    first = measured[np.arange(len(measured) - 6)]
    fit_cell(running.virtual.cell, first, "ordinary-kriging").save(running.folder / "first.truepose")
    (known,) = running.get("maps")
    body = {"n": 3, "after": known["sha"], "candidates": running.plan}
    job = wait(running, running.client.post(f"{API}/cells/{running.cell}/plans", json=body))
    assert job.state == "done", job.problem
    assert {"--after=first.truepose", "--candidates=plans/plan.csv"} <= set(job.command)
    made = next(plan for plan in running.get("plans") if plan["id"] != running.plan)
    rows = [row["q_deg"] for row in running.get(f"plans/{made['id']}")["rows"]]
    offered = np.rad2deg(measured.q[-6:])  # none is measured twice
    assert all(np.abs(offered - row).max(axis=1).min() < 1e-6 for row in rows)
    write_samples(running.folder / "series.csv", first)
    (table,) = running.get("samples")
    enough = {"n": 3, "after": table["id"], "until_mm": 5.0}
    job = wait(running, running.client.post(f"{API}/cells/{running.cell}/plans", json=enough))
    assert job.state == "done", job.problem
    assert {f"--after={table['name']}", "--until=5mm"} <= set(job.command)
    assert job.result["files"] == []
    wrongs = ({"after": "0" * 64}, {"candidates": "0" * 12}, {"after": running.plan}, {"until_mm": 0.0})
    for wrong in wrongs:
        answer = running.client.post(f"{API}/cells/{running.cell}/plans", json={"n": 3, **wrong})
        assert answer.status_code in (404, 422)


@pytest.mark.parametrize("body", ['{"n": 0}', '{"n": 8, "method": "<b>"}', '{"n": NaN}', '{"n": 8, "seed": -1}', "{}"])
def test_a_plan_that_makes_no_sense_starts_nothing(bench: Bench, body: str) -> None:
    headers = {"Content-Type": "application/json"}
    answer = bench.client.post(f"{API}/cells/{bench.cell}/plans", content=body, headers=headers)
    assert answer.status_code == 422
    assert bench.client.get(f"{API}/jobs").json() == []


def test_a_table_that_cannot_be_read_is_listed_with_the_reason(bench: Bench) -> None:
    (bench.folder / "bad.csv").write_text("row,q1_deg,x_meas_mm,y_meas_mm,z_meas_mm\n0,1,x,0,0\n", "utf-8")
    (entry,) = bench.get("samples")
    assert entry["count"] == 1
    assert "is not a number" in entry["problem"]
    assert bench.client.get(f"{API}/cells/{bench.cell}/samples/{entry['id']}").status_code == 422


def test_a_link_in_place_of_a_folder_leads_nowhere(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "outside").mkdir()
    for folder in ("readings", "samples"):
        (bench.folder / folder).symlink_to(tmp_path / "outside")
    answer = bench.send(preview=False)
    assert answer.status_code == 422, answer.text
    assert list((tmp_path / "outside").iterdir()) == []


def test_a_full_disk_leaves_neither_readings_nor_a_job(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    before = bench.left()

    def full(_self: Path, _goal: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", full)
        answer = bench.send(preview=False)
    assert answer.status_code == 507, answer.text
    assert "free some space" in answer.json()["detail"]
    assert bench.left() == before
    assert bench.client.get(f"{API}/jobs").json() == []
