"""Samples of several reflectors: rows of one pose, one fit at the tool point, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose import ErrorMap, fit_cell, load_map, update_map
from truepose.cell import Cell
from truepose.error_map.points import of_one_reflector, reflectors_of
from truepose.errors import DataError, FileError, IdentifiabilityError
from truepose.geometry import apply_transform, invert_transform, make_transform, register_with_body
from truepose.identification import ParametricArm, Positions, filtered, least_squares
from truepose.predictors import KinematicKriging
from truepose.predictors.kinematic.covariance_form import CovarianceForm, Likelihood
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.reflectors import whole_poses
from truepose.samples import Mask, Poses, Samples, check, check_rigid, read_samples, visits, write_samples
from truepose.simulation import VirtualCell
from truepose.trackers import Readings, match
from truepose.trackers.each_reflector import rows_of_reflectors

PREDICTOR = "kinematic-kriging"


@pytest.fixture(scope="module")
def virtual() -> VirtualCell:
    return VirtualCell("paper", seed=2, effects={"geometry", "tool", "tracker"})


@pytest.fixture(scope="module")
def cell(virtual) -> Cell:
    return virtual.cell_with()


@pytest.fixture(scope="module")
def samples(virtual) -> Samples:
    """30 poses; the first lacks reflector B, and one reading of C is 0.5 mm off."""
    found = virtual.measure_each(virtual.design(30, orientation_deg=20.0), seed=1)
    p = found.p_meas.copy()
    p[35] += [0.5, 0.0, 0.0]
    return replace(found, p_meas=p)[np.r_[0, 2:90]]


@pytest.fixture(scope="module")
def error_map(cell, samples) -> ErrorMap:
    return fit_cell(cell, samples, PREDICTOR)


def missed(virtual: VirtualCell, error_map: ErrorMap) -> tuple[float, float]:
    """Return the mean miss at the tool point of other poses, and the share of components within 95 %."""
    q = virtual.design(60, seed=77, orientation_deg=20.0)
    p = apply_transform(invert_transform(virtual.truth.tf_base_tracker), virtual.true_position(q))
    predicted, std = error_map.predict_errors(Poses(q=q))
    expected = error_map.registration.apply(p) - virtual.robot.forward(q, tool=error_map.tf_flange_tool)[:, :3, 3]
    miss = predicted - expected
    return float(np.linalg.norm(miss, axis=1).mean()), float(np.mean(np.abs(miss) <= 1.96 * std))


@pytest.mark.exhaustive
def test_the_tool_point_is_predicted_from_reflectors_beside_it(virtual, error_map):
    several, alone = [missed(virtual, error_map)[0]], []
    for seed in (2, 3, 4):
        other = VirtualCell("paper", seed=seed, effects=virtual.effects)
        q = other.design(30, orientation_deg=20.0)
        if seed > 2:
            several.append(missed(other, fit_cell(other.cell_with(), other.measure_each(q, seed=1), PREDICTOR))[0])
        alone.append(missed(other, fit_cell(other.cell, other.measure(q, seed=1), PREDICTOR))[0])
    assert np.mean(several) < 0.8 * np.mean(alone)
    assert missed(virtual, error_map)[1] >= 0.9


def test_a_fitted_tool_moves_with_its_reflectors(virtual, cell, samples):
    tool = cell.tool.model_copy(update={"fit": "position"})
    fitted = fit_cell(cell.model_copy(update={"tool": tool}), samples, PREDICTOR)
    away = np.linalg.norm(fitted.tf_flange_tool[:3, 3] - virtual.truth.tf_flange_tool[:3, 3])
    assert away < 0.5 * np.linalg.norm(cell.tf_flange_tool[:3, 3] - virtual.truth.tf_flange_tool[:3, 3]) + 0.3
    assert missed(virtual, fitted)[0] < 0.03


def test_a_bad_reading_is_left_out_alone(error_map, samples):
    names = [one["point"] for one in error_map.excluded]
    assert names == ["P12/C"]
    assert len(error_map.samples) >= len(samples) - 1


def test_poses_are_left_out_whole(error_map):
    model = error_map.predictor
    x, e, noise = error_map.fitted_inputs, error_map.e, model.noise_std_
    pose = whole_poses(x[:, :6], x[:, -1])
    out = pose == pose[40]
    assert out.sum() == 3
    again = model.with_fitted_parameters()
    again.set_params(weight=model.weight_[~out].tolist())
    again.fit(x[~out], e[~out], noise[~out])
    found = model.leave_one_out().residual[out]
    np.testing.assert_allclose(found, e[out] - again.predict(x[out]), atol=2e-4)


def test_samples_and_map_are_read_as_written(error_map, cell, samples, tmp_path):
    write_samples(tmp_path / "samples.csv", samples)
    read = read_samples(tmp_path / "samples.csv")
    assert read.reflector.tolist() == samples.reflector.tolist()
    assert Cell.from_toml(cell.to_toml()).reflectors == cell.reflectors
    error_map.save(tmp_path / "map.truepose")
    q = Poses(q=samples.q[:5])
    np.testing.assert_allclose(
        load_map(tmp_path / "map.truepose").predict_errors(q), error_map.predict_errors(q), atol=1e-9
    )


@pytest.mark.exhaustive
def test_folds_keep_rows_of_a_pose_together(cell, samples):
    chosen = fit_cell(cell, samples, "auto", candidates=["registration", "idw", PREDICTOR], folds=3)
    assert chosen.predictor_name == PREDICTOR
    assert {row["predictor"] for row in chosen.ranking} == {"registration", PREDICTOR}


@pytest.mark.exhaustive
def test_calibration_takes_reflectors(virtual, cell, samples, tmp_path):
    """On arms whose geometry alone errs, three points of the tool show more than one."""
    several, alone, inside = [], [], []
    for seed in (2, 3, 4):
        other = VirtualCell("paper", seed=seed, effects=virtual.effects)
        q = other.design(30, orientation_deg=20.0)
        found = fit_cell(other.cell_with(), other.measure_each(q, seed=1), "calibration")
        several.append(missed(other, found)[0])
        inside.append(missed(other, found)[1])
        alone.append(missed(other, fit_cell(other.cell, other.measure(q, seed=1), "calibration"))[0])
    assert np.mean(several) < 0.85 * np.mean(alone)
    assert np.mean(inside) > 0.9
    kept = fit_cell(cell, samples, "calibration")
    kept.save(tmp_path / "map.truepose")
    again = load_map(tmp_path / "map.truepose")
    for poses in (Poses(q=samples.q[:7]), samples[:7]):
        np.testing.assert_allclose(again.predict_errors(poses), kept.predict_errors(poses), atol=1e-9)
    lever = kept.predict_errors(samples[:1])[0] - kept.predict_errors(Poses(q=samples.q[:1]))[0]
    turn = kept.predict_pose_errors(Poses(q=samples.q[:1]))[0][0, 3:]
    off = reflectors_of(cell).p_tool[0] @ virtual.robot.forward(samples.q[0], tool=kept.tf_flange_tool)[:3, :3].T
    np.testing.assert_allclose(lever[0], np.cross(turn, off), atol=1e-3)
    with pytest.raises(DataError, match="calibration models no conditions, got approach"):
        kept.predictor.set_params(conditions=("approach",)).fit(samples.q, kept.e[:1].repeat(len(samples), axis=0))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("method", ["ls", "ekf", "ukf"])
def test_all_solvers_see_the_same_points(virtual, cell, samples, method):
    q, p = samples.q[::2], reflectors_of(cell).p_tool[np.arange(len(samples.q[::2])) % 3]
    arm = ParametricArm.of(virtual.robot, cell.tf_flange_tool)
    x = np.random.default_rng(0).normal(size=len(arm.parameters)) * arm.tolerance * 0.1
    blank = Positions(q, np.zeros((len(q), 3)), 1e-4 * np.tile(np.eye(3), (len(q), 1, 1)), r=p)
    data = replace(blank, p=blank.predicted(arm, x))
    step = 1e-6
    for k in range(0, len(x), 5):
        ends = [data.predicted(arm, x + s * step * np.eye(len(x))[k]) for s in (1, -1)]
        np.testing.assert_allclose(
            data.jacobian(arm, x)[:, :, k], (ends[0] - ends[1]) / (2 * step), atol=1e-3, rtol=1e-5
        )
    np.testing.assert_allclose(data.residual(arm, x), 0.0, atol=1e-12)
    np.testing.assert_allclose(data.one(3).residuals_of(arm, 0, x[None]), 0.0, atol=1e-9)
    misfit = np.array([1e-3])
    if method == "ls":
        found = least_squares(arm, data, misfit=misfit, tolerance=arm.tolerance).x
    else:
        found = filtered(arm, data, kind=method, misfit=misfit)[0].x
    away = data.predicted(arm, found) - data.p
    assert np.abs(away).max() < 0.02


@pytest.mark.parametrize("known", [True, False])
def test_shared_noise_has_the_gradient_of_its_likelihood(virtual, cell, samples, known):
    model = KinematicKriging(virtual.robot, virtual.tf_flange_tool, conditions=("reflector",), residual="none")
    some = samples[:20]
    x = np.column_stack([some.q, np.arange(20) % 3, visits(some)])
    e, reading = np.random.default_rng(0).normal(scale=0.1, size=(20, 3)), np.full((20, 3), 0.01 * known)
    model.set_params(reflectors=reflectors_of(cell))
    model._take(x, e, reading)
    hyper = Hyperparameters.start(2, 0)
    likelihood = Likelihood(model._terms, model._terms.at(x), np.array([1, 2]), e, reading, np.linspace(0.3, 1, 20))
    theta, step = hyper.to_vector(), 1e-3
    gradient = likelihood(hyper)[1]
    for i in range(len(theta)):
        ends = [likelihood(hyper.with_vector(theta + s * step * np.eye(len(theta))[i]))[0] for s in (1, -1)]
        assert gradient[i] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-3, abs=1e-3)


def test_both_forms_of_the_solution_agree(error_map):
    model = error_map.predictor
    x, e, noise = error_map.fitted_inputs, error_map.e, model.noise_std_
    fixed = model.with_fitted_parameters()
    basis = type(fixed)(**{**fixed.get_params(deep=False), "solver": "basis"}).fit(x, e, noise)
    exact = fixed.fit(x, e, noise)
    new = x + np.r_[np.full(6, 0.05), np.zeros(2)]
    (a, a_std), (b, b_std) = (one.predict(new, return_std=True) for one in (exact, basis))
    np.testing.assert_allclose(a, b, atol=2e-3)
    np.testing.assert_allclose(a_std, b_std, rtol=0.1)
    for one, other in zip(exact._form.alone, basis._form.alone, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-3)
    np.testing.assert_allclose(exact.leave_one_out().residual, basis.leave_one_out().residual, atol=2e-3)
    assert isinstance(exact._form, CovarianceForm)


def test_further_samples_are_visits_of_their_own(virtual, cell, error_map, tmp_path):
    new = virtual.measure_each(virtual.design(5, seed=8, orientation_deg=20.0), seed=8)
    updated = update_map(error_map, new)
    visit = updated.predictor._given[0][:, -1]
    assert len(np.unique(visit)) == 35
    np.testing.assert_array_equal(updated.predictor._given[0], updated.fitted_inputs)


@pytest.mark.parametrize("refit", ["tool", "both"])
def test_a_shifted_tool_is_found_with_its_reflectors(virtual, error_map, refit, tmp_path):
    """Readings after the tool was shifted on the flange, and for "both" the tracker moved."""
    shift = np.array([0.6, -0.4, 0.8])
    new = virtual.measure_each(virtual.design(8, seed=11, orientation_deg=20.0), seed=11)
    to_tracker = virtual.truth.tf_base_tracker[:3, :3].T
    p = new.p_meas + virtual.robot.forward(new.q)[:, :3, :3] @ shift @ to_tracker.T
    if refit == "both":
        p = apply_transform(make_transform(Rotation.from_rotvec([0.0, 2e-4, 1e-3]), [30.0, -20.0, 5.0]), p)
    new = replace(new, p_meas=p)
    updated = update_map(error_map, new, refit)
    found = updated.tf_flange_tool[:3, 3] - error_map.tf_flange_tool[:3, 3]
    np.testing.assert_allclose(found, shift, atol=0.03)
    np.testing.assert_array_equal(updated.tf_flange_tool[:3, :3], error_map.tf_flange_tool[:3, :3])
    miss = updated.errors(new) - updated.predict_errors(new)[0]
    assert np.linalg.norm(miss, axis=1).mean() < 0.04
    before = error_map.errors(new) - error_map.predict_errors(new)[0]
    assert np.linalg.norm(before, axis=1).mean() > 1.0
    updated.save(tmp_path / "map.truepose")
    again = load_map(tmp_path / "map.truepose").predict_errors(new)[0]
    np.testing.assert_allclose(again, updated.predict_errors(new)[0], atol=1e-6)


def test_a_turned_tool_is_not_taken_for_a_shifted_one(virtual, error_map):
    new = virtual.measure_each(virtual.design(8, seed=11, orientation_deg=20.0), seed=11)
    tf = error_map.robot.forward(new.q, tool=error_map.tf_flange_tool)
    p = error_map.registration.apply(new.p_meas)
    about = np.einsum("nij,nj->ni", np.swapaxes(tf[:, :3, :3], 1, 2), p - tf[:, :3, 3])
    turned = np.einsum("nij,nj->ni", tf[:, :3, :3], Rotation.from_rotvec([0.0, 0.01, 0.0]).apply(about)) + tf[:, :3, 3]
    p_meas = apply_transform(np.linalg.inv(error_map.registration.tf_base_tracker), turned)
    with pytest.raises(DataError, match=r"turned on the flange by (9\.\d|10\.\d) mrad, not only shifted; state their"):
        update_map(error_map, replace(new, p_meas=p_meas), "tool")


def test_a_mask_names_poses_or_single_readings(samples):
    assert (Mask({"P3": "beam was cut"}).of(samples) != "").sum() == 3
    assert np.flatnonzero(Mask({"P3/b": "beam was cut"}).of(samples) != "").tolist() == [6]
    with pytest.raises(FileError, match="P1/B is not among the samples"):
        Mask({"P1/B": "beam was cut"}).of(samples)


def moved(samples: Samples, name: str, rows: slice, by: float) -> Samples:
    p = samples.p_meas.copy()
    late = np.zeros(len(p), bool)
    late[rows] = True
    p[late & (samples.reflector == name)] += by
    return replace(samples, p_meas=p)


def test_a_reflector_that_moved_is_named_with_its_rows(cell, samples):
    with pytest.raises(DataError, match=r"reflector B moved on the flange between .*P15/.* and .*P16/.*A–B, B–C"):
        fit_cell(cell, moved(samples, "B", slice(44, None), 0.3), PREDICTOR)
    check_rigid(samples, cell)


def test_other_places_than_stated_are_refused_with_the_distances(cell, samples):
    wrong = cell.reflectors["C"].model_copy(update={"x_mm": cell.reflectors["C"].x_mm + 3.0})
    with pytest.raises(DataError, match=r"reflectors A and C are 207\.8\d+ mm apart by their readings, 205\.\d+ ±"):
        check_rigid(samples, cell.model_copy(update={"reflectors": {**cell.reflectors, "C": wrong}}))
    loose = {**cell.reflectors, "C": wrong.model_copy(update={"std_mm": 2.0})}
    check_rigid(samples, cell.model_copy(update={"reflectors": loose}))


def test_a_reflector_that_the_cell_does_not_state_is_refused(virtual, cell, samples):
    names = np.where(samples.reflector == "C", "D", samples.reflector)
    with pytest.raises(DataError, match=r"P1/D.*reflector 'D' is not in the cell file \(it has A, B, C\); add \[refl"):
        fit_cell(cell, replace(samples, reflector=names), PREDICTOR)
    with pytest.raises(DataError, match="it has none"):
        fit_cell(virtual.cell, samples, PREDICTOR)


def test_the_tests_of_a_campaign_take_one_reading_of_a_pose(cell, samples, error_map):
    """Rows of one pose are no independent readings; the tests take one reflector, at its own point."""
    rows, tf = of_one_reflector(samples, cell, error_map.tf_flange_tool)
    assert set(samples.reflector[rows]) == {"A"}
    stated = cell.reflectors["A"].p_flange
    np.testing.assert_allclose(tf[:3, 3], stated, atol=1e-9)
    assert error_map.campaign["tested"] == 30


def test_readings_are_known_by_the_names_of_reflectors(cell, virtual):
    """In any order within a pose; one is missing, and so is a whole pose."""
    q = virtual.design(6, orientation_deg=20.0)
    p = virtual.read_reflectors(q, 3, seed=1)
    order = [(0, "B"), (0, "A"), (0, "C"), (1, "B"), (1, "A"), (1, "C"), (2, "B"), (2, "C")]
    order += [(k, name) for k in (3, 4, 5) for name in "BAC"]
    which = np.array([(pose, "ABC".index(name)) for pose, name in order])
    names = np.array([name.lower() for _, name in order])
    found = p[which[:, 0], which[:, 1]]
    found[-3:] = 0.0
    readings = Readings(found, np.arange(len(order)), "tracker.txt", name=names)
    plan = Poses(q=q, p_cmd=virtual.robot.forward(q, tool=virtual.tf_flange_tool)[:, :3, 3])
    read, rows, pose = rows_of_reflectors(readings, plan, cell)
    assert rows.reflector.tolist() == ["A", "B", "C"] * 2 + ["B", "C"] + ["A", "B", "C"] * 3
    assert pose.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 3, 3, 3, 4, 4, 4, 5, 5, 5]
    np.testing.assert_array_equal(read.p[:3], p[0])
    np.testing.assert_array_equal(read.p[6:8], p[2, 1:])
    assert read.missing[-3:].all()  # a pose of the plan without a reading
    samples, summary = match(read, rows, missing=True)
    assert (len(samples), samples.reflector[-1], len(summary.missing)) == (14, "C", 3)
    with pytest.raises(DataError, match="are 6 poses, but the plan has 5"):
        rows_of_reflectors(readings, plan[:5], cell)


@pytest.mark.parametrize("body", [1, 2, 3])
def test_station_and_body_are_found_together_without_a_wrong_reading(body):
    """One reflector, two, and three on a line: the turn that they do not show stays as stated."""
    rng = np.random.default_rng(body)
    stated = np.array([[0.0, 0.0, 100.0], [0.0, 0.0, 160.0], [0.0, 0.0, 200.0]])[:body]
    flange = make_transform(Rotation.random(15, rng=rng), rng.uniform(-500, 500, (15, 3))).repeat(body, axis=0)
    turn = Rotation.from_rotvec([0.02, -0.01, 0.0] if body > 1 else [0.0, 0.0, 0.0])
    placed = turn.apply(stated) + np.array([1.0, 2.0, 3.0])
    station = make_transform(Rotation.from_euler("xyz", [10, 20, 30], degrees=True), [1000.0, 2000.0, 300.0])
    p = np.einsum("nij,nj->ni", flange[:, :3, :3], np.tile(placed, (15, 1))) + flange[:, :3, 3]
    p = apply_transform(invert_transform(station), p) + rng.normal(scale=0.01, size=p.shape)
    p[4] += 3.0
    which = np.tile(np.arange(body), 15)
    found, motion = register_with_body(flange, p, stated[which], which, stated[0])
    assert np.flatnonzero(found.outliers).tolist() == [4]
    np.testing.assert_allclose(apply_transform(motion, stated), placed, atol=0.02)
    off = np.abs(found.p_flange_tool - placed[0])
    assert (off < 4.5 * np.sqrt(np.diag(found.covariance)[6:])).all()
    assert found.noise_std == pytest.approx(0.01, rel=0.3)


def test_predictors_that_do_not_know_the_arm_are_refused(cell, samples):
    with pytest.raises(DataError, match="'ordinary-kriging' does not know the arm, so it cannot take readings of sev"):
        fit_cell(cell, samples, "ordinary-kriging")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"load": np.r_[np.full(10, 5.0), 9.0, np.full(78, 5.0)]}, "readings of one pose have different load_kg"),
        ({"temperature": np.r_[np.full(10, 20.0), 29.0, np.full(78, 20.0)]}, "one pose have different temp_C"),
        ({"reflector": np.r_[[""], np.full(88, "A")]}, "no reflector is named"),
        ({"q": None}, "several reflectors need the joints"),
    ],
)
def test_contradicting_rows_of_a_pose_are_refused(samples, change, words):
    with pytest.raises(DataError, match=words):
        check(replace(samples, **change))


def test_rows_of_one_pose_need_the_same_joints(samples):
    q = samples.q.copy()
    q[10] += 0.01
    with pytest.raises(DataError, match=r"P4/C.*readings of one pose have different joints"):
        check(replace(samples, q=q))
    assert len(np.unique(visits(replace(samples, q=q, name=None)))) > 30  # without names, other joints: another pose


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[reflectors.A]\nx_mm = 0.0\ny_mm = 0.0\nz_mm = 0.0\n" * 2, r"cannot declare \('reflectors', 'A'\) twice"),
        ("[reflectors.A]\nx_mm = 0.0\ny_mm = 0.0\nz_mm = 0.0\n[reflectors.a]\nx_mm = 9.0\ny_mm = 0.0\nz_mm = 0.0\n",
         "'A' and 'a' are one name"),
        ("[reflectors.A]\nx_mm = 0.0\ny_mm = 0.0\nz_mm = 0.0\n[reflectors.B]\nx_mm = 0.0\ny_mm = 0.0\nz_mm = 0.2\n",
         "is where 'A' is"),
        ('[reflectors."A/1"]\nx_mm = 0.0\ny_mm = 0.0\nz_mm = 0.0\n', "is not one word"),
        ("[reflectors.A]\nx_mm = 0.0\ny_mm = 0.0\n", "z_mm: is missing"),
    ],
)  # fmt: skip
def test_reflectors_of_the_cell_file_are_checked(text, words):
    with pytest.raises(FileError, match=f"(?i){words}"):
        Cell.from_toml('[robot]\nmodel = "kuka-kr150-2"\n' + text)


def test_reflectors_on_a_line_do_not_show_the_turn_of_a_tool_beside_them(virtual):
    tool = virtual.cell.tool.model_copy(update={"fit": "position"})
    on_tool = np.array([[50.0, 0.0, 0.0], [50.0, 0.0, 60.0], [50.0, 0.0, 100.0]])
    stated = apply_transform(virtual.tf_flange_tool, on_tool)
    reflectors = {
        n: dict(zip(("x_mm", "y_mm", "z_mm"), p, strict=True)) for n, p in zip("ABC", stated.tolist(), strict=True)
    }
    plain = virtual.cell.model_dump(exclude_unset=True)
    cell = Cell.model_validate({**plain, "tool": tool.model_dump(exclude_unset=True), "reflectors": reflectors})
    q = virtual.design(20, orientation_deg=20.0).repeat(3, axis=0)
    tf = virtual.true_poses(q)
    p = tf[:, :3, 3] + np.einsum("nij,nj->ni", tf[:, :3, :3], np.tile(on_tool, (20, 1)))
    p = apply_transform(invert_transform(virtual.truth.tf_base_tracker), p)
    samples = Samples(p, q=q, reflector=np.tile(list("ABC"), 20))
    with pytest.raises(IdentifiabilityError, match=r"on one line .* the tool point is 50\.0 mm off the line"):
        fit_cell(cell, samples, PREDICTOR)
    known = cell.model_copy(update={"tool": tool.model_copy(update={"fit": "none"})})
    assert missed(virtual, fit_cell(known, samples, PREDICTOR))[1] > 0.9
