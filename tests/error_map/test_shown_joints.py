"""Tables of joints as a controller shows them, from a plan to a correction."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import truepose as tp
from truepose.cli import app
from truepose.errors import DataError, RobotError
from truepose.planning.measuring import measuring_program
from truepose.robots import load_robot, shown_joints, to_toml
from truepose.samples import Poses, check_against, on_arm, read_poses, samples_text, write_samples
from truepose.simulation import VirtualCell
from truepose.trackers import import_readings, write_readings

ROBOT = load_robot("fanuc-m20ia")


def as_shown(poses, robot=ROBOT):
    """Return a table with the joints on FANUC's display, computed here."""
    shown = poses.q.copy()
    shown[:, 2] -= poses.q[:, 1]
    return replace(poses, q=None, q_shown=shown)


@pytest.fixture(scope="module")
def campaign():
    virtual = VirtualCell("paper", robot="fanuc-m20ia", seed=3)
    q = virtual.design(40)
    return virtual.cell, virtual.measure(q), virtual.measure(virtual.design(8, seed=1), seed=1)


@pytest.fixture(scope="module")
def fitted(campaign):
    cell, samples, _ = campaign
    return tp.fit_cell(cell, samples, "calibration")


@pytest.mark.exhaustive
def test_a_map_is_the_same(campaign, fitted):
    cell, samples, other = campaign
    again = tp.fit_cell(cell, as_shown(samples), "calibration")
    np.testing.assert_allclose(again.samples.q, samples.q, atol=1e-12)
    np.testing.assert_allclose(again.e, fitted.e, atol=1e-9)
    assert again.samples.q_shown is None
    e, _ = fitted.predict_errors(other)
    for found in (
        fitted.predict_errors(as_shown(other))[0],
        fitted.predict(as_shown(other)).e,
    ):
        np.testing.assert_allclose(found, e, atol=1e-9)
    np.testing.assert_allclose(fitted.errors(as_shown(other)), fitted.errors(other), atol=1e-9)
    commanded = fitted.correct(Poses(q=other.q)).p_command
    np.testing.assert_allclose(fitted.correct(as_shown(Poses(q=other.q))).p_command, commanded, atol=1e-9)
    assert fitted.validate(as_shown(other))["after"] == pytest.approx(fitted.validate(other)["after"])
    assert tp.update_map(fitted, as_shown(other)).samples.q.shape == (48, 6)


def test_files_keep_them_and_an_import_converts_them(campaign, tmp_path: Path):
    cell, samples, _ = campaign
    plan = as_shown(Poses(q=samples.q))
    write_samples(tmp_path / "plan.csv", plan)
    assert "q3_shown_deg" in (tmp_path / "plan.csv").read_text().splitlines()[0]
    read = read_poses(tmp_path / "plan.csv")
    assert read.q is None
    np.testing.assert_allclose(read.q_shown, plan.q_shown, atol=1e-12)
    assert "q_shown: 6 joints" in repr(read)
    write_readings(tmp_path / "readings.csv", samples, "tidy")
    imported, _ = import_readings(tmp_path / "readings.csv", read, cell=cell)
    np.testing.assert_allclose(imported.q, samples.q, atol=1e-9)
    assert "shown" not in samples_text(imported)


@pytest.mark.exhaustive
def test_on_the_command_line(campaign, fitted, tmp_path: Path):
    cell, samples, other = campaign
    (tmp_path / "cell.toml").write_text(cell.to_toml())
    fitted.save(tmp_path / "map.truepose")
    for name, table in (("samples", samples), ("other", other)):
        write_samples(tmp_path / f"{name}.csv", table)
        write_samples(tmp_path / f"{name}-shown.csv", as_shown(table))

    def run(*arguments: str):
        result = CliRunner().invoke(app, [*arguments, "--json"])
        assert result.exit_code == 0, result.output
        return json.loads(result.stdout)

    here = str(tmp_path)
    found = [
        run("validate", f"{here}/map.truepose", f"{here}/{name}.csv")["after"]["mean_mm"]
        for name in ("other", "other-shown")
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-6)
    fit = run(
        "fit",
        f"{here}/cell.toml",
        f"{here}/samples-shown.csv",
        "--predictor=registration",
        "--out",
        f"{here}/new.truepose",
    )
    assert fit["n"] == 40
    run("predict", f"{here}/map.truepose", f"{here}/other-shown.csv", "--out", f"{here}/predicted.csv")
    assert "q3_shown_deg" in (tmp_path / "predicted.csv").read_text()


def test_plans_and_programs_are_for_the_controller(campaign):
    cell, samples, _ = campaign
    plan = Poses(q=samples.q[:3])
    assert measuring_program(cell, as_shown(plan)) == measuring_program(cell, plan)


def test_a_coupling_of_the_robot_file_holds_for_samples_and_plans(campaign, tmp_path: Path):
    cell, samples, _ = campaign
    robot = replace(ROBOT, coupling=[[3, 2, 0.5], [6, 5, 0.25]])
    (tmp_path / "arm.toml").write_text(to_toml(robot))
    text = cell.to_toml().replace('"fanuc-m20ia"', '"arm.toml"')
    other = tp.Cell.from_toml(text, folder=tmp_path)
    shown = samples.q.copy()
    shown[:, 2] -= 0.5 * shown[:, 1]
    shown[:, 5] -= 0.25 * shown[:, 4]
    np.testing.assert_allclose(on_arm(Poses(q_shown=shown), other.load_robot()).q, samples.q, atol=1e-12)
    _, program = measuring_program(other, Poses(q=samples.q[:1]))
    degrees = np.rad2deg(shown[0])
    for j in (3, 6):
        assert f"J{j}= {degrees[j - 1]:.3f} deg" in program


def test_both_kinds_must_agree(campaign):
    _, samples, _ = campaign
    both = replace(as_shown(samples), q=samples.q)
    np.testing.assert_array_equal(on_arm(both, ROBOT).q, samples.q)
    assert on_arm(both, ROBOT).q_shown is None
    wrong = samples.q.copy()
    wrong[5, 2] += 0.1
    with pytest.raises(DataError, match=r"row 5: q3 is .* by the joints shown and the coupling of fanuc-m20ia"):
        on_arm(replace(both, q=wrong), ROBOT)
    with pytest.raises(DataError, match="has 5 joints as shown"):
        on_arm(replace(as_shown(samples), q_shown=samples.q[:, :5], approach=None), ROBOT)


def test_without_the_arm_joints_are_not_known(campaign):
    _, samples, _ = campaign
    table = replace(as_shown(samples), p_cmd=None, rotation_cmd=None)
    with pytest.raises(DataError, match="need the arm"):
        tp.choose(["registration"], table)
    lying = replace(ROBOT, offset=np.zeros(6))
    with pytest.raises(RobotError, match="state coupling in"):
        on_arm(table, lying)


def test_degrees_and_repeats_are_found_in_them_too(tmp_path: Path):
    path = tmp_path / "plan.csv"
    path.write_text("q1_shown_rad,q2_shown_rad\n10,20\n-30,40\n")
    with pytest.raises(DataError, match="are they degrees\\? Name the columns q1_shown_deg"):
        read_poses(path)
    path.write_text("q1_shown_deg,q3_shown_deg\n10,20\n-30,40\n")
    with pytest.raises(tp.errors.FileError, match="but not q2_shown_deg"):
        read_poses(path)


def test_joints_of_the_display_under_the_names_of_the_model_are_found(campaign):
    """With the positions on the display, the table itself shows which joints it has."""
    _, samples, _ = campaign
    p = ROBOT.forward(samples.q)[:, :3, 3]
    with pytest.raises(DataError, match=r"as the controller shows them; name the columns q1_shown_deg"):
        check_against(Poses(q=as_shown(samples).q_shown, p_cmd=p), ROBOT)


def test_a_taught_point_in_joints_of_the_display(campaign, tmp_path: Path):
    cell, samples, _ = campaign
    q = samples.q[0]
    p = ROBOT.forward(q[None], tool=cell.tf_flange_tool)[0, :3, 3]
    shown = shown_joints(ROBOT).from_model(q)
    assert tp.check_point(cell, shown, p, shown=True).residual_mm < 1e-6
    with pytest.raises(DataError, match=r"those of the model: .*--shown"):
        tp.check_point(cell, shown, p)
    (tmp_path / "cell.toml").write_text(cell.to_toml())
    joints, position = (" ".join(f"{value:.6f}" for value in row) for row in (np.rad2deg(shown), p))
    options = ["--joints", joints, "--position", position, "--shown"]
    result = CliRunner().invoke(app, ["check-point", str(tmp_path / "cell.toml"), *options])
    assert result.exit_code == 0, result.output
    assert "agree with one taught point" in result.stdout
