"""Corrections: the table of targets, the path, the difference and the files are those of the record."""

from __future__ import annotations

import csv
import gzip
import hashlib
import io
import json
import math
import os
import random
import struct
import time
import zipfile
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from truepose.cli.setup import init
from truepose.geometry import euler, make_transform
from truepose.programs import Coverage, FrameTable, ReadOptions, correct_program, correct_programs
from truepose.web import Workspace, create_app
from truepose.web.corrections import differences
from truepose.web.corrections import index as correction_index
from truepose.web.corrections.columns import ORDERS, VERDICTS
from truepose.web.corrections.routes import DifferencePage, TargetPage
from truepose.web.security import Guard

BASE = "http://127.0.0.1:8765"
FRAMES = FrameTable(
    tools={1: make_transform(euler("kuka", [10.0, 20.0, -30.0]), [5.0, -3.0, 150.0])},
    bases={n: make_transform(euler("kuka", [30.0 * n, -15.0, 5.0]), [900.0, 100.0 * n, 40.0]) for n in (1, 2)},
)
MARKUP = "<img src=x onerror=alert(1)>&\"'"


class Map:
    """A map whose errors grow with x; every 7th target is refused by its guard."""

    hash = "ab" * 32

    def correct(self, poses: np.ndarray, *, on_guard: str, **_: Any) -> SimpleNamespace:
        p, n = poses[:, :3, 3], len(poses)
        e = np.column_stack([p[:, 0] / 4000.0, np.full(n, 0.1), np.zeros(n)])
        left = np.arange(n) % 7 == 3
        e[left] = 0.0
        return SimpleNamespace(
            p_target=p,
            p_command=p - e,
            e=e,
            std=np.abs(p) / 1e4 + 2.0,
            verdict=np.where(left, "skip", "correct"),
            reason=[
                f"correction of {k}.5 mm is above the limit of 0.3 mm" if skip else "" for k, skip in enumerate(left)
            ],
        )


def krl(n: int, seed: int = 0) -> bytes:
    """Return a program with targets in two bases, a point whose base is not known, and a relative motion."""
    rng = random.Random(seed)
    lines = ["&ACCESS RVP", "DEF panel( )", "$TOOL=TOOL_DATA[1]", "; Gr\xf6\xdfe"]
    for k in range(n):
        if k in (0, n // 2, n - 3):
            lines.append(f"$BASE=BASE_DATA[{1 + (k == n // 2) + 5 * (k == n - 3)}]")
        x, y, z = (rng.uniform(*span) for span in ((-300, 900), (-400, 400), (0, 300)))
        lines.append(f"LIN {{X {x:.3f},Y {y:.2f},Z {z:.1f},A 0.0,B 90.0,C 0.0}} C_DIS")
        lines += ["; comment"] * (k % 5)
    lines += ["LIN_REL {X 5}", "END", ""]
    return "\r\n".join(lines).encode("latin-1")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    root = tmp_path / "work"
    init(root / "cell", robot="kuka-kr210-r2700-extra")
    return root


@pytest.fixture
def client(root: Path) -> TestClient:
    guard = Guard(port=8765)
    client = TestClient(create_app(Workspace(root), guard), base_url=BASE)
    client.get(f"/?token={guard.token}")
    return client


def corrected(root: Path, content: bytes, name: str = "panel.src", out: str = "corrected/run", **options: Any) -> Any:
    """Correct a program of the cell as the command line does, which names it as seen from the cell's folder."""
    before = Path.cwd()
    os.chdir(root / "cell")
    try:
        path = Path("programs/up") / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        done = correct_program(path, Map(), frames=FRAMES, on_guard="skip", **options)
        done.write(out)
    finally:
        os.chdir(before)
    return done


def listed(client: TestClient) -> list[dict[str, Any]]:
    cell = client.app.state.workspace.cells()[0].id  # type: ignore[attr-defined]
    return client.get(f"/api/v1/cells/{cell}/corrections").json()  # type: ignore[no-any-return]


def of(client: TestClient, part: str = "", **query: Any) -> Any:
    """Return what the application says of its only correction."""
    return client.get(f"/api/v1/corrections/{listed(client)[0]['id']}{part}", params=query)


def rows(client: TestClient, **query: Any) -> list[dict[str, Any]]:
    return of(client, "/targets", limit=1000, **query).json()["rows"]  # type: ignore[no-any-return]


def test_a_correction_of_the_command_line_is_shown_with_its_counts(client: TestClient, root: Path) -> None:
    done = corrected(root, krl(40))
    (entry,) = listed(client)
    assert (entry["name"], entry["folder"], entry["map_sha256"]) == ("panel", "corrected/run", "ab" * 32)
    assert entry["summary"] == json.loads(json.dumps(done.summary()))
    detail = of(client).json()
    assert detail["index"]["ready"]
    assert sum(detail["verdicts"].values()) == len(done.targets)
    assert detail["verdicts"]["correct"] == done.summary()["corrected"]
    assert detail["coverage"]["total"] == Coverage.of_outcomes([done.targets]).to_dict()["total"]
    assert [(one["file"], one["found"]) for one in detail["files"]] == [("programs/up/panel.src", True)]
    asked = next(one for one in detail["kinds"] if "BASE_DATA[6]" in one["example"])
    assert asked["option"] == "[frames] of the cell file"
    assert asked["counts"]["skip"] == 3


def test_the_table_holds_what_the_record_holds(client: TestClient, root: Path) -> None:
    done = corrected(root, krl(60))
    found, targets = rows(client), done.to_dict()["targets"]
    TargetPage.model_validate(of(client, "/targets").json(), strict=True, extra="forbid")
    assert len(found) == len(targets)
    for k, (row, target) in enumerate(zip(found, targets, strict=True)):
        assert row["row"] == k
        for name in ("name", "file", "line", "motion", "frame", "tool", "reason", "note"):
            assert row[name] == target[name]
        for name in ("before_mm", "after_mm", "base_mm", "base_after_mm"):
            assert row[name] == (None if target[name][0] is None else target[name])
        known = target["correction_mm"][0] is not None
        assert row["std"] == (target["std_mm"] and pytest.approx(target["std_mm"], rel=1e-6))
        assert row["change"] == (pytest.approx(math.hypot(*target["correction_mm"]), abs=1e-6) if known else None)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("descending", [False, True])
@pytest.mark.parametrize("sort", ORDERS)
def test_every_column_sorts_and_what_has_no_number_comes_last(
    client: TestClient, root: Path, sort: str, descending: bool
) -> None:
    corrected(root, krl(50))
    plain = rows(client)
    found = rows(client, sort=sort, descending=descending)
    assert sorted(row["row"] for row in found) == list(range(len(plain)))
    if sort == "name":
        keys = [(row["name"].split(":")[0].lower(), int(row["name"].split(":")[1])) for row in found]
    elif sort == "verdict":
        keys = [VERDICTS.index(row["verdict"]) for row in found]
    else:
        keys = [row[sort] for row in found]
    empty = [k for k, key in enumerate(keys) if key is None]
    assert empty == list(range(len(keys) - len(empty), len(keys)))
    known = keys[: len(keys) - len(empty)]
    assert known == sorted(known, reverse=descending)
    assert len({*map(str, known)}) > 1


def test_verdicts_reasons_and_texts_filter_together(client: TestClient, root: Path) -> None:
    corrected(root, krl(60))
    plain = rows(client)
    kinds = of(client).json()["kinds"]
    assert len(kinds) > 3
    for verdict in ("correct", "skip"):
        wanted = [row["row"] for row in plain if row["verdict"] == verdict]
        assert [row["row"] for row in rows(client, verdict=verdict)] == wanted
    for one in kinds:
        found = rows(client, kind=one["kind"])
        assert len(found) == sum(one["counts"].values())
    for text in ("LIN:1", "lin:1", "BASE 2", "limit of", "panel.SRC", "nowhere", "n:", "Größe", "x" * 100):
        wanted = [
            row["row"]
            for row in plain
            if any(text.lower() in row[name].lower() for name in ("name", "file", "reason", "note", "frame", "tool"))
        ]
        assert [row["row"] for row in rows(client, search=text)] == wanted, text
        left = [row["row"] for row in plain if row["row"] in wanted and row["verdict"] == "skip"]
        assert [row["row"] for row in rows(client, search=text, verdict="skip")] == left


def test_pages_join_to_the_whole(client: TestClient, root: Path) -> None:
    corrected(root, krl(45))
    whole = rows(client, sort="std", descending=True)
    parts = [of(client, "/targets", offset=k, limit=10, sort="std", descending=True).json() for k in range(0, 60, 10)]
    assert [row for part in parts for row in part["rows"]] == whole
    assert {part["total"] for part in parts} == {len(whole)}


def decoded(content: bytes) -> tuple[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    n, known = struct.unpack_from("<2I", content)
    before, change = (np.frombuffer(content, "<f4", 3 * n, 8 + k * 12 * n).reshape(n, 3) for k in (0, 1))
    which = np.frombuffer(content, "<u4", n, 8 + 24 * n)
    verdict = np.frombuffer(content, "u1", n, 8 + 28 * n)
    assert len(content) == 8 + 29 * n
    return known, before, change, which, verdict


def test_the_path_is_that_of_the_program_in_the_base_frame(client: TestClient, root: Path) -> None:
    done = corrected(root, krl(60))
    known, before, change, which, verdict = decoded(of(client, "/path.bin").content)
    rows_known = [i for i, target in enumerate(done.program.targets) if target.tf_base_frame is not None and target.xyz]
    assert which.tolist() == rows_known
    assert known == len(rows_known)
    for i, p, d, code in zip(which.tolist(), before, change, verdict.tolist(), strict=True):
        outcome = done.targets[i]
        tf = outcome.target.tf_base_frame
        np.testing.assert_allclose(p, (tf @ [*outcome.p_before, 1.0])[:3], atol=1e-3)
        np.testing.assert_allclose(d, tf[:3, :3] @ outcome.correction, atol=2e-6)
        assert VERDICTS[code] == outcome.verdict


def test_a_path_with_fewer_points_keeps_those_that_are_not_corrected(client: TestClient, root: Path) -> None:
    done = corrected(root, krl(200))
    whole = decoded(of(client, "/path.bin").content)
    part = decoded(of(client, "/path.bin", most=120).content)
    assert part[0] == whole[0] > len(part[3])
    assert len(part[3]) <= 120
    left = {i for i in whole[3].tolist() if done.targets[i].verdict == "skip"}
    assert left <= set(part[3].tolist())


def difference(client: TestClient, **query: Any) -> list[dict[str, Any]]:
    return of(client, "/diff", limit=1000, **query).json()["rows"]  # type: ignore[no-any-return]


def test_the_difference_is_that_of_the_files_and_marks_the_changed_numbers(client: TestClient, root: Path) -> None:
    content = krl(30)
    done = corrected(root, content)
    DifferencePage.model_validate(of(client, "/diff").json(), strict=True, extra="forbid")
    (new,) = done.files.values()
    lines = [text.decode("latin-1").split("\r\n") for text in (content, new)]
    changed = [k for k, (a, b) in enumerate(zip(*lines, strict=True), 1) if a != b]
    found = difference(client)
    assert [row["line"] for row in found if row["kind"] == "old"] == changed
    assert [row["line"] for row in found if row["kind"] == "new"] == changed
    near = {k + step for k in changed for step in range(-3, 4)} & set(range(1, len(lines[0])))
    assert {row["line"] for row in found} == near
    for row in found:
        text = "".join(row["parts"])
        if row["kind"] == "header":
            assert row["line"] - 1 not in near
        else:
            assert text == lines[row["kind"] == "new"][row["line"] - 1]
    for old, fresh in pairwise(found):
        if old["kind"] == "old":
            assert fresh["kind"] == "new"
            assert old["parts"][::2] == fresh["parts"][::2]
            for a, b in zip(old["parts"][1::2], fresh["parts"][1::2], strict=True):
                assert a != b
                assert float(a) != float(b)  # a number each, nothing else


def test_any_part_of_a_difference_is_the_same_as_in_the_whole(client: TestClient, root: Path) -> None:
    corrected(root, krl(40))
    whole = difference(client)
    assert [
        row for k in range(0, len(whole), 7) for row in of(client, "/diff", offset=k, limit=7).json()["rows"]
    ] == whole
    line = [row["line"] for row in whole if row["kind"] == "new"][20]
    near = of(client, "/diff", line=line, limit=9).json()
    assert any(row["line"] == line and row["kind"] == "new" for row in near["rows"])


@pytest.mark.parametrize(
    ("name", "encoding", "comment"), [("R1.jbi", "cp932", "溶接 <b>"), ("R2.jbi", "utf-8", "溶接 <b>")]
)
def test_comments_are_shown_in_the_letters_of_their_controller(
    client: TestClient, root: Path, name: str, encoding: str, comment: str
) -> None:
    text = (
        f"/JOB\n//NAME {name[:2]}\n//POS\n///TOOL 1\n///POSTYPE BASE\n///RECTAN\n///RCONF 0,0,0,0,0,0,0,0\n"
        "C00000=900.500,20.000,300.000,180.0000,0.0000,-90.0000\n//INST\n///GROUP1 RB1\n"
        f"'{comment}\nMOVL C00000 V=100.0\nEND\n"
    )
    stored = text.replace("\n", "\r\n").encode(encoding)
    done = corrected(root, stored, name=name)
    assert done.summary()["corrected"] == 1
    assert of(client, "/diff").json()["changed"] == 1
    assert "".join(difference(client)[-1]["parts"]) == f"'{comment}"  # the last line around the change


def test_a_packed_program_is_compared_by_its_text(tmp_path: Path) -> None:
    texts = [f'<a>\n <b x="{x}"/>\n</a>\n'.encode() for x in ("1.000", "1.25")]
    pair = differences.Pair("a.urp", tmp_path / "a.urp", tmp_path / "b.urp")
    for path, text in zip((pair.before, pair.after), texts, strict=True):
        path.write_bytes(gzip.compress(text, mtime=0))
    (entry,) = differences.write_differences([pair], tmp_path)
    found = differences.Difference(tmp_path, 0, entry).page(0, 10)
    assert [(row["kind"], row["line"]) for row in found][1:4] == [("context", 1), ("old", 2), ("new", 2)]
    assert [row["parts"][1] for row in found[2:4]] == ["1.000", "1.25"]


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("last", [b"", b"LIN 9"])
def test_lines_end_as_the_readers_say(tmp_path: Path, end: bytes, last: bytes) -> None:
    old = [b"LIN %d" % k for k in range(12)]
    new = [b"LIN 5.5" if k == 5 else line for k, line in enumerate(old)]
    pair = differences.Pair("a.src", tmp_path / "a.src", tmp_path / "b.src")
    for path, lines in zip((pair.before, pair.after), (old, new), strict=True):
        path.write_bytes(end.join([*lines, last]))
    (entry,) = differences.write_differences([pair], tmp_path)
    assert (entry["changed"], entry["lines"]) == (1, 12 + bool(last))
    found = differences.Difference(tmp_path, 0, entry).page(0, 100)
    assert ["".join(row["parts"]) for row in found if row["kind"] == "new"] == ["LIN 5.5"]
    assert [row["line"] for row in found] == [3, 3, 4, 5, 6, 6, 7, 8, 9]


def test_a_member_of_a_zip_has_its_difference(client: TestClient, root: Path) -> None:
    before = Path.cwd()
    os.chdir(root / "cell")
    try:
        folder = Path("programs/b")
        folder.mkdir(parents=True)
        with zipfile.ZipFile(folder / "b.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("am.ini", "[Archive]\nName=x\n[Roboter]\nIRSerialNr=1\n")
            archive.writestr("KRC/R1/Program/panel.src", krl(12))
            archive.writestr("KRC/R1/System/$config.dat", "DEFDAT $CONFIG\r\nENDDAT\r\n")
        batch = correct_programs([folder / "b.zip"], Map(), frames=FRAMES, on_guard="skip")
        batch.write("corrected/b", whole=True)
    finally:
        os.chdir(before)
    found = difference(client)
    assert [row for row in found if row["kind"] == "new"]
    with zipfile.ZipFile(io.BytesIO(of(client, "/files.zip").content)) as sent:
        assert "b.zip" in sent.namelist()
        assert sent.read("b.zip") == (root / "cell/corrected/b/b.zip").read_bytes()


def test_a_file_that_changed_since_has_no_difference(client: TestClient, root: Path) -> None:
    corrected(root, krl(12))
    (root / "cell/corrected/run/panel.src").write_bytes(b"other")
    answer = of(client, "/diff")
    assert answer.status_code == 404
    assert "corrected file" in answer.json()["detail"]


@pytest.mark.parametrize("name", ["../../secret.src", "/{secret}", "programs/link.src"])
def test_a_record_never_leads_out_of_its_cell(client: TestClient, root: Path, name: str) -> None:
    corrected(root, krl(12))
    secret = root.parent / "secret.src"
    secret.write_bytes(b"secret")
    (root / "cell/programs/link.src").symlink_to(secret)
    path = root / "cell/corrected/run/panel.corrections.json"
    digest = hashlib.sha256(b"secret").hexdigest()
    record = json.loads(path.read_text())
    entry = {"file": name.format(secret=secret), "sha256_before": digest, "sha256_after": digest}
    path.write_text(json.dumps({**record, "files": [entry]}))
    assert [one["found"] for one in of(client).json()["files"]] == [False]
    assert of(client, "/diff").status_code == 404
    with zipfile.ZipFile(io.BytesIO(of(client, "/files.zip").content)) as sent:
        assert all(sent.read(one) != b"secret" for one in sent.namelist())


def test_the_download_holds_the_corrected_files_and_the_record(client: TestClient, root: Path) -> None:
    done = corrected(root, krl(30))
    answer = of(client, "/files.zip")
    assert answer.headers["content-disposition"] == "attachment; filename*=UTF-8''panel.zip"
    with zipfile.ZipFile(io.BytesIO(answer.content)) as sent:
        assert sent.testzip() is None
        assert sent.read("panel.src") == next(iter(done.files.values()))
        assert json.loads(sent.read("panel.corrections.json")) == done.to_dict()
        assert set(sent.namelist()) == {"panel.src", "panel.corrections.json", "panel.corrections.csv"}
    assert of(client, "/record").json() == done.to_dict()
    table = list(csv.DictReader(io.StringIO(of(client, "/record", format="csv").text)))
    assert [row["name"] for row in table] == [target["name"] for target in done.to_dict()["targets"]]
    assert of(client, "/record", format="xlsx").content.startswith(b"PK")


def test_the_coverage_is_that_of_the_correction(client: TestClient, root: Path) -> None:
    done = corrected(root, krl(30))
    assert of(client, "/coverage", format="csv").text == Coverage.of_outcomes([done.targets]).to_csv()
    page = of(client, "/coverage")
    assert "Coverage of robot programs" in page.text
    assert "script-src" not in page.headers["content-security-policy"]
    assert page.headers["content-security-policy"].startswith("default-src 'none'")


def test_derived_targets_are_counted_as_the_corrected_points_that_they_follow(client: TestClient, root: Path) -> None:
    body = (
        "DEF panel( )\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\nDECL E6POS XP1={X 100,Y 0,Z 50,A 0,B 90,C 0}\n"
        "LIN XP1\nLIN XP1:{X 0,Y 0,Z -20,A 0,B 0,C 0}\nEND\n"
    )
    done = corrected(root, body.encode(), options=ReadOptions(derived=True, whole_task=True))
    expected = done.summary()
    detail = of(client).json()
    assert detail["verdicts"].get("follows", 0) == expected["following"]
    assert detail["coverage"]["total"]["correctable"] == done.coverage.corrected


def test_names_with_markup_stay_text(client: TestClient, root: Path) -> None:
    name = "<b>R1&amp;.src"
    corrected(root, krl(12), name=name, out=f"corrected/{MARKUP.replace('/', '')}")
    entry = listed(client)[0]
    assert entry["name"] == "<b>R1&amp;"
    assert rows(client)[0]["file"].endswith(name)
    assert "\n" not in of(client, "/files.zip").headers["content-disposition"]
    assert "<b>R1" not in of(client, "/coverage").text


def test_a_long_record_is_indexed_by_a_process_of_its_own(
    client: TestClient, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = corrected(root, krl(40))
    monkeypatch.setattr(correction_index, "SMALL", 0)
    assert not of(client).json()["index"]["ready"]
    answer = of(client, "/targets")
    assert (answer.status_code, "indexed" in answer.json()["detail"]) in ((503, True), (200, False))
    until = time.monotonic() + 60
    while not of(client).json()["index"]["ready"]:
        assert time.monotonic() < until
        time.sleep(0.1)
    assert len(rows(client)) == len(done.targets)


def test_an_index_is_seen_when_it_is_whole_and_made_again_for_another_record(
    client: TestClient, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    corrected(root, krl(12))
    cache = root / ".truepose/cache/corrections"

    def killed(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as broken:
        broken.setattr(correction_index, "write_differences", killed)
        with pytest.raises(KeyboardInterrupt):
            correction_index.write_index(
                root / "cell/corrected/run/panel.corrections.json", root / "cell", cache / "made"
            )
    assert list(cache.iterdir()) == []
    first = len(rows(client))
    corrected(root, krl(20), out="corrected/other")
    assert {len(rows_of(client, one)) for one in listed(client)} == {first, first + 8}


def rows_of(client: TestClient, entry: dict[str, Any]) -> list[Any]:
    found = client.get(f"/api/v1/corrections/{entry['id']}/targets", params={"limit": 1000})
    return found.json()["rows"]  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b'{"format": "truepose corrections"}',
        b'{"format": "truepose corrections", "files": 3}',
        b"\xff\xfe",
    ],
)
def test_what_is_no_record_is_left_out(client: TestClient, root: Path, content: bytes) -> None:
    (root / "cell/corrected").mkdir()
    (root / "cell/corrected/x.corrections.json").write_bytes(content)
    assert listed(client) == []
    assert client.get("/api/v1/corrections/000000000000/targets").status_code == 404


@pytest.mark.parametrize(
    "change", [{"name": None}, {"verdict": "maybe"}, {"before_mm": "x"}, {"before_mm": [1.0]}, {"line": "a"}]
)
def test_a_record_with_broken_targets_is_told(client: TestClient, root: Path, change: dict[str, Any]) -> None:
    corrected(root, krl(12))
    path = root / "cell/corrected/run/panel.corrections.json"
    record = json.loads(path.read_text())
    record["targets"][3] |= change
    if change == {"name": None}:
        del record["targets"][3]["name"]
    path.write_text(json.dumps(record))
    answer = of(client, "/targets")
    assert answer.status_code == 422
    assert "no readable record" in answer.json()["detail"]
