"""Joints as a controller shows them, and those of the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.errors import FileError, RobotError
from truepose.robots import Robot, list_robots, load_robot, parse_robot, robot_template, shown_joints, to_mdh, to_toml

FILE = robot_template()


def stating(value: str) -> str:
    return FILE.replace("[limits]", f"coupling = {value}\n[limits]", 1)


@pytest.mark.parametrize("value", ["[]", "[[3, 2, 1.0]]", "[[3, 2, 1], [6, 5, -0.0125], [6, 4, 0.5], [5, 4, 0.25]]"])
def test_a_coupling_is_read_and_written(value: str) -> None:
    robot = parse_robot(stating(value))
    assert robot.coupling is not None
    again = parse_robot(to_toml(robot))
    assert again.coupling == robot.coupling == parse_robot(to_toml(to_mdh(robot))).coupling
    assert [list(row) for row in robot.coupling] == eval(value)
    assert ("coupling" in str(robot)) == (value != "[]")


def test_without_the_key_it_is_the_makers() -> None:
    assert parse_robot(FILE).coupling is None
    assert "coupling" not in to_toml(parse_robot(FILE))
    for name in list_robots():
        robot = load_robot(name)
        assert shown_joints(robot).coupling == (((3, 2, 1.0),) if robot.maker == "FANUC" else ())
    fanuc = load_robot("fanuc-m20ia")
    assert shown_joints(replace(fanuc, coupling=[])).coupling == ()
    assert shown_joints(fanuc, ground=False).coupling == ()
    lying = replace(fanuc, offset=np.zeros(6))
    with pytest.raises(RobotError, match=r"J3 from the ground, and the upper arm .* state coupling in"):
        shown_joints(lying)
    assert shown_joints(replace(lying, coupling=[[3, 2, 1.0]])).coupling == ((3, 2, 1.0),)


def test_a_row_adds_a_shown_joint() -> None:
    robot = replace(load_robot("staubli-tx2-90"), coupling=[[6, 5, -0.5], [5, 4, 2.0]])
    shown = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    np.testing.assert_array_equal(shown_joints(robot).to_model(shown), [1.0, 2.0, 3.0, 4.0, 13.0, 3.5])


@given(st.data())
def test_both_directions_are_inverse(data: st.DataObject) -> None:
    dof = data.draw(st.integers(2, 7))
    order = data.draw(st.permutations(range(1, dof + 1)))
    factor = st.floats(-3.0, 3.0).filter(lambda x: abs(x) > 1e-3)
    rows = [[order[i], order[k], data.draw(factor)] for i in range(dof) for k in range(i) if data.draw(st.booleans())]
    arm = Robot("any", alpha=np.zeros(dof), a=np.ones(dof), d=np.zeros(dof), offset=np.zeros(dof), coupling=rows)
    q = np.array(data.draw(st.lists(st.floats(-180.0, 180.0), min_size=dof, max_size=dof)))
    shown = shown_joints(arm)
    np.testing.assert_allclose(shown.to_model(shown.from_model(q)), q, atol=1e-7)
    untouched = [j - 1 for j in order if j not in [row[0] for row in rows]]
    np.testing.assert_array_equal(shown.from_model(q)[untouched], q[untouched])


@pytest.mark.parametrize(
    ("value", "match"),
    [
        ("[[3, 3, 1.0]]", "joint 3 is coupled with itself; state its direction in sign"),
        ("[[3, 7, 1.0]]", "there is no joint 7; the arm has joints 1 to 6"),
        ("[[0, 2, 1.0]]", "there is no joint 0"),
        ("[[2.5, 2, 1.0]]", "there is no joint 2.5"),
        ("[[3, 2, 1.0], [2, 3, 0.5]]", "joints 2, 3 depend on each other in a circle"),
        ("[[4, 5, 1.0], [5, 6, 1.0], [6, 4, 1.0], [3, 2, 1.0]]", "joints 4, 5, 6 depend on each other"),
        ("[[3, 2, nan]]", "the factor of joints 3 and 2 is nan; expected a finite number"),
        ("[[3, 2, inf]]", "kinematics.coupling must be|is inf; expected a finite number"),
        ("[[3, 2, 0.0]]", "is 0; expected a finite number that is not 0; leave the row out"),
        ("[[3, 2, 1.0], [3, 2, 1.0]]", "joints 3 and 2 have two rows; keep one"),
        ("[[3, 2]]", r"kinematics.coupling must be a list of rows \[joint, other joint, factor\]"),
        ("[3, 2, 1.0]", "kinematics.coupling must be a list of rows"),
        ('[["J3", "J2", 1.0]]', "kinematics.coupling must be a list of rows"),
        ("1.0", "kinematics.coupling must be a list of rows"),
    ],
)
def test_couplings_that_cannot_be(value: str, match: str) -> None:
    with pytest.raises(FileError, match=match):
        parse_robot(stating(value))


def test_rows_of_python_are_checked_too() -> None:
    with pytest.raises(RobotError, match=r"arm: coupling: expected rows \[joint, other joint, factor\]"):
        Robot("arm", alpha=[0, 0], a=[0, 300], d=[0, 0], offset=[0, 0], coupling=[[2, 1]])
