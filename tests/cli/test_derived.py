"""Commands about points from which programs derive others, and about frames that programs set."""

import pytest


@pytest.fixture
def options(tmp_path):
    """The options with which the program of `derived` is read."""
    return ("--config-dat", tmp_path / "config.dat", "--tool", "1")


@pytest.fixture
def derived(near_samples):
    """A program that derives a position from a point, at a place that the map may correct, and a base that it sets."""
    path = near_samples[0]
    pose = path.read_text().splitlines()[1].removeprefix("LIN ")
    steps = "XAP=XP1\nXAP.Z=XAP.Z+10\nLIN XAP\nLIN XP1\n"
    path.write_text(f"DEF a()\nDECL E6POS XAP\n$BASE=$NULLFRAME\n{steps}END\n")
    path.with_suffix(".dat").write_text(f"DEFDAT A\nDECL E6POS XP1={pose}\nENDDAT\n")
    return path


@pytest.mark.promise("truepose correct --derived corrects a point and what the program derives from it alike.")
def test_derived_points(run, cell_files, derived, options, tmp_path):
    left = run("check", derived, *options).out
    assert "--derived corrects both alike" in left
    checked = run("check", derived, *options, "--derived", "--json").json["targets"]
    assert {one["name"]: one["verdict"] for one in checked} == {"XP1": "correct", "XAP": "skip"}
    done = run("correct", cell_files.map, derived, *options, "--derived", "--out", tmp_path / "out")
    assert done.code == 0, done.err
    assert "1 corrected, 1 derived from these, 0 below uncertainty, 0 skipped" in " ".join(done.out.split())
    assert done.out.strip().splitlines()[-1] == "2 of 2 motion targets corrected, 0 stay nominal"
    record = (tmp_path / "out" / "a.corrections.csv").read_text().splitlines()
    assert {"difference_mm", "note"} <= set(record[0].split(","))


def test_a_limit_of_the_cell_counts(run, cell_files, derived, options, tmp_path):
    limited = tmp_path / "limited.toml"
    limited.write_text(f"{cell_files.cell.read_text()}\n[correction]\nmax_difference_mm = 1e-6\n")
    failed = run("correct", cell_files.map, derived, *options, "--derived", "--cell", limited, "--dry-run").failed()
    assert "at the position that is derived from it, XAP = XP1 + (0, 0, 10) mm" in failed
    assert "limit 1e-06 mm" in failed


@pytest.mark.promise("truepose correct --frame-tolerance corrects in the stored frame, and the record says so.")
def test_frames_that_the_program_sets(run, cell_files, derived, tmp_path):
    config = tmp_path / "config.dat"
    config.write_text(config.read_text() + "BASE_DATA[1]={X 0,Y 0,Z 0,A 0,B 0,C 0}\n")
    text = derived.read_text().replace("$BASE=$NULLFRAME", "BASE_DATA[1].X=touched\n$BASE=BASE_DATA[1]")
    derived.write_text(text.replace("LIN XAP\n", ""))
    options = ("--config-dat", config, "--tool", "1", "--derived")
    assert "--frame-tolerance corrects with the stored frame" in run("check", derived, *options).out
    done = run("correct", cell_files.map, derived, *options, "--frame-tolerance", "3mm,0.1deg", "--out", tmp_path / "o")
    assert done.code == 0, done.err
    assert (
        "corrected in the stored frame: BASE_DATA[1] is changed" in (tmp_path / "o" / "a.corrections.csv").read_text()
    )
    assert "expected a tolerance" in run("check", derived, *options, "--frame-tolerance", "5").failed()
