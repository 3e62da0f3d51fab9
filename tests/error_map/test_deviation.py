"""The deviation of a corrected position: what guards, records and reports say is what the tool tip does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import truepose as tp
from truepose.geometry import apply_transform, invert_transform
from truepose.predictors.orientation import rotation_per_mm
from truepose.report.knowledge import knowledge
from truepose.report.region import planes
from truepose.samples import Poses, Samples
from truepose.verification import RP_PER_STD

FAMILIES = (
    "registration",
    "idw",
    "grid-cell",
    "radial-basis:space=joint",
    "nearest",
    "ordinary-kriging",
    "universal-kriging",
    "vector-kriging",
    "local-kriging",
    "vecchia-kriging",
    "ordinary-kriging-joint",
    "calibration",
    "calibration-network",
    "kinematic-kriging",
)
JOINT = ("calibration", "kinematic-kriging")


@pytest.fixture(scope="module")
def turned() -> tuple[tp.VirtualCell, Samples]:
    """A UR10 measured at orientations within 15 degrees, which a Cartesian map does not see."""
    virtual = tp.VirtualCell("hard", "universal-robots-ur10", seed=4)
    return virtual, virtual.measure(virtual.design(64, seed=4), seed=4)


@pytest.fixture(scope="module")
def maps(turned) -> dict[str, tp.ErrorMap]:
    virtual, samples = turned
    return {name: tp.fit_cell(virtual.cell, samples, name) for name in FAMILIES}


def true_errors(virtual, error_map, q):
    """Return the errors of the tool tip after the map's registration, without any noise."""
    p = apply_transform(invert_transform(virtual.truth.tf_base_tracker), virtual.true_position(q))
    return error_map.registration.apply(p) - error_map.commanded_positions(Poses(q=q))


def inside(error, std):
    return float(np.mean(np.abs(error) < 1.95996 * std))


@pytest.mark.promise("95 % intervals of every predictor hold true errors, also where a map does not see orientation")
@pytest.mark.exhaustive
def test_intervals_hold_true_errors_at_orientations_that_the_map_does_not_see(turned, maps, record_property):
    virtual, _ = turned
    q = virtual.design(100, seed=40)
    record_property("cases", 3 * len(q) * len(maps))
    for name, error_map in maps.items():
        e, std = error_map.predict_errors(Poses(q=q))
        assert inside(true_errors(virtual, error_map, q) - e, std) > 0.88, name


@pytest.mark.promise("95 % intervals of kinematic Kriging hold true errors of arms whose motors ripple")
@pytest.mark.exhaustive
def test_intervals_of_kinematic_kriging_hold_where_motors_ripple(record_property):
    share, seeds = [], range(200, 204)
    for seed in seeds:
        virtual = tp.VirtualCell("hard", seed=seed)
        found = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(100)), "kinematic-kriging")
        q = virtual.design(100, seed=seed + 1000)
        e, std = found.predict_errors(Poses(q=q))
        share.append(inside(true_errors(virtual, found, q) - e, std))
    record_property("cases", 300 * len(seeds))
    assert 0.93 < np.mean(share) < 0.985
    assert min(share) > 0.88


@pytest.mark.exhaustive
@pytest.mark.promise("the deviation is that of the field with the nugget, less what is known of repeatability")
def test_the_deviation_is_field_and_nugget_less_repeatability(turned, maps, record_property):
    virtual, samples = turned
    repeatability = virtual.cell.robot.repeatability_mm / RP_PER_STD
    record_property("cases", len(maps))
    for name, error_map in maps.items():
        x = error_map.coordinates(samples)
        field = error_map.predictor.predict(x, return_std=True)[1]
        nugget = error_map.predictor.nugget_
        expected = field**2 + np.maximum(nugget - repeatability**2, 0.0)
        np.testing.assert_allclose(error_map.predict_errors(samples)[1] ** 2, expected, rtol=1e-9, err_msg=name)
        with_noise = field**2 + nugget + error_map.reading_noise(samples) ** 2
        np.testing.assert_allclose(error_map.predict_reading(samples)[1] ** 2, with_noise, rtol=1e-9, err_msg=name)


@pytest.mark.promise("noise that nobody states is not taken off: it counts as an error of the arm")
@pytest.mark.exhaustive
def test_unknown_noise_counts_as_error(turned, record_property):
    virtual, samples = turned
    names = ("ordinary-kriging", "calibration", "kinematic-kriging", "calibration-network")
    unknown = virtual.cell.model_copy(
        update={"robot": virtual.cell.robot.model_copy(update={"repeatability_mm": None})}
    )
    record_property("cases", len(names))
    for name in names:
        error_map = tp.fit_cell(unknown, replace(samples, p_std=None), name)
        _, field = error_map.predictor.predict(error_map.coordinates(samples), return_std=True)
        expected = field**2 + error_map.predictor.nugget_
        np.testing.assert_allclose(error_map.predict_errors(samples)[1] ** 2, expected, rtol=1e-9)


@pytest.mark.exhaustive
@pytest.mark.promise("guards, records, predictions, reports and rechecks speak of one deviation")
def test_one_deviation_everywhere(turned, maps, record_property):
    virtual, samples = turned
    names = ("ordinary-kriging", "calibration", "kinematic-kriging")
    record_property("cases", len(names))
    for name in names:
        error_map = maps[name]
        q = samples.q[:5]
        targets = virtual.robot.forward(q, tool=error_map.tf_flange_tool)
        corrections = error_map.correct(targets, accept_weak_map=True)  # Cartesian maps are weak here
        least = np.sqrt(error_map.unexplained) * (1 - 1e-9)
        assert (corrections.std >= least).all()
        assert (error_map.unexplained.min() > 0.0) == (name != "kinematic-kriging")  # which explains all but the noise
        assert corrections.to_rows()[0]["std_mm"] == pytest.approx(np.linalg.norm(corrections.std[0]))
        _, measured = error_map.predict_measured(q)
        np.testing.assert_allclose(
            np.linalg.norm(measured, axis=1), np.linalg.norm(error_map.predict_errors(Poses(q=q))[1], axis=1)
        )
        floor = np.linalg.norm(least)
        assert min(float(np.nanmin(plane.std)) for plane in planes(error_map)) >= floor
        told = knowledge(error_map, suggestions=3)
        assert min(told.std_mm["mean"], *(row["std_mm"] for row in told.next_poses)) >= floor
        found = tp.recheck(error_map, virtual.measure(virtual.design(30, seed=9), seed=9))
        assert found.holding.verdict == "holds"


@pytest.mark.exhaustive
@pytest.mark.promise("what a map cannot explain turns the tool, too: the deviation of orientation holds it")
@pytest.mark.parametrize("name", JOINT)
def test_the_deviation_of_orientation_holds_what_is_unexplained(maps, turned, name):
    _, samples = turned
    error_map = maps[name]
    _, std = error_map.predict_pose_errors(samples)
    _, field = error_map.predictor.predict_pose(samples.q, return_std=True)
    lever = error_map.robot.joint_jacobian(samples.q, tool=error_map.tf_flange_tool)
    turn = np.sqrt(np.mean(error_map.unexplained)) * rotation_per_mm(lever)
    expected = field[:, 3:] ** 2 + turn[:, None] ** 2 + error_map.tool_turn[1] ** 2
    np.testing.assert_allclose(std[:, 3:] ** 2, expected, rtol=0.01)  # the lever is that of the nominal arm here
    np.testing.assert_allclose(std[:, :3], error_map.predict_errors(samples)[1], rtol=1e-6)


@pytest.mark.promise("an interpolator's deviation is without the noise of the readings where that is known")
@pytest.mark.parametrize("name", ["idw", "nearest", "grid-cell", "radial-basis"])
def test_interpolators_take_known_noise_off(name, rng, record_property):
    record_property("cases", 2)
    x, noise = rng.random((300, 3)), 0.1
    e = np.sin(3 * x) + rng.normal(scale=noise, size=x.shape)
    told, blind = (tp.predictors.make_predictor(name).fit(x, e, std) for std in (noise, None))
    new = rng.random((400, 3))
    left = np.sin(3 * new) - told.predict(new)
    _, std = told.predict(new, return_std=True)
    assert np.sqrt(np.mean((left / std) ** 2)) == pytest.approx(1.0, rel=0.15)
    np.testing.assert_allclose(blind.predict(new, return_std=True)[1] ** 2, std**2 + noise**2)
