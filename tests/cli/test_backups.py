"""A backup on the command line: check, frames, correct, and a report of what is covered."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest
from tests.programs.backups import small

MACHINE = b"DEFDAT $MACHINE PUBLIC\nDECL FRAME $ROBROOT={X 0,Y 0,Z 0,A 0,B 0,C 0}\nENDDAT\n"


@pytest.fixture
def files(near_samples, tmp_path) -> dict[str, bytes]:
    """A backup of two programs; its controller stores the tool of the measurements, and a base of zeros."""
    tool = (tmp_path / "config.dat").read_text()
    base = "BASE_DATA[1]={X 0,Y 0,Z 0,A 0,B 0,C 0}\n"
    body = near_samples[0].read_text().replace("DEF a()\n", "DEF {}()\nBAS(#TOOL,1)\nBAS(#BASE,{})\n")
    body = body.replace("{X", "{{X").replace("}\n", "}}\n")
    config = f'DEFDAT $CONFIG PUBLIC\n{tool}TOOL_NAME[1,]="probe"\n{base}ENDDAT\n'
    return {
        "KRC/R1/System/$config.dat": config.encode(),
        "KRC/R1/Mada/$machine.dat": MACHINE,
        "KRC/R1/Program/good.src": body.format("good", 0).encode(),
        "KRC/R1/Program/asked.src": body.format("asked", 1).encode(),
        "KRC/R1/Program/run.log": b"1 2 3\n",
    }


@pytest.fixture
def archive(files, tmp_path) -> Path:
    path = tmp_path / "cell 7.zip"
    path.write_bytes(small.packed(files))
    return path


@pytest.mark.exhaustive
def test_check_tells_controllers_reasons_options_and_lines(run, archive, tmp_path):
    report = tmp_path / "coverage.csv"
    shown = run("check", archive, "--report", report)
    assert shown.code == 0
    assert f"{archive}, KRC/R1: KUKA" in shown.out
    assert "2 × refuse: base BASE_DATA[1] is stored as zeros and without a name (R1/System/$config.dat" in shown.out
    assert f"{archive}/KRC/R1/Program/asked.src:4 LIN:4" in shown.out
    assert "[frames.bases.1]  # BASE_DATA[1]: 2 targets in asked.src\nx_mm = 0.0" in shown.out
    assert "[frames] of the cell file may allow 2 more; it assumes: the values that you state are" in shown.out
    assert "2 programs: 2 to correct, 0 to skip, 2 refused" in shown.out
    assert report.read_text().count("\nin all,4,2,2,") == 1
    assert "exists already" in run("check", archive, "--report", report).failed()
    assert ".html or .csv" in run("check", archive, "--report", tmp_path / "a.txt").failed()
    told = run("check", archive, "--json").json
    assert told["backups"][0]["controllers"][0]["name"] == "KRC/R1"
    assert told["coverage"]["correctable"] == 2


def test_frames_lists_those_of_the_controller(run, archive):
    (found,) = run("frames", archive, "--json").json["controllers"]
    assert [(one["kind"], one["key"], one["state"], one["targets"], one["name"]) for one in found["frames"]] == [
        ("base", 1, "zero", 2, ""),
        ("base", 0, "known", 2, ""),
        ("tool", 1, "known", 4, "probe"),
    ]
    assert found["controller"] == "KRC/R1"
    assert "zeros, no name" in run("frames", archive).out


def test_correct_writes_the_changed_file_or_the_whole_zip(run, cell_files, files, archive, tmp_path):
    options = ("--on-guard", "skip", "--json")
    done = run("correct", cell_files.map, archive, *options, "--out", tmp_path / "out")
    assert done.code == 0, done.err
    found = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert found == {
        "KRC/R1/Program/good.src",
        "KRC/R1.corrections.json",
        "KRC/R1.corrections.csv",
        "changed-files.csv",
    }
    record = json.loads((tmp_path / "out/KRC/R1.corrections.json").read_text())
    assert {target["file"] for target in record["targets"]} == {
        f"{archive}/KRC/R1/Program/{name}.src" for name in ("good", "asked")
    }
    whole = ("--whole", "--out", tmp_path / "whole", "--report", tmp_path / "coverage.html")
    assert run("correct", cell_files.map, archive, *options, *whole).code == 0
    assert "50.0" in (tmp_path / "coverage.html").read_text()
    with zipfile.ZipFile(tmp_path / "whole" / archive.name) as made:
        new = {info.filename: made.read(info) for info in made.infolist()}
    assert [name for name in files if new[name] != files[name]] == ["KRC/R1/Program/good.src"]
    assert new["KRC/R1/Program/good.src"] == (tmp_path / "out/KRC/R1/Program/good.src").read_bytes()
    again = run("correct", cell_files.map, tmp_path / "whole" / archive.name, *options, "--out", tmp_path / "again")
    assert "was corrected already" in again.failed()


def test_what_a_zip_does_not_allow_is_refused(run, cell_files, archive):
    for option in ("--whole", "--out=a"):
        assert "has no effect with --in-place" in run("correct", cell_files.map, archive, "--in-place", option).failed()
    done = run("correct", cell_files.map, archive, "--in-place", "--on-guard", "skip")
    assert "lies in a .zip, which is never written over" in done.failed()
    assert "has no controller R9; name one of: KRC/R1" in run("check", archive, "--controller", "R9").failed()


def test_a_truncated_zip_is_named(run, archive):
    archive.write_bytes(archive.read_bytes()[:-100])
    assert f"{archive}: is no .zip or is truncated" in run("check", archive).failed()
    assert "no such file" in run("check", archive.with_name("other.zip")).failed()
