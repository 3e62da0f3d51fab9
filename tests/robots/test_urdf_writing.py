"""Nominal and calibrated arms, written as URDF and as TOML and read back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from truepose.robots import list_robots, load_robot, to_mdh


@pytest.mark.parametrize("name", list_robots())
@pytest.mark.parametrize("kind", ["urdf", "toml"])
def test_round_trip(name, kind, rng, tmp_path):
    nominal = load_robot(name)
    size = {"alpha": 3e-4, "offset": 3e-4, "beta": 3e-4, "a": 0.3, "d": 0.3}
    mdh = to_mdh(nominal)
    calibrated = replace(mdh, **{key: getattr(mdh, key) + rng.normal(scale=s, size=6) for key, s in size.items()})
    q = rng.uniform(-np.pi, np.pi, (500, 6))
    for robot in (nominal, calibrated):
        path = tmp_path / f"arm.{kind}"
        path.write_text(robot.to_urdf() if kind == "urdf" else robot.to_toml(), "utf-8")
        again = load_robot(path)
        np.testing.assert_allclose(again.forward(q), robot.forward(q), atol=1e-9)
        np.testing.assert_allclose(again.limits, robot.limits)


def test_joints_without_limits_and_names_with_signs(tmp_path):
    robot = replace(load_robot("kuka-kr150-2"), name="a <b> & c", limits=np.tile([-np.inf, np.inf], (6, 1)))
    path = tmp_path / "arm.urdf"
    path.write_text(robot.to_urdf(), "utf-8")
    again = load_robot(path)
    assert again.name == robot.name
    assert np.isinf(again.limits).all()
