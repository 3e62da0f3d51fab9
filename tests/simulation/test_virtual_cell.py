from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.errors import DataError, RobotError
from truepose.geometry import apply_transform, register
from truepose.robots import list_robots
from truepose.simulation import EFFECTS, PRESETS, TrackerNoise, VirtualCell


@pytest.fixture(scope="module")
def cell() -> VirtualCell:
    return VirtualCell("paper", seed=0)


def registered(cell, samples):
    return register(samples.p_cmd, samples.p_meas, robust=False).residuals


@pytest.mark.parametrize("seed", range(5))
def test_the_paper_starts_at_about_1_3_mm(seed):
    """Zeng, Tian, Liao (2016): 1.2912 mm at most before compensation."""
    cell = VirtualCell("paper", seed=seed)
    largest = np.linalg.norm(registered(cell, cell.measure(cell.design(512, seed=1))), axis=1).max()
    assert largest == pytest.approx(1.29, abs=0.2)


def test_same_seed_same_readings():
    one, other = (VirtualCell("paper", seed=5) for _ in range(2))
    np.testing.assert_array_equal(one.measure(one.design(10)).p_meas, other.measure(other.design(10)).p_meas)


def test_another_seed_is_another_robot():
    a, b = (VirtualCell("paper", seed=s).truth.robot.alpha for s in (1, 2))
    assert np.abs(a - b).max() > 1e-5


def test_repeated_readings_scatter_by_the_noise_floor(cell):
    q = np.repeat(cell.reach(np.array([cell.preset.centre_mm])), 4000, axis=0)
    p = cell.measure(q).p_meas
    length = np.linalg.norm(p - p.mean(axis=0), axis=1)
    assert length.mean() == pytest.approx(cell.noise_floor, rel=0.03)


def test_truth_maps_the_readings_onto_the_robot(cell):
    q = cell.design(200)
    samples = cell.measure(q)
    miss = apply_transform(cell.truth.tf_base_tracker, samples.p_meas) - cell.true_position(q)
    assert np.linalg.norm(miss, axis=1).mean() == pytest.approx(cell.noise_floor, rel=0.15)
    assert np.abs(miss).max() < 6 * cell.noise_floor


def test_tracker_noise_is_small_along_the_beam():
    noise = TrackerNoise()
    covariance = noise.covariance(np.array([[4000.0, 0.0, 0.0]]))[0]
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [0.007, 0.0195, 0.0195])


def test_commands_are_the_stated_ones(cell):
    """The tool as stated, not as it is: the commanded positions are those asked for."""
    target = np.add(cell.preset.centre_mm, [[0.0, 0.0, 0.0], [100.0, 50.0, -20.0]])
    np.testing.assert_allclose(cell.measure(cell.reach(target)).p_cmd, target, atol=1e-9)
    assert np.abs(cell.truth.tf_flange_tool - cell.tf_flange_tool).max() > 0.1


def test_design_is_within_limits_and_region(cell):
    q = cell.design(300)
    cell.robot.check_limits(q)
    offset = cell.measure(q).p_cmd - cell.preset.centre_mm
    assert (np.abs(offset) <= np.asarray(cell.preset.size_mm) / 2 + 1e-6).all()


def test_poses_out_of_reach_are_refused(cell):
    with pytest.raises(RobotError, match=r"1 of 2 poses are out of reach, the first at \[9000\.0, 0\.0, 0\.0\] mm"):
        cell.reach(np.array([cell.preset.centre_mm, [9000.0, 0.0, 0.0]]))


def test_unknown_preset():
    with pytest.raises(DataError, match="unknown preset 'papr'; expected one of paper, hard, ideal"):
        VirtualCell("papr")


def test_the_cell_file_loads(cell):
    assert cell.cell.tf_flange_tool == pytest.approx(cell.tf_flange_tool)


def test_there_is_an_effect_by_each_name():
    """Each effect alone moves the tool or the readings; none of them leaves nothing but the station."""
    nothing = VirtualCell("hard", seed=1, effects=())
    q = nothing.design(40)
    p = apply_transform(nothing.truth.tf_base_tracker, nothing.measure(q).p_meas)
    np.testing.assert_allclose(p, nothing.measure(q).p_cmd, atol=1e-9)
    for effect in EFFECTS:
        alone = VirtualCell("hard", seed=1, effects=[effect])
        moved = apply_transform(alone.truth.tf_base_tracker, alone.measure(q).p_meas) - p
        assert 0.003 < np.linalg.norm(moved, axis=1).mean() < 10.0, effect


def test_switching_one_effect_leaves_the_others_as_they_are():
    everything, without = VirtualCell("hard", seed=4), VirtualCell("hard", seed=4, effects=set(EFFECTS) - {"backlash"})
    assert everything.truth.backlash.any()
    assert not without.truth.backlash.any()
    for name in ("compliance", "expansion", "tf_base_tracker", "tf_flange_tool"):
        np.testing.assert_array_equal(getattr(everything.truth, name), getattr(without.truth, name))
    np.testing.assert_array_equal(everything.truth.robot.a, without.truth.robot.a)
    q = everything.design(20)
    np.testing.assert_array_equal(everything.truth.joint_error(q), without.truth.joint_error(q))


def test_ideal_is_noise_alone():
    cell = VirtualCell("ideal", seed=2)
    samples = cell.measure(cell.design(300))
    left = np.linalg.norm(apply_transform(cell.truth.tf_base_tracker, samples.p_meas) - samples.p_cmd, axis=1)
    assert left.mean() == pytest.approx(cell.noise_floor, rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_hard_has_the_sizes_of_the_literature(seed):
    """docs/virtual-cell.md: compliance, harmonics of 1–20 arcsec, backlash up to 0.3 mrad."""
    cell = VirtualCell("hard", seed=seed)
    compliance = cell.truth.compliance
    assert ((compliance[:3] >= 3e-7) & (compliance[:3] <= 7e-7)).all()
    assert ((compliance[3:] >= 2e-6) & (compliance[3:] <= 3.5e-6)).all()
    assert ((cell.truth.backlash >= 0) & (cell.truth.backlash <= 3e-4)).all()
    angle = np.linspace(-np.pi, np.pi, 721)[:, None] * np.ones(6)
    arcsec = np.rad2deg(cell.truth.joint_error(angle).std(axis=0)) * 3600.0
    assert (arcsec > 1.0).all()
    assert (arcsec < 30.0).all()
    samples = cell.measure(cell.design(200))
    largest = np.linalg.norm(registered(cell, samples), axis=1).max()
    assert 0.8 < largest < 8.0
    assert samples.load is not None
    assert set(samples.load) == {cell.preset.payload_kg}


def test_orientations_of_hard_vary_and_can_be_held():
    cell = VirtualCell("hard", seed=0)

    def turned(**how):
        rotation = cell.measure(cell.design(100, **how)).rotation_cmd
        return np.rad2deg((rotation[0].inv() * rotation).magnitude()).max()

    assert 15.0 < turned() < 2 * np.sqrt(3) * 15.0
    assert turned(orientation_deg=0.0) < 1e-6


def test_measuring_by_seed_repeats_itself():
    cell = VirtualCell("hard", seed=0)
    q = cell.design(5)
    first = cell.measure(q, seed=7).p_meas
    cell.measure(q)
    np.testing.assert_array_equal(cell.measure(q, seed=7).p_meas, first)
    assert (cell.measure(q, seed=8).p_meas != first).all()


def test_backlash_shifts_by_the_way_a_pose_is_approached():
    cell = VirtualCell("hard", seed=0)
    q = cell.design(30)
    ways = [cell.true_position(q, approach=way) for way in (1.0, -1.0)]
    lag = cell.truth.joints(q, cell._conditions(q, -1.0)) - cell.truth.joints(q, cell._conditions(q, 1.0))
    np.testing.assert_allclose(lag, np.broadcast_to(cell.truth.backlash, q.shape), atol=1e-12)
    assert np.linalg.norm(ways[0] - ways[1], axis=1).max() > 0.05
    order = cell.measure(q, approach="order").approach
    np.testing.assert_array_equal(order[1:], np.sign(np.diff(q, axis=0)))
    np.testing.assert_array_equal(order[0], np.sign(q[0] - np.deg2rad(cell.preset.home_deg)))


def test_backlash_may_vary_with_the_angle_and_changes_nothing_else():
    plain = VirtualCell("backlash", seed=0)
    uneven = VirtualCell(replace(PRESETS["backlash"], backlash_wave=(0.3, 0.6)), seed=0)
    q = np.tile(np.linspace(-np.pi, np.pi, 100)[:, None], plain.robot.dof)
    np.testing.assert_array_equal(uneven.truth.joint_error(q), plain.truth.joint_error(q))
    np.testing.assert_array_equal(uneven.truth.tf_base_tracker, plain.truth.tf_base_tracker)
    share = np.ptp(uneven.truth.backlash_wave(q), axis=0) / 2.0
    assert ((share > 0.29) & (share < 0.6)).all()
    up, down = (uneven.truth.joints(q, uneven._conditions(q, way)) for way in (1.0, -1.0))
    lost = plain.truth.backlash * (1.0 + uneven.truth.backlash_wave(q))
    np.testing.assert_allclose(down - up, lost, atol=1e-12)


def test_an_arm_that_warms_up_drifts_as_its_temperature():
    cell = VirtualCell("hard", seed=0, effects=["thermal"])
    q = np.repeat(cell.design(1), 50, axis=0)
    samples = cell.measure(q, time=np.linspace(0.0, 4 * cell.preset.warm_up_s, 50))
    assert samples.temperature[0] == pytest.approx(20.0)
    assert samples.temperature[-1] == pytest.approx(20.0 + cell.preset.warm_up_kelvin, abs=0.2)
    drift = np.linalg.norm(samples.p_meas - samples.p_meas[0], axis=1)
    np.testing.assert_allclose(drift, drift[-1] * (samples.temperature - 20.0) / (samples.temperature[-1] - 20.0))
    assert 0.1 < drift[-1] < 0.5
    usual = cell.measure(q).temperature
    assert 0.1 < np.ptp(usual) < 2.0


def test_a_payload_bends_the_arm_down():
    cell = VirtualCell("hard", seed=0, effects=["compliance"])
    q = cell.design(20)
    sag = cell.true_position(q, payload_kg=150.0) - cell.true_position(q, payload_kg=0.0)
    assert (sag[:, 2] < -0.5).all()
    mixed = cell.measure(q, payload_kg=np.where(np.arange(20) < 10, 150.0, 0.0))
    np.testing.assert_array_equal(mixed.load, np.repeat([150.0, 0.0], 10))
    p = apply_transform(cell.truth.tf_base_tracker, mixed.p_meas)
    np.testing.assert_allclose(p[:10], cell.true_position(q[:10], payload_kg=150.0), atol=1e-9)


def test_several_reflectors_give_poses_with_honest_deviations():
    cell = VirtualCell("ideal", seed=0, effects=["tracker"])
    q = np.repeat(cell.design(1), 4000, axis=0)
    samples = cell.measure(q, reflectors=3)
    tf = cell.robot.forward(q[:1], tool=cell.tf_flange_tool)[0]
    to_base = Rotation.from_matrix(cell.truth.tf_base_tracker[:3, :3])
    turn = (to_base * samples.rotation_meas * Rotation.from_matrix(tf[:3, :3]).inv()).as_rotvec()
    in_tracker = to_base.inv().apply(turn)
    np.testing.assert_allclose(in_tracker.std(axis=0), samples.rotation_std[0], rtol=0.06)
    np.testing.assert_allclose(samples.p_meas.std(axis=0), samples.p_std[0], rtol=0.06)
    assert np.abs(in_tracker.mean(axis=0)).max() < 5e-6
    single = cell.measure(q[:1]).p_std
    assert (samples.p_std[0] < single[0]).all()


def test_a_reflector_turned_away_is_not_seen():
    cell = VirtualCell("hard", seed=0)
    q = cell.design(200)
    assert cell.visible(q).mean() > 0.9
    away = q.copy()
    away[:, 5] += np.pi
    assert not cell.visible(away).any()
    half = np.where(np.arange(200)[:, None] < 100, q, away)
    seen = cell.measure(half, line_of_sight=True, seed=1)
    np.testing.assert_array_equal(seen.row, np.flatnonzero(cell.visible(half)))
    np.testing.assert_array_equal(seen.p_meas, cell.measure(half, seed=1).p_meas[seen.row])


def test_invalid_measurements_are_refused():
    cell = VirtualCell("hard")
    q = cell.design(4)
    with pytest.raises(DataError, match="unknown effect 'gravity'; expected one of geometry, compliance"):
        VirtualCell("hard", effects=["gravity"])
    with pytest.raises(DataError, match="expected 1 reflector for positions, or 3 or more for poses; got 2"):
        cell.measure(q, reflectors=2)
    with pytest.raises(DataError, match=r"expected time of shape \(4,\), got \(3,\)"):
        cell.measure(q, time=np.zeros(3))
    with pytest.raises(DataError, match=r"expected approach -1, 0 or .*; got 'random'"):
        cell.measure(q, approach="random")


@pytest.mark.parametrize("preset", ["paper", "hard"])
@pytest.mark.parametrize("name", list_robots())
@pytest.mark.sampled(10)
def test_every_robot_of_the_library_can_be_virtual(name, preset):
    """The region, at its orientations, is reached on one branch within limits, and errors scale with the arm."""
    cell = VirtualCell(preset, robot=name, seed=1)
    q = cell.design(60)
    assert cell.robot.within_limits(q).all()
    samples = cell.measure(q)
    largest = np.linalg.norm(registered(cell, samples), axis=1).max()
    assert 0.2 < largest < 10.0
    assert cell.cell.robot.model == name


def test_the_tool_is_turned_otherwise_than_stated():
    cell = VirtualCell("hard", seed=2, effects=["tool"])
    samples = cell.measure(cell.design(20), reflectors=3)
    to_base = Rotation.from_matrix(cell.truth.tf_base_tracker[:3, :3])
    off = samples.rotation_cmd.inv() * to_base * samples.rotation_meas
    assert 1e-3 < off.magnitude().max() < 15e-3
    np.testing.assert_allclose(off.as_rotvec(), np.tile(off[0].as_rotvec(), (20, 1)), atol=1e-9)


def test_repr_fits_a_screen():
    text = repr(VirtualCell("paper", seed=3))
    assert text.startswith(
        "<VirtualCell of kuka-kr210-r2700-extra, seed 3: geometry, tool, repeatability, tracker; noise"
    )
    assert len(text) < 240
