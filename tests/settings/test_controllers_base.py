"""The base of an arm's model against the base in which the controller shows and programs positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.error_map.arm_check import in_controllers_base
from truepose.errors import DataError, RefusedError
from truepose.geometry import apply_transform, make_transform
from truepose.samples import Samples, write_samples

PLACES = {  # of the model's base in the controller's
    "half a turn, as in ROS": make_transform(Rotation.from_euler("z", 180, degrees=True), np.zeros(3)),
    "a quarter": make_transform(Rotation.from_euler("z", 90, degrees=True), np.zeros(3)),
    "three quarters and a foot": make_transform(Rotation.from_euler("z", 270, degrees=True), np.array([0, 0, 400.0])),
    "a foot": make_transform(Rotation.identity(), np.array([0, 0, -330.0])),
}
WORK_OBJECT = make_transform(Rotation.from_euler("zyx", [31, 4, -2], degrees=True), np.array([900.0, -200.0, 150.0]))
SCRIPT = "def a():\n  set_tcp(p[{tool}])\n{moves}end\n"


@pytest.fixture(scope="module")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("hard", seed=3)


def seen_in(samples: Samples, tf: np.ndarray, digits: int = 3) -> Samples:
    """Return samples whose commanded positions the controller shows in another frame."""
    return replace(samples, p_cmd=np.round(apply_transform(tf, samples.p_cmd), digits), rotation_cmd=None)


@pytest.fixture(scope="module")
def samples(virtual) -> Samples:
    return virtual.measure(virtual.design(60, seed=1))


@pytest.mark.parametrize(("away", "code"), [(49.0, "base-turned"), (51.0, "base-elsewhere")])
def test_a_tool_that_starts_a_fit_must_be_near_that_of_the_positions(virtual, samples, away, code):
    """Within 50 mm; farther, another arm may explain them. No tool at all starts from anywhere."""
    shown = seen_in(samples, PLACES["half a turn, as in ROS"])
    start = virtual.tf_flange_tool.copy()
    start[0, 3] += away
    _, (fact,) = in_controllers_base(virtual.robot, shown, start, fit="position")
    assert fact.code == code
    _, (fact,) = in_controllers_base(virtual.robot, shown, np.eye(4), fit="position")
    assert fact.code == "base-turned"


@pytest.mark.sampled(2)
@pytest.mark.parametrize("place", PLACES)
def test_corrections_are_those_of_the_true_base(virtual, samples, place):
    """A cell whose model lies elsewhere corrects as one whose model lies in the controller's base."""
    tf = PLACES[place]
    placed = tp.fit_cell(virtual.cell, seen_in(samples, tf), "calibration")
    plain = tp.fit_cell(virtual.cell, samples, "calibration")
    assert [fact.code for fact in placed.facts if fact.effect == "transforms"] == ["base-turned"]
    assert not [fact for fact in plain.facts if fact.effect == "transforms"]
    poses = virtual.robot.forward(samples.q[:5], tool=virtual.tf_flange_tool)
    wanted = plain.correct(poses, accept_weak_map=True)
    found = placed.correct(tf @ poses, accept_weak_map=True)
    np.testing.assert_allclose(found.correction, wanted.correction @ tf[:3, :3].T, atol=2e-3)
    assert (found.verdict == wanted.verdict).all()
    held_out = virtual.measure(virtual.design(20, seed=2))
    assert placed.validate(seen_in(held_out, tf))["after"]["mean_mm"] == pytest.approx(
        plain.validate(held_out)["after"]["mean_mm"], abs=1e-3
    )


def test_the_commands_correct_in_the_controllers_base(virtual, samples, run, tmp_path):
    tf = PLACES["half a turn, as in ROS"]
    (tmp_path / "cell.toml").write_text(virtual.cell.to_toml())
    write_samples(tmp_path / "samples.csv", seen_in(samples, tf))
    write_samples(tmp_path / "bare.csv", replace(samples, p_cmd=None, rotation_cmd=None))
    poses = tf @ virtual.robot.forward(samples.q[:4], tool=virtual.tf_flange_tool)
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_rotvec()
    numbers = np.column_stack([1e-3 * poses[:, :3, 3], turns])
    moves = "".join(f"  movel(p[{','.join(f'{x:.6f}' for x in row)}])\n" for row in numbers)
    tool = virtual.tf_flange_tool
    turned = Rotation.from_matrix(tool[:3, :3]).as_rotvec()
    stated = ",".join(f"{x:.9g}" for x in [*(1e-3 * tool[:3, 3]), *turned])
    (tmp_path / "a.script").write_text(SCRIPT.format(tool=stated, moves=moves))
    more = ("--predictor", "calibration", "--out", tmp_path / "map.truepose")
    done = run("fit", tmp_path / "cell.toml", tmp_path / "samples.csv", *more)
    assert "base-turned" in done.out
    common = ("--other-maker", "--accept-weak-map", "--on-guard", "skip", "--absolute-accuracy")
    done = run("correct", tmp_path / "map.truepose", tmp_path / "a.script", "--out", tmp_path / "out", *common)
    assert done.code == 0, done.err
    assert "turned by 180° about z in the controller's base" in done.out
    after = [line for line in (tmp_path / "out" / "a.script").read_text().splitlines() if "movel" in line]
    p = 1e3 * np.array([[float(x) for x in line.split("[")[1].split("]")[0].split(",")[:3]] for line in after])
    error_map = tp.load_map(tmp_path / "map.truepose")
    np.testing.assert_allclose(p, error_map.correct(poses, accept_weak_map=True).p_command, atol=2e-3)
    # a cell file of the same robot is still that of the map
    done = run(
        *("correct", tmp_path / "map.truepose", tmp_path / "a.script", "--out", tmp_path / "again", *common),
        *("--cell", tmp_path / "cell.toml"),
    )
    assert done.code == 0, done.err
    # without commanded positions the question is open, and correct says so
    done = run("fit", tmp_path / "cell.toml", tmp_path / "bare.csv", *more, "--force")
    assert "its base" in done.out
    done = run("correct", tmp_path / "map.truepose", tmp_path / "a.script", "--out", tmp_path / "open", *common)
    assert "its base and the tool were not checked" in done.out


def test_positions_in_a_work_object_are_refused_until_accepted(virtual, samples, tmp_path):
    error_map = tp.fit_cell(virtual.cell, seen_in(samples, WORK_OBJECT), "calibration")
    error_map.save(tmp_path / "map.truepose")
    poses = virtual.robot.forward(samples.q[:3], tool=virtual.tf_flange_tool)
    for one in (error_map, tp.load_map(tmp_path / "map.truepose")):
        np.testing.assert_array_equal(one.robot.tf_base_first, virtual.robot.tf_base_first)
        with pytest.raises(RefusedError, match=r"base lies at .* or accept it with --accept base-elsewhere"):
            one.correct(poses, accept_weak_map=True)
        plain = tp.fit_cell(virtual.cell, samples, "calibration").correct(poses, accept_weak_map=True)
        accepted = one.correct(poses, accept_weak_map=True, accept={"base-elsewhere"})
        np.testing.assert_allclose(accepted.correction, plain.correction, atol=1e-6)
    with pytest.raises(DataError, match="'scale' cannot be accepted; expected one of base-elsewhere"):
        error_map.correct(poses, accept={"scale"})


def test_errors_of_the_model_are_no_other_base(virtual, samples):
    """A controller that knows its arm shows positions that differ from the nominal model, but not by a frame."""
    rng = np.random.default_rng(1)
    off = replace(samples, p_cmd=samples.p_cmd + rng.normal(0.0, 0.4, samples.p_cmd.shape), rotation_cmd=None)
    with pytest.raises(DataError, match="the controller seems to compensate already"):
        tp.fit_cell(virtual.cell, off, "calibration")
