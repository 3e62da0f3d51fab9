"""Robot files of a user's own: the template, tables of D-H parameters, and the keys that people expect."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from truepose.errors import FileError, RobotError
from truepose.robots import (
    DataSheet,
    Robot,
    list_robots,
    load_robot,
    max_reach,
    parse_robot,
    parse_robot_csv,
    robot_template,
    to_toml,
)
from truepose.robots.io.plausible import check_units

UR5E = """# Universal Robots, DH parameters for calculations of kinematics and dynamics
# convention = dh
# maker: Universal Robots
joint;alpha_rad;a_m;d_m;offset_deg;sign;lower_deg;upper_deg
1;1.5707963267948966;0;0.1625;0;1;-360;360
2;0;-0.425;0;0;1;-360;360
3;0;-0.3922;0;0;1;-360;360
4;1.5707963267948966;0;0.1333;0;1;-360;360
5;-1.5707963267948966;0;0.0997;0;1;-360;360
6;0;0;0.0996;0;1;-360;360
"""


def test_the_template_is_a_robot_and_names_every_key() -> None:
    robot = parse_robot(robot_template())
    assert robot.data_sheet is not None
    assert max_reach(robot, robot.data_sheet.reach_at) == pytest.approx(robot.data_sheet.reach_mm, abs=0.1)
    uncommented = re.sub(
        r"^# (?=\[(base|flange)\]|([xyz]_mm|quaternion_wxyz|beta_deg) = )", "", robot_template(), flags=re.M
    )
    np.testing.assert_allclose(parse_robot(uncommented).fixed, robot.fixed)


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("theta_deg", r'unknown key "theta_deg" in \[kinematics\]; use "offset_deg", the angle theta'),
        ("theta", 'use "offset_deg"'),
        ("r_mm", 'use "a_mm"'),
        ("alpha_rad", 'use "alpha_deg", in degrees'),
        ("d_m", 'use "d_mm", in mm'),
        ("type", 'use "convention"'),
        ("joints", "state one list for each column in"),
        ("lower_deg", r"it belongs in \[limits\]"),
        ("maker", "it belongs above the tables"),
    ],
)
def test_the_key_of_another_notation_is_answered_with_the_right_one(name: str, match: str) -> None:
    with pytest.raises(FileError, match=match):
        parse_robot(robot_template().replace("[limits]", f"{name} = [1.0]\n[limits]", 1))


def test_a_table_of_dh_parameters(tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / "ours.csv"
    path.write_text(UR5E, "utf-8")
    robot, library = load_robot(path), load_robot("universal-robots-ur5e")
    q = rng.uniform(-3, 3, (20, 6))
    np.testing.assert_allclose(robot.forward(q), library.forward(q), atol=1e-9)
    np.testing.assert_allclose(robot.limits, library.limits)
    assert (robot.name, robot.maker, robot.convention) == ("ours", "Universal Robots", "dh")


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("# convention = dh", "#", 'state the convention in a line above the table: "# convention = dh"'),
        ("convention = dh", "convention = khalil", 'unknown convention "khalil"; expected "mdh"'),
        ("offset_deg", "theta_deg", 'unknown key "theta_deg" in the header; use "offset_deg"'),
        ("a_m;", "a_ft;", 'unknown key "a_ft" in the header; did you mean'),
        ("d_m;", "a_mm;", 'has two columns for "a_mm"; remove one'),
        ("0.1625", "?", "d_m is '\\?', which is not a number"),
        (";lower_deg", ";beta_deg", "limits needs both lower_deg and upper_deg"),
        ("offset_deg", "theta [rad]", r'unknown key "theta \[rad\]" in the header; use "offset_deg"'),
        ("d_m;", "d;", 'unknown key "d" in the header; use "d_mm", with its unit'),
        ("3;0;-0.3922;0;0;1;-360;360\n", "", r"dh\.csv:7: is the row of joint 4; expected joint 3: is a row missing"),
        ("1;1.5707963267948966;0;0.1625;0;1;-360;360\n", "", r"dh\.csv:5: is the row of joint 2; expected joint 1"),
        ("\n2;0;-0.425", "\n3;0;-0.425", r"dh\.csv:6: is the row of joint 3; expected joint 2"),
        ("-360;360\n2", "360;-360\n2", "joint 1: the lower limit 360° is not below the upper -360°"),
        ("1.5707963267948966", "pi/0", "alpha_rad is 'pi/0', which is not a number"),
    ],
)
def test_invalid_tables_are_refused(old: str, new: str, match: str) -> None:
    assert old in UR5E
    with pytest.raises(FileError, match=match):
        parse_robot_csv(UR5E.replace(old, new, 1), path="dh.csv")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("alpha_rad;a_m;d_m;offset_deg", "Alpha [rad];a (m);d [m];offset [°]"),
        ("joint;", "i;"),
        ("convention = dh", "Convention: DH"),
        ("\n1;1.5707963267948966;", "\nbase;PI/2;"),
        ("-1.5707963267948966", "-π/2"),
        ("5;-1.5707963267948966", "5; - 0.5*pi"),
    ],
)
def test_a_table_as_papers_print_it(old: str, new: str, rng: np.random.Generator) -> None:
    assert old in UR5E
    q = rng.uniform(-3, 3, (20, 6))
    robot = parse_robot_csv(UR5E.replace(old, new), path="dh.csv")
    np.testing.assert_allclose(robot.forward(q), parse_robot_csv(UR5E).forward(q), atol=1e-9)


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("a.csv", UR5E.replace("alpha_rad", "alpha_deg"), "alpha of joint 1 is 1.5708 degrees; is it in radians"),
        ("a.csv", UR5E.replace("a_m;d_m", "a_mm;d_mm"), "all links together are 1.3123 mm long; are they in metres"),
        ("a.csv", UR5E.replace("0.425", "425"), "all links together are 425.887 m long; are they in another unit"),
        ("a.csv", UR5E.replace("360", "6.2832"), "no joint moves farther than 6.2832 degrees; are the limits in rad"),
        ("a.toml", to_toml(Robot("a", alpha=[0], a=[250], d=[0], offset=[np.deg2rad(-1.57)])), "offset of joint 1 is"),
    ],
)
def test_units_that_contradict_their_numbers(name: str, text: str, match: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text, "utf-8")
    with pytest.raises(FileError, match=match):
        load_robot(tmp_path / name)


def test_every_robot_of_the_library_has_plausible_units() -> None:
    for name in list_robots():
        check_units(load_robot(name), name)


def test_an_arm_with_small_twists_is_not_in_radians() -> None:
    check_units(Robot("planar", alpha=[0, 0], a=[300.0, 200.0], d=[0, 0], offset=[0, np.deg2rad(1.2)]), "planar.toml")


def test_the_data_sheet_survives_the_text() -> None:
    sheet = DataSheet(reach_mm=901.5, reach_at="flange", repeatability_mm=0.02)
    arm = Robot("one", alpha=[0], a=[250.0], d=[0], offset=[0], data_sheet=sheet)
    assert parse_robot(to_toml(arm)).data_sheet == sheet
    assert str(sheet) == "reach 901.5 mm (flange), repeatability 0.02 mm"
    assert str(DataSheet()) == "nothing stated"


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("reach_mm = -1", r"arm\.toml: data_sheet\.reach_mm must be above 0, got -1"),
        ('reach_mm = "900"', "data_sheet.reach_mm must be a number; got '900'"),
        ('reach_at = "elbow"', 'reach_at must be wrist, flange, unstated; got "elbow"'),
        ("range_mm = 900", r'unknown key "range_mm" in \[data_sheet\]; did you mean "reach_mm"'),
    ],
)
def test_invalid_data_sheets_are_refused(line: str, match: str) -> None:
    text = to_toml(Robot("one", alpha=[0], a=[250.0], d=[0], offset=[0])).split("[limits]")[0]
    with pytest.raises(FileError, match=match):
        parse_robot(f"{text}\n[data_sheet]\n{line}\n", path="arm.toml")


def test_reach_is_limited_by_the_joints_and_needs_six_of_them() -> None:
    extra = load_robot("kuka-kr210-r2700-extra")  # joint 2 stops at -5 deg, the arm is not quite stretched
    assert max_reach(extra) == pytest.approx(350 + 1150 * np.cos(np.deg2rad(5)) + np.hypot(1200, 41), abs=0.01)
    assert max_reach(extra, "flange") == pytest.approx(max_reach(extra) + 215)
    with pytest.raises(RobotError, match="six joints, the arm has 1"):
        max_reach(Robot("one", alpha=[0], a=[250.0], d=[0], offset=[0]))
    with pytest.raises(RobotError, match='at must be "wrist" or "flange"'):
        max_reach(extra, "unstated")
