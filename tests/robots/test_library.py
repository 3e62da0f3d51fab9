"""The library's files against published positions, the file format both ways, and bad files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from truepose.errors import FileError, RobotError
from truepose.robots import Robot, list_robots, load_robot, parse_robot, to_toml

FIXED_NAMES = [
    "kuka-kr150-2",
    "kuka-kr210-r2700-extra",
    "kuka-kr10-r1100-sixx",
    "abb-irb120",
    "abb-irb1600-10-145",
    "abb-irb6640-185-280",
    "abb-irb6700-200-260",
    "fanuc-m20ia",
    "fanuc-lrmate200id",
    "fanuc-m900ia-260l",
    "staubli-tx2-90",
    "universal-robots-ur5",
    "universal-robots-ur5e",
    "universal-robots-ur10",
    "universal-robots-ur10e",
]


def test_all_promised_names_are_there() -> None:
    assert list_robots() == sorted(FIXED_NAMES)


@pytest.mark.parametrize("name", FIXED_NAMES)
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
        ("fanuc-m20ia", [0, 0, 0, 0, 0, 0], [150 + 835 + 100, 0, 525 + 790 + 250], [1, 0, 0]),
        ("staubli-tx2-90", [0, 0, 0, 0, 0, 0], [50, 50, 478 + 425 + 425 + 100], [0, 0, 1]),
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


@pytest.mark.parametrize("name", FIXED_NAMES)
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
        ("KUKA-KR150-2", "did you mean kuka-kr150-2"),
        ("zzz", "the library has abb-irb120, "),
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
