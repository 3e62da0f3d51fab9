"""Gross readings: one list for registration, folds, predictors, comparison and validation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import truepose as tp
from truepose.predictors import KinematicCalibration
from truepose.predictors.outliers import fit_without_gross
from truepose.samples import Samples
from truepose.simulation import VirtualCell


@pytest.fixture(scope="module")
def virtual() -> VirtualCell:
    return VirtualCell("paper", seed=5)


@pytest.fixture(scope="module")
def sound(virtual: VirtualCell) -> Samples:
    return virtual.measure(virtual.design(30, seed=1), seed=1)


def spoiled(samples: Samples, *, rows: tuple[int, ...] = (7,), by: float) -> Samples:
    """Some readings are moved, each in another direction."""
    p_meas, rng = samples.p_meas.copy(), np.random.default_rng(3)
    for row in rows:
        direction = rng.normal(size=3)
        p_meas[row] += by * direction / np.linalg.norm(direction)
    return replace(samples, p_meas=p_meas)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("by", [20.0, 590.0])
@pytest.mark.parametrize("predictor", ["calibration", "kinematic-kriging", "ordinary-kriging-joint"])
def test_a_map_is_that_of_the_readings_kept(virtual: VirtualCell, sound: Samples, predictor: str, by: float):
    found = tp.fit_cell(virtual.cell, spoiled(sound, by=by), predictor)
    kept = tp.fit_cell(virtual.cell, sound[np.arange(30) != 7], predictor)
    assert [row["row"] for row in found.excluded] == [7]
    assert len(found.samples) == found.worth.n == 29
    np.testing.assert_array_equal(found.registration.tf_base_tracker, kept.registration.tf_base_tracker)
    np.testing.assert_array_equal(found.predict(sound.q).std, kept.predict(sound.q).std)
    assert found.worth == kept.worth


def test_auto_compares_without_gross_readings(virtual: VirtualCell, sound: Samples):
    found = tp.choose(["registration", "idw"], spoiled(sound, by=590.0), virtual.cell, splits=["points"])
    kept = tp.choose(["registration", "idw"], sound[np.arange(30) != 7], virtual.cell, splits=["points"])
    assert [row["row"] for row in found.excluded] == [7]
    assert found.ranking == kept.ranking
    assert "1 more left out before" in repr(found)


def test_several_gross_readings_are_left_out(virtual: VirtualCell, sound: Samples):
    rows = (2, 7, 11, 19, 23)
    found = tp.fit_cell(virtual.cell, spoiled(sound, rows=rows, by=40.0), "calibration")
    assert sorted(row["row"] for row in found.excluded) == list(rows)


def test_large_errors_of_one_joint_stay(virtual: VirtualCell, sound: Samples):
    """A joint that is mastered wrongly moves far poses by several millimetres, and no reading is gross."""
    arm = virtual.cell.load_robot()
    off = sound.q + np.deg2rad([0.0, 0.0, 0.0, 0.0, 1.4, 0.0])
    tool = virtual.tf_flange_tool
    moved = arm.forward(off, tool=tool)[:, :3, 3] - arm.forward(sound.q, tool=tool)[:, :3, 3]
    p_meas = tp.register(arm.forward(sound.q, tool=tool)[:, :3, 3], sound.p_meas).apply(sound.p_meas) + moved
    found = tp.fit_cell(virtual.cell, replace(sound, p_meas=p_meas), "calibration")
    assert found.excluded == []


@pytest.mark.parametrize("by", [3.0, 20.0, 457.0])
def test_calibration_judges_by_a_scale_that_gross_readings_do_not_increase(virtual: VirtualCell, by: float):
    arm, rng = virtual.cell.load_robot(), np.random.default_rng(2)
    middle = np.array([0.0, -1.2, 1.4, 0.0, 0.5, 0.0])
    q = middle + rng.uniform(-1.0, 1.0, size=(27, arm.dof))
    e = 0.3 * arm.error_jacobian(q, parameters=["a3"])[:, :, 0] + rng.normal(scale=0.03, size=(27, 3))
    e[7] += by * np.array([0.6, 0.0, -0.8])
    model = KinematicCalibration(arm)
    gross = fit_without_gross(model, q, e)
    assert np.flatnonzero(gross).tolist() == [7]
    assert model.misfit_std_ < 0.06


def test_validation_names_gross_readings_and_shows_figures_without_them(virtual: VirtualCell, sound: Samples):
    fitted = tp.fit_cell(virtual.cell, sound, "calibration")
    held_out = virtual.measure(virtual.design(20, seed=2), seed=2)
    found = fitted.validate(spoiled(held_out, rows=(5,), by=590.0), rivals=False)
    kept = fitted.validate(held_out[np.arange(20) != 5], rivals=False)
    assert found["after"]["mean_mm"] > 20.0
    assert [row["row"] for row in found["gross"]] == [5]
    assert found["without_gross"]["after"] == kept["after"]
    assert "1 of 20 readings are gross" in repr(found)
    assert kept["gross"] == []
    assert kept["without_gross"] is None


def test_validation_does_not_excuse_errors_that_neighbours_share(virtual: VirtualCell, sound: Samples):
    """A reflector that was bumped: all readings from then on are off, and no reading is to blame."""
    fitted = tp.fit_cell(virtual.cell, sound, "calibration")
    held_out = virtual.measure(virtual.design(20, seed=2), seed=2)
    p_meas = held_out.p_meas + 5.0
    assert fitted.validate(replace(held_out, p_meas=p_meas), rivals=False)["gross"] == []
    half = np.where(held_out.q[:, :1] > np.median(held_out.q[:, 0]), 5.0, 0.0)
    found = fitted.validate(replace(held_out, p_meas=held_out.p_meas + half), rivals=False)
    assert len(found["gross"]) <= 2  # at the border


def test_an_update_keeps_old_exclusions_and_judges_new_readings_by_the_same_rule(virtual: VirtualCell, sound: Samples):
    old = tp.fit_cell(virtual.cell, spoiled(sound, by=20.0), "kinematic-kriging")
    new = virtual.measure(virtual.design(14, seed=2), seed=2)
    updated = tp.update_map(old, spoiled(new, rows=(4,), by=20.0))
    assert updated.excluded[: len(old.excluded)] == old.excluded
    assert [row["row"] for row in updated.excluded[len(old.excluded) :]] == [4]
    kept = tp.update_map(old, new[np.arange(14) != 4])
    np.testing.assert_array_equal(updated.predict(sound.q).std, kept.predict(sound.q).std)


def test_a_validation_says_how_many_readings_were_left_out(virtual: VirtualCell, sound: Samples):
    found = tp.fit_cell(virtual.cell, spoiled(sound, by=20.0), "idw")
    masked = replace(virtual.measure(virtual.design(14, seed=2), seed=2), excluded=({"row": 3, "reason": "masked"},))
    validation = found.validate(masked)
    assert validation["excluded"] == [{"row": 3, "reason": "masked"}]
    assert validation["left_out_of_map"] == 1
    assert "left out: 1 readings of this table, 1 of the map" in repr(validation)
