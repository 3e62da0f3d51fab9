"""A map and new samples: whether it holds, what happened, and how it takes them in."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.error_map.update import GROWTH, STATION, TOOL, Recheck
from truepose.errors import DataError
from truepose.geometry import apply_transform, invert_transform, make_transform
from truepose.samples import Samples, write_samples
from truepose.verification.consistency import ConsistencyTest, Drift


@pytest.fixture(scope="module")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("hard", seed=21, effects={"geometry", "tool", "repeatability", "tracker", "transmission"})


@pytest.fixture(scope="module")
def error_map(virtual) -> tp.ErrorMap:
    return tp.fit_cell(virtual.cell, virtual.measure(virtual.design(120, seed=1), seed=1), "kinematic-kriging")


@pytest.fixture(scope="module")
def held_out(virtual) -> Samples:
    """Without noise."""
    q = virtual.design(150, seed=5)
    return Samples(apply_transform(invert_transform(virtual.truth.tf_base_tracker), virtual.true_position(q)), q=q)


def new_readings(virtual, n, seed=3):
    return virtual.measure(virtual.design(n, seed=seed), seed=seed)


def mean_miss(error_map, samples):
    return np.linalg.norm(error_map.errors(samples) - error_map.predict_errors(samples)[0], axis=1).mean()


def test_the_map_holds_for_what_it_was_made_for(virtual, error_map):
    rechecks = [tp.recheck(error_map, new_readings(virtual, 10, seed)) for seed in range(30, 45)]
    assert repr(rechecks[0]).startswith("<Recheck: The map ")
    found = [recheck.holding for recheck in rechecks]
    assert sum(one.verdict == "holds" for one in found) >= 13
    assert np.mean([one.ratio for one in found]) == pytest.approx(1.0, abs=0.2)


def _turned(virtual, readings, joint):
    """The same, had a crash moved joint 2 or 3 by 0.3 mrad."""
    q = readings.q.copy()
    q[:, joint] += 3e-4
    moved = (
        virtual.robot.forward(q, virtual.tf_flange_tool) - virtual.robot.forward(readings.q, virtual.tf_flange_tool)
    )[:, :3, 3]
    return replace(readings, p_meas=readings.p_meas + moved @ virtual.truth.tf_base_tracker[:3, :3])


def _station(virtual, readings):
    tf = make_transform(Rotation.from_rotvec([0.0, 1e-4, 2e-4]), [0.3, -0.2, 0.1])
    return replace(readings, p_meas=apply_transform(tf, readings.p_meas))


def _tool(virtual, readings):
    shift = virtual.robot.forward(readings.q)[:, :3, :3] @ [0.3, 0.0, -0.2]
    return replace(readings, p_meas=readings.p_meas + shift @ virtual.truth.tf_base_tracker[:3, :3])


@pytest.mark.parametrize(
    ("happened", "cause"),
    [
        (_station, STATION),
        (_tool, TOOL),
        (lambda v, r: _turned(v, r, 1), "joint 2 is off"),
        (lambda v, r: _turned(v, r, 2), "joint 3 is off"),
    ],
    ids=["station", "tool", "joint 2", "joint 3"],
)
def test_what_happened_is_found(virtual, error_map, happened, cause):
    found = tp.recheck(error_map, happened(virtual, new_readings(virtual, 12)))
    assert found.holding.verdict == "does not hold"
    assert found.causes[0].cause == cause
    assert found.causes[0].explained > 0.8
    assert cause in found.words[1]


def test_an_arm_that_grew(virtual, error_map):
    readings = new_readings(virtual, 12)
    p_base = apply_transform(virtual.truth.tf_base_tracker, readings.p_meas) * (1 + 150e-6)
    grown = replace(readings, p_meas=apply_transform(invert_transform(virtual.truth.tf_base_tracker), p_base))
    found = tp.recheck(error_map, grown)
    assert GROWTH in [cause.cause for cause in found.causes[:2]]


def test_drift_over_time_and_temperature(virtual, error_map):
    readings = new_readings(virtual, 40)
    hours = np.linspace(0, 4, 40)
    drifting = replace(
        readings,
        p_meas=readings.p_meas + 0.05 * hours[:, None] * virtual.truth.tf_base_tracker[2, :3],
        time=3600.0 * hours,
        temperature=20.0 + np.sin(7 * np.arange(40)),
    )
    found = tp.recheck(error_map, drifting)
    assert found.time.p_value < 1e-6
    np.testing.assert_allclose(found.time.slope, [0, 0, 0.05], atol=0.02)
    assert found.temperature.p_value > 1e-3
    assert any(sentence.startswith("Over time: drift: 0.0") for sentence in found.words)
    assert found.to_dict()["temperature"]["p_value"] == found.temperature.p_value


def test_a_drift_within_a_map_that_holds_is_called_one():
    """A drift is as significant as its length in its own standard deviations says, and does not contradict the map."""
    slope = np.array([0.02, 0.0, 0.0])
    drift = Drift(slope, np.full(3, 0.005), 0.001)
    found = Recheck(ConsistencyTest(40, 0.9, 0.8, 0.7, []), [], drift, None)
    assert found.words == [
        "The map holds: residuals are 0.90 times what it predicts (p = 1, 40 readings).",
        "Over time: drift, small enough for the map to hold: 0.0200 ± 0.0050 mm/h (p = 0.001).",
    ]


def test_samples_join(virtual, error_map, held_out, tmp_path):
    more = new_readings(virtual, 240)
    joined = tp.update_map(error_map, more)
    assert len(joined.samples) == len(error_map.samples) + 240
    assert len(error_map.predictor.weight_) == len(error_map.samples)  # the old map is as it was
    assert mean_miss(joined, held_out) < 0.9 * mean_miss(error_map, held_out)
    joined.save(tmp_path / "joined.truepose")
    again = tp.load_map(tmp_path / "joined.truepose")
    for a, b in zip(joined.predict_errors(held_out), again.predict_errors(held_out), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_samples_join_a_map_without_arm(virtual, held_out):
    cartesian = tp.fit_cell(virtual.cell, new_readings(virtual, 60, 1), "ordinary-kriging")
    joined = tp.update_map(cartesian, new_readings(virtual, 60, 2))
    assert len(joined.samples) == 120
    assert joined.predictor.variogram == cartesian.predictor.with_fitted_parameters().variogram
    assert joined.predict_errors(held_out)[1].mean() < cartesian.predict_errors(held_out)[1].mean()
    assert tp.recheck(cartesian, new_readings(virtual, 8)).holding.n == 8


def test_a_moved_tracker_needs_a_few_readings(virtual, error_map, held_out, tmp_path):
    tf = make_transform(Rotation.from_rotvec([0.1, -0.2, 1.3]), [800.0, -2000.0, 100.0])

    def from_there(samples):
        return replace(samples, p_meas=apply_transform(tf, samples.p_meas))

    moved = tp.update_map(error_map, from_there(new_readings(virtual, 8)), refit="station")
    assert mean_miss(moved, from_there(held_out)) < mean_miss(error_map, held_out) + 0.02
    np.testing.assert_allclose(moved.e, error_map.e, atol=1e-9)
    p, std = moved.predict_measured(held_out.q)
    assert np.linalg.norm(p - from_there(held_out).p_meas, axis=1).mean() < 0.1
    assert std.shape == p.shape
    moved.save(tmp_path / "moved.truepose")
    np.testing.assert_allclose(tp.load_map(tmp_path / "moved.truepose").predict_measured(held_out.q)[0], p, atol=1e-6)


@pytest.mark.parametrize("refit", ["tool", "both"])
def test_another_tool_needs_a_few_readings(virtual, error_map, refit, tmp_path):
    """Its errors are those of the arm, seen at its own point, and the turn of the tool."""
    other = virtual.truth.tf_flange_tool.copy()
    other[:3, 3] += [60.0, -150.0, 220.0]
    tf = make_transform(
        Rotation.from_rotvec([0.0, 0.0, 0.7 * (refit == "both")]), [0.0, 500.0 * (refit == "both"), 0.0]
    )

    def read(n, seed):
        q, rng = virtual.design(n, seed=seed), np.random.default_rng(seed)
        joints = q + virtual.truth.joint_error(q)
        p_base = virtual.truth.robot.forward(joints, tool=other)[:, :3, 3] + rng.normal(scale=0.02, size=(n, 3))
        p_tracker = apply_transform(invert_transform(virtual.truth.tf_base_tracker), p_base)
        return Samples(apply_transform(tf, p_tracker), q=q, source="new tool")

    changed = tp.update_map(error_map, read(12, 3), refit=refit)
    samples = read(100, 9)
    nominal = np.linalg.norm(changed.errors(samples), axis=1).mean()
    assert mean_miss(changed, samples) < 0.25 * nominal
    assert mean_miss(changed, samples) < 0.12
    np.testing.assert_allclose(changed.e, error_map.e, atol=1e-9)
    changed.save(tmp_path / "changed.truepose")
    again = tp.load_map(tmp_path / "changed.truepose")
    np.testing.assert_allclose(again.predict_errors(samples)[0], changed.predict_errors(samples)[0], atol=1e-7)
    with pytest.raises(DataError, match="samples are of another point"):
        tp.update_map(changed, read(3, 4))


def test_wrong_words(virtual, error_map):
    with pytest.raises(DataError, match=r'refit is .base.; expected "station", "tool", "both", or None'):
        tp.update_map(error_map, new_readings(virtual, 8), refit="base")
    bare = Samples(new_readings(virtual, 8).p_meas, p_cmd=np.zeros((8, 3)), source="bare")
    with pytest.raises(DataError, match="bare"):
        tp.update_map(error_map, bare, refit="tool")


def test_readings_that_a_map_has_count_once(virtual, error_map, run, tmp_path):
    """Counted twice, readings would claim twice the evidence: standard deviations too small, corrections too bold."""
    new = new_readings(virtual, 12, seed=9)
    once = tp.update_map(error_map, new)
    for again in (new, error_map.samples[:5], new[3:7]):
        with pytest.raises(DataError, match="all of these readings are in the map already"):
            tp.update_map(once, again)
    later = new_readings(virtual, 4, seed=10)
    joined = Samples(np.concatenate([new.p_meas, later.p_meas]), q=np.concatenate([new.q, later.q]))
    twice = tp.update_map(once, joined)
    assert len(twice.samples) == len(once.samples) + 4
    assert sum(row["reason"] == "in the map already" for row in twice.excluded) == 12
    poses = virtual.design(6, seed=11)
    fitted = tp.update_map(tp.update_map(error_map, later), new)
    np.testing.assert_allclose(twice.predict(poses).std, fitted.predict(poses).std, rtol=0.05)
    write_samples(tmp_path / "new.csv", new)
    once.save(tmp_path / "once.truepose")
    refused = run("update", tmp_path / "once.truepose", tmp_path / "new.csv", "--out", tmp_path / "twice.truepose")
    assert "in the map already" in refused.failed()
    assert not (tmp_path / "twice.truepose").exists()


@pytest.fixture(scope="module")
def two_loads():
    """A map of samples with 20 and 60 kg, whose cell states no payload."""
    virtual = tp.VirtualCell("hard", seed=0, effects={"geometry", "tool", "repeatability", "tracker", "compliance"})
    cell = virtual.cell.model_copy(update={"payload": type(virtual.cell.payload)()})
    kg = np.where(np.arange(50) % 2, 20.0, 60.0)
    samples = virtual.measure(virtual.design(50, seed=0), seed=0, payload_kg=kg)
    return virtual, tp.fit_cell(cell, samples, "kinematic-kriging")


def test_new_payloads_leave_what_old_ones_refer_to(two_loads, tmp_path):
    """Before, predictions without a stated payload moved by 0.14 mm to the mean of all payloads."""
    virtual, error_map = two_loads
    updated = tp.update_map(error_map, virtual.measure(virtual.design(20, seed=3), seed=3, payload_kg=200.0))
    updated.save(tmp_path / "map.truepose")
    read = tp.load_map(tmp_path / "map.truepose")
    q = virtual.design(40, seed=9)
    for kg in (20.0, 60.0, None):
        poses = tp.Poses(q=q, load=None if kg is None else np.full(40, kg))
        (before, _), (after, std), again = (one.predict_errors(poses) for one in (error_map, updated, read))
        assert np.linalg.norm(after - before, axis=1).mean() < 0.05
        np.testing.assert_allclose(again, (after, std), atol=1e-9)
    before, after = error_map.predictor.parameters_, updated.predictor.parameters_
    rows = [
        (old["estimate"], old["std"], new["estimate"])
        for old, new in zip(before, after, strict=True)
        if "payload" in old["name"]
    ]
    assert all(abs(new - old) < 3.0 * std for old, std, new in rows)


def test_samples_without_a_payload_take_none_from_those_of_the_map(two_loads, virtual, error_map):
    bare = virtual.cell.payload.mass_kg
    other, known = two_loads
    new = replace(other.measure(other.design(6, seed=4), seed=4), load=None)
    with pytest.raises(
        DataError, match="the map knows the payload of its samples; state that of the new ones in load_"
    ):
        tp.update_map(known, new)
    stated = known.changed(cell=other.cell)
    assert tp.update_map(stated, new).samples.load[-6:].tolist() == [other.cell.payload.mass_kg] * 6
    heavy = virtual.measure(virtual.design(6, seed=4), seed=4, payload_kg=30.0)
    joined = tp.update_map(error_map.changed(samples=replace(error_map.samples, load=None)), heavy).samples
    assert set(joined.load[:-6]) == {bare}
    assert set(joined.load[-6:]) == {30.0}
