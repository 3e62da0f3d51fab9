"""The demonstration, and `truepose correct` on its program."""

import csv
import json
import re
import shutil
from pathlib import Path

import openpyxl
import pytest


def test_demo_shows_the_improvement(demo):
    _, done = demo
    assert done["before"].keys() == done["after"].keys() == {"n", "mean_mm", "rms_mm", "std_mm", "p95_mm", "max_mm"}
    assert done["reduction_max_percent"] > 75.36  # the paper's
    assert done["before"]["max_mm"] == pytest.approx(1.3, abs=0.35)
    assert done["remeasured"]["reduction_max_percent"] > 75.36
    assert done["after"]["mean_mm"] > 0.8 * done["noise_floor_mm"]
    page = Path(done["report"]).read_text(encoding="utf-8")
    # the checks of the arm and of the reflector: a virtual cell has no controller, and one orientation here
    assert page.count('class="missing"') == 2
    assert "panel.src: PASS. Re-measured targets: 24" in page
    assert Path(done["program"]).exists()


def test_corrected_program_differs_in_digits_only(demo):
    folder, _ = demo
    original, corrected = ((folder / where / "panel.dat").read_bytes() for where in ("program", "corrected"))
    assert original != corrected
    assert re.sub(rb"[-\d.]+", b"", original) == re.sub(rb"[-\d.]+", b"", corrected)
    assert (folder / "program" / "panel.src").read_bytes() == (folder / "corrected" / "panel.src").read_bytes()


def test_corrected_program_is_not_corrected_again(run, demo, tmp_path):
    folder, _ = demo
    again = run("correct", folder / "map.truepose", folder / "corrected" / "panel.src", "--out", tmp_path / "twice")
    assert "already" in again.failed()
    assert not (tmp_path / "twice").exists()


@pytest.mark.exhaustive
def test_demo_table_for_people(run, tmp_path):
    done = run("demo", tmp_path / "d")
    assert done.code == 0
    for word in ("before", "after", "reduction", "report.html"):
        assert word in done.out


@pytest.fixture
def program(demo, tmp_path):
    """A KRL pair to spoil, and the map to correct it with."""
    folder, _ = demo
    shutil.copytree(folder / "program", tmp_path / "program")
    return tmp_path / "program" / "panel.src", folder / "map.truepose"


def test_dry_run_writes_nothing(run, program, tmp_path):
    source, error_map = program
    done = run("correct", error_map, source, "--out", tmp_path / "dry", "--dry-run")
    assert done.code == 0
    assert "+DECL E6POS XP1=" in done.out
    assert not (tmp_path / "dry").exists()


def test_correct_records_every_target(run, program, tmp_path):
    source, error_map = program
    (record,) = run("correct", error_map, source, "--out", tmp_path / "out", "--json").json["programs"]
    assert record["summary"]["corrected"] == 24
    assert json.loads((tmp_path / "out" / "panel.corrections.json").read_text())["targets"] == record["targets"]


def test_correct_writes_records_as_workbooks(run, program, tmp_path):
    source, error_map = program
    written = run("correct", error_map, source, "--out", tmp_path / "out", "--xlsx", "--json").json["written"]
    assert str(tmp_path / "out" / "panel.corrections.xlsx") in written
    sheet = openpyxl.load_workbook(tmp_path / "out" / "panel.corrections.xlsx").active
    rows = list(csv.DictReader((tmp_path / "out" / "panel.corrections.csv").open(encoding="utf-8")))
    heads = [cell.value for cell in sheet[1]]
    assert (heads, sheet.max_row) == (list(rows[0]), len(rows) + 1)
    assert sheet.cell(2, 1 + heads.index("x_mm")).value == float(rows[0]["x_mm"])
    assert sheet.cell(2, 1 + heads.index("name")).value == rows[0]["name"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("TOOL_NO 3", "TOOL_NO 9", r"panel\.(dat|src):\d+.*tool TOOL_DATA\[9\] is not known"),
        ("X 41.720", "X 41.7.20", r"panel\.dat:\d+"),
        ("X 41.720", "X 4172.0", r"panel\.dat:3: XP1: outside the sampled region"),
        ("A 180.000,B 20.000", "A 180.000,B 80.000", r"panel\.dat:3: XP1: orientation is 60\.0°"),
        ("S 2", "S 6", r"panel\.dat:3: XP1: no sample was on arm branch"),
        (",S 2,T 10,E1 0.0}", "", r"panel\.dat:3"),
    ],
    ids=["tool number", "number", "far away", "orientation", "branch", "broken aggregate"],
)
def test_a_target_that_cannot_be_trusted_refuses_the_program(run, program, tmp_path, old, new, message):
    source, error_map = program
    data = source.with_suffix(".dat")
    text = data.read_text()
    assert old in text
    data.write_text(text.replace(old, new, 1))
    assert re.search(message, run("correct", error_map, source, "--out", tmp_path / "out").failed())
    assert not (tmp_path / "out").exists()


def test_on_guard_skip_leaves_the_target_and_says_so(run, program, tmp_path):
    source, error_map = program
    data = source.with_suffix(".dat")
    data.write_text(data.read_text().replace("X 41.720", "X 4172.0", 1))
    done = run("correct", error_map, source, "--out", tmp_path / "out", "--on-guard", "skip", "--json").json
    summary = done["programs"][0]["summary"]
    assert (summary["corrected"], summary["skipped"]) == (23, 1)
    assert b"X 4172.0" in (tmp_path / "out" / "panel.dat").read_bytes()


def test_missing_dat(run, program, tmp_path):
    source, error_map = program
    source.with_suffix(".dat").unlink()
    assert "panel.dat" in run("correct", error_map, source, "--out", tmp_path / "alone").failed()
