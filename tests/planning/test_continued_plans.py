"""Plans that continue a measured series, reach an accuracy, or come to poses from both sides."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import truepose as tp
from truepose.cell.sections import Measuring
from truepose.cli import app
from truepose.errors import DataError
from truepose.planning import plan
from truepose.planning.prior import Prior
from truepose.robots import shown_joints
from truepose.samples import read_poses


@pytest.fixture(scope="module")
def series():
    """A cell, and 30 poses of a first series that were measured."""
    virtual = tp.VirtualCell("hard", seed=2)
    return virtual, virtual.measure(plan(virtual.cell, 30, "sobol").q, seed=1)


@pytest.mark.parametrize("method", ["posterior", "sobol", "latin-hypercube"])
@pytest.mark.exhaustive
def test_no_pose_is_measured_twice(series, method):
    """Also where the seed, and so what is offered, is that of the first series."""
    virtual, samples = series
    first = plan(virtual.cell, 30, method) if method != "sobol" else None
    measured = samples if first is None else virtual.measure(first.q, seed=1)
    then = plan(virtual.cell, 10, method, after=measured)
    assert np.abs(then.q[:, None] - measured.q).max(axis=2).min() > 1e-3
    assert then.expected[0]["n"] == 0


@pytest.mark.exhaustive
def test_the_forecast_after_a_series_holds(series):
    virtual, samples = series
    held_out = virtual.measure(virtual.design(300, seed=1000), seed=3)
    expected = plan(virtual.cell, 1, after=samples).expected[0]["mean_mm"]
    found = tp.fit_cell(virtual.cell, samples, "kinematic-kriging").validate(held_out, rivals=False)["after"]["mean_mm"]
    assert 0.8 < found / expected < 1.25


@pytest.mark.exhaustive
def test_as_many_poses_as_an_accuracy_takes(series):
    virtual, samples = series
    alone = plan(virtual.cell, 1, after=samples).expected[0]["mean_mm"]
    enough = plan(virtual.cell, 40, after=samples, until=1.1 * alone)
    assert enough.reaches
    assert enough.q.shape == (0, 6)
    some = plan(virtual.cell, 40, after=samples, until=0.93 * alone)
    assert some.reaches
    assert 0 < len(some.q) < 40
    few = plan(virtual.cell, 2, after=samples, until=0.75 * alone)
    assert (few.reaches, len(few.q)) == (False, 2)
    first = plan(virtual.cell, 60, until=0.1)
    assert first.reaches
    assert len(first.q) < 40


@pytest.mark.exhaustive
def test_what_cannot_be_reached_or_continued_is_refused(series):
    virtual, samples = series
    with pytest.raises(DataError, match=r"0\.001 mm cannot be reached: noise"):
        plan(virtual.cell, 10, until=0.001)
    with pytest.raises(DataError, match=r"beside the 30 that were measured already, got 0"):
        plan(virtual.cell, 3, candidates=samples.q, after=samples)
    bare = tp.Samples(samples.p_meas, p_cmd=virtual.robot.forward(samples.q)[:, :3, 3], source="bare")
    with pytest.raises(DataError, match="joints"):
        plan(virtual.cell, 3, after=bare)
    seven = tp.Samples(samples.p_meas, q=np.pad(samples.q, ((0, 0), (0, 1))), source="seven.csv")
    with pytest.raises(DataError, match=r"seven\.csv: the samples have 7 joints and .* has 6; continue"):
        plan(virtual.cell, 3, after=seven)
    other = tp.VirtualCell("paper", robot="universal-robots-ur10")
    with pytest.raises(tp.errors.TrueposeError):
        plan(other.cell, 3, after=samples)


@pytest.mark.exhaustive
def test_samples_may_have_joints_as_the_controller_shows_them():
    virtual = tp.VirtualCell("paper", robot="fanuc-m20ia")
    samples = virtual.measure(virtual.design(24, seed=1), seed=1)
    shown = shown_joints(virtual.robot).from_model(samples.q)
    found = [plan(virtual.cell, 3, after=one).q for one in (samples, replace(samples, q=None, q_shown=shown))]
    np.testing.assert_allclose(found[1], found[0], atol=1e-9)


@pytest.mark.exhaustive
def test_the_command_continues_samples(series, tmp_path):
    virtual, samples = series
    cell, table, out = tmp_path / "cell.toml", tmp_path / "samples.csv", tmp_path / "plan"
    cell.write_text(virtual.cell.to_toml())
    tp.write_samples(table, samples)

    def run(*words):
        return CliRunner().invoke(app, ["plan", str(cell), "--after", str(table), "--out", str(out), *words])

    done = run("--n", "20", "--until", "1 mm")
    assert done.exit_code == 0, done.output
    assert "No more poses are needed" in done.output
    assert "0 (the samples alone)" in done.output
    assert not out.exists()
    done = run("--n", "4", "--until", "0.035mm", "--json")
    assert done.exit_code == 0, done.output
    data = json.loads(done.stdout)
    assert (data["n"], data["until_mm"], data["reaches"]) == (4, 0.035, False)
    assert len(read_poses(out / "plan.csv").q) == 4
    for wrong in ("0", "-1mm", "soon", "inf"):
        assert run("--n", "4", "--until", wrong).exit_code == 2


@pytest.mark.exhaustive
def test_joints_come_from_both_sides_unless_one_is_asked_for():
    """In about half of the poses each, whatever the pose; the program comes from where the plan says."""
    cell = tp.VirtualCell("hard", seed=5).cell
    below = cell.model_copy(update={"measuring": Measuring(approach="below")})
    made = plan(cell, 60, "sobol")
    assert made.to_dict()["approach"] == "both"
    signs = made.poses.approach
    assert np.abs(signs.mean(axis=0)).max() < 0.35
    assert np.abs(np.corrcoef(signs.T) - np.eye(6)).max() < 0.4
    start = made.space.approach_start(made.q, signs)
    low, high = cell.load_robot().limits.T
    assert ((start >= low) & (start <= high)).all()
    np.testing.assert_array_equal(np.sign(made.q - start), signs)
    assert (plan(below, 10, "sobol").poses.approach == 1.0).all()
    numbers = re.findall(r"PTP \{A1 (-?[\d.]+)", made.program()[1])
    assert len(numbers) >= 120


@pytest.mark.exhaustive
def test_a_plan_from_both_sides_measures_the_lost_motion():
    """Targets that are approached from either side are predicted: from below alone they are a millimetre off."""
    virtual = tp.VirtualCell("backlash", seed=1)
    poses = plan(virtual.cell, 50, "sobol").poses
    found = tp.fit_cell(virtual.cell, virtual.measure(poses.q, approach=poses.approach), "kinematic-kriging")
    q = virtual.design(100, seed=1000)
    signs = np.random.default_rng(5).choice([-1.0, 1.0], q.shape)
    held_out = virtual.measure(q, approach=signs, seed=3)
    assert np.linalg.norm(found.errors(held_out) - found.predict_reading(held_out)[0], axis=1).mean() < 0.1


@pytest.mark.exhaustive
def test_after_a_first_series_other_poses_are_chosen():
    virtual = tp.VirtualCell("hard", seed=2)
    first = plan(virtual.cell, 24, "sobol")
    error_map = tp.fit_cell(virtual.cell, virtual.measure(first.q), "kinematic-kriging")
    then = plan(virtual.cell, 12, after=error_map)
    prior = Prior.after(error_map.predictor, error_map.samples.q, then.q)
    targets = virtual.design(200, seed=3)
    left = [prior.given(q) for q in (then.q, first.q[:12])]
    assert left[0].expected(*left[0].at(targets)) < left[1].expected(*left[1].at(targets))
    named = tp.fit_cell(virtual.cell, virtual.measure(first.q), "ordinary-kriging")
    assert plan(virtual.cell, 5, "sobol", after=named).q.shape == (5, 6)
