"""Any chain as modified D-H with Hayati's beta: the same poses, and parameters that stay in bounds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.tiers import examples

from truepose.geometry import make_transform
from truepose.robots import Robot, list_robots, load_robot, to_mdh

UR = [name for name in list_robots() if name.startswith("universal-robots")]


@settings(max_examples=examples(100))
@given(seed=st.integers(0, 2**32 - 1), dof=st.integers(1, 8), convention=st.sampled_from(["mdh", "dh"]))
def test_poses_are_kept(seed: int, dof: int, convention: str) -> None:
    rng = np.random.default_rng(seed)
    base, flange = make_transform(Rotation.random(2, rng=rng), rng.normal(scale=100, size=(2, 3)))
    robot = Robot(
        "random",
        alpha=rng.choice([0, np.pi / 2, -np.pi / 2, np.pi, 1.0, 1e-5, 1e-13], dof),
        a=rng.choice([0, 1.0, -500.0], dof),
        d=rng.choice([0, 1.0], dof) * rng.normal(scale=300, size=dof),
        offset=rng.normal(size=dof),
        beta=rng.choice([0, 1e-3, 1e-9], dof) * (convention == "mdh"),
        sign=rng.choice([-1.0, 1.0], dof),
        convention=convention,  # type: ignore[arg-type]
        tf_base_first=base,
        tf_last_flange=flange,
    )
    q = rng.uniform(-3, 3, (20, dof))
    found = to_mdh(robot)
    assert found.convention == "mdh"
    np.testing.assert_allclose(found.forward(q), robot.forward(q), rtol=0, atol=1e-9)
    assert np.abs(found.a).max() < 20 * 1000 * dof  # no common normal that runs away
    assert np.abs(found.d).max() < 20 * 1000 * dof


@pytest.mark.parametrize("name", UR)
def test_ur_keeps_its_numbers(name: str) -> None:
    robot = load_robot(name)
    found = to_mdh(robot)
    np.testing.assert_allclose(found.a[1:], robot.a[:-1], atol=1e-9)  # Craig's order: alpha and a of the link before
    np.testing.assert_allclose(found.alpha[1:], robot.alpha[:-1], atol=1e-12)
    np.testing.assert_allclose(found.d, robot.d, atol=1e-9)
    np.testing.assert_allclose(found.offset, 0.0, atol=1e-12)
    np.testing.assert_array_equal(found.tf_last_flange, np.eye(4))


def test_nearly_parallel_axes_take_beta() -> None:
    tilted = Robot("tilted", alpha=[0, 1e-4], a=[0, 500], d=[0, 0], offset=[0, 0], beta=[2e-4, 0])
    found = to_mdh(tilted)
    np.testing.assert_allclose(found.beta[0], 2e-4, rtol=1e-6)
    np.testing.assert_allclose(found.alpha[1], 1e-4, rtol=1e-6)
    assert np.abs(found.d).max() < 1e-9
