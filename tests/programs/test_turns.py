"""Along paths the branch follows from the motion before; a stale Turn is ignored there, and counts for PTP."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.error_map import ErrorMap
from truepose.error_map.fit import fit_cell
from truepose.errors import RefusedError
from truepose.geometry import euler
from truepose.programs import FrameTable, ReadOptions, correct_program, read_program
from truepose.programs.core.joints import joints_along_paths
from truepose.robots import load_robot, nearest_branch, status_turn
from truepose.simulation import VirtualCell

ROBOT = load_robot("kuka-kr210-r2700-extra")
EYE = np.eye(4)
KNOWN = FrameTable(tools={0: EYE}, bases={0: EYE})
Q = np.deg2rad([5.0, -75.0, 95.0, 10.0, 50.0, 20.0])
STALE = 0b001001  # A1 and A4 stated on the other side of zero


def numbers(controller: str, tf: np.ndarray) -> np.ndarray:
    return np.concatenate([tf[:3, 3], euler(controller, Rotation.from_matrix(tf[:3, :3]))])


def pose(q: np.ndarray, turn: int | None, flip: int = 0, tool: np.ndarray = EYE) -> str:
    row = numbers("kuka", ROBOT.forward(q) @ tool)
    text = ",".join(f"{k} {v:.4f}" for k, v in zip("XYZABC", row, strict=True))
    if turn is None:
        return f"{{{text}}}"
    status, _ = status_turn(ROBOT, q)
    return f"{{{text},S {int(status)},T {turn ^ flip}}}"


def turn_of(q: np.ndarray) -> int:
    return int(status_turn(ROBOT, q)[1])


def middle_of(error_map: ErrorMap) -> np.ndarray:
    """Return the joints of the sample nearest to the middle of all."""
    q = error_map.samples.q
    assert q is not None
    return q[np.argmin(np.abs(q - q.mean(axis=0)).sum(axis=1))]


def write(folder: Path, *body: str) -> Path:
    path = folder / "a.src"
    path.write_text("\n".join(["DEF a()", "$TOOL=$NULLFRAME", "$BASE=$NULLFRAME", *body, "END", ""]))
    return path


@pytest.fixture(scope="module", params=["ordinary-kriging", "calibration"])
def error_map(request: pytest.FixtureRequest) -> ErrorMap:
    virtual = VirtualCell("paper", seed=5)
    return fit_cell(virtual.cell, virtual.measure(virtual.design(120, seed=2)), request.param)


MOTIONS = {
    "LIN": ("LIN {0}", "LIN {1}"),
    "CIRC": ("LIN {0}", "CIRC {1},{2}"),
    "SLIN": ("SLIN {0}", "SLIN {1}"),
    "SCIRC": ("SLIN {0}", "SCIRC {1},{2}"),
    "SPL": ("SPLINE", "SPL {0}", "SPL {1}", "SPL {2}", "ENDSPLINE"),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("word", MOTIONS)
@pytest.mark.parametrize("anchored", [True, False])
def test_a_stale_turn_changes_nothing_along_paths(
    tmp_path: Path, error_map: ErrorMap, word: str, anchored: bool
) -> None:
    """137 such targets of a real program were refused with "joint 1 would be at 343°"."""
    start, tool = middle_of(error_map), error_map.tf_flange_tool
    joints = []
    for shift in ([20.0, 10.0, 0.0], [40.0, 15.0, 10.0], [60.0, 30.0, 15.0]):
        tf = ROBOT.forward(start)
        tf[:3, 3] += shift
        joints.append(nearest_branch(ROBOT.inverse(tf), start))

    def corrected(flip: int) -> list[str]:
        texts = [pose(q, turn_of(q), flip, tool) for q in joints]
        lines = [line.format(*texts) for line in MOTIONS[word]]
        first = [f"PTP {pose(start, turn_of(start), 0, tool)}"] if anchored else []
        path = write(tmp_path, "$TOOL=TOOL_DATA[1]", *first, *lines)
        done = correct_program(path, error_map, frames=FrameTable(tools={1: tool}), accept_weak_map=True)
        assert {target.verdict for target in done.targets} == {"correct"}
        return re.findall(r"[XYZ] (-?[\d.]+)", done.files[path].decode())

    assert corrected(STALE) == corrected(0)


def test_ptp_keeps_its_turn(tmp_path: Path, error_map: ErrorMap) -> None:
    tool, samples = error_map.tf_flange_tool, error_map.samples.q
    assert samples is not None
    q = samples[np.argmin(np.abs(samples[:, 0] - np.deg2rad(17.0)))]
    path = write(tmp_path, "$TOOL=TOOL_DATA[1]", f"PTP {pose(q, turn_of(q), 0b000001, tool)}")
    with pytest.raises(RefusedError, match="joint 1 would be at -34"):
        correct_program(path, error_map, frames=FrameTable(tools={1: tool}), accept_weak_map=True)


def test_joints_move_on_from_the_ptp_motion(tmp_path: Path, rng: np.random.Generator) -> None:
    """A6 goes on beyond 180°, where Turn, Status and the nearest pose would name another turn."""
    steps = rng.uniform(0.0, 1.0, size=(40, 6)) * np.deg2rad([0.5, 0.3, -0.4, 0.2, 0.3, 8.0])
    q = Q + np.deg2rad([0, 0, 0, 0, 0, 110.0]) + np.cumsum(steps, axis=0)
    assert q[-1, 5] > np.pi
    turns = [turn_of(q[0]), *(turn_of(one) ^ STALE if k % 3 else None for k, one in enumerate(q[1:]))]
    words = ["PTP", *["LIN"] * 20, *["SLIN"] * 19]
    body = [f"{word} {pose(one, turn)}" for word, one, turn in zip(words, q, turns, strict=True)]
    program = read_program(write(tmp_path, *body), KNOWN)
    near = joints_along_paths(ROBOT, program.targets, EYE)
    assert near is not None
    assert np.isnan(near[0]).all()
    np.testing.assert_allclose(near[1:], q[1:], atol=2e-4)


def test_no_joints_follow_from_an_unknown_start(tmp_path: Path) -> None:
    lines = [f"LIN {pose(Q, turn_of(Q))}", "PTP {A1 0,A2 -90}", f"LIN {pose(Q, turn_of(Q))}"]
    program = read_program(write(tmp_path, *lines, f"PTP {pose(Q, turn_of(Q))}"), KNOWN)
    near = joints_along_paths(ROBOT, program.targets, EYE)
    assert near is not None
    assert np.isnan(near).all()
    only = read_program(write(tmp_path, *lines[:2]), KNOWN)
    assert joints_along_paths(ROBOT, only.targets, EYE) is None


@pytest.mark.parametrize("allowed", [False, True])
def test_joint_targets_state_the_turns(tmp_path: Path, allowed: bool) -> None:
    """A6 stands at 300° behind a PTP to joints; the LIN behind it has no Status, or one with a stale Turn."""
    q = Q + np.deg2rad([0, 0, 0, 0, 0, 280.0])
    joints = "PTP {" + ",".join(f"A{j} {np.rad2deg(x):.4f}" for j, x in enumerate(q, 1)) + "}"
    for turn in (None, turn_of(q) ^ STALE):
        path = write(tmp_path, joints, f"LIN {pose(q, turn)}", f"LIN {pose(q + np.deg2rad(3.0), turn)}")
        program = read_program(path, KNOWN, ReadOptions(joint_targets=allowed))
        near = joints_along_paths(ROBOT, program.targets, EYE)
        assert near is not None
        assert np.isnan(near[0]).all()
        np.testing.assert_allclose(near[1:], [q, q + np.deg2rad(3.0)], atol=2e-4)
    changed = "DEF a()\nDECL AXIS XA\nXA={{A1 5,A2 -90,A3 90,A4 0,A5 30,A6 300}}\nXA.A6=f()\nPTP XA\nLIN {}\nEND\n"
    path.write_text(changed.format(pose(q, None)))
    program = read_program(path, replace(KNOWN, tool=0, base=0), ReadOptions(joint_targets=allowed))
    assert joints_along_paths(ROBOT, program.targets, EYE) is None  # what XA is then is known at run time only


def test_a_map_takes_the_joints_nearby(error_map: ErrorMap) -> None:
    q = error_map.samples.q
    assert q is not None
    poses = ROBOT.forward(q[:5]) @ error_map.tf_flange_tool
    near = q[:5] + np.deg2rad(5.0)
    near[4] = np.nan
    given = error_map.correct(poses, near=near, accept_weak_map=True)
    np.testing.assert_allclose(given.p_command, error_map.correct(poses, accept_weak_map=True).p_command, atol=1e-9)
    turned = error_map.correct(poses, near=q[:5] + 2 * np.pi * np.eye(6)[0], accept_weak_map=True)
    assert "joint 1 would be at" in " ".join(turned.reason)


FANUC = load_robot("fanuc-m20ia")


@pytest.mark.parametrize(("motion", "stays"), [("L", False), ("J", True)])
def test_turn_numbers_of_fanuc_count_for_joint_motions(
    tmp_path: Path, make_map: type, motion: str, stays: bool
) -> None:
    """Joint 6 crosses 180° with the correction, where its turn number changes."""
    q = np.deg2rad([10.0, 20.0, -10.0, 15.0, -60.0, 179.999])
    row = numbers("fanuc", FANUC.forward(q))
    values = ", ".join(f"{k} = {v:.4f} {'mm' if k in 'XYZ' else 'deg'}" for k, v in zip("XYZWPR", row, strict=True))
    speed = "100%" if motion == "J" else "100mm/sec"
    path = tmp_path / "a.ls"
    path.write_text(
        f"/PROG A\n/MN\n1:{motion} P[1] {speed} FINE ;\n/POS\nP[1]{{\n GP1:\n UF : 0, UT : 0, "
        f"CONFIG : 'N U T, 0, 0, 0',\n{values}\n}};\n/END\n"
    )
    found = []
    for sign in (1.0, -1.0):
        error_map = make_map([0.0, 3.0 * sign, 0.0])
        error_map.robot = FANUC
        done = correct_program(path, error_map, frames=FrameTable(), on_guard="skip")
        found.append(done.targets[0].reason)
    assert any("its configuration would change" in reason for reason in found) == stays, found


def test_letters_of_fanuc_count_along_paths_whatever_the_turn_numbers(tmp_path: Path, make_map: type) -> None:
    """The elbow cannot be reached after the correction; stale turn numbers do not hide that."""
    q = np.deg2rad([10.0, 20.0, -10.0, 15.0, -60.0, 30.0])
    row = numbers("fanuc", FANUC.forward(q))
    values = ", ".join(f"{k} = {v:.4f} {'mm' if k in 'XYZ' else 'deg'}" for k, v in zip("XYZWPR", row, strict=True))
    path = tmp_path / "a.ls"
    path.write_text(
        "/PROG A\n/MN\n1:L P[1] 100mm/sec FINE ;\n/POS\nP[1]{\n GP1:\n UF : 0, UT : 0, "
        f"CONFIG : 'N U T, 1, 0, 0',\n{values}\n}};\n/END\n"
    )
    error_map = make_map([0.0, 0.0, 5000.0])
    error_map.robot = FANUC
    done = correct_program(path, error_map, frames=FrameTable(), on_guard="skip")
    assert done.targets[0].reason == "its configuration would change from N U T to out of reach"


def test_a_path_that_winds_on_is_left_and_does_not_stop_the_program(tmp_path: Path, error_map: ErrorMap) -> None:
    start = middle_of(error_map)
    turns = [start + np.deg2rad(100.0 * k % 360.0) * np.eye(6)[5] for k in range(24)]
    path = write(tmp_path, f"PTP {pose(start, turn_of(start))}", *(f"LIN {pose(q, None)}" for q in turns))
    near = joints_along_paths(ROBOT, read_program(path, KNOWN).targets, EYE)
    assert near is not None
    assert np.nanmax(np.abs(near)) <= 3.0 * np.pi
    assert np.rad2deg(near[5, 5] - near[1, 5]) == pytest.approx(400.0, abs=1.0)
    done = correct_program(path, error_map, frames=KNOWN, on_guard="skip", accept_weak_map=True)
    assert not done.targets.corrected[-5:].any()
