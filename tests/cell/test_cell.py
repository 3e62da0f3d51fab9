"""The cell file: what it means, what it refuses, and that it comes back as it was."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from truepose.cell import Cell, load_cell, template
from truepose.errors import FileError, RobotError
from truepose.robots import to_toml

KUKA = '[robot]\nmodel = "kuka-kr210-r2700-extra"\n'
ABB = '[robot]\nmodel = "abb-irb120"\n'
ROBOTS = ["kuka-kr10-r1100-sixx", "abb-irb120", "fanuc-m20ia", "universal-robots-ur10", "staubli-tx2-90"]


def cell(text: str) -> Cell:
    return Cell.from_toml(text)


def test_only_the_model_is_needed() -> None:
    described = cell(KUKA)
    np.testing.assert_array_equal(described.tf_flange_tool, np.eye(4))
    assert described.tracker.fit == "pose"
    assert described.tool.fit == "none"
    assert described.correction.on_guard == "refuse"
    assert described.config_dat is None


def test_kuka_angles() -> None:
    tf = cell(KUKA + "[tool]\nx_mm = 110\na_deg = 30.0\nb_deg = -20.0\nc_deg = 170.0").tf_flange_tool
    np.testing.assert_allclose(
        tf[:3, :3], Rotation.from_euler("ZYX", [30, -20, 170], degrees=True).as_matrix(), atol=1e-15
    )
    np.testing.assert_array_equal(tf[:3, 3], [110, 0, 0])


@pytest.mark.parametrize(
    ("model", "angles", "vector"),
    [
        ("abb-irb120", "q1 = 0.70710678\nq2 = 0.70710678\nq3 = 0.0\nq4 = 0.0", [np.pi / 2, 0, 0]),
        ("fanuc-m20ia", "w_deg = 0.0\np_deg = 0.0\nr_deg = 90.0", [0, 0, np.pi / 2]),
        ("universal-robots-ur10", "ry_rad = 1.5", [0, 1.5, 0]),
        ("staubli-tx2-90", "rx_deg = 90.0", [np.pi / 2, 0, 0]),
    ],
)
def test_other_makers_angles(model: str, angles: str, vector: list[float]) -> None:
    tf = cell(f'[robot]\nmodel = "{model}"\n[tool]\n{angles}').tf_flange_tool
    np.testing.assert_allclose(Rotation.from_matrix(tf[:3, :3]).as_rotvec(), vector, atol=1e-8)


def test_base_and_station_are_seen_from_each_other() -> None:
    described = cell(KUKA + "[base]\nx_mm = 1000\na_deg = 90\n[tracker]\nfit = false\nx_mm = 1000\ny_mm = 500")
    assert described.tracker.fit == "none"
    np.testing.assert_allclose(described.tf_base_tracker[:3, 3], [500, 0, 0], atol=1e-12)


def test_numbered_frames_and_paths_start_at_the_file(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(
        KUKA + '[frames]\nconfig_dat = "R1/$config.dat"\n[frames.tools.3]\nz_mm = 5\n[frames.bases.12]\nc_deg = 180'
    )
    described = load_cell(path)
    assert described.config_dat == tmp_path / "R1/$config.dat"
    assert set(described.tools) == {3}
    np.testing.assert_allclose(np.diag(described.bases[12]), [1, -1, -1, 1], atol=1e-12)


def test_robot_file_beside_the_cell_file(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(to_toml(cell(KUKA).load_robot()))
    (tmp_path / "cell.toml").write_text('[robot]\nmodel = "mine.toml"\n[tool]\na_deg = 90.0')
    assert load_cell(tmp_path / "cell.toml").load_robot().maker == "KUKA"


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (KUKA + "[tool]\nx_m = 0.1", 4, "[tool] x_m: unknown key; did you mean x_mm? Lengths are in mm."),
        (KUKA + "\n[tols]\nx_mm = 1.0", 4, "[tols]: unknown key; did you mean tool?"),
        (
            KUKA + "[tool]\nw_deg = 1.0",
            4,
            "[tool] w_deg: is not an angle of a kuka controller; expected a_deg, b_deg, c_deg",
        ),
        (KUKA + '[tool]\nx_mm = "3"', 4, "[tool] x_mm: should be a valid number, not '3'"),
        (KUKA + "[tool]\ny_mm = nan", 4, "[tool] y_mm: should be a finite number, not nan"),
        (KUKA + '[tool]\nfit = "pos"', 4, "[tool] fit: should be 'none', 'position' or 'pose', not 'pos'"),
        (KUKA + "[tracker]\nrange_um = 5\nstd_mm = 0.1", 5, "cannot be combined with range_um; state only one form"),
        (KUKA + "[frames.tools.3]\nx_m = 0.1", 4, "[frames.tools.3] x_m: unknown key; did you mean x_mm?"),
        (KUKA + "[frames.tools.a]\nx_m = 0.1", 4, "[frames.tools.a] x_m: unknown key; did you mean x_mm?"),
        (KUKA + "[frames.bases.1]\nq1 = 1.0", 4, "[frames.bases.1] q1: is not an angle of a kuka controller"),
        (KUKA + '[frames]\nconfigdat = "a"', 4, "did you mean config_dat?"),
        (KUKA + '[correction]\non_guard = "stop"', 4, "should be 'refuse', 'skip' or 'clip', not 'stop'"),
        (KUKA + "[correction]\nmax_std_mm = 0", 4, "should be greater than or equal to 0.000001, not 0"),
        (ABB + "[tool]\nq1 = 1.0", 4, "a quaternion needs all of q1, q2, q3, q4"),
        (ABB + "[tool]\nq1 = 1.0\nq2 = 1.0\nq3 = 0.0\nq4 = 0.0", 4, "has length 1.41421"),
        ('[robot]\nmodel = "kuka-kr210"', 2, "did you mean"),
        ('[robot]\nmodel = "absent.toml"', 2, "absent.toml: no such file"),
        ("[tool]\nx_mm = 0", None, "[robot]: is missing; `truepose init`"),
        ("[robot\nmodel = 3", 1, "is not TOML"),
    ],
)
def test_wrong_files_say_where_and_what(text: str, line: int | None, message: str) -> None:
    with pytest.raises(FileError, match=re.escape(message)) as caught:
        cell(text)
    assert caught.value.line == line
    assert "\n" not in str(caught.value)


def test_unknown_maker_takes_one_unambiguous_set(tmp_path: Path) -> None:
    text = to_toml(cell(KUKA).load_robot()).replace('maker = "KUKA"', 'maker = ""')
    (tmp_path / "mine.toml").write_text(text)
    own = '[robot]\nmodel = "mine.toml"\n[tool]\n'
    described = Cell.from_toml(own + "c_deg = 90.0", folder=tmp_path)
    np.testing.assert_allclose(described.tf_flange_tool[2, 1], 1.0)
    with pytest.raises(FileError, match="may be those of yaskawa or staubli"):
        Cell.from_toml(own + "rx_deg = 90.0", folder=tmp_path)
    with pytest.raises(FileError, match="mix controllers"):
        Cell.from_toml(own + "a_deg = 90.0\nw_deg = 1.0", folder=tmp_path)


def test_missing_file() -> None:
    with pytest.raises(FileError, match=r"nowhere\.toml: no such file"):
        load_cell("nowhere.toml")


def test_a_cell_does_not_change() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        cell(KUKA).tool.x_mm = 3.0  # type: ignore[misc]


@pytest.mark.parametrize("robot", ROBOTS)
def test_template_loads_as_it_is_and_with_its_comments_removed(robot: str) -> None:
    text = template(robot)
    described = cell(text)
    assert described.robot.model == robot
    assert (described.tool.fit, described.tracker.fit) == ("position", "pose")
    np.testing.assert_allclose(described.tf_flange_tool, np.eye(4), atol=1e-15)
    active = re.sub(r"^# (?=\[|\w+ = )", "", text, flags=re.MULTILINE)
    alternatives = cell(re.sub(r"^std_mm.*$", "", active, flags=re.MULTILINE))
    assert alternatives.tracker.angle_um == 7.5
    assert alternatives.bases.keys() == {1}


def test_template_of_unknown_robot() -> None:
    with pytest.raises(RobotError, match="did you mean"):
        template("kuka-kr11")


numbers = st.floats(-5000, 5000)


@given(
    x=numbers, angle=st.floats(-180, 180), fit=st.sampled_from(["none", "position", "pose"]), number=st.integers(1, 64)
)
def test_toml_comes_back(x: float, angle: float, fit: str, number: int) -> None:
    described = cell(
        KUKA
        + f'[tool]\nx_mm = {x!r}\nb_deg = {angle!r}\nfit = "{fit}"\n[frames]\nconfig_dat = "Zelle ü/\\"$config.dat"\n'
        + f"[frames.tools.{number}]\na_deg = {angle!r}\n[payload]\nmass_kg = 12.5\n[tracker]\nrobust = false"
    )
    again = cell(described.to_toml())
    assert again == described
    np.testing.assert_array_equal(again.tools[number], described.tools[number])


def test_reading_std_along_and_across_the_beam() -> None:
    noise = cell(KUKA + "[tracker]\nrange_um = 5\nrange_um_per_m = 0.5\nangle_um = 7.5\nangle_um_per_m = 3").tracker
    std = noise.reading_std(np.array([[4000.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert std is not None
    np.testing.assert_allclose(std, [[7e-3, 19.5e-3, 19.5e-3], [7.5e-3, 7.5e-3, 7.5e-3]])
    assert cell(KUKA).tracker.reading_std(np.zeros((2, 3))) is None
    constant = cell(KUKA + "[tracker]\nstd_mm = 0.02").tracker.reading_std(np.zeros((2, 3)))
    np.testing.assert_array_equal(constant, np.full((2, 3), 0.02))


def test_frames_have_numbers_or_names() -> None:
    cell = Cell.from_toml(ABB + '[frames.tools.tGrip]\nx_mm = 5\n[frames.bases.2]\n[frames.bases."a b"]\ny_mm = 1')
    assert (list(cell.tools), list(cell.bases)) == (["tGrip"], [2, "a b"])
    again = Cell.from_toml(cell.to_toml())
    assert (list(again.tools), list(again.bases)) == (["tGrip"], ["a b"])  # an empty pose is the default


def test_repr_fits_a_screen() -> None:
    described = cell(KUKA + '[tool]\nz_mm = 360.0\nfit = "position"\n[payload]\nmass_kg = 120.0')
    assert repr(described) == str(described)
    assert repr(described).startswith("<Cell of kuka-kr210-r2700-extra: tool at (0, 0, 360) mm, fit position; ")
    assert "payload 120 kg" in repr(described)
    assert len(repr(described)) < 240


REPORT = """
[report]
company = "Müller & Söhne"
logo = "logo.svg"
measured = 2026-03-31
tracker_calibration_due = "2026-12-31"
temperature_C = 20.5
tolerance_mm = 0.3
"""


def test_facts_of_the_report(tmp_path) -> None:
    cell = Cell.from_toml(template("kuka-kr150-2") + REPORT, folder=tmp_path)
    assert (cell.report.company, str(cell.report.measured)) == ("Müller & Söhne", "2026-03-31")
    assert (cell.tolerance_mm, cell.logo) == (0.3, tmp_path / "logo.svg")
    assert Cell.from_toml(cell.to_toml()).report == cell.report
    again = Cell.model_validate(cell.model_dump(mode="json", exclude_unset=True))
    assert again.report == cell.report


def test_tolerance_of_the_report_is_that_of_the_correction() -> None:
    text = '[robot]\nmodel = "kuka-kr150-2"\n[correction]\ntolerance_mm = 0.2\n[report]\n'
    assert Cell.from_toml(text).tolerance_mm == 0.2
    with pytest.raises(FileError, match=r"\[report\] tolerance_mm: states 0.3 mm, but \[correction\] states 0.2 mm"):
        Cell.from_toml(text + "tolerance_mm = 0.3\n")


@pytest.mark.parametrize("value", ["20260331", '"31.3.2026"', "2026-03-31T10:00:00", "true"])
def test_dates_of_the_report_are_dates(value: str) -> None:
    text = f'[robot]\nmodel = "kuka-kr150-2"\n[report]\nmeasured = {value}\n'
    with pytest.raises(FileError, match=r"toml:4: \[report\] measured: expected a date such as 2026-03-31, got"):
        Cell.from_toml(text)


M10IA = '[robot]\nmodel = "fanuc-m10ia"\n'
STATED = "world_height_mm = 450.0\n"
REGION = "[region]\nx_mm = 900.0\nsize_mm = [100.0, 100.0, 100.0]\nhome_deg = [0, 0, 0, 0, -90, 0]\n"


@pytest.mark.parametrize(
    ("table", "named"),
    [
        (REGION, r"\[region\]"),
        ("[obstacles.table]\nx_mm = [0, 1]\ny_mm = [0, 1]\nz_mm = [0, 1]\n", r"\[obstacles\.table\]"),
        ("[frames.bases.1]\nz_mm = 900.0\n", r"\[frames\.bases\.1\]"),
        ('[tracker]\nfit = "none"\nz_mm = 900.0\n', r"\[base\], \[tracker\]"),
    ],
)
def test_poses_relative_to_a_base_above_the_mounting_face_are_confirmed_once(table: str, named: str) -> None:
    """A cell file of version 0.2 counts from the mounting face; taken as it is, it would be wrong by this height."""
    match = rf"world_height_mm: is missing: .* is its controller's world, 450 mm above .*; check {named}, .* = 450"
    with pytest.raises(FileError, match=match):
        cell(M10IA + table)
    assert cell(M10IA + STATED + table).robot.world_height_mm == 450.0
    assert cell(KUKA + table).robot.world_height_mm is None


def test_nothing_is_asked_where_nothing_is_relative_to_the_base() -> None:
    cell(M10IA + "[tool]\nz_mm = 100.0\n[base]\nz_mm = 5.0\n[frames.tools.1]\nz_mm = 1.0\n")
    cell(M10IA + STATED + REGION + "frame = 1\n[frames.bases.1]\nz_mm = 900.0\n")


def test_the_height_counts_once() -> None:
    with pytest.raises(FileError, match=r"cell\.toml:4: .*450 mm once more: .*remove \[frames\.bases\.0\]"):
        cell(M10IA + STATED + "[frames.bases.0]\nz_mm = 450.0\n")
    cell(M10IA + STATED + "[frames.bases.0]\nz_mm = 200.0\n")
    with pytest.raises(FileError, match=r"\[robot\] world_height_mm: .* 450 mm above the mounting face, not 440 mm"):
        cell(M10IA + "world_height_mm = 440.0\n")
    with pytest.raises(FileError, match="the base of kuka-kr210-r2700-extra is where its file puts it; remove this"):
        cell(KUKA + STATED)
