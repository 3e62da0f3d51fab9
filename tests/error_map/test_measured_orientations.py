"""Measured orientations in the fit: rows of six, with their noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose import ErrorMap, fit_cell, load_map, update_map
from truepose.predictors.kinematic.covariance_form import CovarianceForm
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.terms import Terms
from truepose.predictors.kinematic.turned import with_turns
from truepose.samples import Poses, Samples, read_samples, write_samples
from truepose.simulation import VirtualCell

PREDICTOR = "kinematic-kriging"
BAD = 7


@pytest.fixture(scope="module")
def virtual() -> VirtualCell:
    return VirtualCell("hard", seed=1)


@pytest.fixture(scope="module")
def samples(virtual) -> Samples:
    """40 poses with orientations, of which one is 5 mrad off."""
    found = virtual.measure(virtual.design(40, orientation_deg=15.0), seed=1, reflectors=3)
    turns = found.rotation_meas.as_quat()
    turns[BAD] = (Rotation.from_rotvec([5e-3, 0.0, 0.0]) * found.rotation_meas[BAD]).as_quat()
    return replace(found, rotation_meas=Rotation.from_quat(turns))


@pytest.fixture(scope="module")
def error_map(virtual, samples) -> ErrorMap:
    return fit_cell(virtual.cell, samples, PREDICTOR)


def missed(virtual: VirtualCell, error_map: ErrorMap) -> tuple[float, float]:
    """Return the mean miss of position [mm] and of orientation [rad] at other poses."""
    q = virtual.design(60, seed=77, orientation_deg=15.0)
    tf = error_map.registration.tf_base_tracker @ np.linalg.inv(virtual.truth.tf_base_tracker)
    true = tf @ virtual.true_poses(q)
    nominal = virtual.robot.forward(q, tool=error_map.tf_flange_tool)
    turn = Rotation.from_matrix(true[:, :3, :3]) * Rotation.from_matrix(nominal[:, :3, :3]).inv()
    found = error_map.predict_pose_errors(Poses(q=q))[0]
    p = found[:, :3] - (true - nominal)[:, :3, 3]
    return float(np.linalg.norm(p, axis=1).mean()), float(
        np.linalg.norm(found[:, 3:] - turn.as_rotvec(), axis=1).mean()
    )


@pytest.mark.exhaustive
def test_orientations_show_the_turns_of_the_arm(virtual, samples, error_map):
    without = fit_cell(virtual.cell, samples, f"{PREDICTOR}:conditions=none")
    untold = fit_cell(virtual.cell, replace(samples, rotation_std=None), PREDICTOR)
    assert "orientation" in error_map.predictor.conditions
    assert "orientation" not in without.predictor.conditions + untold.predictor.conditions
    here, before = missed(virtual, error_map), missed(virtual, without)
    assert here[1] < 0.5 * before[1]
    assert here[0] < 1.05 * before[0]


@pytest.mark.exhaustive
def test_a_wrong_orientation_is_left_out_alone(error_map):
    model = error_map.predictor
    n = len(error_map.samples)
    assert BAD not in model.gross_
    assert model.weight_[BAD] > 0.5
    turned = model._weight[n:]
    assert int(turned.argmin()) == BAD
    assert turned[BAD] < 0.1
    assert len(model.leave_one_out().residual) == n


def test_left_out_poses_take_their_orientation_along(error_map):
    model, x, e = error_map.predictor, error_map.fitted_inputs, error_map.e
    out = np.arange(len(e)) == 11
    again = model.with_fitted_parameters()
    again.set_params(weight=model._weight[~np.tile(out, 2)].tolist())
    again.fit(x[~out], e[~out], model.noise_std_[~out])
    np.testing.assert_allclose(model.leave_one_out().residual[out], e[out] - again.predict(x[out]), atol=5e-4)


def test_predictions_do_not_look_at_orientations(error_map):
    x = error_map.fitted_inputs
    hidden = x.copy()
    hidden[:, 6:][np.isfinite(x[:, 6:])] = np.nan
    hidden[:, -6:] = np.nan
    np.testing.assert_array_equal(error_map.predictor.predict(x), error_map.predictor.predict(hidden))


@pytest.mark.exhaustive
def test_the_mounting_of_the_target_does_not_matter(virtual, samples, error_map):
    turned = replace(samples, rotation_meas=samples.rotation_meas * Rotation.from_euler("xyz", [40, -80, 120], True))
    other = fit_cell(virtual.cell, turned, PREDICTOR)
    q = Poses(q=samples.q[:9])
    np.testing.assert_allclose(other.predict_errors(q)[0], error_map.predict_errors(q)[0], atol=1e-4)


def test_samples_and_map_are_read_as_written(error_map, samples, tmp_path):
    write_samples(tmp_path / "samples.csv", samples)
    np.testing.assert_allclose(read_samples(tmp_path / "samples.csv").rotation_std, samples.rotation_std, rtol=1e-9)
    error_map.save(tmp_path / "map.truepose")
    q = Poses(q=samples.q[:5])
    found = load_map(tmp_path / "map.truepose").predict_pose_errors(q)
    np.testing.assert_allclose(found, error_map.predict_pose_errors(q), atol=1e-9)


def test_further_samples_bring_their_orientations(virtual, error_map, tmp_path):
    new = virtual.measure(virtual.design(6, seed=5, orientation_deg=15.0), seed=5, reflectors=3)
    updated = update_map(error_map, new)
    assert len(updated.predictor._own) == 2 * len(updated.samples)
    updated.save(tmp_path / "map.truepose")
    q = Poses(q=new.q)
    np.testing.assert_allclose(
        load_map(tmp_path / "map.truepose").predict_errors(q)[0], updated.predict_errors(q)[0], atol=1e-3
    )


def test_rows_of_orientation_are_those_of_a_pose_with_their_own_noise(virtual):
    q, rng = virtual.design(12, orientation_deg=15.0), np.random.default_rng(0)
    e, turn, std = rng.normal(scale=0.1, size=(12, 3)), rng.normal(scale=1e-4, size=(12, 3)), rng.uniform(1, 3, (12, 3))
    reading, std = np.full((12, 3), 0.02), 1e-5 * std
    terms = Terms(virtual.robot, virtual.tf_flange_tool, residual="none", conditions=("orientation",))
    x, y, noise, own = with_turns(terms, np.concatenate([q, turn, std], axis=1), e, reading)
    hyper = Hyperparameters.start(0, 0, noise=0.03)
    form = CovarianceForm.of(terms, terms.at(x), np.empty(0, np.int64), hyper, y, hyper.noise**2 + noise**2)
    design = terms.at(np.concatenate([q, np.full((12, 6), np.nan)], axis=1), "pose")
    length = terms.at(x).turn[12:, None]
    target = [terms.names.index(f"target r{axis}") for axis in "xyz"]
    design.drift[:, 3:, target] = virtual.robot.forward(q, tool=virtual.tf_flange_tool)[:, :3, :3] * 0.03
    variance = np.concatenate([0.03**2 + reading**2, (0.03 / length) ** 2 + std**2], axis=1).reshape(-1, 1)
    columns, wanted = design.drift.reshape(72, -1), np.concatenate([e, turn], axis=1).reshape(-1)
    inverse = np.linalg.inv(columns.T @ (columns / variance) + np.eye(columns.shape[1]))
    mean, covariance = form.drift_estimate()
    scale = terms.prior_std
    np.testing.assert_allclose(mean * scale, inverse @ (columns.T @ (wanted / variance[:, 0])) * scale, atol=2e-4)
    np.testing.assert_allclose(columns @ covariance @ columns.T, columns @ inverse @ columns.T, atol=1e-6)
    assert own.tolist() == [*range(12), *range(12)]


def test_both_forms_of_the_solution_agree(error_map):
    fixed = error_map.predictor.with_fitted_parameters()
    basis = type(fixed)(**{**fixed.get_params(deep=False), "solver": "basis"})
    x, e, noise = error_map.fitted_inputs, error_map.e, error_map.predictor.noise_std_
    new = x[:, :6] + 0.05
    for one, other in zip(*(m.fit(x, e, noise).predict_pose(new, True) for m in (fixed, basis)), strict=True):
        np.testing.assert_allclose(one, other, rtol=0.1, atol=3e-3)
