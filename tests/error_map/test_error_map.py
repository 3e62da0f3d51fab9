from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.error_map.target_joints import BranchTracker
from truepose.errors import DataError, IdentifiabilityError, KrigingError, RobotError
from truepose.geometry import make_transform
from truepose.predictors import PositionalErrors
from truepose.robots import nearest_branch, status_turn
from truepose.samples import Poses, Samples


@pytest.fixture(scope="module")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("paper", seed=2)


@pytest.fixture(scope="module")
def samples(virtual) -> Samples:
    return virtual.measure(virtual.design(100, seed=1))


@pytest.fixture(scope="module")
def error_map(virtual, samples) -> tp.ErrorMap:
    return tp.fit_cell(virtual.cell, samples, "ordinary-kriging")


@pytest.fixture(scope="module")
def targets(virtual):
    """Poses inside the region, base to tool."""
    p = np.asarray(virtual.preset.centre_mm) + np.random.default_rng(0).uniform(-300, 300, size=(30, 3))
    return make_transform(tp.euler("kuka", virtual.preset.abc_deg), p)


def test_corrected_commands_end_at_their_targets(virtual, error_map, targets):
    """What the map is for: the true robot, sent to the commands, ends nearer to the targets."""
    corrections = error_map.correct(targets)
    assert set(corrections.verdict) == {"correct"}

    def miss(p_command):
        measured = virtual.measure(virtual.reach(p_command))
        return np.linalg.norm(error_map.registration.apply(measured.p_meas) - targets[:, :3, 3], axis=1)

    before, after = miss(targets[:, :3, 3]), miss(corrections.p_command)
    assert after.mean() < 0.25 * before.mean()
    assert after.mean() < 1.6 * virtual.noise_floor


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.sampled(1)
def test_the_largest_error_falls_by_more_than_in_the_paper(seed):
    """75.36 % (Zeng, Tian, Liao 2016), on held-out poses of ten robots."""
    cell = tp.VirtualCell("paper", seed=seed)
    fitted = tp.fit_cell(cell.cell, cell.measure(cell.design(160, seed=seed)), "ordinary-kriging")
    figures = fitted.validate(cell.measure(cell.design(100, seed=1000 + seed)))
    assert figures["reduction_max_percent"] > 75.36


def test_solution_reproduces_the_target(error_map, targets):
    corrections = error_map.correct(targets)
    assert np.nanmax(corrections.mirror_miss) < 0.02
    predicted = corrections.p_command + error_map.predictor.predict(corrections.p_command)
    np.testing.assert_allclose(predicted, corrections.p_target, atol=1e-4)
    # one step (15) is near it, but not the same
    assert 0 < np.linalg.norm(corrections.p_mirror - corrections.p_command, axis=1).max() < 0.02


def test_guards(virtual, error_map, targets):
    far = targets.copy()
    far[0, 0, 3] += 5000
    far[1, :3, :3] = tp.euler("kuka", (180.0, 70.0, 180.0)).as_matrix()
    tools = np.broadcast_to(virtual.tf_flange_tool, (30, 4, 4)).copy()
    tools[2, 2, 3] += 80
    status = np.full(30, 2)
    status[3] = 7
    status[4] = -1
    status[5] = 18  # bit 4 is not about the branch
    found = error_map.correct(far, tf_flange_tool=tools, status=status)
    for i, reason in enumerate(
        ("outside the sampled region", "orientation is 50.0°", "tool point is 80.0 mm", "branch")
    ):
        assert reason in found.reason[i]
        assert found.verdict[i] == "refuse"
        np.testing.assert_array_equal(found.p_command[i], found.p_target[i])
    assert set(found.verdict[4:]) == {"correct"}


def test_limits_of_the_cell_file_are_used(virtual, samples, targets):
    strict = virtual.cell.model_copy(
        update={"correction": virtual.cell.correction.model_copy(update={"max_correction_mm": 0.05})}
    )
    found = tp.fit_cell(strict, samples, "ordinary-kriging").correct(targets, on_guard="clip")
    assert "clip" in found.verdict
    assert np.linalg.norm(found.correction, axis=1).max() <= 0.05 + 1e-12


def test_map_file_comes_back_the_same(error_map, targets, tmp_path):
    path = tmp_path / "m.truepose"
    error_map.save(path)
    again = tp.load_map(path)
    assert again.hash == error_map.hash
    np.testing.assert_allclose(again.correct(targets).p_command, error_map.correct(targets).p_command, atol=1e-9)
    p, std = again.predict_measured(error_map.samples.q)
    expected, expected_std = error_map.predict_measured(error_map.samples.q)
    np.testing.assert_allclose(p, expected, atol=1e-9)
    np.testing.assert_allclose(std, expected_std, atol=1e-9)


def test_gross_reading_is_named_and_left_out(virtual, samples):
    p_meas = samples.p_meas.copy()
    p_meas[17] += [0.0, 4.0, 0.0]
    spoiled = Samples(p_meas, q=samples.q, source="spoiled")
    fitted = tp.fit_cell(virtual.cell, spoiled, "ordinary-kriging")
    assert [row["row"] for row in fitted.excluded] == [17]
    assert len(fitted.samples) == 99


@pytest.fixture
def steep(virtual, rng) -> Samples:
    """Errors that rise steeply towards one corner, where registration alone calls some of them gross."""
    offset = rng.uniform(-0.5, 0.5, size=(150, 3)) * virtual.preset.size_mm
    p_cmd = np.add(virtual.preset.centre_mm, offset)
    to_corner = np.linalg.norm(offset - 0.5 * np.asarray(virtual.preset.size_mm), axis=1)
    e = 1.6 * np.exp(-((to_corner / 500.0) ** 2))[:, None] * [1.0, 0.0, 0.0] + 0.1 * np.sin(p_cmd / 400.0)
    return Samples(p_cmd + e + rng.normal(scale=0.02, size=e.shape), p_cmd=p_cmd, source="steep")


def test_large_errors_that_neighbours_share_stay(virtual, steep):
    fitted = tp.fit_cell(virtual.cell, steep, "ordinary-kriging")
    assert fitted.registration.outliers.sum() >= 5
    assert fitted.excluded == []


def test_gross_readings_among_steep_errors_are_named(virtual, steep):
    p_meas = steep.p_meas.copy()
    p_meas[[20, 31]] += [[0.0, 5.0, 0.0], [3.0, 0.0, 0.0]]
    spoiled = Samples(p_meas, p_cmd=steep.p_cmd, source="spoiled")
    assert [row["row"] for row in tp.fit_cell(virtual.cell, spoiled, "ordinary-kriging").excluded] == [20, 31]


@pytest.mark.parametrize("predictor", ["ordinary-kriging-joint", "kinematic-kriging"])
def test_maps_in_joint_space_correct_poses(virtual, samples, targets, predictor):
    """On the branch that the program names, or that of the samples; as well as the map in Cartesian space."""
    fitted = tp.fit_cell(virtual.cell, samples, predictor)
    tools = np.broadcast_to(virtual.tf_flange_tool, (30, 4, 4))
    status, turn = status_turn(virtual.robot, virtual.reach(targets[:, :3, 3]))
    corrections = fitted.correct(targets, tf_flange_tool=tools, status=status, turn=turn)
    assert set(corrections.verdict) == {"correct"}
    np.testing.assert_allclose(fitted.correct(targets).p_command, corrections.p_command, atol=1e-9)
    miss = virtual.true_position(virtual.reach(corrections.p_command))
    registered = miss - targets[:, :3, 3] - _systematic(virtual, fitted, targets)
    assert np.linalg.norm(registered, axis=1).mean() < 1.5 * virtual.noise_floor


@pytest.fixture(scope="module")
def turning(virtual):
    """The cell measured in many orientations by kinematic Kriging: what the arm's orientation errors need."""
    rng = np.random.default_rng(4)
    q = virtual.design(80, seed=1) + rng.uniform(-1, 1, size=(80, 6)) * np.deg2rad([0, 0, 0, 25, 20, 40])
    return tp.fit_cell(virtual.cell, virtual.measure(q), "kinematic-kriging")


def test_position_and_orientation_are_corrected_together(virtual, turning, targets):
    """The predicted outcome is the target to 1 µm and 1 µrad; the true arm turns less far from it than before."""
    found = turning.correct(targets, orientation=True)
    assert set(found.verdict) == {"correct"}
    command = targets.copy()
    command[:, :3, 3] = found.p_command
    command[:, :3, :3] = Rotation.from_rotvec(found.rotation).as_matrix() @ targets[:, :3, :3]
    home = np.deg2rad(virtual.preset.home_deg)

    def joints(poses):
        return nearest_branch(virtual.robot.inverse(poses, tool=virtual.tf_flange_tool), home)

    error, std = turning.predict_pose_errors(Poses(q=joints(command)))
    np.testing.assert_allclose(command[:, :3, 3] + error[:, :3], targets[:, :3, 3], atol=1e-3)
    outcome = Rotation.from_rotvec(error[:, 3:]).as_matrix() @ command[:, :3, :3]
    np.testing.assert_allclose(_angle(outcome, targets), 0.0, atol=1e-6)
    np.testing.assert_allclose(std[:, 3:], found.rotation_std, rtol=1e-6)
    tf = turning.registration.tf_base_tracker @ np.linalg.inv(virtual.truth.tf_base_tracker)

    def after(poses):
        return tf @ virtual.truth.robot.forward(joints(poses), tool=virtual.truth.tf_flange_tool)

    assert _angle(after(command), targets).mean() < 0.5 * _angle(after(targets), targets).mean()
    assert found.to_rows()[0]["rotation_std_rad"] == pytest.approx(np.linalg.norm(std[0, 3:]))


def _angle(a, b):
    return Rotation.from_matrix(a[:, :3, :3] @ np.swapaxes(b[:, :3, :3], 1, 2)).magnitude()


def test_a_tool_mounted_askew_is_known_from_measured_orientations():
    """Positions cannot tell the tool's own turn; readings of three reflectors do, and it is corrected with the rest."""
    cell = tp.VirtualCell("hard", seed=6, effects={"geometry", "tool", "repeatability", "tracker", "transmission"})
    q, new = cell.design(80), cell.design(50, seed=9)
    told = tp.fit_cell(cell.cell, cell.measure(q, reflectors=3), "kinematic-kriging")
    askew = Rotation.from_matrix(cell.tf_flange_tool[:3, :3].T @ cell.truth.tf_flange_tool[:3, :3]).as_rotvec()
    np.testing.assert_allclose(told.tool_turn[0], askew, atol=1e-3)  # and the turn of the last frame
    readings = cell.measure(new, reflectors=3)
    error, std = told.predict_pose_errors(Poses(q=new))
    nominal = cell.robot.forward(new, tool=cell.tf_flange_tool)
    measured = Rotation.from_matrix(told.registration.tf_base_tracker[:3, :3]) * readings.rotation_meas
    left = _angle((Rotation.from_rotvec(error[:, 3:]).as_matrix() @ nominal[:, :3, :3]), measured.as_matrix())
    before = _angle(nominal, measured.as_matrix())
    assert left.mean() < 0.3 * before.mean()
    assert np.mean(left < 1.96 * np.linalg.norm(std[:, 3:], axis=1)) > 0.93


def test_another_point_of_the_tool_is_corrected_as_such(virtual, turning, targets):
    """The map measured one point; a kinematic map knows how the tool turns, and corrects others by it."""
    tool = virtual.tf_flange_tool.copy()
    tool[:3, 3] += [0.0, 200.0, -100.0]
    poses = targets @ np.linalg.inv(virtual.tf_flange_tool) @ tool
    far = turning.limits_in_force(
        max_std_mm=0.5, min_correction_stds=0.0
    )  # that far from the measured point the tool's own turn counts
    found = turning.correct(poses, tf_flange_tool=tool, limits=far)
    assert set(found.verdict) == {"correct"}
    q = virtual.reach(targets[:, :3, 3])
    error, _ = turning.predict_pose_errors(Poses(q=q))
    at_point = error[:, :3] + np.cross(error[:, 3:], poses[:, :3, 3] - targets[:, :3, 3])
    np.testing.assert_allclose(-found.correction, at_point, atol=2e-3)
    assert np.linalg.norm(at_point - error[:, :3], axis=1).mean() > 0.02


def test_orientation_needs_a_map_that_knows_it(error_map, turning, targets):
    with pytest.raises(DataError, match=r"knows errors of position only; .* --predictor kinematic-kriging"):
        error_map.correct(targets, orientation=True)
    with pytest.raises(DataError, match=r"needs poses \(n, 4, 4\)"):
        turning.correct(targets[:, :3, 3], orientation=True)


def test_guards_of_the_joints(virtual, turning, targets, samples):
    """Joint limits, singularities and KUKA's words: in joint space, and for maps in Cartesian space, too."""
    q = np.deg2rad([[10.0, -60, 80, 20, 40, 348.0], [10, -60, 80, 30, 0.02, 20], [10, -60, 80, 1e-5, 40, 20]])
    poses = virtual.robot.forward(q, tool=virtual.tf_flange_tool)
    follower = BranchTracker(
        virtual.robot, poses, np.broadcast_to(virtual.tf_flange_tool, (3, 4, 4)), q, *_words(virtual, q)
    )
    follower.joints(poses[:, :3, 3] + [[0.0, 0.0, 0.0], [0, 0, 0], [0, -1.0, 0]], np.arange(3))
    assert follower.reasons()[0] == ""
    assert "near a singularity: smallest singular value" in follower.reasons()[1]
    assert follower.reasons()[2] == "its Status and Turn would change from S 2, T 2 to S 2, T 10"
    follower.q[0, 5] = np.deg2rad(351.0)
    assert follower.reasons()[0] == "joint 6 would be at 351.000°, limits -350° to 350°"


def _words(virtual, q):
    status, turn = status_turn(virtual.robot, q)
    return status, turn


def _systematic(virtual, fitted, targets):
    """What the registration makes of the true positions of its own frame: a rigid motion, no error of the map."""
    tf = fitted.registration.tf_base_tracker @ np.linalg.inv(virtual.truth.tf_base_tracker)
    p = targets[:, :3, 3]
    return p - (p @ tf[:3, :3].T + tf[:3, 3])


def test_payload_of_the_cell_reaches_the_compliance(virtual, samples, tmp_path):
    cell = tp.Cell.model_validate(
        {**virtual.cell.model_dump(exclude_defaults=True), "payload": {"mass_kg": 120.0, "z_mm": 200.0}}
    )
    fitted = tp.fit_cell(cell, samples, "calibration:terms=compliance")
    assert fitted.predictor.payload == (120.0, 0.0, 0.0, 200.0)
    fitted.save(tmp_path / "m.truepose")
    again = tp.load_map(tmp_path / "m.truepose")
    np.testing.assert_allclose(again.predictor.predict(samples.q), fitted.predictor.predict(samples.q), atol=1e-9)


def test_maps_in_joint_space_guard(virtual, samples, targets):
    fitted = tp.fit_cell(virtual.cell, samples, "ordinary-kriging-joint")
    far = targets[:4].copy()
    far[0, 0, 3] += 5000.0
    far[1, :3, :3] = tp.euler("kuka", (180.0, 80.0, 180.0)).as_matrix()
    found = fitted.correct(far, status=np.array([2, 2, 6, 2]), turn=np.full(4, -1))
    assert "out of reach" in found.reason[0]
    assert "outside the sampled region" in found.reason[1]
    assert "outside the sampled region" in found.reason[2]  # the other wrist
    assert found.verdict.tolist() == ["refuse", "refuse", "refuse", "correct"]
    with pytest.raises(DataError, match=r"needs poses \(n, 4, 4\)"):
        fitted.correct(targets[:, :3, 3])


@pytest.mark.parametrize("predictor", ["ordinary-kriging", "ordinary-kriging-joint"])
def test_targets_as_poses_positions_joints_or_a_table(virtual, samples, targets, predictor):
    fitted = tp.fit_cell(virtual.cell, samples, predictor)
    q = virtual.reach(targets[:, :3, 3])
    expected = fitted.correct(targets)
    table = Poses(p_cmd=targets[:, :3, 3], rotation_cmd=Rotation.from_matrix(targets[:, :3, :3]))
    given = [q, Poses(q=q), table, *([targets[:, :3, 3]] if predictor == "ordinary-kriging" else [])]
    for poses in given:
        found = fitted.correct(poses)
        np.testing.assert_allclose(found.p_target, expected.p_target, atol=1e-6)
        np.testing.assert_allclose(found.p_command, expected.p_command, atol=1e-6)
        assert found.verdict.tolist() == expected.verdict.tolist()
    tool = virtual.tf_flange_tool.copy()
    tool[2, 3] += 20.0
    longer = fitted.correct(q, tf_flange_tool=tool)
    np.testing.assert_allclose(longer.p_target, virtual.robot.forward(q, tool=tool)[:, :3, 3], atol=1e-9)


def test_targets_given_as_joints_keep_their_branch(virtual, samples):
    """A wrist turned by half a turn is another configuration of the same pose, where nothing was measured."""
    fitted = tp.fit_cell(virtual.cell, samples, "ordinary-kriging-joint")
    q = virtual.design(3, seed=8)
    turned = q + np.array([0.0, 0.0, 0.0, np.pi, 0.0, -np.pi])
    turned[:, 4] *= -1.0
    for flipped in virtual.robot.forward(q) - virtual.robot.forward(turned):
        np.testing.assert_allclose(flipped, 0.0, atol=1e-6)
    assert set(fitted.correct(q).verdict) == {"correct"}
    assert all("outside the sampled region" in reason for reason in fitted.correct(turned).reason)


def test_targets_of_another_shape(error_map, samples, targets):
    with pytest.raises(DataError, match=r"joints \(n, 6\), all finite; got targets of shape \(4, 5\)"):
        error_map.correct(np.zeros((4, 5)))
    with pytest.raises(DataError, match=r"all finite; got targets of shape \(2, 3\)"):
        error_map.correct(np.full((2, 3), np.nan))
    with pytest.raises(DataError, match="status, turn and near cannot be combined with joints"):
        error_map.correct(samples.q, status=np.zeros(len(samples), int))


def test_poses_read_from_a_file_are_predicted(error_map, samples, tmp_path):
    tp.write_samples(tmp_path / "poses.csv", tp.Poses(q=samples.q[:7]))
    found = error_map.predict(tp.read_poses(tmp_path / "poses.csv"))
    p, std = error_map.predict_measured(samples.q[:7])
    np.testing.assert_allclose(found.p_measured, p, atol=1e-5)  # angles of the file are rounded
    np.testing.assert_allclose(found.std_measured, std, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found.std, axis=1), np.linalg.norm(std, axis=1), atol=1e-5)
    assert repr(found).startswith("<Prediction of 7 poses: error ")
    assert found.to_dict()["max_std_mm"] == pytest.approx(np.linalg.norm(std, axis=1).max(), abs=1e-5)


def test_the_representation_of_a_map_fits_a_screen(error_map):
    lines = repr(error_map).splitlines()
    assert len(lines) <= 8
    assert "kuka-kr" in lines[1]
    assert "ordinary-kriging (Cartesian space)" in lines[2]
    assert "100" in lines[3]
    assert "mm at the samples (median)" in lines[4]
    assert "better than none" in lines[5]
    assert error_map._repr_html_().count("<tr>") == len(lines) - 1


def test_a_changed_map_is_not_the_map_of_the_file(error_map, tmp_path):
    error_map.save(tmp_path / "m.truepose")
    read = tp.load_map(tmp_path / "m.truepose")
    assert (read.path, error_map.path) == (tmp_path / "m.truepose", None)
    changed = read.changed(excluded=[{"row": 3, "reason": "taken out by hand"}])
    assert changed.path is None
    assert changed.hash != read.hash


def test_positions_without_joints(virtual, samples):
    bare = Samples(samples.p_meas, p_cmd=samples.p_cmd, rotation_cmd=samples.rotation_cmd, source="bare")
    fitted = tp.fit_cell(virtual.cell, bare, "ordinary-kriging")
    p, _ = fitted.predict_measured(Poses(p_cmd=samples.p_cmd[:5]))
    np.testing.assert_allclose(p, samples.p_meas[:5], atol=0.2)
    with pytest.raises(DataError, match="needs joints"):
        tp.fit_cell(virtual.cell, bare, "ordinary-kriging-joint")


def test_tool_cannot_be_told_at_one_orientation(virtual, samples):
    cell = virtual.cell.model_copy(update={"tool": virtual.cell.tool.model_copy(update={"fit": "position"})})
    with pytest.raises(IdentifiabilityError, match="tool"):
        tp.fit_cell(cell, samples)


def test_station_as_stated(virtual, samples):
    x, y, z = virtual.truth.tf_base_tracker[:3, 3]
    a, b, c = tp.euler("kuka", Rotation.from_matrix(virtual.truth.tf_base_tracker[:3, :3])).tolist()
    tracker = {"fit": "none", "x_mm": x, "y_mm": y, "z_mm": z, "a_deg": a, "b_deg": b, "c_deg": c}
    cell = tp.Cell.model_validate({**virtual.cell.model_dump(exclude_defaults=True), "tracker": tracker})
    fitted = tp.fit_cell(cell, samples, "registration")
    np.testing.assert_allclose(fitted.registration.tf_base_tracker, virtual.truth.tf_base_tracker, atol=1e-6)
    assert np.linalg.norm(fitted.e, axis=1).mean() > 1.0  # tool and base errors are no longer absorbed


def test_joints_beyond_limits_name_their_row(virtual, samples):
    q = samples.q.copy()
    q[4, 1] = np.deg2rad(20.0)
    spoiled = Samples(samples.p_meas, q=q, row=np.arange(100) + 500, source="s.csv")
    with pytest.raises(RobotError, match=r"s\.csv: row 504: .*joint 2 at 20\.000 deg, limits -140 to -5"):
        tp.fit_cell(virtual.cell, spoiled)


@pytest.mark.exhaustive
def test_radians_read_as_degrees_are_guessed(ur10):
    samples = tp.read_samples(ur10 / "samples.csv")
    cell = tp.Cell.model_validate({"robot": {"model": "universal-robots-ur10"}, "tool": {"fit": "position"}})
    shrunk = Samples(samples.p_meas, q=np.deg2rad(samples.q), source="s.csv")
    with pytest.raises(DataError, match=r"are the columns q1_deg … in radians\?"):
        tp.fit_cell(cell, shrunk)


@pytest.mark.exhaustive
def test_measured_ur10(ur10, tmp_path):
    """Registration with the tool fitted brings the mean to 0.72 ± 0.02 mm with nominal links (the data's README)."""
    samples = tp.read_samples(ur10 / "samples.csv")
    cell = tp.Cell.model_validate({"robot": {"model": "universal-robots-ur10"}, "tool": {"fit": "position"}})
    half = np.random.default_rng(0).permutation(len(samples))
    fitted = tp.fit_cell(cell, samples[half[:316]], "ordinary-kriging")
    fitted.save(tmp_path / "ur10.truepose")
    figures = tp.load_map(tmp_path / "ur10.truepose").validate(samples[half[316:]])
    assert figures["before"]["mean_mm"] == pytest.approx(0.72, abs=0.02)
    assert figures["after"]["mean_mm"] < 0.5
    assert figures["seen"] == 0
    assert repr(figures).splitlines()[0] == f"Accuracy of {len(samples) - 316} poses [mm]"


def test_noise_of_the_readings_reaches_the_predictor_and_survives_the_file(virtual, samples, tmp_path):
    """A sample that is read badly counts for little; intervals of a reading hold its own noise."""
    std = np.full((100, 3), 0.01)
    std[40:] = 1.0
    p_meas = samples.p_meas + np.random.default_rng(0).normal(size=std.shape) * std
    told = Samples(p_meas, q=samples.q, p_std=std, source="told")
    fitted, blind = (
        tp.fit_cell(virtual.cell, one, "calibration") for one in (told, Samples(p_meas, q=samples.q, source="blind"))
    )
    test = virtual.measure(virtual.design(50, seed=3), seed=3)
    mean = [found.validate(test)["after"]["mean_mm"] for found in (fitted, blind)]
    assert mean[0] < 0.5 * mean[1]
    fitted.save(tmp_path / "m.truepose")
    again = tp.load_map(tmp_path / "m.truepose")
    np.testing.assert_allclose(again.predict_reading(test)[1], fitted.predict_reading(test)[1], rtol=1e-9)
    worse = Samples(test.p_meas, q=test.q, p_std=test.p_std + 1.0)
    assert (fitted.predict_reading(worse)[1] > 0.9).all()
    stated = virtual.cell.model_copy(update={"tracker": virtual.cell.tracker.model_copy(update={"std_mm": 0.3})})
    silent = Samples(test.p_meas, q=test.q)
    assert (tp.fit_cell(stated, silent, "calibration").predict_reading(silent)[1] > 0.3).all()


@pytest.mark.exhaustive
def test_gross_readings_widen_no_intervals(virtual, samples):
    """They are named, and what is taken for noise is the noise of the others."""
    p_meas = samples.p_meas.copy()
    p_meas[[10, 60]] += [[3.0, 0.0, 0.0], [0.0, -1.5, 0.0]]
    noise = {}
    for name, p in (("clean", samples.p_meas), ("spoiled", p_meas)):
        fitted = tp.fit_cell(virtual.cell, Samples(p, q=samples.q, p_std=samples.p_std), "kinematic-kriging")
        noise[name] = fitted.predictor.hyper_.noise
    assert [row["row"] for row in fitted.excluded] == [10, 60]
    assert noise["spoiled"] == pytest.approx(noise["clean"], rel=0.2)


def test_errors_of_kriging_name_points_and_lines(virtual):
    """By row, the operator would measure the wrong point again."""
    measured = virtual.measure(np.repeat(virtual.design(20, seed=1), [2, *[1] * 19], axis=0), seed=1)
    order = np.array([1, 2, 3, 4, 0, *range(5, 21)])  # both readings of the first pose apart from each other
    named = replace(
        measured[order],
        p_std=None,
        name=np.array([f"P{k}" for k in range(1, 22)]),
        line=np.arange(2, 23),
        source="s.csv",
    )
    with pytest.raises(
        KrigingError, match=r"^s\.csv: points P1 \(line 2\), P5 \(line 6\) are one point, but their errors"
    ):
        tp.fit_cell(virtual.cell, named, "ordinary-kriging:exact=yes")
    with pytest.raises(KrigingError, match=r"rows 0, 4 are one point"):
        tp.fit_cell(virtual.cell, replace(named, name=None, line=None, row=None), "ordinary-kriging:exact=yes")


def test_rows_of_an_error_are_those_of_all_samples():
    """A fit of some of the samples counts its own rows."""
    error = KrigingError("{rows} are one point; average them", [0, 2])
    assert str(error) == "rows 0, 2 are one point; average them"
    assert str(error.of_rows([4, 7, 9])) == "rows 4, 9 are one point; average them"
    errors = PositionalErrors(
        {"cartesian": np.array([[9.0] * 3, *np.eye(3), [0.0, 1.0, 0.0]])}, np.arange(15.0).reshape(5, 3)
    )
    with pytest.raises(KrigingError, match="rows 2, 4 are one point"):
        errors.fit("ordinary-kriging:exact=yes", np.arange(1, 5))


@pytest.mark.exhaustive
def test_many_samples_are_kriged_by_an_approximation_that_is_named(virtual, samples, monkeypatch):
    monkeypatch.setattr("truepose.predictors.registry.LARGEST_GLOBAL", 30)
    with pytest.warns(UserWarning, match=r"samples are too many for universal-kriging:space=joint; vecchia-kriging:"):
        error_map = tp.fit_cell(virtual.cell, samples, "universal-kriging:space=joint")
    assert error_map.predictor_name == "vecchia-kriging:drift=linear:space=joint"
    exact = tp.fit_cell(virtual.cell, samples[:30], "universal-kriging:space=joint")
    assert exact.predictor_name == "universal-kriging:space=joint"
