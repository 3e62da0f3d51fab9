"""Plans: what is chosen tells most, can be measured, and the programs go there."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

import truepose as tp
from truepose.cell import Cell
from truepose.cli import app
from truepose.errors import DataError, FileError, RobotError
from truepose.geometry import register
from truepose.planning import METHODS, plan, work_region
from truepose.planning.collision import CollisionModel
from truepose.planning.forecast import Forecast
from truepose.planning.greedy import Posterior, lowest_largest, lowest_mean, most_observable
from truepose.planning.planner import shortest_tour
from truepose.planning.prior import Prior
from truepose.robots import load_robot
from truepose.samples import read_poses

QUIET = lambda done, of: None  # noqa: E731


def cell_of(extra: str = "", **region):
    cell = Cell.from_toml(tp.VirtualCell("hard", seed=5).cell.to_toml() + extra)
    return Cell.from_toml(cell.model_copy(update={"region": cell.region.model_copy(update=region)}).to_toml())


@pytest.fixture
def weights(rng):
    """Columns of 30 candidates and 20 targets for 8 weights."""
    columns, aim = rng.normal(size=(30, 3, 8)), rng.normal(size=(60, 8))
    noise = 0.1 * np.broadcast_to(np.eye(3), (30, 3, 3))
    return columns, noise, aim.T @ aim / 20


def mean_variance(columns, noise, aim, chosen):
    information = np.eye(8)
    for i in chosen:
        information += columns[i].T @ np.linalg.inv(noise[i]) @ columns[i]
    return np.trace(aim @ np.linalg.inv(information))


def test_gains_are_those_of_the_posterior(weights):
    """As samples come and go, the same pose twice among them."""
    columns, noise, aim = weights
    posterior, chosen = Posterior(columns, noise, aim), []
    for i in (4, 7, 7):
        posterior.add(i)
        chosen.append(i)
        before = mean_variance(columns, noise, aim, chosen)
        taken = [before - mean_variance(columns, noise, aim, [*chosen, k]) for k in range(30)]
        np.testing.assert_allclose(posterior.gains(), taken, rtol=1e-9)
    for i in chosen:
        posterior.remove(i)
    np.testing.assert_allclose(posterior.gains(), Posterior(columns, noise, aim).gains(), rtol=1e-7)


def test_exchange_finds_the_best_pair(weights):
    columns, noise, aim = weights
    pairs = [(i, j) for i in range(30) for j in range(i)]
    best = min(mean_variance(columns, noise, aim, pair) for pair in pairs)
    found = lowest_mean(columns, noise, aim, 2, QUIET)
    assert mean_variance(columns, noise, aim, found) <= 1.02 * best
    greedy = lowest_mean(columns, noise, aim, 6, QUIET, passes=0)
    exchanged = lowest_mean(columns, noise, aim, 6, QUIET)
    assert mean_variance(columns, noise, aim, exchanged) <= mean_variance(columns, noise, aim, greedy)
    assert len(set(exchanged.tolist())) == 6


def test_largest_variances_are_pivots_of_cholesky(weights):
    """With one direction per candidate the order is that of a pivoted Cholesky factorisation."""
    columns, _, _ = weights
    alone = columns.copy()
    alone[:, 1:] = 0.0
    tiny = 1e-9 * np.broadcast_to(np.eye(3), (30, 3, 3))
    covariance = alone[:, 0] @ alone[:, 0].T
    pivots = []
    for _ in range(5):
        pivots.append(int(np.argmax(np.diag(covariance))))
        column = covariance[:, pivots[-1]] / np.sqrt(covariance[pivots[-1], pivots[-1]])
        covariance = covariance - np.outer(column, column)
    assert lowest_largest(alone, tiny, 5, QUIET).tolist() == pivots


def test_observability_is_raised(weights):
    columns, _, _ = weights
    from truepose.planning.designs import _INDICES

    def smallest(rows):
        return np.linalg.svd(columns[rows].reshape(-1, 8), compute_uv=False)[-1]

    chosen = most_observable(columns, _INDICES["o3"], 6, QUIET)
    random = [smallest(np.random.default_rng(k).permutation(30)[:6]) for k in range(200)]
    assert smallest(chosen) > np.quantile(random, 0.97)


def test_a_tour_is_short(rng):
    q, home = rng.uniform(-1, 1, (40, 6)), np.zeros(6)

    def length(order):
        legs = np.concatenate([[home], q[order], [home]])
        return np.abs(np.diff(legs, axis=0)).max(axis=1).sum()

    order = shortest_tour(q, home)
    assert sorted(order) == list(range(40))
    assert length(order) < 0.75 * np.mean([length(rng.permutation(40)) for _ in range(50)])
    line = np.linspace(1, 5, 9)[:, None] * np.ones(6)
    shuffled = rng.permutation(9)
    assert length_of_line(line[shuffled][shortest_tour(line[shuffled], home)]) == pytest.approx(10.0)


def length_of_line(q):
    return np.abs(np.diff(np.concatenate([[np.zeros(6)], q, [np.zeros(6)]]), axis=0)).max(axis=1).sum()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.exhaustive
def test_every_method_plans(method):
    cell = cell_of()
    found = plan(cell, 12, method, rng=3)
    assert found.q.shape == (12, 6)
    assert len(np.unique(found.q.round(9), axis=0)) == 12
    low, high = cell.load_robot().limits.T
    assert ((found.q > low) & (found.q < high)).all()
    p = found.poses.p_cmd
    assert (np.abs(p - [1700, 0, 900]) <= np.array([450, 800, 450]) + 1e-6).all()
    np.testing.assert_array_equal(plan(cell, 12, method, rng=3).q, found.q)
    assert repr(found).startswith(f"<Plan of 12 poses for {cell.robot.model}: {method}, expected error ")
    assert [row["n"] for row in found.expected] == [3, 6, 9, 12, 18, 24]
    means = [row["mean_mm"] for row in found.expected if row["n"] != 12]
    assert means == sorted(means, reverse=True)


@pytest.mark.exhaustive
def test_orientations_stay_within_the_tilt():
    found = plan(cell_of(tilt_deg=5.0), 20, "sobol")
    at_rest = work_region(cell_of()).rotation
    turn = (at_rest.inv() * found.poses.rotation_cmd).as_rotvec()
    assert 0.03 < np.abs(turn).max() <= np.deg2rad(5.0) + 1e-9
    still = plan(cell_of(tilt_deg=0.0), 20, "posterior")
    np.testing.assert_allclose((at_rest.inv() * still.poses.rotation_cmd).magnitude(), 0.0, atol=1e-8)


@pytest.mark.exhaustive
def test_expected_is_what_is_found():
    """The mean length predicted, noise included, against virtual cells that are measured as planned."""
    cell, found = tp.VirtualCell("hard", seed=0).cell, []
    made = plan(cell, 40)
    for seed in range(3):
        virtual = tp.VirtualCell("hard", seed=seed)
        samples, test = virtual.measure(made.q, seed=1), virtual.measure(virtual.design(200, seed=9), seed=2)
        registration = register(samples.p_cmd, samples.p_meas)
        e, e_test = (registration.apply(s.p_meas) - s.p_cmd for s in (samples, test))
        model = tp.KinematicKriging(virtual.robot, virtual.tf_flange_tool).fit(samples.q, e)
        found.append(np.linalg.norm(e_test - model.predict(test.q), axis=1).mean())
    assert made.expected_mm == pytest.approx(np.median(found), rel=0.2)


@pytest.mark.exhaustive
def test_the_forecast_agrees_in_both_forms():
    """Covariances of readings and columns give the same lengths; earlier readings count, and fewer tell less."""
    cell = cell_of()
    q = plan(cell, 60, "sobol").q
    robot, targets = cell.load_robot(), q[40:]
    forecast = Forecast.of(Prior.of(robot, cell.tf_flange_tool, q), targets, q[:10])
    hyper = forecast.draws[0]
    exact = forecast._exactly(hyper, q[10:40], [5, 30])
    np.testing.assert_allclose(exact, forecast._by_columns(hyper, q[10:40], [5, 30]), rtol=0.02)
    assert exact[0] > exact[1]
    alone = Forecast(forecast.prior, forecast.draws, targets, q[:0])
    assert alone._exactly(hyper, q[10:40], [5])[0] > exact[0]


@pytest.mark.exhaustive
def test_a_forecast_has_an_interval_and_leaves_out_measured_targets():
    cell = cell_of()
    q = plan(cell, 40, "sobol").q
    prior = Prior.of(cell.load_robot(), cell.tf_flange_tool, q)
    row = Forecast.of(prior, q, q[:0]).after(q[:20], [20])[0]
    assert 0.0 < row["low_mm"] < row["mean_mm"] < row["high_mm"]
    assert row["mean_mm"] == pytest.approx(Forecast.of(prior, q[20:], q[:0]).after(q[:20], [20])[0]["mean_mm"])
    strain_wave = load_robot("universal-robots-ur10")
    draws = Forecast.of(Prior.of(strain_wave, np.eye(4), q), q, q[:0]).draws
    lengths = np.array([one.joint_length for one in draws])
    assert 0.02 <= lengths.min() < 0.03
    assert 0.1 < lengths.max() <= 0.15


@pytest.mark.exhaustive
def test_chosen_among_a_list(rng):
    cell = cell_of()
    q = plan(cell, 60, "sobol").q
    found = plan(cell, 10, candidates=q)
    assert all((np.abs(q - row).max(axis=1) < 1e-12).any() for row in found.q)
    with pytest.raises(DataError, match=r"need a \[region\]"):
        plan(cell, 10, "grid", candidates=q)
    with pytest.raises(DataError, match="expected at least 61 measurable poses, got 60"):
        plan(cell, 61, "sobol", candidates=q)


# --- what stands around -----------------------------------------------------------------------------------------------


def test_a_box_is_kept_clear_of():
    table = "\n[obstacles.table]\nx_mm = [1100.0, 1900.0]\ny_mm = [-900.0, -500.0]\nz_mm = [0.0, 700.0]\n"
    cell = cell_of(table)
    found = plan(cell, 20, "sobol")
    assert "in the box table" in found.reach.left_out
    around = found.space.collision
    assert (around.touched(found.q) == "").all()
    for row, (q, box) in enumerate(zip(found.q, found.way, strict=True)):
        start = found.space.home if row == 0 or box else found.q[row - 1]
        assert around.way_touches(start[None], found.space.approach_start(q[None])) == [""]


def test_a_box_in_the_way_is_gone_around_by_home():
    virtual = tp.VirtualCell("hard", seed=5)
    sides = virtual.reach(np.array([[1550.0, -500.0, 500.0], [1550.0, 500.0, 500.0]]))
    above = np.rad2deg(virtual.reach(np.array([[1550.0, 0.0, 1400.0]]))[0]).tolist()
    post = "\n[obstacles.post]\nx_mm = [1500.0, 1600.0]\ny_mm = [-50.0, 50.0]\nz_mm = [0.0, 700.0]\n"
    found = plan(cell_of(post, home_deg=above), 2, "sobol", candidates=sides)
    assert found.way == ["", "post"]
    _, text = found.program()
    assert text.count(f"PTP {{A1 {above[0] + 0.0:.4f},A2 {above[1]:.4f}") == 3


def test_distance_to_a_box_is_that_of_the_rods():
    robot = tp.load_robot("kuka-kr150-2")
    q = np.deg2rad([[0.0, -90.0, 90.0, 0.0, 0.0, 0.0]])
    tip = robot.forward(q)[0, :3, 3]

    def touched(gap, radius):
        box = tip + np.array([[gap, -50, -50], [gap + 100, 50, 50]])
        return CollisionModel(robot, np.eye(4), {"box": box}, link_radius=radius).touched(q)[0]

    assert touched(-1.0, 0.0) == "box"
    assert touched(1.0, 0.0) == ""


def test_line_of_sight():
    robot = tp.load_robot("kuka-kr210-r2700-extra")
    q = np.deg2rad([[0.0, -75.0, 95.0, 0.0, 50.0, 0.0]])
    tool = np.eye(4)
    tool[:3, 3] = [110.0, 0.0, 360.0]
    tf = robot.forward(q, tool=tool)[0]
    before, behind = tf[:3, 3] + [4000.0, 0.0, 0.0], tf[:3, 3] * [-2.0, 1.0, 1.0]
    assert CollisionModel(robot, tool, p_tracker=before).sees(q) == [True]
    assert CollisionModel(robot, tool, p_tracker=behind).sees(q) == [False]  # the arm stands between
    wall = {"wall": np.array([tf[:3, 3] + [1000, -100, -100], tf[:3, 3] + [1100, 100, 100]])}
    assert CollisionModel(robot, tool, wall, p_tracker=before).sees(q) == [False]
    beside = {"wall": wall["wall"] + [0, 300, 0]}
    assert CollisionModel(robot, tool, beside, p_tracker=before).sees(q) == [True]
    axis = tf[:3, :3].T @ [1.0, 0.0, 0.0]
    assert CollisionModel(robot, tool, p_tracker=before, reflector_axis=axis).sees(q) == [True]
    assert CollisionModel(robot, tool, p_tracker=before, reflector_axis=-axis).sees(q) == [False]


# --- bad input --------------------------------------------------------------------------------------------------------


def test_a_region_out_of_reach_says_how_much_and_why():
    with pytest.raises(RobotError, match=r"0 % of the poses offered can be measured \(100 % out of reach\); check"):
        plan(cell_of(x_mm=9000.0), 10)
    far = cell_of(size_mm=(4000.0, 1600.0, 900.0))
    assert "out of reach" in plan(far, 10, "sobol").reach.describe()


def test_bad_wishes():
    cell = cell_of()
    with pytest.raises(DataError, match="unknown method 'best'; expected one of posterior, "):
        plan(cell, 10, "best")
    with pytest.raises(DataError, match=r"n must be at least 1 \(60 or more recommended\), got 0"):
        plan(cell, 0)
    with pytest.raises(DataError, match=r"the cell has no \[region\]"):
        plan(cell.model_copy(update={"region": None}), 10)
    framed = cell.model_copy(update={"region": cell.region.model_copy(update={"frame": 7})})
    with pytest.raises(DataError, match=r"frame 7 is not among \[frames.bases\] \(known: none\)"):
        plan(framed, 10)
    with pytest.raises(FileError, match=r"home_deg: expected 6 joints, got 2"):
        cell_of(home_deg=[0.0, 0.0])
    with pytest.raises(FileError, match=r"\[obstacles.a\] x_mm: expected the smaller number first, got 2 and 1"):
        cell_of("\n[obstacles.a]\nx_mm = [2.0, 1.0]\ny_mm = [0.0, 1.0]\nz_mm = [0.0, 1.0]\n")
    with pytest.raises(FileError, match=r"\[region\] size_mmm: unknown key; did you mean size_mm"):
        Cell.from_toml('[robot]\nmodel = "kuka-kr150-2"\n[region]\nsize_mmm = [1.0, 1.0, 1.0]\n')


@pytest.mark.exhaustive
def test_a_region_in_a_frame_of_the_controller():
    frame = "\n[frames.bases.1]\nx_mm = 1700.0\nz_mm = 900.0\n"
    shifted = cell_of(frame, x_mm=0.0, z_mm=0.0, frame=1)
    np.testing.assert_allclose(plan(shifted, 8, "sobol").q, plan(cell_of(), 8, "sobol").q, atol=1e-9)


# --- programs ---------------------------------------------------------------------------------------------------------

ROBOTS = {
    "kuka-kr210-r2700-extra": ".src",
    "abb-irb6700-200-260": ".mod",
    "fanuc-m900ia-260l": ".ls",
    "universal-robots-ur10": ".script",
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("robot", ROBOTS)
def test_measuring_programs(robot, tmp_path):
    """Every pose is approached, waited at and signalled; our own reader takes the file."""
    rng = np.random.default_rng(0)
    limits = tp.load_robot(robot).limits.clip(-2, 2)
    q = rng.uniform(0.6 * limits[:, 0], 0.6 * limits[:, 1], (200, 6))
    cell = Cell.from_toml(f'[robot]\nmodel = "{robot}"\n[measuring]\ntrigger_output = 4\ndwell_s = 1.5\n')
    found = plan(cell, 9, "sobol", candidates=q)
    table, program = found.write(tmp_path)
    assert program.suffix == ROBOTS[robot]
    text = program.read_text()
    assert len(re.findall(r"WAIT SEC 1\.5|WaitTime \\InPos, 1\.5|WAIT +1\.50\(sec\)|sleep\(1\.5\)", text)) == 9
    assert len(re.findall(r"PULSE\(|PulseDO|DO\[4\]=PULSE|_out\(4, True", text)) == 9
    np.testing.assert_allclose(joints_of(text, robot)[2:-1:2], found.q, atol=1.1e-5)
    np.testing.assert_allclose(joints_of(text, robot)[1:-1:2], found.space.approach_start(found.q), atol=1.1e-5)
    poses = read_poses(table)
    np.testing.assert_allclose(poses.q, found.q, atol=1e-9)
    assert set(poses.approach.ravel()) <= {-1.0, 1.0}
    assert poses.name[0] == "P001"
    result = CliRunner().invoke(app, ["check", str(program), "--json"])
    targets = json.loads(result.stdout)["targets"]
    assert [target["verdict"] for target in targets] == ["skip"] * 20  # joints: nothing there to correct


def joints_of(text, robot):
    """Read the joints of all motions, independently of the writers."""
    if robot.startswith("kuka"):
        found = re.findall(r"PTP \{A1 (\S+?),A2 (\S+?),A3 (\S+?),A4 (\S+?),A5 (\S+?),A6 (\S+?)\}", text)
    elif robot.startswith("abb"):
        found = re.findall(r"MoveAbsJ \[\[(.*?),(.*?),(.*?),(.*?),(.*?),(.*?)\]", text)
    elif robot.startswith("fanuc"):
        found = re.findall(
            "J1= (\\S+) deg, J2= (\\S+) deg, J3= (\\S+) deg,\\s+J4= (\\S+) deg, J5= (\\S+) deg, J6= (\\S+) deg", text
        )
    else:
        found = re.findall(r"movej\(\[(.*?), (.*?), (.*?), (.*?), (.*?), (.*?)\]", text)
    q = np.array(found, float)
    if robot.startswith("fanuc"):
        q[:, 2] += q[:, 1]
    return q if robot.startswith("universal") else np.deg2rad(q)


def test_a_maker_without_a_writer_gets_the_table(tmp_path):
    q = np.random.default_rng(0).uniform(-1, 1, (50, 6))
    found = plan(Cell.from_toml('[robot]\nmodel = "staubli-tx2-90"\n'), 5, "sobol", candidates=q)
    assert [path.name for path in found.write(tmp_path)] == ["plan.csv"]
    with pytest.raises(RobotError, match=r"measuring programs can be written for kuka, abb, .*, not for Stäubli"):
        found.program()


@pytest.mark.exhaustive
def test_on_the_command_line(tmp_path):
    (tmp_path / "cell.toml").write_text(tp.VirtualCell("hard", seed=5).cell.to_toml())
    arguments = ["plan", str(tmp_path / "cell.toml"), "--n", "8", "--out", str(tmp_path / "out"), "--method", "sobol"]
    result = CliRunner().invoke(app, [*arguments, "--json"])
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert data["n"] == 8
    assert data["measurable_percent"] == 100.0
    assert {"O1", "O5"} <= set(data["observability"])
    shown = CliRunner().invoke(app, [*arguments, "--force"]).stdout
    assert "8 (this plan)" in shown
    assert "plan.csv" in shown
    assert "comes from either side in about half of the poses" in " ".join(shown.split())
    assert set(tp.read_poses(tmp_path / "out" / "plan.csv").approach.ravel()) == {-1.0, 1.0}
    below = CliRunner().invoke(app, [*arguments, "--force", "--one-side"]).stdout
    assert "Every joint comes from below: its lost motion is not measured" in " ".join(below.split())
    assert set(tp.read_poses(tmp_path / "out" / "plan.csv").approach.ravel()) == {1.0}


@pytest.mark.exhaustive
def test_the_measured_ur10(ur10):
    """Poses chosen before any reading is looked at leave less than as many at random (marks: 0.33, 0.21 mm)."""
    samples = tp.read_samples(ur10 / "samples.csv")
    cell = Cell.from_toml('[robot]\nmodel = "universal-robots-ur10"\n[tool]\nz_mm = 109.0\nrz_rad = 1.5717\n')
    for n, mark in ((20, 0.33), (60, 0.21)):
        chosen = plan(cell, n, candidates=samples.q).q
        rows = np.array([int(np.argmin(np.abs(samples.q - q).max(axis=1))) for q in chosen])
        rest = np.setdiff1d(np.arange(len(samples)), rows)
        error_map = tp.fit_cell(cell, samples[np.sort(rows)], "kinematic-kriging")
        assert error_map.validate(samples[rest])["after"]["mean_mm"] < mark
