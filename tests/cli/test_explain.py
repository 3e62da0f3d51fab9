"""`truepose explain`: what a map knows, in words, numbers and pictures."""

from dataclasses import replace

import numpy as np
import pytest

import truepose as tp
from truepose.cli.explain import _effect
from truepose.report.knowledge import knowledge
from truepose.samples import write_samples


@pytest.fixture(scope="module")
def kinematic(tmp_path_factory):
    """A map by kinematic Kriging, its file, and the virtual cell."""
    virtual = tp.VirtualCell("hard", seed=31, effects={"geometry", "tool", "repeatability", "tracker", "transmission"})
    error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(80, seed=1), seed=1), "kinematic-kriging")
    path = tmp_path_factory.mktemp("kinematic") / "map.truepose"
    error_map.save(path)
    return virtual, error_map, path


@pytest.mark.exhaustive
def test_what_kinematic_kriging_knows(run, kinematic, tmp_path):
    virtual, _, path = kinematic
    done = run("explain", path, "--parameters", "--out", tmp_path / "pictures")
    assert done.code == 0, done.err
    for part in ("kinematic-kriging of 80 samples", "registration", "joint 6", "Joint curves", "What to measure next"):
        assert part in done.out
    for name in ("joints.svg", "sure.svg"):
        assert (tmp_path / "pictures" / name).read_text("utf-8").lstrip().startswith("<?xml")
    data = run("explain", path, "--json").json
    assert data["noise_mm"] == pytest.approx(virtual.noise_floor / 1.596, rel=0.25)
    assert [joint["joint"] for joint in data["joints"]] == [1, 2, 3, 4, 5, 6]
    assert set(data["shares_mm"]) >= {"registration", "geometry", "compliance", "joint 1", "rest"}
    assert {row["name"] for row in data["parameters"]} >= {"theta2", "a2"}
    assert data["std_mm"]["mean"] <= data["std_mm"]["p95"] <= data["std_mm"]["max"]
    assert len(data["measure_next"]) == 5
    assert set(data["measure_next"][0]) == {*(f"q{j}_deg" for j in range(1, 7)), "std_mm"}


def test_parameters_are_shown_on_request_and_all_fits_80_columns(run, kinematic):
    _, _, path = kinematic
    brief, long = run("explain", path).out, run("explain", path, "--parameters").out
    assert len(brief.splitlines()) < 40
    assert "Joint curves" not in brief
    assert "--parameters" in brief
    assert "Joint curves" in long
    assert max(map(len, long.splitlines())) <= 80


def test_measuring_what_is_proposed_makes_surer_than_other_poses(kinematic):
    virtual, error_map, _ = kinematic
    rng = np.random.default_rng(0)
    wanted = knowledge(error_map, suggestions=8).next_poses
    proposed = np.deg2rad([[row[f"q{j}_deg"] for j in range(1, 7)] for row in wanted])
    grid = virtual.design(200, seed=8)
    std = {}
    for name, q in (("proposed", proposed), ("others", virtual.design(64, seed=12)[rng.permutation(64)[:8]])):
        updated = tp.update_map(error_map, virtual.measure(q, seed=2))
        std[name] = updated.predict_errors(replace(error_map.samples[:1], **_poses(virtual, grid)))[1].mean()
    assert std["proposed"] < std["others"] < error_map.predictor.predict(grid, return_std=True)[1].mean()


def _poses(virtual, q):
    measured = virtual.measure(q, seed=1)
    return {name: getattr(measured, name) for name in measured.columns()}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("predictor", ["ordinary-kriging", "calibration"])
def test_other_predictors_say_what_they_know(run, cell_files, tmp_path, predictor):
    out = tmp_path / "map.truepose"
    write_samples(tmp_path / "wide.csv", _wide(cell_files.virtual))
    assert run("fit", cell_files.cell, tmp_path / "wide.csv", "--predictor", predictor, "--out", out).code == 0
    done = run("explain", out, "--suggestions", 2, "--parameters")
    assert ("variogram" if predictor == "ordinary-kriging" else "Identified parameters") in done.out
    data = run("explain", out, "--json", "--suggestions", 2).json
    assert data["joints"] == []
    assert len(data["measure_next"]) == 2
    assert set(data["measure_next"][0]) > ({"x_mm"} if predictor == "ordinary-kriging" else {"q1_deg"})


def _wide(virtual):
    q = virtual.design(60, seed=1) + np.random.default_rng(0).uniform(-0.3, 0.3, (60, 6))
    return virtual.measure(q)


def test_an_amplitude_is_not_negative():
    row = {"name": "gear 1 q2", "group": "gear", "estimate": 3e-6, "std": 2e-6, "unit": "rad"}
    assert _effect(row) == ("gear 1 q2", "3.0", "0.0", "6.9", "µrad")
    assert _effect({**row, "group": "backlash"})[2] == "-0.9"
