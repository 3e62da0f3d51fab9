"""`truepose update`: the test of a map, what joins it, and what is found again."""

import re
from dataclasses import replace

import numpy as np
import pytest

from truepose.samples import write_samples


@pytest.fixture
def readings(cell_files):
    return cell_files.virtual.measure(cell_files.virtual.design(12, seed=9), seed=9)


def test_samples_join_a_map_that_holds(run, cell_files, readings, tmp_path):
    write_samples(tmp_path / "new.csv", readings)
    tested = run("update", cell_files.map, tmp_path / "new.csv", "--json").json
    assert tested["holding"]["verdict"] == "holds"
    assert tested["out"] is None
    done = run("update", cell_files.map, tmp_path / "new.csv", "--out", tmp_path / "joined.truepose")
    assert "The map holds: residuals are" in done.out
    assert "joined.truepose: 92 samples." in done.out.replace("\n", " ")
    again = run("validate", tmp_path / "joined.truepose", tmp_path / "new.csv", "--json").json
    assert again["seen"] == 12
    assert again["holding"]["verdict"] == "holds"


def test_a_moved_tracker_is_refused_and_found_again(run, cell_files, readings, tmp_path):
    write_samples(tmp_path / "moved.csv", replace(readings, p_meas=readings.p_meas + np.array([0.0, 0.8, 0.3])))
    refused = run("update", cell_files.map, tmp_path / "moved.csv", "--out", tmp_path / "never.truepose").failed()
    assert "does not hold" in refused
    assert "by 0.8" in refused  # at one orientation a tool that moved looks the same
    assert "Equally likely: the station moved (tracker or robot base)." in refused
    assert not (tmp_path / "never.truepose").exists()
    done = run("update", cell_files.map, tmp_path / "moved.csv", "--refit", "station", "--out", tmp_path / "m.truepose")
    assert "station from 12 samples" in done.out
    before, after = (
        run("validate", path, tmp_path / "moved.csv", "--json").json["after"]["mean_mm"]
        for path in (cell_files.map, tmp_path / "m.truepose")
    )
    assert after < 0.2 * before
    assert "The map does not hold" in run("validate", cell_files.map, tmp_path / "moved.csv").out
    anyway = run("update", cell_files.map, tmp_path / "moved.csv", "--anyway", "--out", tmp_path / "a.truepose")
    assert anyway.code == 0


def test_a_gross_reading_is_named(run, cell_files, readings, tmp_path):
    p = readings.p_meas.copy()
    p[4] += [0.0, 0.0, 2.0]
    write_samples(tmp_path / "gross.csv", replace(readings, p_meas=p))
    done = run("update", cell_files.map, tmp_path / "gross.csv")
    assert re.search("Far from the prediction: line [678]", done.out)


def test_validate_names_gross_readings_and_judges_without_them(run, cell_files, readings, tmp_path):
    p = readings.p_meas.copy()
    p[4] += [0.0, 0.0, 590.0]
    write_samples(tmp_path / "gross.csv", replace(readings, p_meas=p))
    shown = " ".join(run("validate", cell_files.map, tmp_path / "gross.csv").out.split())
    assert "1 of 12 readings are gross, without them the mean after is 0.0" in shown
    assert "The map does not hold" in shown
    assert "Without gross readings: The map holds" in shown
    found = run("validate", cell_files.map, tmp_path / "gross.csv", "--json").json
    assert len(found["gross"]) == 1
    assert found["holding_without_gross"]["verdict"] == "holds"
    assert found["without_gross"]["after"]["n"] == 11


@pytest.mark.exhaustive
def test_fit_leaves_a_gross_reading_out_of_all_steps(run, cell_files, tmp_path):
    samples = cell_files.virtual.measure(cell_files.virtual.design(30, seed=3), seed=3)
    p = samples.p_meas.copy()
    p[7] += [590.0, 0.0, 0.0]
    write_samples(tmp_path / "gross.csv", replace(samples, p_meas=p))
    write_samples(tmp_path / "kept.csv", samples[np.arange(30) != 7])
    gross, kept = (
        run(
            *("fit", cell_files.cell, tmp_path / f"{name}.csv", "--predictor", "calibration", "--json"),
            *("--out", tmp_path / f"{name}.truepose"),
        ).json
        for name in ("gross", "kept")
    )
    assert len(gross["excluded"]) == 1
    assert gross["n"] == kept["n"]
    for key in ("registered", "leave_one_out"):
        assert gross[key]["max_mm"] == pytest.approx(kept[key]["max_mm"], rel=1e-6)
    assert gross["worth"]["left_mm"] == pytest.approx(kept["worth"]["left_mm"], rel=1e-6)


def test_tools_need_a_map_that_knows_the_arm(run, cell_files, readings, tmp_path):
    write_samples(tmp_path / "new.csv", readings)
    assert (
        "knows errors of position only"
        in run("update", cell_files.map, tmp_path / "new.csv", "--refit", "tool").failed()
    )
