"""The library's files against published positions, the file format both ways, and bad files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.robots.arms import FIRST

import truepose.robots
from truepose.errors import FileError, RobotError
from truepose.geometry import euler
from truepose.robots import Robot, list_robots, load_robot, max_reach, nearest_branch, parse_robot, to_toml
from truepose.robots.inverse.axes import Axes

LIBRARY = list_robots()
FOLDER = Path(truepose.robots.__file__).parent / "library"

UP, DOWN, X, Y = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, 1, 0]])
ALONG = ([UP, Y, Y, UP, Y, UP], [X, Y])  # arm upright at zero
RAISED = ([UP, -Y, -Y, -UP, -Y, -UP], [X, -Y])  # joint 2 counts from the horizontal
ZERO = {  # the axes of positive turn and the flange's x and y at zero joints, from the descriptions that the files name
    "KUKA": ([DOWN, Y, Y, -X, Y, -X], [DOWN, Y]),
    "ABB": ([UP, Y, Y, X, Y, X], [DOWN, Y]),
    "FANUC": ([UP, Y, -Y, -X, -Y, -X], [UP, -Y]),
    "Yaskawa": ([UP, Y, -Y, -X, -Y, -X], [UP, -Y]),
    "Stäubli": ALONG,
    "Doosan": ALONG,
    "Mitsubishi": ALONG,
    "Denso": (ALONG[0], [-X, -Y]),
    "Kawasaki": ([DOWN, -X, X, UP, X, UP], [X, Y]),
    "Comau": ([DOWN, Y, -Y, DOWN, Y, DOWN], [X, Y]),
    "Epson": ([UP, X, X, -Y, X, -Y], [UP, X]),
    "Nachi": RAISED,
    "Hyundai": RAISED,
    "Universal Robots": ([UP, -Y, -Y, -Y, DOWN, -Y], [X, UP]),
}


def test_the_library_has_78_arms_of_14_makers() -> None:
    assert set(FIRST) < set(LIBRARY)
    assert len(LIBRARY) == 78
    assert {load_robot(name).maker for name in LIBRARY} == ZERO.keys()


@pytest.mark.parametrize("name", LIBRARY)
@pytest.mark.sampled(8)
def test_the_reach_is_that_of_the_data_sheet(name: str) -> None:
    """To half of its last digit and 0.3 %, which the rounding of dimensions and the makers' reading of "reach" need."""
    robot = load_robot(name)
    sheet = robot.data_sheet
    assert sheet is not None
    assert sheet.reach_mm is not None
    tolerance = sheet.reach_rounding_mm / 2 + 0.003 * sheet.reach_mm
    if sheet.reach_at == "unstated":  # Universal Robots: a rounded working radius, between wrist and flange
        assert max_reach(robot, "wrist") <= sheet.reach_mm <= max_reach(robot, "flange")
    else:
        assert max_reach(robot, sheet.reach_at) == pytest.approx(sheet.reach_mm, abs=tolerance)


def test_repeatability_is_stated_with_its_source() -> None:
    stated = []
    for name in LIBRARY:
        sheet = load_robot(name).data_sheet
        if sheet is not None and sheet.repeatability_mm is not None:
            assert 0.005 <= sheet.repeatability_mm <= 0.3, name
            assert "repeatability: " in (FOLDER / f"{name}.toml").read_text("utf-8"), name
            stated.append(name)
    assert len(stated) == 13


@pytest.mark.parametrize("name", LIBRARY)
def test_axes_and_flange_at_zero_are_those_of_the_maker(name: str) -> None:
    robot = load_robot(name)
    axes = Axes.of(robot)
    directions, flange = ZERO[robot.maker]
    np.testing.assert_allclose(axes.direction, directions, atol=1e-12)
    np.testing.assert_allclose(axes.tf_base_flange[:3, :2].T, flange, atol=1e-12)


@pytest.mark.sampled(20)
@pytest.mark.parametrize("name", LIBRARY)
def test_inverse_leads_back(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    q = rng.uniform(*robot.limits.T, size=(10, 6))
    poses = robot.forward(q)
    solutions = robot.inverse(poses)
    exists = ~np.isnan(solutions).any(axis=-1)
    back = robot.forward(solutions[exists])
    np.testing.assert_allclose(back, np.repeat(poses, exists.sum(axis=1), axis=0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(nearest_branch(solutions, q), q, atol=1e-6)


def test_fanuc_displays_w_180_p_minus_90_r_0_at_zero() -> None:
    tf = load_robot("fanuc-m20ia").forward(np.zeros(6))
    np.testing.assert_allclose(tf[:3, :3], euler("fanuc", np.array([180.0, -90.0, 0.0])).as_matrix(), atol=1e-12)


@pytest.mark.parametrize("name", LIBRARY)
def test_each_robot_is_complete(name: str) -> None:
    robot = load_robot(name)
    assert robot.name == name
    assert robot.dof == 6
    assert robot.maker
    assert robot.model
    assert robot.source
    assert np.isfinite(robot.limits).all()


@pytest.mark.parametrize(
    ("name", "q_deg", "p", "z"),
    [  # worked by hand from the dimensions: arm stretched forward, or upper arm up and forearm forward
        ("kuka-kr150-2", [0, 0, 0, 0, 0, 0], [350 + 1250 + 1100 + 230, 0, 750 - 55], [1, 0, 0]),
        ("kuka-kr150-2", [0, -90, 90, 0, 0, 0], [350 + 1100 + 230, 0, 750 + 1250 - 55], [1, 0, 0]),
        ("kuka-kr10-r1100-sixx", [90, -90, 90, 0, 0, 0], [0, -(25 + 515 + 80), 400 + 560 + 35], [0, -1, 0]),
        ("abb-irb120", [0, 0, 0, 0, 0, 0], [302 + 72, 0, 290 + 270 + 70], [1, 0, 0]),
        ("abb-irb6640-185-280", [90, 0, 0, 0, 0, 0], [0, 320 + 1392 + 200, 780 + 1075 + 200], [0, 1, 0]),
        ("fanuc-m20ia", [0, 0, 0, 0, 0, 0], [150 + 835 + 100, 0, 790 + 250], [1, 0, 0]),
        ("denso-vs-060", [0, 0, 0, 0, 0, 0], [-10, 0, 181.5 + 163.5 + 305 + 164.5 + 135.5 + 70], [0, 0, 1]),
        ("denso-vs-087", [0, 0, 0, 0, 0, 0], [30 - 20, 0, 2 * 197.5 + 445 + 287 + 143 + 80], [0, 0, 1]),
        ("staubli-tx2-90", [0, 0, 0, 0, 0, 0], [50, 50, 425 + 425 + 100], [0, 0, 1]),
        ("universal-robots-ur5", [0, 0, 0, 0, 0, 0], [-425 - 392.25, -109.15 - 82.3, 89.159 - 94.65], [0, -1, 0]),
    ],
)
def test_flange_where_the_drawing_puts_it(name: str, q_deg: list[float], p: list[float], z: list[float]) -> None:
    tf = load_robot(name).forward(np.deg2rad(q_deg))
    np.testing.assert_allclose(tf[:3, 3], p, atol=1e-9)
    np.testing.assert_allclose(tf[:3, 2], z, atol=1e-12)


def test_ur10_agrees_with_the_craig_table_of_the_measurements(ur10: Path, rng: np.random.Generator) -> None:
    text = (ur10 / "README.md").read_text("utf-8")
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")
    ]
    alpha, a, d = np.array([row[1:] for row in cells if row[0] in "123456"], dtype=float).T
    craig = Robot("craig", alpha=np.deg2rad(alpha), a=a, d=d, offset=np.zeros(6))
    q = rng.uniform(-np.pi, np.pi, (100, 6))
    np.testing.assert_allclose(load_robot("universal-robots-ur10").forward(q), craig.forward(q), atol=1e-9)


@pytest.mark.sampled(20)
@pytest.mark.parametrize("name", LIBRARY)
def test_text_and_back(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    path = tmp_path / "arm.toml"
    path.write_text(to_toml(robot), "utf-8")
    again = load_robot(path)
    q = rng.uniform(-np.pi, np.pi, (20, 6))
    np.testing.assert_allclose(again.forward(q), robot.forward(q), atol=1e-9)
    np.testing.assert_allclose(again.limits, robot.limits, atol=1e-12)
    assert (again.name, again.maker, again.model, again.source) == (robot.name, robot.maker, robot.model, robot.source)


def test_base_flange_and_no_limits_survive_the_text(rng: np.random.Generator) -> None:
    tilted = np.array([[0, -1, 0, 10.5], [1, 0, 0, -2], [0, 0, 1, 1e-3], [0, 0, 0, 1]], dtype=float)
    robot = Robot(
        'a "strange"\\\n name',
        alpha=rng.normal(size=3),
        a=rng.normal(size=3),
        d=rng.normal(size=3),
        offset=rng.normal(size=3),
        beta=rng.normal(size=3),
        tf_base_first=tilted,
        tf_last_flange=tilted,
    )
    again = parse_robot(to_toml(robot))
    assert again.name == robot.name
    assert np.isinf(again.limits).all()
    np.testing.assert_allclose(again.fixed, robot.fixed, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("kuka-kr150", "did you mean kuka-kr150-2"),
        ("irb2600", "did you mean abb-irb2600-12-165 or abb-irb2600-12-185"),
        ("kuka-kr210-r2700", "did you mean kuka-kr210-r2700-extra"),
        ("KUKA-KR150-2", "did you mean kuka-kr150-2"),
        ("zzz", r"`truepose robots` \(list_robots\(\)\) lists the 78 names of the library"),
        ("arm.urdf.xacro", "expand xacro first"),
    ],
)
def test_unknown_robot(name: str, match: str) -> None:
    with pytest.raises(RobotError, match=match):
        load_robot(name)


def test_missing_file() -> None:
    with pytest.raises(FileError, match=r"nowhere\.toml: no such file"):
        load_robot("nowhere.toml")


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("alpha_deg", "alfa_deg", r'unknown key "alfa_deg" in \[kinematics\]; did you mean "alpha_deg"'),
        ("maker", "makers", 'unknown key "makers"; did you mean "maker"'),
        ("a_mm", "# a_mm", "kinematics.a_mm is missing"),
        ("a_mm = [", "a_mm = [1.0, ", "kinematics.a_mm must be a list of 6 numbers"),
        ("a_mm = [0.0", "a_mm = ['0'", "kinematics.a_mm must be a list of 6 numbers"),
        ("upper_deg", "# upper_deg", "limits needs both lower_deg and upper_deg"),
        ("name = ", "name = 3 #", "expected name ="),
        ('"mdh"', '"hdm"', 'unknown convention "hdm"'),
        ("[limits]", "limits]", "is not TOML"),
        ("[limits]", "[base]\nx_mm = nan\n[limits]", "base: tf_base_first|NaN"),
        ("[limits]", "[flange]\nquaternion_wxyz = [0, 0, 0, 0]\n[limits]", "flange: abb orientation .* has length 0"),
    ],
)
def test_invalid_files_are_refused(old: str, new: str, match: str) -> None:
    text = to_toml(load_robot("kuka-kr150-2"))
    assert old in text
    with pytest.raises(FileError, match=rf"arm\.toml(:15)?: .*{match}"):
        parse_robot(text.replace(old, new, 1), path="arm.toml")
