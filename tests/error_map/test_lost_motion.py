"""Samples from one side of each joint: what comes from the other side is as uncertain as the lost motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.error_map.lost_motion import lost_motion_std, sampled_sides
from truepose.geometry import apply_transform, invert_transform
from truepose.robots import load_robot
from truepose.samples import Poses

KRIGING = "kinematic-kriging"
PREDICTORS = (KRIGING, f"{KRIGING}:conditions=none", "calibration", "ordinary-kriging", "idw:space=joint")


def one_sided(seed=0, predictor=KRIGING, n=50, preset="backlash", **how):
    virtual = tp.VirtualCell(preset, seed=seed)
    samples = virtual.measure(virtual.design(n, seed=seed), seed=seed, **{"approach": 1.0, **how})
    return virtual, tp.fit_cell(virtual.cell, samples, predictor)


@pytest.fixture(scope="module")
def made():
    return one_sided()


def misses(virtual, error_map, q, approach):
    """Return what a map leaves of the errors at joints that come from some sides, and its standard deviation."""
    p = virtual.true_position(q, approach=approach)
    p = error_map.registration.apply(apply_transform(invert_transform(virtual.truth.tf_base_tracker), p))
    predicted, std = error_map.predict_errors(Poses(q=q, approach=approach))
    return p - virtual.robot.forward(q, tool=error_map.tf_flange_tool)[:, :3, 3] - predicted, std


def sides(q, seed=1):
    return np.random.default_rng(seed).choice([-1.0, 1.0], q.shape)


def test_targets_from_sides_that_no_sample_had_are_not_corrected(made) -> None:
    """Before, 64 of 64 were corrected with a standard deviation of 0.05 mm, and were 1.5 mm off."""
    virtual, error_map = made
    q = virtual.design(64, seed=9)
    miss, std = misses(virtual, error_map, q, sides(q))
    assert np.linalg.norm(miss, axis=1).mean() > 1.0
    assert np.mean(np.abs(miss) < 1.96 * std) > 0.9
    found = error_map.correct(Poses(q=q, approach=sides(q)), on_guard="skip")
    done = np.isin(found.verdict, ["correct", "clip"])
    assert done.sum() <= 3
    assert "from a side that no sample had" in next(reason for reason in found.reason if "deviation" in reason)
    own = error_map.correct(Poses(q=q, approach=np.ones_like(q)), on_guard="skip")
    assert np.isin(own.verdict, ["correct", "clip"]).mean() > 0.9
    miss, std = misses(virtual, error_map, q, np.ones_like(q))
    assert np.linalg.norm(miss, axis=1).mean() < 0.05
    assert std.max() < 0.1


@pytest.mark.exhaustive
@pytest.mark.parametrize("predictor", [KRIGING, "calibration"])
def test_the_deviation_covers_what_comes_from_other_sides(predictor) -> None:
    """Over cells: the lost motions of one cell are the same at all its targets."""
    inside = []
    for seed in range(8):
        virtual, error_map = one_sided(seed, predictor)
        q = virtual.design(40, seed=99)
        miss, std = misses(virtual, error_map, q, sides(q, seed))
        inside.append(np.mean(np.abs(miss) < 1.96 * std))
    assert 0.9 < np.mean(inside) < 0.99


@pytest.mark.sampled(2)
@pytest.mark.parametrize("predictor", PREDICTORS)
def test_only_the_deviation_of_known_other_sides_grows(predictor) -> None:
    virtual, error_map = one_sided(predictor=predictor, n=30)
    q = virtual.design(8, seed=3)
    plain, plain_std = error_map.predict_errors(Poses(q=q))
    lost = lost_motion_std(virtual.robot)
    lever = virtual.robot.joint_jacobian(q, tool=error_map.tf_flange_tool)
    for approach, share in ((np.ones_like(q), 0.0), (-np.ones_like(q), 1.0), (0.0 * q, 0.5)):
        poses = Poses(q=q, approach=approach)
        mean, std = error_map.predict_errors(poses)
        np.testing.assert_allclose(mean, plain, atol=1e-9)
        grown = std**2 - plain_std**2
        np.testing.assert_allclose(grown, share * lost**2 * np.sum(lever**2, axis=2), atol=1e-6)
        np.testing.assert_allclose(error_map.predict(poses).std, std)
        np.testing.assert_allclose(error_map.correct(poses, accept_weak_map=True).std, std, rtol=0.02)
        if error_map.knows_orientation:
            np.testing.assert_allclose(error_map.predict_pose_errors(poses)[1][:, :3], std, rtol=0.02)
    some = np.ones_like(q)
    some[:, 0] = 0.0
    grown = error_map.predict_errors(Poses(q=q, approach=some))[1] ** 2 - plain_std**2
    np.testing.assert_allclose(grown, 0.5 * lost**2 * lever[:, :, 0] ** 2, atol=1e-6)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("predictor", PREDICTORS)
def test_joints_that_samples_reached_from_both_sides_are_not_widened(predictor) -> None:
    virtual = tp.VirtualCell("backlash", seed=0)
    q = virtual.design(40, seed=0)
    approach = sides(q)
    approach[:, 4] = 1.0
    samples = virtual.measure(q, seed=0, approach=approach)
    error_map = tp.fit_cell(virtual.cell, samples, predictor)
    np.testing.assert_array_equal(np.flatnonzero(error_map.lost_motion), [4])
    at = virtual.design(8, seed=3)
    other = np.ones_like(at)
    other[:, [0, 1, 2, 3, 5]] = -1.0
    assert not error_map.from_other_sides(at, other, error_map.tf_flange_tool).any()
    assert [fact.code for fact in error_map.facts if fact.code == "one-sided"] == ["one-sided"]
    both = tp.fit_cell(virtual.cell, virtual.measure(q, seed=0, approach=sides(q)), predictor)
    assert not both.lost_motion.any()
    assert not {"one-sided", "sides-not-stated"} & {fact.code for fact in both.facts}


def test_the_fact_widens_and_has_a_size(made, tmp_path: Path) -> None:
    virtual, error_map = made
    error_map.save(tmp_path / "map.truepose")
    for one in (error_map, tp.load_map(tmp_path / "map.truepose")):
        (fact,) = [fact for fact in one.facts if fact.code == "one-sided"]
        assert fact.effect == "widens"
        assert 1.0 < fact.size < 2.5
        assert fact.unit == "mm"
        assert "joints 1, 2, 3, 4, 5, 6 came from one side" in fact.words
    untold = tp.fit_cell(virtual.cell, replace(error_map.samples, approach=None), "registration")
    assert [fact.effect for fact in untold.facts if fact.code == "sides-not-stated"] == ["told"]
    assert not untold.lost_motion.any()


def test_the_side_is_that_of_nearly_all_samples() -> None:
    approach = np.array([[1.0, 1.0, -1.0, 0.0]] * 10)
    approach[:2, 1] = -1.0
    assert sampled_sides(approach, 4).tolist() == [1.0, 1.0, -1.0, 0.0]
    approach[:3, 1] = -1.0
    assert sampled_sides(approach, 4).tolist() == [1.0, 0.0, -1.0, 0.0]
    assert sampled_sides(None, 3).tolist() == [0.0, 0.0, 0.0]


def test_the_prior_depends_on_the_arm() -> None:
    large, small = (lost_motion_std(load_robot(name)) for name in ("abb-irb6700-200-260", "universal-robots-ur5e"))
    assert 1e-4 < small < large < 1e-3


@pytest.mark.parametrize("word", ["LIN", "PTP"])
def test_motions_from_other_sides_or_from_unknown_ones_are_refused(made, word, tmp_path: Path) -> None:
    virtual, error_map = made
    middle = virtual.design(1, seed=4)[0]
    stops = middle + np.deg2rad([[0.0], [3.0], [6.0], [3.0]])  # up, up, and down again
    text = ["DEF a()", "$TOOL=TOOL_DATA[1]", "$BASE=$NULLFRAME"]
    for i, pose in enumerate(virtual.robot.forward(np.array(stops), tool=error_map.tf_flange_tool)):
        c = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
        numbers = ",".join(f"{name} {x:.5f}" for name, x in zip("XYZABC", [*pose[:3, 3], *c], strict=True))
        text.append(f"{word if i else 'PTP'} {{{numbers}}}")
    path = tmp_path / "a.src"
    path.write_text("\n".join([*text, "END", ""]))
    tool = {key: value for key, value in virtual.cell.tool.model_dump(exclude_unset=True).items() if key != "fit"}
    cell = tp.Cell.model_validate({**virtual.cell.model_dump(exclude_unset=True), "frames": {"tools": {"1": tool}}})
    found = tp.correct_program(path, error_map, cell=cell, on_guard="skip")
    assert found.targets.corrected.tolist() == [False, True, True, False]
    (told,) = [one for one in found.warnings if "from which side" in one]
    assert told.startswith("1 targets: it is not known")
