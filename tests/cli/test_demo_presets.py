"""The demonstration on the hard cell: every effect, orientations that vary, the whole way through files."""

from __future__ import annotations

import pytest


@pytest.mark.exhaustive
def test_demo_on_the_hard_cell(run, tmp_path):
    done = run("demo", tmp_path, "--preset", "hard", "--json")
    assert done.code == 0, done.err
    found = done.json
    assert found["predictor"] == "kinematic-kriging"
    assert found["before"]["mean_mm"] > 0.3
    assert found["after"]["mean_mm"] < 1.5 * found["noise_floor_mm"]
    assert found["remeasured"]["after"]["mean_mm"] < 1.6 * found["noise_floor_mm"]
    assert {"blocks", "time"} <= found["groups"].keys()
    page = (tmp_path / "report.html").read_text()
    assert "kinematic-kriging" in page
    header = (tmp_path / "fit_samples.csv").read_text().splitlines()[0]
    for column in ("approach1", "load_kg", "temp_C", "time_s"):
        assert column in header


def test_no_such_preset(run, tmp_path):
    assert (
        "unknown preset 'soft'; expected one of paper, hard, ideal"
        in run("demo", tmp_path, "--preset", "soft").failed()
    )
