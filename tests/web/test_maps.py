"""Maps over the API: every number is that of the library and of the command line."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from truepose import VirtualCell, fit_cell, load_map
from truepose.report.knowledge import knowledge
from truepose.report.region import predict_positions
from truepose.samples import Poses, write_samples
from truepose.web import Workspace, create_app
from truepose.web.maps.facts import MapEntry, of_cell
from truepose.web.maps.tables import written
from truepose.web.security import CSRF_HEADER, Guard

BASE = "http://127.0.0.1:8765"


@dataclass
class Page:
    """A client inside a session, the workspace's folder, and the cell."""

    client: TestClient
    root: Path
    cell: str
    headers: dict[str, str]

    def get(self, path: str, **query: Any) -> Any:
        answer = self.client.get(f"/api/v1{path}", params=query)
        assert answer.status_code == 200, answer.text
        return answer.json() if "json" in answer.headers["content-type"] else answer.content

    def post(self, path: str, body: dict[str, Any]) -> Any:
        return self.client.post(f"/api/v1{path}", json=body, headers=self.headers)

    def sha(self, name: str) -> str:
        return str(load_map(self.root / "one" / "maps" / f"{name}.truepose").hash)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    root = tmp_path_factory.mktemp("work")
    folder = root / "one"
    (folder / "maps").mkdir(parents=True)
    (folder / "samples").mkdir()
    virtual = VirtualCell("paper")
    samples = virtual.measure(virtual.design(60))
    (folder / "cell.toml").write_text(virtual.cell.to_toml(), "utf-8")
    write_samples(folder / "samples" / "a.csv", samples)
    for name in ("ordinary-kriging", "ordinary-kriging-joint", "kinematic-kriging"):
        fit_cell(virtual.cell, samples, name).save(folder / "maps" / f"{name}.truepose")
    guard = Guard(port=8765)
    with TestClient(create_app(Workspace(root), guard), base_url=BASE) as client:
        client.get(f"/?token={guard.token}")
        cell = Workspace(root).cells()[0].id
        yield Page(client, root, cell, {CSRF_HEADER: guard.csrf})


@pytest.fixture(params=["ordinary-kriging", "ordinary-kriging-joint", "kinematic-kriging"])
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def rows(content: bytes) -> np.ndarray:
    return np.frombuffer(content, "<f4").reshape(-1, 7)


@pytest.mark.exhaustive
def test_the_list_tells_what_each_figure_is_of(page: Page) -> None:
    entries = {entry["file"]: entry for entry in page.get(f"/cells/{page.cell}/maps")}
    error_map = load_map(page.root / "one" / "maps" / "ordinary-kriging.truepose")
    entry = entries["maps/ordinary-kriging.truepose"]
    assert entry["sha"] == error_map.hash
    assert entry["n"] == len(error_map.samples)
    assert entry["before"]["of"] == "samples after registration"
    assert entry["before"]["mean_mm"] == pytest.approx(np.linalg.norm(error_map.e, axis=1).mean())
    assert entry["after"]["of"] == "leave-one-out"
    left = np.linalg.norm(error_map.leave_one_out().residual, axis=1)
    assert entry["after"]["p95_mm"] == pytest.approx(np.percentile(left, 95))


def test_the_facts_are_those_of_the_command_line(page: Page, run: Callable[..., Any]) -> None:
    folder = page.root / "one"
    out = folder / "again.truepose"
    arguments = [str(folder / "cell.toml"), str(folder / "samples" / "a.csv"), "--out", str(out)]
    printed = run("fit", *arguments, "--predictor", "idw", "--json").json
    facts = page.get(f"/maps/{printed['hash']}")
    out.unlink()
    known = {key: value for key, value in printed.items() if key not in ("map", "better")}
    assert facts["figures"] == known
    assert facts["space"] == "cartesian"
    assert facts["local_std"] is False
    assert facts["foreign"] is None


def test_arrows_are_the_samples_errors_and_what_is_left_of_them(page: Page, name: str) -> None:
    sha = page.sha(name)
    error_map = page.client.app.state.workspace.map(sha)[2]  # type: ignore[attr-defined]
    before = rows(page.get(f"/maps/{sha}/arrays.bin"))
    assert before[:, :3] == pytest.approx(error_map.p_cmd, abs=1e-3)
    assert before[:, 3:6] == pytest.approx(error_map.e, abs=1e-6)
    std = np.linalg.norm(error_map.predict_errors(error_map.samples)[1], axis=1)
    assert before[:, 6] == pytest.approx(std, rel=1e-5)
    after = rows(page.get(f"/maps/{sha}/arrays.bin", set="leave-one-out"))
    assert after[:, :3] == pytest.approx(before[:, :3])
    assert after[:, 3:6] == pytest.approx(error_map.leave_one_out().residual, abs=1e-6)


def test_grid_slices_and_volume_agree_with_predictions_at_their_places(page: Page, name: str) -> None:
    sha = page.sha(name)
    error_map = page.client.app.state.workspace.map(sha)[2]  # type: ignore[attr-defined]
    facts = page.get(f"/maps/{sha}")
    low, high = np.array(facts["low_mm"]), np.array(facts["high_mm"])
    grid = rows(page.get(f"/maps/{sha}/arrays.bin", set="grid", n=90))
    assert 20 <= len(grid) <= 90
    e, std = predict_positions(error_map, grid[:, :3].astype(float))
    assert grid[:, 3:6] == pytest.approx(e, abs=2e-4)  # places are rounded to single precision
    assert grid[:, 6] == pytest.approx(np.linalg.norm(std, axis=1), rel=1e-2)
    at = float(low[1] + 0.25 * (high[1] - low[1]))
    plane = np.frombuffer(page.get(f"/maps/{sha}/slices.bin", plane="xz", at=at, n=5), "<f4").reshape(2, 5, 5)
    place = [low[0] + 0.75 * (high[0] - low[0]), at, low[2] + 0.5 * (high[2] - low[2])]
    e, std = predict_positions(error_map, np.array([place]))
    assert plane[0, 2, 3] == pytest.approx(np.linalg.norm(e), nan_ok=True, rel=1e-5)
    assert plane[1, 2, 3] == pytest.approx(np.linalg.norm(std), nan_ok=True, rel=1e-5)
    volume = np.frombuffer(page.get(f"/maps/{sha}/volume.bin", n=3), "<f4").reshape(3, 3, 3)
    corner = np.linalg.norm(predict_positions(error_map, np.array([[high[0], low[1], low[2]]]))[1])
    assert volume[0, 0, 2] == pytest.approx(corner, nan_ok=True, rel=1e-5)


def test_a_result_is_computed_once_and_kept_in_the_workspace(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    from truepose.web.maps import arrays

    sha = page.sha("ordinary-kriging")
    first = page.get(f"/maps/{sha}/volume.bin", n=4)
    monkeypatch.setattr(arrays, "volume", lambda *_: pytest.fail("computed again"))
    assert page.get(f"/maps/{sha}/volume.bin", n=4) == first
    assert any((page.root / ".truepose" / "cache").iterdir())
    monkeypatch.setattr(arrays, "volume", lambda *_: b"anew")
    monkeypatch.setattr("truepose.web.cache.code_hash", lambda: "of other code")
    assert page.get(f"/maps/{sha}/volume.bin", n=4) == b"anew"


@pytest.mark.sampled(2)
@pytest.mark.parametrize("table", ["samples", "figures", "candidates", "curves", "excluded", "variogram"])
def test_tables_are_exported_with_units(page: Page, table: str) -> None:
    text = page.get(f"/maps/{page.sha('kinematic-kriging')}/table.csv", table=table).decode()
    head, *lines = csv.reader(text.splitlines())
    assert all(len(line) == len(head) for line in lines)
    if table == "samples":
        error_map = load_map(page.root / "one" / "maps" / "kinematic-kriging.truepose")
        column = head.index("y_error_leave_one_out_mm")
        values = [float(line[column]) for line in lines]
        assert values == pytest.approx(error_map.leave_one_out().residual[:, 1], rel=1e-6)
    if table in ("samples", "figures", "curves", "variogram"):
        assert lines


def test_texts_of_tables_are_no_formulas() -> None:
    text = written(["reason"], [["=1+1"], ["@cmd"], ["plain, with comma"]])
    assert list(csv.reader(text.splitlines())) == [["reason"], ["'=1+1"], ["'@cmd"], ["plain, with comma"]]


def test_curves_are_what_explain_knows(page: Page) -> None:
    sha = page.sha("kinematic-kriging")
    error_map = load_map(page.root / "one" / "maps" / "kinematic-kriging.truepose")
    curves = page.get(f"/maps/{sha}/curves")
    known = knowledge(error_map)
    assert [one["joint"] for one in curves["joints"]] == [curve.joint + 1 for curve in known.curves]
    assert curves["joints"][0]["std_mrad"] == pytest.approx(1e3 * known.curves[0].std)
    assert len(curves["measure_next"]) == 5


def test_held_parameters_of_a_variogram_are_those_of_the_command_line(page: Page, run: Callable[..., Any]) -> None:
    sha, folder = page.sha("ordinary-kriging"), page.root / "one"
    held = {"nugget": 0.0004, "range": 700.0}
    found = page.post(f"/maps/{sha}/variogram", {**held, "space": "cartesian"}).json()
    words = found["command"].replace("cell.toml", str(folder / "cell.toml"))
    words = words.replace("SAMPLES.csv", str(folder / "samples" / "a.csv"))
    printed = run(*words.split()[1:], "--json").json["variograms"][0]
    for key in ("nugget_mm2", "sill_mm2", "range"):
        assert found["model"][key] == pytest.approx(printed["model"][key], rel=1e-6)
    assert found["model"]["nugget_mm2"] == held["nugget"]
    assert found["verdict"] == printed["verdict"]
    fitted = page.get(f"/maps/{sha}/variogram")
    assert fitted["model"]["nugget_mm2"] != held["nugget"]
    curve = found["model"]
    assert curve["semivariance_mm2"][0] == pytest.approx(curve["nugget_mm2"])
    assert curve["semivariance_mm2"][-1] <= curve["nugget_mm2"] + curve["sill_mm2"] + 1e-9
    assert all(point["low_mm2"] <= point["high_mm2"] for point in found["points"])


@pytest.mark.parametrize("language", ["en", "de", "zh"])
def test_the_findings_come_in_the_language_of_the_page(page: Page, language: str) -> None:
    texts = page.get(f"/maps/{page.sha('ordinary-kriging')}/variogram", language=language)["findings"]
    assert len(texts) >= 6
    assert all(texts.values())


def test_single_poses_are_predicted_as_by_the_library(page: Page, name: str) -> None:
    error_map = load_map(page.root / "one" / "maps" / f"{name}.truepose")
    q = error_map.samples.q[:3] + 0.01
    answer = page.post(f"/maps/{page.sha(name)}/predict", {"q_deg": np.rad2deg(q).tolist()})
    found, expected = answer.json(), error_map.predict(Poses(q=q, source="test"))
    assert found["e_mm"] == pytest.approx(expected.e, abs=1e-9)
    assert found["std_mm"] == pytest.approx(expected.std, abs=1e-9)
    assert found["p_measured_mm"] == pytest.approx(expected.p_measured, abs=1e-6)


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"q_deg": [[0, 0, 0, 0, 0, 0]], "p_mm": [[1, 2, 3]]},
        {"q_deg": []},
        {"q_deg": [[0.0, 1.0]]},
        {"q_deg": [[0, -90, 90, 0, 45, 0], [0]]},
        {"q_deg": [[9999, -90, 90, 0, 45, 0]]},
        {"p_mm": []},
        {"p_mm": [[1, 2]]},
    ],
)
def test_poses_that_are_none_are_refused(page: Page, body: dict[str, Any]) -> None:
    answer = page.post(f"/maps/{page.sha('kinematic-kriging')}/predict", body)
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("text", ['{"q_deg": [[NaN, 0, 0, 0, 0, 0]]}', '{"p_mm": [[1, 2, Infinity]]}'])
def test_numbers_that_are_none_are_refused(page: Page, text: str) -> None:
    path = f"/api/v1/maps/{page.sha('ordinary-kriging')}/predict"
    answer = page.client.post(path, content=text, headers={**page.headers, "Content-Type": "application/json"})
    assert answer.status_code == 422
    assert "NaN" not in answer.text


def test_a_fit_and_a_validation_are_command_lines_that_write_into_the_cell(page: Page) -> None:
    table = page.get(f"/cells/{page.cell}/files", kind="samples")[0]
    order = {"samples": table["id"], "predictor": "idw:power=3", "name": "../../bad <name>"}
    answer = page.post(f"/cells/{page.cell}/maps", order)
    assert answer.status_code == 202, answer.text
    command = answer.json()["command"]
    assert command[:3] == ["fit", "cell.toml", "samples/a.csv"]
    assert "--predictor=idw:power=3" in command
    (out,) = [word for word in command if word.startswith("--out=")]
    assert out == "--out=maps/bad _name_.truepose"
    answer = page.post(f"/maps/{page.sha('ordinary-kriging')}/validation", {"samples": table["id"]})
    assert answer.json()["command"] == ["validate", "maps/ordinary-kriging.truepose", "samples/a.csv"]


@pytest.mark.parametrize("predictor", ["krigging", "--force", "idw:power=x", ""])
def test_an_unknown_predictor_starts_no_job(page: Page, predictor: str) -> None:
    table = page.get(f"/cells/{page.cell}/files", kind="samples")[0]
    answer = page.post(f"/cells/{page.cell}/maps", {"samples": table["id"], "predictor": predictor})
    assert answer.status_code == 422


def test_a_broken_map_is_listed_with_its_problem_and_has_no_address(page: Page) -> None:
    whole = (page.root / "one" / "maps" / "ordinary-kriging.truepose").read_bytes()
    middle = len(whole) // 2
    contents = {
        "empty": b"",
        "text": b"no map",
        "cut": whole[:middle],
        "bit": whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :],
    }
    folder = page.root / "one" / "maps"
    for name, content in contents.items():
        (folder / f"{name}.truepose").write_bytes(content)
    try:
        entries = {entry["file"]: entry for entry in page.get(f"/cells/{page.cell}/maps")}
        for name in contents:
            assert entries[f"maps/{name}.truepose"]["problem"], name
            assert str(page.root) not in entries[f"maps/{name}.truepose"]["problem"]
        assert entries["maps/ordinary-kriging.truepose"]["problem"] is None
    finally:
        for name in contents:
            (folder / f"{name}.truepose").unlink()


@pytest.mark.parametrize(
    "path", ["", "/arrays.bin", "/slices.bin", "/volume.bin", "/curves", "/variogram", "/candidates"]
)
def test_a_map_that_is_not_here_is_not_found(page: Page, path: str) -> None:
    for sha in ("0" * 64, "..%2F..%2Fcell.toml", "x"):
        answer = page.client.get(f"/api/v1/maps/{sha}{path}")
        assert answer.status_code == 404
        assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize(
    ("path", "query"),
    [
        ("arrays.bin", {"set": "other"}),
        ("arrays.bin", {"set": "grid", "n": 100_001}),
        ("slices.bin", {"plane": "zz"}),
        ("slices.bin", {"at": "nan"}),
        ("slices.bin", {"n": 1}),
        ("volume.bin", {"n": 65}),
        ("variogram", {"space": "other"}),
    ],
)
def test_questions_beyond_the_limits_are_refused(page: Page, path: str, query: dict[str, Any]) -> None:
    answer = page.client.get(f"/api/v1/maps/{page.sha('ordinary-kriging')}/{path}", params=query)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


def test_a_map_of_another_cell_says_so(page: Page, tmp_path: Path) -> None:
    from truepose.cell import template

    folder = page.root / "two"
    folder.mkdir()
    try:
        (folder / "cell.toml").write_text(template("universal-robots-ur10"), "utf-8")
        whole = (page.root / "one" / "maps" / "ordinary-kriging.truepose").read_bytes()
        (page.root / "one" / "maps" / "ordinary-kriging.truepose").rename(tmp_path / "kept")
        (folder / "stranger.truepose").write_bytes(whole)
        sha = load_map(folder / "stranger.truepose").hash
        assert "universal-robots-ur10" in page.get(f"/maps/{sha}")["foreign"]
    finally:
        (tmp_path / "kept").rename(page.root / "one" / "maps" / "ordinary-kriging.truepose")
        for path in folder.iterdir():
            path.unlink()
        folder.rmdir()


@pytest.mark.parametrize("at", ["1e157", "-1e300", "1e13", "nan", "inf"])
def test_a_plane_beyond_every_number_of_use_is_refused(page: Page, at: str) -> None:
    path = f"/api/v1/maps/{page.sha('ordinary-kriging')}/slices.bin"
    assert page.client.get(path, params={"at": at, "n": 3}).status_code == 422
    assert page.client.get(path, params={"at": "1e12", "n": 3}).status_code == 200


@pytest.mark.parametrize("name", ["nugget", "sill", "range"])
def test_a_parameter_of_a_variogram_beyond_every_number_of_use_is_refused(page: Page, name: str) -> None:
    path = f"/api/v1/maps/{page.sha('ordinary-kriging')}/variogram"
    assert page.client.post(path, json={name: 1e200}, headers=page.headers).status_code == 422


@pytest.mark.promise("The page of a cell lists the maps of its own robot first, and marks those of another one.")
def test_maps_of_another_robot_are_marked() -> None:
    cell = VirtualCell("paper").cell
    own = cell.model_copy(update={"robot": cell.robot.model_copy(update={"id": "A-1"})})
    entries = [
        MapEntry(sha=str(k), file="m", modified=0.0, size=1, robot_id=one) for k, one in enumerate(("B", "a-1", None))
    ]
    for stated, order in (
        (own, [("1", False), ("2", False), ("0", True)]),
        (cell, [(str(k), False) for k in range(3)]),
    ):
        folder: Any = SimpleNamespace(load=lambda stated=stated: stated)
        assert [(one.sha, one.other_robot) for one in of_cell(folder, entries)] == order
