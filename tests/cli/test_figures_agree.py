"""Figures and words of validate, explain, predict, update, correct and the report agree on one map."""

from __future__ import annotations

import csv
import json
from types import SimpleNamespace

import numpy as np
import pytest

import truepose as tp
from truepose.programs.nominal import nominal_targets
from truepose.report.evidence import gather
from truepose.report.knowledge import knowledge


@pytest.fixture(scope="module", params=["ordinary-kriging", "kinematic-kriging"])
def cell_map(request, demo, run, tmp_path_factory):
    """The folder of the demonstration, and a map of its samples."""
    folder = demo[0]
    path = tmp_path_factory.mktemp("map") / "map.truepose"
    done = run("fit", folder / "cell.toml", folder / "fit_samples.csv", "--predictor", request.param, "--out", path)
    assert done.code == 0, done.err
    return folder, path


def std_of(run, map_path, poses, out) -> np.ndarray:
    """The standard deviations that ``predict`` writes for a table of poses."""
    done = run("predict", map_path, poses, "--out", out, "--force")
    assert done.code == 0, done.err
    with out.open() as rows:
        return np.array([float(row["std_mm"]) for row in csv.DictReader(rows)])


@pytest.mark.exhaustive
def test_explain_speaks_of_poses_that_are_measured_or_used(run, cell_map, tmp_path):
    folder, path = cell_map
    found = run("explain", path, "--json").json
    assert found["std_where"] == "in the work region of the cell file"
    held_out = std_of(run, path, folder / "held_out_samples.csv", tmp_path / "held_out.csv")
    assert found["std_mm"]["mean"] == pytest.approx(held_out.mean(), rel=0.15)
    assert found["std_mm"]["max"] < 2 * held_out.max()
    assert "corrected position in the work region of the cell file" in run("explain", path).out


@pytest.mark.sampled(1)
def test_without_a_region_explain_speaks_of_the_samples(cell_map):
    error_map = tp.load_map(cell_map[1])
    bare = error_map.changed(cell=error_map.cell.model_copy(update={"region": None}))
    found = knowledge(bare, suggestions=0)
    at_samples = np.linalg.norm(error_map.predict_errors(error_map.samples)[1], axis=1)
    assert found.where == "between the samples"
    assert found.std_mm["mean"] == pytest.approx(at_samples.mean(), rel=0.15)
    assert found.std_mm["max"] < 2 * at_samples.max()


@pytest.mark.sampled(1)
def test_explain_and_predict_give_one_deviation_for_one_pose(run, cell_map, tmp_path):
    _, path = cell_map
    first = run("explain", path, "--json", "--suggestions", 1).json["measure_next"][0]
    names = {f"{axis}_mm": f"{axis}_cmd_mm" for axis in "xyz"}
    columns = {names.get(key, key): value for key, value in first.items() if key != "std_mm"}
    poses = tmp_path / "pose.csv"
    poses.write_text(",".join(columns) + "\n" + ",".join(map(str, columns.values())) + "\n")
    assert std_of(run, path, poses, tmp_path / "out.csv")[0] == pytest.approx(first["std_mm"], rel=1e-3)


@pytest.mark.sampled(1)
def test_correct_and_predict_give_one_deviation_for_one_target(run, cell_map, tmp_path):
    folder, path = cell_map
    options = ("--accept-weak-map", "--on-guard", "skip", "--out", tmp_path)
    done = run("correct", path, folder / "program" / "panel.src", *options)
    assert done.code == 0, done.err
    record = json.loads((tmp_path / "panel.corrections.json").read_text())
    error_map = tp.load_map(path)
    program = tp.read_program(tmp_path / "panel.src", tp.FrameTable.from_cell(error_map.cell))
    nominal = nominal_targets(program, path, error_map.tf_flange_tool)
    std = np.linalg.norm(error_map.correct(nominal.tf_base_tool, tf_flange_tool=nominal.tf_flange_tool).std, axis=1)
    own = {(row["line"], row["name"]): row["std_mm"] for row in record["targets"]}
    pairs = [(own[t.line, t.name], s) for t, s in zip(nominal.targets, std, strict=True) if own[t.line, t.name]]
    assert len(pairs) > 5
    assert np.array(pairs)[:, 0] == pytest.approx(np.array(pairs)[:, 1], rel=1e-3)
    held_out = std_of(run, path, folder / "held_out_samples.csv", tmp_path / "held_out.csv")
    assert np.array(pairs)[:, 0].mean() == pytest.approx(held_out.mean(), rel=0.2)


@pytest.mark.exhaustive
def test_report_and_validate_give_one_accuracy(run, cell_map):
    folder, path = cell_map
    test = folder / "held_out_samples.csv"
    shown = run("validate", path, test, "--json").json
    reported = gather(tp.load_map(path), tp.read_samples(test), study=SimpleNamespace()).accuracy
    for state in ("before", "after"):
        assert reported[state] == pytest.approx(shown[state], rel=1e-9)


@pytest.mark.sampled(1)
def test_validate_and_update_say_the_same_of_the_map(run, cell_map):
    folder, path = cell_map
    test = folder / "held_out_samples.csv"
    said = next(line for line in run("validate", path, test).out.splitlines() if line.startswith("The map"))
    assert run("update", path, test).out.splitlines()[0] == said
