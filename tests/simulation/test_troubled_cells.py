import numpy as np
import pytest
from scipy.stats import kurtosis

from truepose.errors import DataError
from truepose.geometry import apply_transform
from truepose.simulation import EFFECTS, PRESETS, TROUBLES, VirtualCell

KINDS = (*TROUBLES, "cold-start", "backlash", "ripple", "other-payload")
PAPER = [2792.9308248, -2341.5034218, 893.1016301]
HARD = [2845.3698573, -2513.1782356, 869.5178771]


def in_base(cell, samples):
    return apply_transform(cell.truth.tf_base_tracker, samples.p_meas)


def moved_by(trouble, q, seed=1):
    """Return what one trouble alone does to the true positions of configurations."""
    alone = VirtualCell("hard", seed=seed, effects=[trouble])
    return alone, alone.true_position(q) - VirtualCell("hard", seed=seed, effects=()).true_position(q)


@pytest.mark.parametrize("kind", KINDS)
def test_a_troubled_cell_is_hard_and_one_thing_more(kind):
    """The arm, the tool, the station and the design are those of hard with the same seed."""
    hard, cell = VirtualCell("hard", seed=3), VirtualCell(kind, seed=3)
    np.testing.assert_array_equal(cell.design(20), hard.design(20))
    for name in ("tf_base_tracker", "tf_flange_tool", "compliance", "expansion"):
        np.testing.assert_array_equal(getattr(cell.truth, name), getattr(hard.truth, name))
    np.testing.assert_array_equal(cell.truth.robot.a, hard.truth.robot.a)
    assert set(EFFECTS) <= cell.effects
    q = cell.design(20)
    one, other = (c.measure(q, seed=1) for c in (cell, hard))
    assert not np.array_equal(one.p_meas, other.p_meas) or not np.array_equal(cell.at_work(q), hard.at_work(q))


def test_no_preset_but_the_troubled_has_a_trouble():
    assert {*PRESETS} == {"paper", "hard", "ideal", *KINDS}
    for name in ("paper", "hard", "ideal"):
        cell = VirtualCell(name, seed=0)
        assert not cell.effects & set(TROUBLES)
        assert not any(np.any(v) for k, v in vars(cell.truth.troubles).items() if k != "step_at")
        q = cell.design(5)
        np.testing.assert_array_equal(cell.at_work(q), cell.true_position(q))


def test_draws_of_earlier_presets_stay_as_they_were():
    """Readings from before the troubled cells existed; every published figure hangs on them."""
    paper, hard = (VirtualCell(name, seed=0) for name in ("paper", "hard"))
    assert paper.measure(paper.design(3)).p_meas[2] == pytest.approx(PAPER, abs=1e-6)
    assert hard.measure(hard.design(3)).p_meas[2] == pytest.approx(HARD, abs=1e-6)


def test_heavy_tails_are_those_of_students_t():
    usual, heavy = (VirtualCell("hard", seed=0, effects=["tracker", *more]) for more in ((), ("heavy-tails",)))
    q = np.repeat(usual.design(1), 4000, axis=0)
    (a, b), std = (c.measure(q, seed=1).p_meas for c in (usual, heavy)), usual.measure(q[:1]).p_std[0]
    scaled = (b - b.mean(axis=0)) / std
    assert (np.abs(kurtosis((a - a.mean(axis=0)) / std, axis=0)) < 0.5).all()
    assert (kurtosis(scaled, axis=0) > 5.0).all()
    # the middle half of t with 3 degrees of freedom lies within 0.765
    np.testing.assert_allclose(np.median(np.abs(scaled), axis=0), 0.765, rtol=0.06)
    np.testing.assert_array_equal(heavy.measure(q[:1]).p_std, usual.measure(q[:1]).p_std)


def test_rounding_leaves_few_decimals_in_the_file_only():
    cell = VirtualCell("rounding", seed=0)
    q = cell.design(30)
    samples = cell.measure(q, seed=1)
    for values, decimals in ((samples.p_meas, 1), (samples.p_cmd, 1), (np.rad2deg(samples.q), 2)):
        np.testing.assert_allclose(np.round(values, decimals), values, atol=1e-9)
    assert 0 < np.abs(samples.q - q).max() <= np.deg2rad(0.005) + 1e-12
    unrounded = VirtualCell("hard", seed=0).measure(q, seed=1)
    assert 0 < np.abs(samples.p_meas - unrounded.p_meas).max() <= 0.05 + 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_one_joint_jumps_within_the_work(seed):
    cell = VirtualCell("hard", seed=seed, effects=["joint-step"])
    step, at = cell.truth.troubles.step, cell.truth.troubles.step_at
    (joint,) = np.flatnonzero(step)
    assert 0.1e-3 <= abs(step[joint]) <= 0.5e-3
    assert abs(np.rad2deg(at[joint]) - cell.preset.home_deg[joint]) <= 10.0
    q = np.repeat(cell.design(1), 2, axis=0)
    q[:, joint] = at[joint] + [-1e-9, 1e-9]
    jump = cell.truth.joints(q, cell._conditions(q))
    np.testing.assert_allclose(jump[1] - jump[0], step, atol=1e-8)


def test_the_pedestal_tilts_towards_where_the_arm_reaches():
    cell = VirtualCell("hard", seed=1)
    q = cell.design(30)
    alone, moved = moved_by("pedestal", q)
    p = VirtualCell("hard", seed=1, effects=()).true_position(q)
    k = alone.truth.troubles.tilt_per_mm
    assert ((k >= 0.05e-6) & (k <= 0.25e-6)).all()
    # what lies outside sinks, and what lies above the base leans out
    np.testing.assert_allclose(moved[:, 2], -(p[:, :2] ** 2 @ k), rtol=1e-3)
    np.testing.assert_allclose(moved[:, :2], k * p[:, :2] * p[:, 2:], rtol=2e-2, atol=2e-3)


def test_creep_is_a_drift_over_the_campaign():
    cell = VirtualCell("hard", seed=2, effects=["creep"])
    q = np.repeat(cell.design(1), 11, axis=0)
    p = cell.measure(q).p_meas
    assert 0.1 <= np.linalg.norm(p[-1] - p[0]) <= 0.5
    np.testing.assert_allclose(np.diff(p, axis=0), np.tile((p[-1] - p[0]) / 10, (10, 1)), atol=1e-9)
    np.testing.assert_allclose(in_base(cell, cell.measure(q)).mean(axis=0), cell.true_position(q)[0], atol=1e-9)
    assert np.isfinite(cell.measure(q[:1]).p_meas).all()


def test_a_cold_start_is_used_warm():
    cell = VirtualCell("cold-start", seed=0)
    q = cell.design(50)
    samples = cell.measure(q)
    assert samples.temperature[0] == pytest.approx(20.0)
    assert samples.temperature[-1] < 24.0
    warm = cell.true_position(q, time=1e6)
    assert np.linalg.norm(cell.at_work(q) - warm, axis=1).max() < 0.02
    assert np.linalg.norm(cell.true_position(q) - warm, axis=1).max() > 0.1


def test_backlash_with_mixed_approach():
    cell = VirtualCell("backlash", seed=0)
    assert ((cell.truth.backlash >= 0.1e-3) & (cell.truth.backlash <= 1e-3)).all()
    samples = cell.measure(cell.design(50))
    assert (np.abs(samples.approach.mean(axis=0)) < 0.5).all()


@pytest.mark.parametrize("robot", [None, "universal-robots-ur10"])
def test_work_with_another_payload(robot):
    cell = VirtualCell("other-payload", robot=robot, seed=0)
    assert cell.preset.work_payload_kg == pytest.approx(0.25 * cell.preset.payload_kg, abs=0.1)
    q = cell.design(10)
    lifted = cell.at_work(q) - cell.true_position(q)
    assert (lifted[:, 2] > 0).all()
    assert set(cell.measure(q).load) == {cell.preset.payload_kg}


def test_an_unknown_effect_lists_the_troubles():
    with pytest.raises(DataError, match=r"unknown effect 'gravity'; expected one of geometry.*joint-step"):
        VirtualCell("hard", effects=["gravity"])
