"""ISO 9283:1998 against cases computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.errors import DataError
from truepose.verification import Attained
from truepose.verification.performance import (
    crossings,
    distance_figures,
    path_figures,
    performance_figures,
    pose_accuracy,
    pose_drift,
    pose_repeatability,
)

SQUARE = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
"""Four points, each 0.1 from their mean: l̄ = 0.1, S_l = 0."""


def attained(pose: list[str], p: np.ndarray, p_cmd: np.ndarray, **more: object) -> Attained:
    return Attained(pose=np.array(pose), p_cmd=p_cmd, p=p, **more)  # type: ignore[arg-type]


def test_pose_accuracy_by_hand() -> None:
    """The barycentre is (0.3, 0.4, 0) away: 0.5."""
    assert pose_accuracy(np.full((4, 3), 100.0), 100.0 + SQUARE + np.array([0.3, 0.4, 0.0])) == pytest.approx(0.5)


def test_repeatability_by_hand() -> None:
    """l = 1, 1, 3, 3: mean 2, S = √(4/3), RP = 2 + 3 √(4/3)."""
    p = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 3.0, 0], [0, -3.0, 0]])
    assert pose_repeatability(SQUARE) == pytest.approx(0.1)
    assert pose_repeatability(p) == pytest.approx(2.0 + 3.0 * np.sqrt(4.0 / 3.0))


def test_distance_by_hand() -> None:
    """Attained 100.1, 100.2, 100.3 of 100: AD = 0.2, S = 0.1, RD = 0.3."""
    p_1, p_2 = np.zeros((3, 3)), np.array([[100.1, 0, 0], [0, 100.2, 0], [0, 0, 100.3]])
    assert distance_figures(p_1, p_2, 100.0) == pytest.approx((0.2, 0.3))


def test_drift_by_hand() -> None:
    """Blocks of four: AP goes 0, 0.3, 0.2, RP 0.1, 0.1, 0.2."""
    p = np.concatenate([SQUARE, SQUARE + np.array([0.3, 0, 0]), 2.0 * SQUARE + np.array([0, 0.2, 0])])
    assert pose_drift(np.zeros((12, 3)), p, cycles=4) == pytest.approx((0.3, 0.1))


def test_path_by_hand() -> None:
    """At the second point the barycentre is 0.5 off, and l = 0.1; at the first 0.2 off, and l = 0.2."""
    p_cmd = np.array([[0.0, 0, 0], [10.0, 0, 0]])
    p = p_cmd + np.stack([2.0 * SQUARE + np.array([0, 0, 0.2]), SQUARE + np.array([0, 0, 0.5])], axis=1)
    assert path_figures(p_cmd, p) == pytest.approx((0.5, 0.2))


SPREAD = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 3.0, 0], [0, -3.0, 0]])
"""Four points around their mean: l = 1, 1, 3, 3, so l̄ = 2 and S = √(4/3)."""
REPEATABILITY = 2.0 + 3.0 * np.sqrt(4.0 / 3.0)


def test_path_repeatability_by_hand() -> None:
    """RT = l̄ + 3 S: at the second of three points 0.1 (l̄ = 2, S = √(4/3)), which is more than at the others."""
    p_cmd = np.array([[0.0, 0, 0], [10.0, 0, 0], [20.0, 0, 0]])
    off = [0.1 * SQUARE + np.array([0, 0.3, 0.4]), 0.1 * SPREAD + np.array([0.2, 0, 0]), SQUARE]
    found = path_figures(p_cmd, p_cmd + np.stack(off, axis=1))
    assert found == pytest.approx((0.5, 0.1 * REPEATABILITY))


def test_drift_of_repeatability_by_hand() -> None:
    """RP goes from 0.1 to that of 0.1 times the spread and back to 0.2; what is left over is no block."""
    p = np.concatenate([SQUARE, 0.1 * SPREAD, 2.0 * SQUARE, 9.0 * SPREAD[:3]])
    assert pose_drift(np.zeros((15, 3)), p, cycles=4) == pytest.approx((0.0, 0.1 * REPEATABILITY - 0.1))


def five_poses(spread: np.ndarray, cycles: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P1 to P5, attained with a spread that repeats, the k-th k tenths of a millimetre off along z."""
    commanded = np.array([[0.0, 0, 0], [300.0, 0, 0], [0, 300.0, 0], [300.0, 400.0, 0], [0, 0, 300.0]])
    k = np.repeat(np.arange(5), cycles)
    p_cmd = commanded[k]
    off = np.tile(spread, (5 * cycles // len(spread), 1)) + 0.1 * (k + 1)[:, None] * np.array([0.0, 0.0, 1.0])
    return np.array([f"P{one + 1}" for one in k]), p_cmd, p_cmd + off


def test_all_figures_by_hand() -> None:
    """Each of five poses in 32 cycles; S is that of 32 values, n − 1."""
    pose, p_cmd, p = five_poses(0.01 * SPREAD, 32)
    s = 0.01 * np.sqrt(32.0 / 31.0)  # of 16 values of 0.01 and of 0.03
    turn = np.deg2rad(np.tile([[0.1, -0.2, 0.0], [0.3, -0.2, 0.0]], (80, 1)))
    direction = np.tile(np.repeat([0, 1], 16), 5)
    p[direction == 1] += np.where(pose[direction == 1] == "P4", 0.5, 0.25)[:, None] * np.array([1.0, 0.0, 0.0])
    p[direction == 0] -= np.where(pose[direction == 0] == "P4", 0.5, 0.25)[:, None] * np.array([1.0, 0.0, 0.0])
    found = performance_figures(attained(list(pose), p, p_cmd, turn=turn, direction=direction))
    assert [one.AP_mm for one in found.poses] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    assert found.poses[2].AP_xyz_mm == pytest.approx((0.0, 0.0, 0.3))
    assert found.AP_mm == pytest.approx(0.5)
    assert found.RP_mm == found.poses[3].RP_mm
    assert found.poses[0].AP_abc_deg == pytest.approx((0.2, -0.2, 0.0))
    assert found.poses[0].RP_abc_deg == pytest.approx((0.3 * np.sqrt(32.0 / 31.0), 0.0, 0.0))
    assert (found.vAP_mm, found.vAP_pose) == (pytest.approx(1.0), "P4")
    straight = performance_figures(attained(list(pose), *reversed(five_poses(0.01 * SPREAD, 32)[1:])))
    assert [one.RP_mm for one in straight.poses] == pytest.approx([0.02 + 3.0 * s] * 5)
    # between P2 and P4, 400 mm apart in y, both with the same spread, 0.2 mm apart in z
    assert straight.AD_poses == ("P2", "P4")
    assert straight.AD_mm == pytest.approx(np.hypot(400.0, 0.2) - 400.0)
    assert straight.RD_mm == pytest.approx(0.0, abs=1e-9)


def test_distances_by_hand() -> None:
    """P2 is attained 0.1, 0.2 and 0.3 mm too far away in turn; the cycles beyond those of P4 do not count."""
    p_cmd = np.array([[0.0, 0, 0]] * 4 + [[100.0, 0, 0]] * 3)
    p = p_cmd + np.array([[0.0, 0, 0]] * 4 + [[0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]])
    found = performance_figures(attained(["P4"] * 4 + ["P2"] * 3, p, p_cmd))
    assert (found.AD_poses, found.AD_mm, found.RD_mm) == (("P2", "P4"), pytest.approx(0.2), pytest.approx(0.3))


def test_drift_is_found_in_the_order_of_time() -> None:
    """Ten cycles at 0, ten half a millimetre away, given in the wrong order; P1 before the pose with more cycles."""
    block = np.tile(SQUARE, (3, 1))[:10]
    p = np.concatenate([block + np.array([0.0, 0, 0.5]), block, np.tile(SQUARE, (8, 1))])
    time = np.concatenate([np.arange(10) + 4.0 * 3600, np.arange(10), np.arange(32)])
    found = performance_figures(attained(["P1"] * 20 + ["P2"] * 32, p, np.zeros((52, 3)), time=time))
    centre = float(np.linalg.norm(block.mean(axis=0)))
    assert found.dAP_mm == pytest.approx(np.hypot(centre, 0.5) - centre)
    assert found.dRP_mm == pytest.approx(0.0, abs=1e-12)
    assert (found.drift_pose, found.drift_hours) == ("P1", pytest.approx((4.0 * 3600 + 9) / 3600))
    assert any(reason.startswith("drift: over 4 hours") for reason in found.missing)


def test_where_a_path_crosses_the_planes() -> None:
    """A line 1 mm beside the commanded one, read at other places; a corner passed at 1 mm as well."""
    x = np.linspace(0.0, 100.0, 6)
    path = np.column_stack([x, np.zeros(6), np.zeros(6)])
    read = np.column_stack([np.linspace(-7.0, 113.0, 41), np.full(41, 1.0), np.zeros(41)])
    np.testing.assert_allclose(crossings(path, read), path + np.array([0.0, 1.0, 0.0]), atol=1e-12)
    with pytest.raises(DataError, match=r"does not pass the plane across point 4 .* \(2 of 6\); read from before"):
        crossings(path, read[read[:, 0] < 79.0])


def test_readings_that_pause_in_a_plane() -> None:
    path = np.column_stack([np.linspace(0.0, 100.0, 6), np.zeros(6), np.zeros(6)])
    read = np.column_stack([np.linspace(-20.0, 120.0, 8), np.full(8, 1.0), np.zeros(8)])
    paused = read[[0, 1, 2, 3, 3, 3, 4, 5, 6, 7]]  # at the plane of the second point
    np.testing.assert_allclose(crossings(path, paused), crossings(path, read), atol=1e-12)


def test_a_circle_is_passed_on_the_right_side() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    circle = 50.0 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(25)])
    dense = np.linspace(-0.2, 2.0 * np.pi + 0.2, 4001)
    read = 50.5 * np.column_stack([np.cos(dense), np.sin(dense), np.zeros(4001)])
    off = np.linalg.norm(crossings(circle, read)[1:-1] - circle[1:-1], axis=1)
    np.testing.assert_allclose(off, 0.5, atol=1e-3)


def cube(cycles: int) -> tuple[list[str], np.ndarray]:
    centre = np.array([[1000.0, 0, 500], [1200, 200, 700], [1200, -200, 700], [800, -200, 300], [800, 200, 300]])
    names = [f"P{k + 1}" for _ in range(cycles) for k in range(5)]
    return names, np.tile(centre, (cycles, 1))


def test_a_complete_measurement_lacks_little() -> None:
    rng = np.random.default_rng(3)
    names, p_cmd = cube(90)
    direction = np.repeat(np.arange(3), 150)
    p = p_cmd + rng.normal(scale=0.02, size=p_cmd.shape) + 0.05 * np.eye(3)[direction]
    turn = np.deg2rad(rng.normal(scale=0.01, size=p.shape) + np.array([0.1, 0, 0]))
    time = np.linspace(0, 9 * 3600, 450)
    path = np.array([[900.0, 0, 500], [1000.0, 0, 500]])
    measured = attained(
        names + ["path1", "path2"] * 10,
        np.vstack([p, np.tile(path, (10, 1)) + rng.normal(scale=0.02, size=(20, 3))]),
        np.vstack([p_cmd, np.tile(path, (10, 1))]),
        turn=np.vstack([turn, np.zeros((20, 3))]),
        direction=np.append(direction, np.zeros(20, dtype=int)),
        time=np.append(time, np.zeros(20)),
    )
    found = performance_figures(measured)
    assert found.missing == ()
    assert [pose.name for pose in found.poses] == ["P1", "P2", "P3", "P4", "P5"]
    assert {pose.n for pose in found.poses} == {90}
    assert found.vAP_mm == pytest.approx(0.05 * np.sqrt(2), abs=0.02)
    assert found.poses[0].AP_abc_deg == pytest.approx((0.1, 0, 0), abs=5e-3)
    assert found.poses[0].RP_abc_deg == pytest.approx((0.03, 0.03, 0.03), abs=0.01)
    assert found.AD_poses == ("P2", "P4")
    assert found.AD_mm == pytest.approx(0.0, abs=0.02)
    assert found.RD_mm == pytest.approx(3 * 0.02 * np.sqrt(2), rel=0.5)
    assert found.drift_pose == "P1"
    assert found.dAP_mm is not None
    assert found.AT_mm == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize(("cycles", "few"), [(29, True), (30, False)])
def test_thirty_cycles_are_enough(cycles: int, few: bool) -> None:
    names, p_cmd = cube(cycles)
    p = p_cmd + np.random.default_rng(4).normal(scale=0.02, size=p_cmd.shape)
    missing = performance_figures(attained(names, p, p_cmd)).missing
    assert any("fewer than 30 cycles" in one for one in missing) == few


def test_what_is_missing_is_said_with_the_standards_number() -> None:
    names, p_cmd = cube(3)
    found = performance_figures(attained(names[:-5], p_cmd[:-5] + np.linspace(0, 0.1, 10)[:, None], p_cmd[:-5]))
    ways = "the directions of approach are not recorded; the standard asks for 3 perpendicular ones at P1, P2 and P4"
    assert found.missing == (
        "AP, RP: 5 of 5 poses have fewer than 30 cycles (pose P1: 2); the standard asks for 30",
        "AP, RP of orientation: no orientations were measured",
        f"vAP: {ways}, 30 cycles each",
        "AD, RD: 2 pairs; the standard asks for 30",
        "drift: no times; the standard asks for 10 cycles of P1 at a time over 8 hours",
        'AT, RT: no path; name its points "path1", "path2" …, each in 10 cycles',
    )
    assert (found.vAP_mm, found.dAP_mm, found.AT_mm) == (None, None, None)


def test_no_pose_repeated() -> None:
    with pytest.raises(DataError, match="none of 4 poses is repeated; ISO 9283 asks for 30 cycles of each of 5 poses"):
        performance_figures(attained(list("abcd"), SQUARE, SQUARE))
