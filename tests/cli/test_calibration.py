"""`truepose fit --predictor calibration`: the table, the map that stays, and what is refused."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from truepose.robots import load_robot
from truepose.samples import Samples, write_samples

ROBOT = load_robot("kuka-kr210-r2700-extra")
TOOL = np.array([110.0, -20.0, 360.0])


def measured(n, seed=4):
    rng = np.random.default_rng(3)
    true = replace(ROBOT, a=ROBOT.a + 0.3 * rng.normal(size=6), offset=ROBOT.offset + 3e-4 * rng.normal(size=6))
    rng = np.random.default_rng(seed)
    q = ROBOT.limits.mean(axis=1) + 0.35 * np.ptp(ROBOT.limits, axis=1) * rng.uniform(-1, 1, (n, 6))
    p = true.forward(q, TOOL)[:, :3, 3] + 0.02 * rng.normal(size=(n, 3))
    return Samples(p_meas=p[:, [1, 0, 2]] * [1, -1, 1] + [3000, 200, -100], q=q)


@pytest.fixture
def files(tmp_path):
    cell = tmp_path / "cell.toml"
    cell.write_text('[robot]\nmodel = "kuka-kr210-r2700-extra"\n[tool]\nfit = "position"\n', "utf-8")
    samples = tmp_path / "samples.csv"
    write_samples(samples, measured(60))
    return cell, samples, tmp_path / "map.truepose"


@pytest.mark.parametrize(
    "name",
    [
        "calibration",
        "calibration:method=ls",
        "calibration:method=ekf",
        "calibration:method=ukf",
        "calibration:terms=sin1+cos1",
        "calibration-network",
    ],
)
@pytest.mark.sampled(1)
def test_fit_and_predict(run, files, name, tmp_path):
    cell, samples, out = files
    data = run("fit", cell, samples, "--predictor", name, "--out", out, "--json").json
    assert data["leave_one_out"]["mean_mm"] < 0.15 * data["registered"]["mean_mm"]
    assert data["calibration"]["rank"] >= 27
    rows = {row["parameter"]: row for row in data["calibration"]["parameters"]}
    assert rows["theta1"]["note"] == "not identifiable with base rz"
    assert rows["a3"]["std"] < 0.1
    write_samples(tmp_path / "test.csv", measured(30, seed=5))
    after = run("validate", out, tmp_path / "test.csv", "--json").json["after"]
    assert after["mean_mm"] < 0.1
    run("predict", out, samples, "--out", tmp_path / "predicted.csv")
    with (tmp_path / "predicted.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 60


def test_table(run, files):
    cell, samples, out = files
    fit = ("fit", cell, samples, "--predictor", "calibration", "--out", out)
    short = run(*fit).out
    assert "All parameters: --parameters." in short
    assert "theta2" not in short
    shown = run(*fit, "--force", "--parameters").out
    assert "Identified parameters (hayati, method lm)" in shown
    assert "theta2" in shown
    assert "Identified 27 of 39 parameters" in shown
    assert "12 combinations are set by manufacturing tolerances only" in shown


def test_too_few_poses(run, files):
    cell, samples, out = files
    write_samples(samples, measured(8))
    done = run("fit", cell, samples, "--predictor", "calibration", "--out", out)
    assert done.code == 1
    assert "8 samples are too few: rank" in done.err
    assert "add poses that turn all joints, such as q = (" in done.err


def test_controller_that_compensates(run, files):
    cell, samples, out = files
    rng = np.random.default_rng(3)
    shown = replace(ROBOT, a=ROBOT.a + 0.5 * rng.normal(size=6), offset=ROBOT.offset + 4e-4 * rng.normal(size=6))
    taken = measured(60)
    write_samples(samples, replace(taken, p_cmd=shown.forward(taken.q, TOOL)[:, :3, 3]))
    done = run("fit", cell, samples, "--predictor", "calibration", "--out", out)
    assert done.code == 1
    assert "seems to compensate already" in done.err
    assert not out.exists()
