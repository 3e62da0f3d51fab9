"""Folders of measured robots for the public benchmark: what is read, what is refused, and the table that is made."""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.measured_robots import read_robot

import truepose as tp
from benchmarks import __main__ as command
from benchmarks import accuracy_data, measured_robots
from truepose.errors import TrueposeError
from truepose.samples import write_samples

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "src" / "truepose" / "samples" / "data"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one small robot."""
    folder = tmp_path_factory.mktemp("robots")
    robot = folder / "paper"
    robot.mkdir()
    virtual = tp.VirtualCell("paper", seed=3)
    (robot / "cell.toml").write_text(virtual.cell.to_toml())
    write_samples(robot / "samples.csv", virtual.measure(virtual.design(30, seed=1)))
    (robot / "README.md").write_text("# A virtual robot\n\nLicence CC0.\n")
    words = ["fit"] * 18 + ["test"] * 10 + [""] * 2
    rows = [f"{i},{word},{'test' if i < 8 else 'fit'}" for i, word in enumerate(words)]
    (robot / "split.csv").write_text("\n".join(["row,first,last", *rows]) + "\n")
    return folder


@pytest.fixture
def robot(made: Path, tmp_path: Path) -> Path:
    """A copy that a test may change."""
    return Path(shutil.copytree(made, tmp_path / "robots")) / "paper"


def test_a_robot_is_read_with_its_splits(robot: Path) -> None:
    found = read_robot(robot)
    assert (found.name, found.title, len(found.samples)) == ("paper", "A virtual robot", 30)
    first, last = found.splits
    assert (first.fit.tolist(), first.test.tolist()) == (list(range(18)), list(range(18, 28)))
    assert (last.name, len(last.fit), len(last.test), last.repeated) == ("last", 22, 8, 0)


def change(robot: Path, old: str, new: str) -> None:
    text = (robot / "split.csv").read_text()
    assert old in text
    (robot / "split.csv").write_text(text.replace(old, new, 1))


BAD = {
    "unknown row": ("\n29,", "\n99,", "row '99' is not in samples.csv"),
    "row twice": ("\n29,", "\n28,", "row '28' stands in line 30 already"),
    "another word": ("\n29,,fit", "\n29,train,fit", "'train' is none of 'fit', 'test' and an empty cell"),
    "in neither": ("\n29,,fit", "", "has no row for row '29' of samples.csv"),
    "too many cells": ("\n29,,fit", "\n29,,fit,fit", "has 4 cells, expected 3"),
    "no header": ("row,first,last", "0,fit,fit", "has another header; expected 'row' or 'name'"),
    "same name": ("row,first,last", "row,first,first", "has two splits of the name 'first'"),
    "other names": ("row,first", "name,first", "samples.csv has no such column; use 'row'"),
}


@pytest.mark.parametrize("what", BAD)
def test_a_split_that_is_not_right_is_refused_with_its_line(robot: Path, what: str) -> None:
    old, new, words = BAD[what]
    change(robot, old, new)
    with pytest.raises(TrueposeError, match=r"split\.csv") as refused:
        read_robot(robot)
    assert words in str(refused.value)


def test_small_parts_are_refused(robot: Path) -> None:
    rows = [f"{i},{'fit' if i < 26 else 'test'}" for i in range(30)]
    (robot / "split.csv").write_text("\n".join(["row,small", *rows]))
    with pytest.raises(TrueposeError, match="split 'small' has 4 samples of 'test'; it needs 5 or more"):
        read_robot(robot)
    (robot / "split.csv").write_text("")
    with pytest.raises(TrueposeError, match="has another header"):
        read_robot(robot)


def table(robot: Path) -> list[dict[str, str]]:
    """Return the rows of the samples, and write them as the only content of the file."""
    lines = [line for line in (robot / "samples.csv").read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def write(robot: Path, rows: list[dict[str, str]]) -> None:
    with (robot / "samples.csv").open("w", newline="") as file:
        out = csv.DictWriter(file, list(rows[0]))
        out.writeheader()
        out.writerows(rows)


def test_one_reading_in_both_parts_is_refused_and_repeated_poses_are_counted(robot: Path) -> None:
    rows = table(robot)
    own = {key: rows[20][key] for key in ("row", "name") if key in rows[20]}
    rows[20] = {**rows[1], **own}
    write(robot, rows)
    with pytest.raises(TrueposeError, match=r"split 'first': .* are one reading, in both parts"):
        read_robot(robot)
    rows[20]["x_meas_mm"] = f"{float(rows[20]['x_meas_mm']) + 0.02:.4f}"  # read again
    write(robot, rows)
    assert [split.repeated for split in read_robot(robot).splits] == [1, 1]


@pytest.mark.parametrize("name", measured_robots.FILES)
def test_every_file_is_needed(robot: Path, name: str) -> None:
    (robot / name).unlink()
    with pytest.raises(TrueposeError, match=f"{name}: is missing"):
        read_robot(robot)


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["benchmarks", "accuracy", *map(str, arguments)])
    return command.main()


@pytest.mark.exhaustive
def test_the_table_is_made_continued_and_made_anew_for_other_data(
    robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "found.csv"
    options = ("--data", robot.parent, "--out", out, "--predictor", "registration", "--predictor", "ordinary-kriging")
    calls: list[str] = []
    real = accuracy_data.held_out

    def counted(*given: Any) -> Any:
        calls.append(given[-1])
        return real(*given)

    monkeypatch.setattr(accuracy_data, "held_out", counted)
    assert run(monkeypatch, *options) == 0
    assert "| `ordinary-kriging` | 0." in capsys.readouterr().out
    rows = list(csv.DictReader(out.open()))
    assert [(row["split"], row["predictor"], row["n_test"]) for row in rows] == [
        (split, name, count)
        for split, count in (("first", "10"), ("last", "8"))
        for name in ("registration", "ordinary-kriging")
    ]
    found = read_robot(robot)
    test = found.samples[found.splits[0].test]
    error_map = tp.fit_cell(found.cell, found.samples[found.splits[0].fit], "ordinary-kriging")
    length = np.linalg.norm(error_map.errors(test) - error_map.predict_reading(test)[0], axis=1)
    assert float(rows[1]["mean"]) == pytest.approx(length.mean(), rel=1e-5)
    assert float(rows[1]["largest"]) == pytest.approx(length.max(), rel=1e-5)
    assert len(calls) == 4
    assert run(monkeypatch, *options) == 0
    assert len(calls) == 4, "finished rows are kept"
    change(robot, "\n29,,fit", "\n29,,test")
    assert run(monkeypatch, *options) == 0
    assert len(calls) == 8, "other data, other rows"


def test_a_predictor_that_cannot_run_says_why_in_its_row(
    robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write(robot, [{name: value for name, value in row.items() if name[0] != "q"} for row in table(robot)])
    out = tmp_path / "found.csv"
    assert run(monkeypatch, "--data", robot.parent, "--out", out, "--predictor", "calibration") == 0
    assert "joints" in capsys.readouterr().out
    assert "joints" in next(csv.DictReader(out.open()))["failed"]


def test_what_is_wrong_is_said_without_a_traceback(
    robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (robot.parent / "empty").mkdir()
    assert run(monkeypatch, "--data", robot.parent, "--check") == 1
    assert "error: " in capsys.readouterr().err
    (robot.parent / "empty").rmdir()
    assert run(monkeypatch, "--data", robot.parent, "--predictor", "nonsense") == 1
    assert "nonsense" in capsys.readouterr().err
    (tmp_path / "other.csv").write_text("a,b\n")
    assert run(monkeypatch, "--data", robot.parent, "--out", tmp_path / "other.csv") == 1
    assert "is no table of this benchmark" in capsys.readouterr().err
    for wrong in (["--check"], ["--predictor", "auto"]):
        with pytest.raises(SystemExit):
            run(monkeypatch, *wrong)


@pytest.mark.exhaustive
def test_the_data_of_the_package_are_such_a_folder() -> None:
    command = [sys.executable, "-m", "benchmarks", "accuracy", "--data", EXAMPLE, "--check"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True)
    assert "random-150: 150 samples to fit, 316 held out" in done.stdout
    assert "All files can be read." in done.stdout
