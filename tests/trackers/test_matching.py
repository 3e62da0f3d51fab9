"""Readings joined with their plan, and every way in which they may not fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tests.tiers import examples

from truepose.cell import Cell
from truepose.errors import DataError
from truepose.robots import load_robot
from truepose.samples import Poses, Samples, read_samples
from truepose.simulation import VirtualCell
from truepose.trackers import Readings, import_readings, match

FloatArray = NDArray[np.float64]


def plan_of(p_cmd: FloatArray) -> Poses:
    return Poses(p_cmd=p_cmd, source="plan.csv")


def readings_of(p: FloatArray) -> Readings:
    return Readings(p=p, line=np.arange(len(p)) + 1, layout="test", source="readings.txt")


def measured(rng: np.random.Generator, p_cmd: FloatArray, tool_error: float = 10.0) -> FloatArray:
    """Readings from an unknown station, of a robot with errors and a tool that is not as stated."""
    turn = Rotation.from_rotvec(rng.uniform(-0.2, 0.2, (len(p_cmd), 3)))
    p_base = p_cmd + turn.apply([tool_error, 0, 0]) + rng.normal(scale=0.3, size=p_cmd.shape)
    return Rotation.random(rng=rng).apply(p_base) + np.array([3000.0, -500.0, 200.0])


@pytest.fixture
def p_cmd(rng: np.random.Generator) -> FloatArray:
    return rng.uniform(-600, 600, (60, 3))


def test_in_order(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    p = measured(rng, p_cmd)
    plan = Poses(p_cmd=p_cmd, q=rng.uniform(-1, 1, (60, 6)), row=np.arange(60) + 100, source="plan.csv")
    samples, summary = match(readings_of(p), plan)
    assert isinstance(samples, Samples)
    np.testing.assert_array_equal(samples.p_meas, p)
    np.testing.assert_array_equal(samples.row, plan.row)
    assert samples.p_std is None
    assert (summary.missing, summary.reordered, summary.outliers, summary.averaged) == ((), (), (), 0)
    assert summary.sentences()[1] == "60 readings for 60 points of the plan gave 60 samples."


def test_swapped_rows(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    p = measured(rng, p_cmd)
    wrong = p.copy()
    wrong[[4, 19]] = p[[19, 4]]
    with pytest.raises(
        DataError,
        match=r"readings\.txt: rows 4, 19 of plan\.csv are swapped \(read in lines 20, 5; residual .* exchanged\)",
    ):
        match(readings_of(wrong), plan_of(p_cmd))
    samples, summary = match(readings_of(wrong), plan_of(p_cmd), reorder=True)
    np.testing.assert_array_equal(samples.p_meas, p)
    assert summary.reordered == (4, 19)
    assert summary.reordered_points == ("row 4", "row 19")


def test_swapped_neighbours(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    p = measured(rng, p_cmd)
    wrong = p.copy()
    wrong[[4, 5]] = p[[5, 4]]
    with pytest.raises(DataError, match=r"rows 4, 5 of plan\.csv are swapped \(read in lines 6, 5"):
        match(readings_of(wrong), plan_of(p_cmd))


def test_one_row_read_at_the_end(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    p = measured(rng, p_cmd)
    late = np.vstack([np.delete(p, 17, axis=0), p[17:18]])
    with pytest.raises(DataError, match=r"row 17 of plan\.csv was read out of order \(read in line 60\)"):
        match(readings_of(late), plan_of(p_cmd))
    np.testing.assert_array_equal(match(readings_of(late), plan_of(p_cmd), reorder=True)[0].p_meas, p)


def test_swapped_repeats_of_one_place_are_left_alone(rng: np.random.Generator) -> None:
    """Five positions in thirty cycles: position alone cannot say which cycle a reading is of; the order does."""
    p_cmd = np.tile(rng.uniform(-400, 400, (5, 3)), (30, 1))
    p = p_cmd + rng.normal(scale=0.05, size=p_cmd.shape) + 3000.0
    samples, summary = match(readings_of(p), plan_of(p_cmd))
    np.testing.assert_array_equal(samples.p_meas, p)
    assert summary.averaged == 0


@pytest.mark.parametrize("as_zero", [True, False])
def test_missing_rows(rng: np.random.Generator, p_cmd: FloatArray, as_zero: bool) -> None:
    p = measured(rng, p_cmd)
    gone = [7, 30, 31]
    left = np.delete(p, gone, axis=0)
    given = np.where(np.isin(np.arange(60), gone)[:, None], 0.0, p) if as_zero else left
    with pytest.raises(
        DataError,
        match=r"57 readings for 60 points .* without a reading: rows 7, 30, 31 of plan\.csv; .* with --missing",
    ):
        match(readings_of(given), plan_of(p_cmd))
    samples, summary = match(readings_of(given), plan_of(p_cmd), missing=True)
    np.testing.assert_array_equal(samples.p_meas, left)
    assert samples.row is not None
    np.testing.assert_array_equal(samples.row, np.delete(np.arange(60), gone))
    assert summary.missing == (7, 30, 31)


def test_shifted_rows_are_a_missing_one(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    p = measured(rng, p_cmd)
    stranger = p.mean(axis=0) + 2000.0
    with pytest.raises(DataError, match=r"60 readings for 60 points of the plan; line 60 fits no point"):
        match(readings_of(np.vstack([np.delete(p, 10, axis=0), stranger])), plan_of(p_cmd))


def test_repeats_are_averaged_and_their_scatter_kept(rng: np.random.Generator) -> None:
    p_cmd = rng.uniform(-600, 600, (400, 3))
    p = measured(rng, p_cmd)
    repeats = np.repeat(np.arange(400), np.where(np.arange(400) % 2, 1, 3))
    noise = rng.normal(scale=[0.01, 0.03, 0.05], size=(800, 3))
    samples, summary = match(readings_of(p[repeats] + noise), plan_of(p_cmd))
    assert summary.averaged == 400
    np.testing.assert_allclose(samples.p_meas[0], (p[[0, 0, 0]] + noise[:3]).mean(axis=0))
    assert samples.p_std is not None
    np.testing.assert_allclose(samples.p_std[1], [0.01, 0.03, 0.05], rtol=0.15)
    np.testing.assert_allclose(samples.p_std[0], samples.p_std[1] / np.sqrt(3))
    assert summary.scatter_mm == pytest.approx(np.sqrt((0.01**2 + 0.03**2 + 0.05**2) / 3), rel=0.15)


def test_two_repeats_are_too_few_for_a_standard_deviation(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    p = measured(rng, p_cmd)
    samples, summary = match(readings_of(np.insert(p, [3, 9], p[[3, 9]] + 0.02, axis=0)), plan_of(p_cmd))
    assert samples.p_std is None
    assert summary.averaged == 2
    assert summary.scatter_mm is not None


def test_standard_deviation_and_orientation_of_the_file(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    p, rotation = measured(rng, p_cmd), Rotation.random(60, rng=rng)
    twice = np.repeat(np.arange(60), np.where(np.arange(60) == 3, 2, 1))
    small = Rotation.from_rotvec(np.where(np.arange(61)[:, None] == 3, 1e-3, 0.0) * [[1, 0, 0]])
    given = replace(
        readings_of(p[twice]), p_std=np.full((61, 3), 0.02), rotation=small * rotation[twice], time=np.arange(61.0)
    )
    samples, _ = match(given, plan_of(p_cmd))
    assert samples.p_std is not None
    assert samples.rotation_meas is not None
    assert samples.time is not None
    np.testing.assert_allclose(samples.p_std[[2, 3]], [[0.02] * 3, [0.02 / np.sqrt(2)] * 3])
    np.testing.assert_allclose((samples.rotation_meas[3] * rotation[3].inv()).as_rotvec(), [5e-4, 0, 0], atol=1e-9)
    assert samples.time[[2, 3, 4]].tolist() == [2.0, 3.5, 5.0]


def test_gross_readings_are_kept_and_named(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    p = measured(rng, p_cmd)
    p[[11, 40]] += [[300.0, 0, 0], [0, -150.0, 0]]
    samples, summary = match(readings_of(p), plan_of(p_cmd))
    assert len(samples) == 60
    assert summary.outliers == (11, 40)
    assert (
        "Points of the plan whose readings lie far from the expected positions, to be checked: row 11, row 40."
        in summary.sentences()
    )


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "metres"), (1 / 25.4, "inches")])
def test_other_units(rng: np.random.Generator, p_cmd: FloatArray, factor: float, unit: str) -> None:
    with pytest.raises(DataError, match=rf"readings\.txt: the readings spread .* times less than the plan; {unit}\?"):
        match(readings_of(measured(rng, p_cmd) * factor), plan_of(p_cmd))


def test_another_plan(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    with pytest.raises(DataError, match=r"readings\.txt: .*is it this plan"):
        match(readings_of(measured(rng, rng.uniform(-600, 600, (60, 3)))), plan_of(p_cmd))


def test_several_reflectors(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    turn = Rotation.random(60, rng=rng)
    three = np.stack([p_cmd + turn.apply(offset) for offset in np.eye(3) * 150], axis=1).reshape(-1, 3)
    with pytest.raises(
        DataError, match=r"180 readings for 60 points of the plan: 3 for each point, and no repeats; several reflectors"
    ):
        match(readings_of(measured(rng, three)), plan_of(p_cmd))


def test_too_few_and_no_positions(rng: np.random.Generator, p_cmd: FloatArray) -> None:
    with pytest.raises(DataError, match="2 readings for 60 points of the plan; at least 3 are required"):
        match(readings_of(measured(rng, p_cmd)[:2]), plan_of(p_cmd))
    with pytest.raises(DataError, match=r"plan\.csv: has no commanded positions"):
        match(readings_of(measured(rng, p_cmd)), Poses(q=np.zeros((60, 6)), source="plan.csv"))


@settings(max_examples=examples(25), derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(25, 120), tool_error=st.sampled_from([0.0, 20.0]))
def test_missing_doubled_swapped_and_gross_together(seed: int, n: int, tool_error: float) -> None:
    """Issue 7's mixture: 5 % missing, 2 % doubled, 2 % swapped, 1 % gross, all found and named."""
    rng = np.random.default_rng(seed)
    p_cmd = rng.uniform(-600, 600, (n, 3))
    p = measured(rng, p_cmd, tool_error)
    chosen = rng.permutation(n)[: 2 + n // 20 + n // 50 + n // 100]
    swapped, doubled, gross, gone = np.split(chosen, np.cumsum([2, n // 50, n // 100]))
    p[gross] += 300.0 * rng.choice([-1, 1], (len(gross), 3))
    order = np.arange(n)
    order[swapped] = order[swapped[::-1]]
    order = np.repeat(order, np.where(np.isin(order, doubled), 2, 1))
    order = order[~np.isin(order, gone)]
    given_readings = readings_of(p[order] + rng.normal(scale=0.01, size=(len(order), 3)))
    samples, summary = match(given_readings, plan_of(p_cmd), reorder=True, missing=True)
    assert summary.averaged == len(doubled)
    # a gross reading within three rows of a missing one may stand for either
    assert set(summary.missing) | set(summary.outliers) == set(gone) | set(gross)
    if not len(gross):
        assert set(summary.reordered) == set(swapped)
        np.testing.assert_allclose(samples.p_meas, np.delete(p, gone, axis=0), atol=0.1)


@pytest.mark.exhaustive
def test_two_thousand_rows(rng: np.random.Generator) -> None:
    axis = np.linspace(-600, 600, 13)
    p_cmd = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)[:2000]
    p = measured(rng, p_cmd)
    gone = np.sort(rng.choice(2000, 60, replace=False))
    samples, summary = match(readings_of(np.delete(p, gone, axis=0)), plan_of(p_cmd), missing=True)
    assert summary.missing == tuple(gone)
    np.testing.assert_array_equal(samples.p_meas, np.delete(p, gone, axis=0))


def test_import_computes_what_was_commanded(tmp_path: Path, rng: np.random.Generator) -> None:
    cell = Cell.from_toml('[robot]\nmodel = "kuka-kr210-r2700-extra"\n[tool]\nx_mm = 110.0\nz_mm = 360.0')
    robot = load_robot("kuka-kr210-r2700-extra")
    q = np.radians(np.array([0, -80, 90, 0, 30, 0]) + rng.uniform(-30, 30, (30, 6)))
    p_cmd = robot.forward(q, tool=cell.tf_flange_tool)[:, :3, 3]
    p = measured(rng, p_cmd, 0.0)
    path = tmp_path / "readings.txt"
    path.write_text("".join(f"{i}, {x:.6f}, {y:.6f}, {z:.6f}\n" for i, (x, y, z) in enumerate(p)))
    samples, summary = import_readings(path, Poses(q=q), cell=cell)
    assert samples.p_cmd is not None
    np.testing.assert_allclose(samples.p_cmd, p_cmd)
    np.testing.assert_allclose(samples.p_meas, p, atol=1e-6)
    assert summary.median_mm < 1.0
    wrong = Poses(q=q, p_cmd=np.roll(p_cmd, 1, axis=0), source="plan.csv")
    with pytest.raises(DataError, match=r"plan\.csv: joints and commanded positions disagree"):
        import_readings(path, wrong, cell=cell)


def test_measured_robot(ur10: Path, rng: np.random.Generator) -> None:
    given = read_samples(ur10 / "samples.csv")
    assert given.p_cmd is not None
    keep = np.delete(np.arange(632), [5, 300, 301, 600])
    samples, summary = match(readings_of(given.p_meas[keep]), plan_of(given.p_cmd), missing=True)
    np.testing.assert_array_equal(samples.p_meas, given.p_meas[keep])
    assert summary.missing == (5, 300, 301, 600)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("shift", [3.0, 800.0])
@pytest.mark.parametrize("at", [15, 30, 45])
@pytest.mark.parametrize("bad", [False, True])
def test_a_tracker_that_was_moved(p_cmd: FloatArray, shift: float, at: int, bad: bool) -> None:
    """Readings after line `at` from another station; with `bad`, rows are missing and swapped beside that."""
    rng = np.random.default_rng(5)
    p = measured(rng, p_cmd, tool_error=1.0)
    p[at:] = Rotation.from_rotvec([0, 0, 1e-5 * shift]).apply(p[at:]) + np.array([shift, 0, 0])
    readings = readings_of(p)
    if bad:
        order = np.arange(60)
        order[[3, 9]] = order[[9, 3]]
        readings = readings[np.delete(order, [12, 50])]
    said = rf"readings\.txt: the tracker was moved before line {at + 1}, by .* two registrations leave .* import the"
    with pytest.raises(DataError, match=said):
        match(readings, plan_of(p_cmd), reorder=True, missing=True)


@pytest.mark.parametrize("order", ["as planned", "along x", "in layers"])
@pytest.mark.parametrize("seed", range(4))
def test_errors_that_vary_over_the_work_region_are_no_move(seed: int, order: str) -> None:
    cell = VirtualCell("hard", seed=seed)
    samples = cell.measure(cell.design(100))
    x, _, z = samples.p_cmd.T
    rank = {"as planned": np.arange(100), "along x": np.argsort(x), "in layers": np.lexsort((x, z // 200))}[order]
    _, summary = match(readings_of(samples.p_meas[rank]), plan_of(samples.p_cmd[rank]))
    assert summary.samples == 100


def test_another_load_is_no_move() -> None:
    cell = VirtualCell("hard", seed=1)
    load = np.where(np.arange(100) < 50, 120.0, 0.0)
    samples = cell.measure(cell.design(100), payload_kg=load)
    _, summary = match(readings_of(samples.p_meas), replace(plan_of(samples.p_cmd), load=load))
    assert summary.samples == 100
    with pytest.raises(
        DataError, match=r"the tracker was moved before line 5[01], .* or pass --two-stations .* if the tracker did not"
    ):
        match(readings_of(samples.p_meas), plan_of(samples.p_cmd))
    _, allowed = match(readings_of(samples.p_meas), plan_of(samples.p_cmd), two_stations=True)
    assert any(note.startswith("It seems that the tracker was moved before line 5") for note in allowed.sentences())


def test_an_arm_that_warms_up_is_no_move() -> None:
    cell = VirtualCell("hard", seed=1)
    samples = cell.measure(cell.design(100), time=15.0 * np.arange(100))
    match(readings_of(samples.p_meas), plan_of(samples.p_cmd))
