"""How the samples of a map are registered: what is fitted, what is stated, and what is said about it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.error_map.registration import reading_noise, register_samples, tool_estimate, with_tool_hint
from truepose.errors import DataError, RobotError
from truepose.geometry import Registration, apply_transform, invert_transform, make_transform
from truepose.samples import Samples

STATION = make_transform(Rotation.from_rotvec([0.0, 0.0, 2.0]), [3000.0, 500.0, 800.0])


@pytest.fixture(scope="module")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("paper", seed=4)


def cell_of(virtual: tp.VirtualCell, **tool: Any) -> tp.Cell:
    return virtual.cell.model_copy(update={"tool": virtual.cell.tool.model_copy(update=tool)})


def read(virtual: tp.VirtualCell, off: Any = (0.0, 0.0, 0.0), n: int = 20) -> Samples:
    """Exact readings of the nominal arm from a station, of a point that is `off` the stated tool [mm]."""
    q = np.deg2rad([0.0, -70.0, 90.0, 0.0, 40.0, 0.0]) + np.random.default_rng(1).uniform(-0.5, 0.5, (n, 6))
    tool = virtual.tf_flange_tool @ make_transform(Rotation.identity(), np.asarray(off, float))
    p = virtual.robot.forward(q, tool=tool)[:, :3, 3]
    return Samples(apply_transform(invert_transform(STATION), p), q=q, source="s.csv")


def test_a_stated_tool_is_not_fitted(virtual: tp.VirtualCell) -> None:
    samples = read(virtual)
    found, tool, p_cmd = register_samples(cell_of(virtual, fit="none"), virtual.robot, samples)
    assert found.p_flange_tool is None
    np.testing.assert_array_equal(tool, virtual.tf_flange_tool)
    np.testing.assert_allclose(p_cmd, apply_transform(STATION, samples.p_meas), atol=1e-6)
    np.testing.assert_allclose(found.tf_base_tracker, STATION, atol=1e-6)


def test_a_fitted_tool_is_that_of_the_readings(virtual: tp.VirtualCell) -> None:
    off = np.array([3.0, -2.0, 1.0])
    found, tool, p_cmd = register_samples(cell_of(virtual, fit="position"), virtual.robot, read(virtual, off))
    np.testing.assert_allclose(tool[:3, 3], virtual.tf_flange_tool[:3, 3] + off, atol=1e-6)
    np.testing.assert_array_equal(tool[:3, :3], virtual.tf_flange_tool[:3, :3])
    assert found.p_flange_tool == pytest.approx(tool[:3, 3])
    np.testing.assert_allclose(p_cmd, apply_transform(STATION, read(virtual, off).p_meas), atol=1e-6)


def test_positions_without_joints_need_a_stated_tool(virtual: tp.VirtualCell) -> None:
    samples = read(virtual)
    alone = Samples(samples.p_meas, p_cmd=apply_transform(STATION, samples.p_meas), source="s.csv")
    found, tool, p_cmd = register_samples(cell_of(virtual, fit="none"), virtual.robot, alone)
    np.testing.assert_allclose(found.tf_base_tracker, STATION, atol=1e-6)
    assert p_cmd is alone.p_cmd
    np.testing.assert_array_equal(tool, virtual.tf_flange_tool)
    for fit in ("position", "pose"):
        with pytest.raises(DataError, match=rf's\.csv: \[tool\] fit = "{fit}" needs joints'):
            register_samples(cell_of(virtual, fit=fit), virtual.robot, alone)


def test_a_fitted_orientation_is_the_mean_of_the_measured_ones(virtual: tp.VirtualCell) -> None:
    samples, turn = read(virtual), Rotation.from_rotvec([0.01, 0.02, -0.03])
    with pytest.raises(DataError, match=r'fit = "pose" needs measured orientations'):
        register_samples(cell_of(virtual, fit="pose"), virtual.robot, samples)
    tool = Rotation.from_matrix(virtual.tf_flange_tool[:3, :3]) * turn
    base = Rotation.from_matrix(virtual.robot.forward(samples.q)[:, :3, :3]) * tool
    measured = replace(samples, rotation_meas=Rotation.from_matrix(STATION[:3, :3]).inv() * base)
    found = register_samples(cell_of(virtual, fit="pose"), virtual.robot, measured)[1]
    np.testing.assert_allclose(found[:3, :3], tool.as_matrix(), atol=1e-9)


@pytest.mark.exhaustive
def test_joints_in_radians_named_as_degrees_are_hinted_at(virtual: tp.VirtualCell) -> None:
    """Within 6.28°; joints that go farther are degrees."""
    samples, robot = read(virtual), replace(virtual.robot, limits=np.tile([-np.pi, np.pi], (6, 1)))
    for largest, hinted in ((0.99 * 2.0 * np.pi, True), (1.01 * 2.0 * np.pi, False)):
        q = np.deg2rad(samples.q / np.abs(samples.q).max() * largest)
        with pytest.raises(DataError) as refused:
            register_samples(cell_of(virtual, fit="none"), robot, replace(samples, q=q))
        assert ("are the columns q1_deg … in radians?" in str(refused.value)) == hinted


def test_joints_beyond_their_limits_are_named(virtual: tp.VirtualCell) -> None:
    samples = read(virtual)
    q = samples.q.copy()
    q[[3, 7], 1] = virtual.robot.limits[1, 1] + [0.01, -0.001]
    with pytest.raises(RobotError, match=r"s\.csv: row 3: .* cannot reach this pose \(joint 2 at"):
        register_samples(cell_of(virtual, fit="none"), virtual.robot, replace(samples, q=q))


@pytest.mark.parametrize(("moved", "std", "hint"), [(4.9, 0.5, False), (4.9, 1.1, True), (5.1, 0.0, True)])
def test_a_tool_that_errors_of_the_arm_moved_by_five_millimetres_is_hinted_at(
    moved: float, std: float, hint: bool
) -> None:
    registration = Registration(
        np.eye(4), np.zeros((3, 3)), np.zeros(3, bool), np.zeros((9, 9)), 0.0, np.zeros(3), np.empty((0, 2), int), "one"
    )
    tool = {"x": (0.6 * moved, std), "y": (0.0, 0.0), "z": (0.8 * moved, 0.0)}
    rows = [{"name": f"tool {axis}", "estimate": value, "std": s} for axis, (value, s) in tool.items()]
    found = with_tool_hint(registration, [*rows, {"name": "a2", "estimate": 90.0, "std": 9.0}])
    assert found.hint.startswith("one; with the arm's own errors estimated too") == hint
    assert (found is registration) != hint


def test_the_noise_of_readings_is_turned_into_the_base(virtual: tp.VirtualCell) -> None:
    quarter = make_transform(Rotation.from_euler("z", 90.0, degrees=True), np.zeros(3))
    samples = read(virtual)
    registration = register_samples(cell_of(virtual, fit="none"), virtual.robot, samples)[0]
    known = replace(samples, p_std=np.tile([0.01, 0.02, 0.03], (20, 1)))
    found = reading_noise(virtual.cell, known, replace(registration, tf_base_tracker=quarter))
    np.testing.assert_allclose(found, np.tile([0.02, 0.01, 0.03], (20, 1)))


def test_a_tool_is_estimated_only_beside_a_stated_one(virtual: tp.VirtualCell) -> None:
    samples = read(virtual)
    assert tool_estimate(cell_of(virtual, fit="none"), virtual.robot, samples) is not None
    assert tool_estimate(cell_of(virtual, fit="position"), virtual.robot, samples) is None
    without = Samples(samples.p_meas, p_cmd=samples.p_meas, source="s.csv")
    assert tool_estimate(cell_of(virtual, fit="none"), virtual.robot, without) is None
