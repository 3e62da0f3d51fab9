"""The cell's tool and arm against positions that the controller itself shows."""

from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.errors import DataError
from truepose.geometry import make_transform
from truepose.samples import Samples, read_samples, write_samples

TRUE_Z, WRONG_Z = 360.0, 365.0


@pytest.fixture(scope="module")
def shown(virtual, samples) -> Samples:
    """The samples with the positions that the controller shows: nominal arm, tool of 360 mm, rounded."""
    p_cmd = virtual.robot.forward(samples.q, tool=virtual.tf_flange_tool)[:, :3, 3]
    return replace(samples, p_cmd=np.round(p_cmd, 2), rotation_cmd=None)


@pytest.fixture(scope="module")
def bare(samples) -> Samples:
    """The same joints and readings, without what was commanded."""
    return replace(samples, p_cmd=None, rotation_cmd=None)


def cell_of(cell_text: str, **tool: object) -> tp.Cell:
    cell = tp.Cell.from_toml(cell_text)
    return cell.model_copy(update={"tool": cell.tool.model_copy(update=tool)})


@pytest.mark.promise("A tool that commanded positions contradict is refused, and both tools are named.")
def test_a_tool_that_the_positions_contradict_is_refused(virtual, shown, cell_text, record_property):
    assert virtual.tf_flange_tool[2, 3] == TRUE_Z
    wrong = {"z_mm": WRONG_Z}, {"x_mm": 110.4}, {"y_mm": -2.0}
    for values in wrong:
        cell = cell_of(cell_text, fit="none", **values)
        for predictor in ("registration", "ordinary-kriging", "calibration"):
            with pytest.raises(DataError, match=r"tool .110.00, 0.00, 360.00. mm, but .tool. states ") as refused:
                tp.fit_cell(cell, shown, predictor)
        x, y, z = (f"{getattr(cell.tool, f'{axis}_mm'):.2f}" for axis in "xyz")
        assert f"[tool] states ({x}, {y}, {z}) mm" in str(refused.value)
    record_property("cases", 3 * len(wrong))
    found = tp.fit_cell(cell_of(cell_text, fit="none"), shown, "registration").arm_check
    assert found.checked
    assert "The controller's tool agrees with [tool] within 0.0" in found.words
    np.testing.assert_allclose(found.p_flange_tool_mm, [110.0, 0.0, 360.0], atol=0.01)


@pytest.mark.promise("The commands import, fit and validate refuse a tool that commanded positions contradict.")
def test_the_commands_refuse_it(run, shown, bare, cell_text, tmp_path):
    wrong, right = tmp_path / "wrong.toml", tmp_path / "right.toml"
    wrong.write_text(cell_of(cell_text, fit="none", z_mm=WRONG_Z).to_toml())
    right.write_text(cell_of(cell_text, fit="none").to_toml())
    table, without = tmp_path / "shown.csv", tmp_path / "bare.csv"
    write_samples(table, shown)
    write_samples(without, bare)
    out = tmp_path / "map.truepose"
    options = ("--predictor", "registration", "--out", out)
    failed = run("fit", wrong, table, *options).failed()
    assert "360.00) mm, but [tool] states (110.00, 0.00, 365.00) mm, 5.00 mm apart" in failed
    assert not out.exists()
    assert run("fit", wrong, without, *options).code == 0  # nothing to compare with, which is said
    assert "5.00 mm apart" in run("validate", out, table).failed()
    done = run("fit", right, table, *options, "--force")
    assert done.code == 0, done.err
    assert "Arm and tool: The arm's model agrees with the commanded positions of 80 poses" in done.out


@pytest.mark.promise("Poses of several orientations distinguish the tool, the base and a controller that compensates.")
def test_tool_base_and_compensation_are_told_apart(virtual, cell_text, rng):
    q = np.radians(np.array([0, -80, 90, 0, 30, 0]) + rng.uniform(-30, 30, (40, 6)))
    robot, tool = virtual.robot, virtual.tf_flange_tool
    p_cmd = np.round(robot.forward(q, tool=tool)[:, :3, 3], 2)
    right, wrong = (cell_of(cell_text, fit="none", z_mm=z) for z in (TRUE_Z, WRONG_Z))

    def fit(cell: tp.Cell, positions: np.ndarray) -> tp.ErrorMap:
        shown = Samples(p_cmd + rng.normal(scale=0.1, size=p_cmd.shape), q=q, p_cmd=positions, source="s.csv")
        return tp.fit_cell(cell, shown, "registration")

    lifted = p_cmd + np.array([0.0, 0.0, 500.0])
    found = fit(right, lifted)
    assert found.arm_check.checked
    assert any("is 500 mm higher in the controller's base" in fact.words for fact in found.facts)
    with pytest.raises(DataError, match=r"tool .110.00, 0.00, 360.00. mm, but .tool. states .*, 5.00 mm apart"):
        fit(wrong, lifted)
    accurate = replace(
        robot, a=robot.a + rng.normal(scale=0.8, size=6), offset=robot.offset + 1e-3 * rng.normal(size=6)
    )
    with pytest.raises(DataError, match=r"seems to compensate already"):
        fit(right, accurate.forward(q, tool=tool)[:, :3, 3])


@pytest.mark.promise("With one orientation only, a message says that a tool and a base cannot be distinguished.")
def test_one_orientation_names_both_explanations(virtual, samples, shown, cell_text):
    turned = virtual.robot.forward(samples.q)[:, :3, :3]
    alike = np.flatnonzero(Rotation.from_matrix(turned[:1].transpose(0, 2, 1) @ turned).magnitude() < 1e-6)
    assert len(alike) > 8  # the plan of this cell keeps one orientation
    with pytest.raises(DataError, match=r"or, since the orientations are all alike, a base that lies at"):
        tp.fit_cell(cell_of(cell_text, fit="none", z_mm=WRONG_Z), shown[alike], "registration")


@pytest.mark.promise("Commanded orientations that contradict the stated tool are refused with both orientations.")
def test_a_turned_tool_is_refused(virtual, shown, cell_text):
    rotation = Rotation.from_matrix(virtual.robot.forward(shown.q, tool=virtual.tf_flange_tool)[:, :3, :3])
    right = cell_of(cell_text, fit="none")
    assert (
        "Its orientation agrees"
        in tp.fit_cell(right, replace(shown, rotation_cmd=rotation), "registration").arm_check.words
    )
    turned = replace(shown, rotation_cmd=rotation * Rotation.from_euler("z", 30, degrees=True))
    with pytest.raises(DataError, match=r"turned by Rz 30.00° .* by Rz 0.00° .*, 30.00° apart"):
        tp.fit_cell(right, turned, "registration")
    fitted = tp.fit_cell(cell_of(cell_text, fit="position"), turned_flange(turned, virtual), "registration")
    assert "30.00° apart: state the angles in [tool]" in fitted.arm_check.words


def turned_flange(samples: Samples, virtual) -> Samples:
    """Return the samples with wrists that differ, so that a tool can be fitted."""
    q = samples.q + np.radians(np.random.default_rng(0).uniform(-20, 20, samples.q.shape) * [0, 0, 0, 1, 1, 1])
    tf = virtual.robot.forward(q, tool=virtual.tf_flange_tool)
    turn = Rotation.from_matrix(tf[:, :3, :3]) * Rotation.from_euler("z", 30, degrees=True)
    return Samples(tf[:, :3, 3] + 100.0, q=q, p_cmd=np.round(tf[:, :3, 3], 2), rotation_cmd=turn, source="s.csv")


@pytest.mark.promise("A fitted measured point that is not the controller's tool is named beside it.")
def test_a_fitted_point_need_not_be_the_controllers_tool(virtual, shown, cell_text):
    other = turned_flange(shown, virtual)
    reflector = make_transform(translation=[110.0, 40.0, TRUE_Z])
    measured = replace(other, p_meas=virtual.robot.forward(other.q, tool=reflector)[:, :3, 3], rotation_cmd=None)
    words = tp.fit_cell(cell_of(cell_text, fit="position"), measured, "registration").arm_check.words
    assert "40.00 mm from it: the controller's tool is (110.00, 0.00, 360.00) mm" in words


@pytest.mark.promise("Without commanded positions fit, map, repr and report say that arm and tool were not checked.")
def test_what_was_not_checked_is_said(run, cell_text, bare, tmp_path, no_figures):
    from truepose.report import write_report
    from truepose.report.locale import load_locale

    tp.fit_cell(tp.Cell.from_toml(cell_text), bare, "registration").save(tmp_path / "bare.truepose")
    error_map = tp.load_map(tmp_path / "bare.truepose")
    assert not error_map.arm_check.checked
    said = repr(error_map).splitlines()
    assert said[1].endswith("arm and tool not checked")
    assert said[3].split() == ["samples", "80"]
    cell = tmp_path / "cell.toml"
    cell.write_text(cell_text)
    write_samples(tmp_path / "samples.csv", bare)
    done = run("fit", cell, tmp_path / "samples.csv", "--predictor", "registration", "--out", tmp_path / "m.truepose")
    assert "Arm and tool: The arm's model, its base and the tool were not checked" in done.out
    assert "truepose check-point" in done.out
    write_report(error_map, tmp_path / "report.html")
    assert load_locale("en")("cell.arm_not_checked") in unescape((tmp_path / "report.html").read_text(encoding="utf-8"))


@pytest.mark.promise("One taught point checks the arm's model and the tool, and what differs is named.")
def test_one_taught_point_is_compared(run, virtual, cell_text, tmp_path):
    q = np.radians([10.0, -80.0, 95.0, 20.0, 40.0, -30.0])
    tf = virtual.robot.forward(q[None], tool=virtual.tf_flange_tool)[0]
    right, wrong = cell_of(cell_text), cell_of(cell_text, z_mm=WRONG_Z)
    rotation = Rotation.from_matrix(tf[:3, :3])
    assert tp.check_point(right, q, tf[:3, 3], rotation).checked
    assert tp.check_point(wrong, q, tf[:3, 3], tool=1).checked
    with pytest.raises(DataError, match=r"5\.00 mm apart; .* tool is \(110\.00, 0\.00, 360\.00\) mm .* 365\.00\) mm"):
        tp.check_point(wrong, q, tf[:3, 3])
    with pytest.raises(DataError, match=r"an orientation 90.00° from that"):
        tp.check_point(right, q, tf[:3, 3], rotation * Rotation.from_euler("z", 90, degrees=True))
    file = tmp_path / "cell.toml"
    file.write_text(wrong.to_toml())
    joints, position = " ".join(map(str, np.rad2deg(q).round(4))), " ".join(f"{value:.2f}" for value in tf[:3, 3])
    angles = ", ".join(f"{value:.3f}" for value in tp.euler("kuka", rotation))
    arguments = ("check-point", file, "--joints", joints, "--position", position)
    assert "5.00 mm apart" in run(*arguments).failed()
    done = run(*arguments, "--tool", "1", "--angles", angles)
    assert done.code == 0, done.err
    assert "agree with one taught point within 0.0" in done.out
    assert "'1_0' is not a number" in run(*arguments[:2], "--joints", "1_0", *arguments[4:]).failed()
    assert "expected joints of shape (n, 6)" in run("check-point", file, "--joints", "1 2", *arguments[4:]).failed()


@pytest.mark.promise("Positions that the model itself computed, as in a plan, do not count as a check.")
def test_positions_of_the_model_prove_nothing(virtual, samples, cell_text, tmp_path):
    own = virtual.measure(virtual.design(30, seed=1))
    write_samples(tmp_path / "own.csv", own)
    for fit, one in (
        ("none", own),
        ("none", read_samples(tmp_path / "own.csv")),
        ("position", turned_flange(own, virtual)),
    ):
        if fit == "position":
            one = replace(one, p_cmd=virtual.robot.forward(one.q, tool=virtual.tf_flange_tool)[:, :3, 3])
        found = tp.fit_cell(cell_of(cell_text, fit=fit), one, "registration").arm_check
        assert not found.checked
        assert "the commanded positions are the model's own to the last digit" in found.words


@pytest.mark.promise("The measured UR10, whose positions are in another frame, is fitted, and the frame is named.")
def test_measured_robot_is_not_refused(ur10):
    samples = read_samples(ur10 / "samples.csv")
    cell = tp.Cell.model_validate({"robot": {"model": "universal-robots-ur10"}, "tool": {"fit": "position"}})
    found = tp.fit_cell(cell, samples, "registration")
    assert any("is turned by 180° about z in the controller's base" in fact.words for fact in found.facts)
