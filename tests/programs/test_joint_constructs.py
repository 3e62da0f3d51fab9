"""What each language may do with joint targets, and joint targets in paths and before the guards of a real map."""

# ruff: noqa: E501
from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.programs.joint_arms import FRAMES, MAKERS, TOOL, Sagging
from tests.programs.test_joint_targets import JOINTS, texts

from truepose.error_map import ErrorMap
from truepose.error_map.fit import fit_cell
from truepose.errors import RefusedError
from truepose.geometry import euler, make_transform
from truepose.programs import FrameTable, ReadOptions, Target, correct_program, read_program
from truepose.simulation import VirtualCell

AXES = "A1 10,A2 -80,A3 95,A4 20,A5 30,A6 40"
SET = "$TOOL=TOOL_DATA[1]\n"
TWO = FrameTable(tools={1: TOOL, 2: np.eye(4), "tgrip": TOOL, "tother": np.eye(4)}, bases={1: np.eye(4)})


def krl(folder: Path, src: str, dat: str = "", **options: Any) -> dict[str, Target]:
    path = folder / "a.src"
    path.write_text(f"DEF a()\n{src}\nEND\n")
    (folder / "a.dat").write_text(f"DEFDAT A\n{dat}\nENDDAT\n")
    program = read_program(path, TWO, ReadOptions(**{"joint_targets": True, **options}))
    return {target.name: target for target in program.targets}


@pytest.mark.parametrize(
    ("src", "dat", "verdict", "reason"),
    [
        ("PTP XA", f"DECL E6AXIS XA={{{AXES},E1 0,E2 0.0}}", "correct", ""),
        ("SPTP XA C_DIS", f"DECL AXIS XA={{{AXES}}}", "correct", ""),
        ("PTP xa\nPTP XA C_PTP", f"DECL AXIS Xa={{AXIS: {AXES}}}", "correct", ""),
        ("PTP XA\n$TOOL=TOOL_DATA[2]\nPTP XA", f"DECL AXIS XA={{{AXES}}}", "refuse", "TOOL_DATA[1] (line 3) and TOOL_DATA[2]"),
        ("$BASE=BASE_DATA[1]\nPTP XA\n$BASE=BASE_DATA[7]\nPTP XA", f"DECL AXIS XA={{{AXES}}}", "correct", ""),
        ("PTP XA\nXA.A1=XA.A1+5\nPTP XA", f"DECL AXIS XA={{{AXES}}}", "refuse", "read by arithmetic"),
        ("XA.A1=5\nPTP XA", f"DECL AXIS XA={{{AXES}}}", "skip", "component .A1 set at run time"),
        ("PTP XA\nHomed(XA)", f"DECL AXIS XA={{{AXES}}}", "refuse", "both moved to"),
        ("PTP XA", f"DECL GLOBAL E6AXIS XA={{{AXES}}}", "refuse", "GLOBAL"),
        ("PTP XA", f"DECL E6AXIS XA={{{AXES},E2 -4.5}}", "refuse", "external axis E2"),
        ("PTP XA", "DECL E6AXIS XA={A1 10,A2 -80}", "skip", "joint target"),
        ("LIN XA", f"DECL E6AXIS XA={{{AXES}}}", "skip", "joint target"),
        ("$IPO_MODE=#TCP\nPTP XA", f"DECL E6AXIS XA={{{AXES}}}", "refuse", "the robot holds the part"),
        ("$TOOL=f()\nPTP XA", f"DECL E6AXIS XA={{{AXES}}}", "refuse", "$TOOL is known at run time only"),
        ("$TOOL=TOOL_DATA[5]\nPTP XA", f"DECL E6AXIS XA={{{AXES}}}", "refuse", "TOOL_DATA[5] is not known"),
    ],
)  # fmt: skip
def test_krl(tmp_path: Path, src: str, dat: str, verdict: str, reason: str) -> None:
    found = {name.upper(): target for name, target in krl(tmp_path, SET + src, dat).items()}
    assert (found["XA"].verdict, reason in found["XA"].reason) == (verdict, True), found["XA"].reason
    off = {name.upper(): t for name, t in krl(tmp_path, SET + src, dat, joint_targets=False).items()}["XA"]
    assert off.verdict == "skip"
    assert off.reason == ("joint target; allow joint_targets to correct it" if verdict == "correct" else "joint target")


JT = "[[10,-20.5,30,40,-50,60],[9E9,9E9,9E9,9E9,9E9,9E9]]"
MOVE = "MoveAbsJ {}\\NoEOffs,v100,z1,tGrip;"


@pytest.mark.parametrize(
    ("data", "code", "verdict", "reason"),
    [
        (f"CONST jointtarget j:={JT};", MOVE.format("j"), "correct", ""),
        (f"LOCAL CONST jointtarget j:={JT};", MOVE.format("J") + MOVE.format("j"), "correct", ""),
        (f"PERS jointtarget j:={JT};", MOVE.format("j"), "skip", "PERS: another task of the controller may write it"),
        (f"VAR jointtarget j:={JT};", MOVE.format("j"), "correct", ""),
        (f"VAR jointtarget j:={JT};", MOVE.format("j") + "j:=CJointT();", "skip", "VAR, assigned (line 4)"),
        (f"CONST jointtarget j:={JT};", MOVE.format("j") + "p:=CalcRobT(j,tGrip);", "refuse", "read by arithmetic"),
        (f"CONST jointtarget j:={JT};", MOVE.format("j") + "MoveAbsJ j,v1,z1,tOther;", "refuse", "tGrip (line 4) and tOther"),
        (f"CONST jointtarget j:={JT};", "MoveAbsJ j,v1,z1,tNone;", "refuse", "tNone is not known"),
        (f"CONST jointtarget j:={JT};", "PDispSet d;" + MOVE.format("j"), "correct", ""),
        (f"CONST jointtarget j:={JT.replace('[9E9', '[35', 1)};", MOVE.format("j"), "refuse", "external axis 1"),
        (f"CONST jointtarget j:={JT.replace('[9E9', '[0', 1)};", MOVE.format("j"), "correct", ""),
        (f"CONST jointtarget j:={JT.replace('60', '9E9', 1)};", MOVE.format("j"), "skip", "9E9 is beyond"),
        (f"CONST jointtarget j:={JT.replace('60', 'a1', 1)};", MOVE.format("j"), "skip", "an expression"),
        (f"CONST jointtarget j:={JT.replace('60', '1.2.3', 1)};", MOVE.format("j"), "skip", "joint target"),
        ("CONST jointtarget j:=[[1,2,3],[9E9]];", MOVE.format("j"), "skip", "an expression"),
        (f"CONST jointtarget j:={JT};CONST jointtarget j:={JT};", MOVE.format("j"), "skip", "declared a second time"),
        ("CONST jointtarget j:=jHome;", MOVE.format("j"), "skip", "run time only"),
    ],
)  # fmt: skip
def test_rapid(tmp_path: Path, data: str, code: str, verdict: str, reason: str) -> None:
    path = tmp_path / "a.mod"
    path.write_text(f"MODULE m\n{data}\nPROC main()\n{code}\nENDPROC\nENDMODULE\n")

    def only(options: ReadOptions) -> Target:
        (found,) = [target for target in read_program(path, TWO, options).targets if target.name == "j"]
        return found

    assert (only(JOINTS).verdict, reason in only(JOINTS).reason) == (verdict, True), only(JOINTS).reason
    assert only(replace(JOINTS, joint_targets=False)).verdict == "skip"
    if verdict == "correct":
        assert ("global to the task" in only(replace(JOINTS, whole_task=False)).reason) == (
            not data.startswith("LOCAL")
        )


def test_rapid_literals_arrays_and_unused_data(tmp_path: Path) -> None:
    path = tmp_path / "a.mod"
    path.write_text(
        f"MODULE m\nCONST jointtarget a{{2}}:=[{JT},{JT.replace('10', '15')}];CONST jointtarget unused:={JT};\nPROC main()\n"
        f"MoveAbsJ {JT},v1,fine,tGrip;\nMoveAbsJ a{{2}},v1,z1,tGrip;\nMoveExtJ unused,v1,z1;\nMoveAbsJ jFar,v1,z1,tGrip;\nENDPROC\nENDMODULE\n"
    )
    found = {t.name: (t.verdict, t.reason, t.joints) for t in read_program(path, TWO, JOINTS).targets}
    assert found["MoveAbsJ:4"] == ("correct", "", (10, -20.5, 30, 40, -50, 60))
    assert found["a{2}"] == ("correct", "", (15, -20.5, 30, 40, -50, 60))
    assert found["MoveExtJ:6"][:2] == found["MoveAbsJ:7"][:2] == ("skip", "joint target")
    assert "a{1}" not in found


J = ["J1=    10.000", "J2=    20.000", "J3=   -10.000", "J4=    15.000", "J5=   -60.000", "J6=    30.000"]


@pytest.mark.parametrize(
    ("code", "body", "verdict", "reason"),
    [
        ("J P[1] 50% FINE", {}, "correct", ""),
        ("L P[1] 100mm/sec CNT50", {}, "correct", ""),
        ("UTOOL_NUM=1 ;\n  2:J P[1] 50% FINE", {}, "correct", ""),
        ("UFRAME_NUM=9 ;\n  2:J P[1] 50% FINE", {}, "correct", ""),
        ("UTOOL_NUM=2 ;\n  2:J P[1] 50% FINE", {}, "refuse", "UTOOL_NUM 2 is in force"),
        ("J P[1] 50% FINE", {"UT : 1": "UT : 7"}, "refuse", "UTOOL[7] is not known"),
        ("J P[1] 50% FINE Offset,PR[1]", {}, "skip", "Offset"),
        ("J P[1] 50% FINE INC", {}, "skip", "INC"),
        ("J P[1] 50% FINE ;\n  2:PR[1]=P[1]", {}, "refuse", "both moved to"),
        ("J P[1] 50% FINE ;\n  2:PR[1]=P[1] ;\n  3:PR[1,3]=PR[1,3]+50 ;\n  4:L PR[1] 9mm/sec FINE", {}, "refuse", "both moved to"),
        ("J P[1] 50% FINE ;\n  2:R[1]=1 ;\n  3:PR[1]=P[R[1]]", {}, "refuse", "both moved to"),
        ("J P[1] 50% FINE", {"   -10.000": " ********"}, "skip", "joint target"),
        ("J P[1] 50% FINE", {"J6=": "J9="}, "skip", "joint target"),
        ("J P[1] 50% FINE", {"30.000 deg": "30.000 deg,\n\tJ7=  5.000 mm"}, "refuse", "external axis J7"),
    ],
)  # fmt: skip
def test_fanuc(tmp_path: Path, code: str, body: dict[str, str], verdict: str, reason: str) -> None:
    position = "P[1]{\n   GP1:\n\tUF : 4, UT : 1,\t\n\t" + ",\t".join(f"{axis} deg" for axis in J) + "\n};"
    for old, new in body.items():
        position = position.replace(old, new)
    path = tmp_path / "a.ls"
    path.write_text(f"/PROG  A\n/ATTR\n/MN\n  1:{code} ;\n/POS\n{position}\n/END\n")
    for derived in (False, True):
        options = replace(JOINTS, derived=derived)
        (found,) = [t for t in read_program(path, TWO, options).targets if t.name == "P[1]"]
        assert (found.verdict, reason in found.reason) == (verdict, True), found.reason


class Kinked(Sagging):
    """Asks for the same shift everywhere."""

    def error(self, p: np.ndarray) -> np.ndarray:
        return np.tile([0.0, -0.6, 0.0], (len(p), 1))


@pytest.mark.parametrize(("first", "path_stays"), [(0.0, False), (400.0, True)])
def test_a_path_starts_at_the_joint_target(tmp_path: Path, first: float, path_stays: bool) -> None:
    """If the start stays nominal (its A4 is beyond a limit), the straight motions behind it would have a kink."""
    arm = MAKERS["kuka"].robot
    q = np.radians([5.0, -75.0, 95.0, first, 50.0, 20.0])
    start = arm.forward(q) @ TOOL
    lines = []
    for x in (15.0, 30.0, 45.0):
        tf = start @ make_transform(np.eye(3), [0.0, 0.0, x])
        values = [
            *tf[:3, 3],
            *euler(
                "kuka", __import__("scipy.spatial.transform", fromlist=["Rotation"]).Rotation.from_matrix(tf[:3, :3])
            ),
        ]
        lines.append(
            "LIN {" + ",".join(f"{key} {value:.4f}" for key, value in zip("XYZABC", values, strict=True)) + "}"
        )
    joints = "PTP {" + ",".join(f"A{j} {value:.4f}" for j, value in enumerate(np.degrees(q), 1)) + "}"
    path = tmp_path / "a.src"
    path.write_text("\n".join(["DEF a()", "$TOOL=TOOL_DATA[1]", "$BASE=$NULLFRAME", joints, *lines, "END", ""]))
    corrected = correct_program(path, Kinked(arm), frames=FRAMES, options=JOINTS, on_guard="skip")
    assert [t.verdict for t in corrected.targets] == (["skip"] * 4 if path_stays else ["correct"] * 4)
    assert ("would bend the path" in corrected.targets[1].reason) == path_stays
    if not path_stays:
        assert corrected.continuity.bend[1] < 0.01


@pytest.fixture(scope="module")
def error_map() -> ErrorMap:
    virtual = VirtualCell("paper", seed=5)
    return fit_cell(virtual.cell, virtual.measure(virtual.design(60)), "ordinary-kriging")


def program(folder: Path, numbers: np.ndarray) -> Path:
    rows = ["PTP {" + ",".join(f"A{j} {text}" for j, text in enumerate(row, 1)) + "}" for row in texts(numbers, 4)]
    path = folder / "a.src"
    path.write_text("\n".join(["DEF a()", "$TOOL=TOOL_DATA[1]", *rows, "END", ""]))
    return path


def test_the_map_gives_what_it_gives_for_joints(tmp_path: Path, error_map: ErrorMap) -> None:
    q = error_map.samples.q[:6] + np.radians(0.3)
    path = program(tmp_path, np.degrees(q))
    frames = FrameTable(tools={1: error_map.tf_flange_tool})
    corrected = correct_program(path, error_map, frames=frames, options=JOINTS, accept_weak_map=True)
    written = np.array(
        [re.findall(r"A\d (-?[\d.]+)", line) for line in corrected.files[path].decode().splitlines()[2:-1]], float
    )
    told = np.array([re.findall(r"A\d (-?[\d.]+)", line) for line in path.read_text().splitlines()[2:-1]], float)
    commands = error_map.correct(np.radians(told), accept_weak_map=True)
    assert corrected.coverage.corrected > 3
    for now, outcome, command in zip(written, corrected.targets, commands.p_command, strict=True):
        reached = (error_map.robot.forward(np.radians(now)) @ error_map.tf_flange_tool)[:3, 3]
        assert np.linalg.norm(reached - command) == pytest.approx(
            0.0 if np.isnan(outcome.remaining) else outcome.remaining, abs=3e-5
        )


def test_guards_of_the_map_apply(tmp_path: Path, error_map: ErrorMap) -> None:
    q = error_map.samples.q[:1].repeat(3, axis=0)
    q[1, 0] += np.radians(90.0)  # outside of the sampled region
    q[2, 5] += 2 * np.pi if q[2, 5] < 0 else -2 * np.pi  # the same pose a turn away: kept where limits allow
    path = program(tmp_path, np.degrees(q))
    frames = FrameTable(tools={1: error_map.tf_flange_tool})
    with pytest.raises(RefusedError, match=r"PTP:4: .*(sampled region|standard deviation)"):
        correct_program(path, error_map, frames=frames, options=JOINTS, accept_weak_map=True)
    left = correct_program(path, error_map, frames=frames, options=JOINTS, accept_weak_map=True, on_guard="skip")
    assert left.targets[1].verdict == "skip"
    assert left.targets[0].verdict == left.targets[2].verdict == "correct"
    change = left.targets[2].joints_after - np.degrees(q[2]).round(4)
    np.testing.assert_allclose(change, left.targets[0].joints_after - np.degrees(q[0]).round(4), atol=2e-4)


def test_the_command_line(tmp_path: Path, error_map: ErrorMap, run: Any) -> None:
    error_map.save(map_path := tmp_path / "map.truepose")
    path = program(tmp_path, np.degrees(error_map.samples.q[:2]))
    (tmp_path / "$config.dat").write_text(
        "TOOL_DATA[1]={"
        + ",".join(
            f"{k} {v:.6f}"
            for k, v in zip(
                "XYZABC",
                [
                    *error_map.tf_flange_tool[:3, 3],
                    *euler("kuka", Rotation.from_matrix(error_map.tf_flange_tool[:3, :3])),
                ],
                strict=True,
            )
        )
        + "}\n"
    )
    where = ("--config-dat", tmp_path / "$config.dat")
    off, on = run("check", path, *where), run("check", path, *where, "--joint-targets")
    assert "0 to correct, 2 to skip" in off.out
    assert "joint target; allow joint_targets to correct it" in off.out
    assert "2 to correct, 0 to skip" in on.out
    done = run("correct", map_path, path, *where, "--joint-targets", "--accept-weak-map", "--out", tmp_path / "out")
    assert "2 corrected" in done.out
    assert re.search(r"2 of the corrected are joint targets; their digits leave 0\.000\d mm at most", done.out)
    assert (tmp_path / "out" / "a.src").read_bytes() != path.read_bytes()
    again = run(
        "correct",
        map_path,
        tmp_path / "out" / "a.src",
        *where,
        "--joint-targets",
        "--accept-weak-map",
        "--out",
        tmp_path / "twice",
    )
    assert "was corrected already" in again.failed()
