"""A wrong tool in the cell file is named as such by import and fit, with the tool that was found."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.geometry import apply_transform, estimate_tool, make_transform
from truepose.samples import write_samples
from truepose.trackers import write_readings

OFF = 158.0


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Two cell files, one of them with a wrong tool; two campaigns, with little and with much change of orientation."""
    folder = tmp_path_factory.mktemp("tool")
    virtual = tp.VirtualCell("paper", seed=3)
    tool = virtual.cell.tool
    text = virtual.cell.to_toml()
    true = virtual.truth.tf_flange_tool[:3, 3].tolist()
    for axis, value in zip("xyz", true, strict=True):
        text = text.replace(f"{axis}_mm = {getattr(tool, f'{axis}_mm')}", f"{axis}_mm = {value}", 1)
    (folder / "good.toml").write_text(text)
    (folder / "bad.toml").write_text(text.replace(f"x_mm = {true[0]}", f"x_mm = {true[0] + OFF}", 1))
    rng = np.random.default_rng(1)
    for name, much in (("little", 1.0), ("much", 6.0)):
        q = virtual.design(60, seed=1) + rng.uniform(-0.3, 0.3, (60, 6)) * [1, 1, 1, much, 1, much]
        samples = replace(virtual.measure(q), p_cmd=None, rotation_cmd=None)
        write_samples(folder / f"{name}.csv", samples)
        write_readings(folder / f"{name}.txt", samples, "columns")
        rows = [",".join(f"{angle:.6f}" for angle in row) for row in np.rad2deg(q)]
        (folder / f"{name}-plan.csv").write_text("\n".join([",".join(f"q{j}_deg" for j in range(1, 7)), *rows]) + "\n")
    return folder


@pytest.mark.sampled(1)
@pytest.mark.parametrize("campaign", ["little", "much"])
def test_import_names_a_wrong_tool(run, files, tmp_path, campaign):
    plan, out = files / f"{campaign}-plan.csv", tmp_path / "out.csv"
    done = run("import", files / "bad.toml", files / f"{campaign}.txt", "--plan", plan, "--out", out)
    said = " ".join((done.out + done.err).split())
    assert "the tool in the cell file is probably wrong by 15" in said
    assert "the readings fit the tool (11" in said
    assert 'correct [tool]; with fit = "position" these values are where its fit starts' in said
    good = run("import", files / "good.toml", files / f"{campaign}.txt", "--plan", plan, "--out", out, "--force")
    assert good.code == 0, good.err
    assert "probably wrong" not in good.out
    assert "Tool: the readings fit the tool (11" in good.out


@pytest.mark.parametrize("campaign", ["little", "much"])
def test_fit_names_a_wrong_tool(run, files, tmp_path, campaign):
    out = tmp_path / "map.truepose"
    command = (files / f"{campaign}.csv", "--predictor", "nearest", "--out", out)
    done = run("fit", files / "bad.toml", *command)
    assert "the tool in the cell file is probably wrong by 15" in " ".join((done.out + done.err).split())


def test_fitted_tool_is_shown_beside_the_stated_one(run, files, tmp_path):
    text = (
        (files / "bad.toml").read_text().replace("[tool]\n", '[tool]\nfit = "position"\n').replace('fit = "none"\n', "")
    )
    cell = tmp_path / "fitted.toml"
    cell.write_text(text)
    done = run("fit", cell, files / "much.csv", "--predictor", "nearest", "--out", tmp_path / "map.truepose")
    assert done.code == 0, done.err
    assert "Fitted tool, flange to measured point: x 113." in done.out
    assert "mm from the tool in the cell file, which is the starting value" in done.out


def test_import_names_a_tool_that_was_never_entered(run, files, tmp_path):
    text = re.sub(r"(?m)^(\[tool\]\n)(?:.+\n)*", '\\1x_mm = 0.0\nfit = "position"\n', (files / "bad.toml").read_text())
    cell = tmp_path / "empty.toml"
    cell.write_text(text)
    done = run("import", cell, files / "much.txt", "--plan", files / "much-plan.csv", "--out", tmp_path / "out.csv")
    said = " ".join(done.err.split())
    assert done.code == 1
    assert "the tool in the cell file is probably wrong by" in said
    assert "the readings fit the tool (11" in said


def test_estimate_tells_errors_of_an_arm_from_a_wrong_tool(rng):
    flange = make_transform(Rotation.random(30, rng=rng), rng.uniform(-800.0, 800.0, (30, 3)))
    tool = np.array([10.0, 20.0, 150.0])
    readings = apply_transform(flange, tool) + rng.normal(0.0, 0.5, (30, 3))
    near = estimate_tool(flange, readings, tool + np.array([0.0, 0.0, 0.3]))
    assert not near.suspect
    assert near.suspicion == ""
    far = estimate_tool(flange, readings, tool + np.array([0.0, 0.0, OFF]))
    assert far.suspect
    assert far.distance_mm == pytest.approx(OFF, abs=1.0)
    assert estimate_tool(make_transform(None, flange[:, :3, 3]), readings, tool) is None
