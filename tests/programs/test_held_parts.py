"""Programs whose robot holds the part: the tool stands in the world, and the part is moved to it."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.programs.conftest import FakeMap

import truepose as tp
from truepose.errors import RefusedError
from truepose.geometry import euler, make_transform
from truepose.programs import (
    CorrectedProgram,
    FrameTable,
    Program,
    ReadOptions,
    correct_program,
    read_program,
    read_programs,
)
from truepose.programs.core.program import FrameTolerance
from truepose.programs.nominal import nominal_targets
from truepose.programs.verify import verify_program
from truepose.robots import nearest_branch, status_turn
from truepose.trackers import Readings

IDENTITY = "[[0,0,0],[1,0,0,0]]"
TF_TOOL = make_transform(euler("kuka", [20.0, 70.0, -10.0]), [1450.0, 250.0, 900.0])
"""Where the tool stands, in the robot's base."""
TF_UFRAME = make_transform(euler("kuka", [5.0, -8.0, 30.0]), [40.0, -25.0, 160.0])
TF_OFRAME = make_transform(euler("kuka", [-15.0, 3.0, 2.0]), [10.0, 60.0, 5.0])
"""The part on the flange."""


def rapid_pose(tf: np.ndarray) -> str:
    x, y, z, w = Rotation.from_matrix(tf[:3, :3]).as_quat()
    p = ",".join(f"{v:.6f}" for v in tf[:3, 3])
    return f"[[{p}],[{w:.9f},{x:.9f},{y:.9f},{z:.9f}]]"


def places(n: int, seed: int = 0, spread: float = 60.0) -> np.ndarray:
    """Return places of the tool on the part, (n, 4, 4) [mm], in the part's frame."""
    rng = np.random.default_rng(seed)
    turn = euler("kuka", [8.0, 12.0, -5.0]) * Rotation.from_rotvec(rng.uniform(-0.1, 0.1, (n, 3)))
    return make_transform(turn, rng.uniform(-spread, spread, (n, 3)) + np.array([100.0, 30.0, 80.0]))


def module(
    goals: np.ndarray, motion: str = "MoveL", tool: str | None = None, held: str = "TRUE", more: str = ""
) -> str:
    tool = tool or f"[FALSE,{rapid_pose(TF_TOOL)},[4,[0,0,1],[1,0,0,0],0,0,0]]"
    names = [f"p{k}" for k in range(len(goals))]
    conf = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
    targets = [
        f"LOCAL CONST robtarget {name}:=[{rapid_pose(tf)[1:-1]},{conf}];" for name, tf in zip(names, goals, strict=True)
    ]
    return "\n".join([
        "MODULE Held",
        f"LOCAL PERS tooldata gun:={tool};",
        f'LOCAL PERS wobjdata part:=[{held},TRUE,"",{rapid_pose(TF_UFRAME)},{rapid_pose(TF_OFRAME)}];',
        *targets,
        "PROC main()",
        *(f"{motion} {name},v100,fine,gun\\WObj:=part;" for name in names),
        more,
        "ENDPROC",
        "ENDMODULE",
        "",
    ])  # fmt: skip


def flanges(goals: np.ndarray) -> np.ndarray:
    """Return the flanges, (n, 4, 4) [mm], base frame: the place of the tool on the part is where the tool stands."""
    return TF_TOOL @ np.linalg.inv(TF_UFRAME @ TF_OFRAME @ goals)


def goals_of(program: Program) -> np.ndarray:
    turn = Rotation.from_quat(np.array([t.angles for t in program.targets])[:, [1, 2, 3, 0]])
    return make_transform(turn, np.array([t.xyz for t in program.targets]))


def verdicts(done: CorrectedProgram) -> list[str]:
    return [row["verdict"] for row in done.to_dict()["targets"]]


def write(folder: Path, text: str) -> Path:
    path = folder / "held.mod"
    path.write_text(text)
    return path


def read(folder: Path, text: str, **options) -> Program:
    return read_program(write(folder, text), FrameTable(), ReadOptions(**options))


def test_the_flange_moves_as_the_map_says(tmp_path):
    """Whatever the map asks for in the base frame is what the flange does, with each orientation of the part."""
    shifts = np.random.default_rng(1).uniform(-1.5, 1.5, (12, 3))
    goals = places(12)
    done = correct_program(read(tmp_path, module(goals)), FakeMap(shifts), resolution=1e-5)
    assert verdicts(done) == ["correct"] * 12
    done.write(tmp_path / "out")
    after = goals_of(read_program(tmp_path / "out" / "held.mod", FrameTable()))
    before, moved = flanges(goals), flanges(after)
    np.testing.assert_allclose(moved[:, :3, 3] - before[:, :3, 3], shifts, atol=2e-4)
    np.testing.assert_allclose(moved[:, :3, :3], before[:, :3, :3], atol=1e-7)


def test_the_map_is_asked_about_the_place_on_the_part(tmp_path):
    goals = places(5)
    error_map = FakeMap()
    correct_program(read(tmp_path, module(goals)), error_map)
    (call,) = error_map.calls
    np.testing.assert_allclose(call["poses"], np.broadcast_to(TF_TOOL, (5, 4, 4)), atol=1e-5)
    np.testing.assert_allclose(call["tf_flange_tool"], TF_UFRAME @ TF_OFRAME @ goals, atol=1e-5)


@pytest.fixture(scope="module")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("paper", seed=3)


@pytest.fixture(scope="module")
def error_map(virtual):
    q = virtual.design(120, seed=1, orientation_deg=25.0)
    return tp.fit_cell(virtual.cell, virtual.measure(q, seed=1), "kinematic-kriging")


def true_distance(virtual, error_map, q: np.ndarray, on_part: np.ndarray, stands: np.ndarray) -> np.ndarray:
    """Return the distances, (n,) [mm], between the places on the part (flange frame) and where the tool stands.

    The part is measured on the gripper from the reflector, and the tool in the base to which the map was registered.
    """
    tf_base = error_map.registration.tf_base_tracker @ np.linalg.inv(virtual.truth.tf_base_tracker)
    flange = tf_base @ virtual.true_poses(q) @ np.linalg.inv(virtual.tf_flange_tool)
    return np.linalg.norm((flange @ on_part)[:, :3, 3] - stands[:3, 3], axis=1)


@dataclass
class OnArm:
    """A part on the arm, and the tool that it is brought to: `goals` (n, 4, 4) [mm] on the part."""

    stands: np.ndarray
    tf_part: np.ndarray
    goals: np.ndarray
    q: np.ndarray

    @property
    def on_part(self) -> np.ndarray:
        return self.tf_part @ self.goals


def on_arm(virtual: tp.VirtualCell, *, line: bool) -> OnArm:
    """Return 20 places of a part on a straight line, or anywhere near its middle."""
    rng, t = np.random.default_rng(5), np.linspace(-1.0, 1.0, 20)[:, None]
    stands = make_transform(euler("kuka", virtual.preset.abc_deg), np.asarray(virtual.preset.centre_mm))
    tf_part = virtual.tf_flange_tool @ make_transform(euler("kuka", [60.0, 35.0, -20.0]), [-330.0, 220.0, -140.0])
    on_part = virtual.tf_flange_tool @ make_transform(
        Rotation.from_rotvec(0.2 * (t * [1.0, -0.5, 0.3] if line else rng.uniform(-1.0, 1.0, (20, 3)))),
        120.0 * (t * [0.8, -0.4, 1.0] if line else rng.uniform(-1.0, 1.0, (20, 3))),
    )
    q = nearest_branch(virtual.robot.inverse(stands @ np.linalg.inv(on_part)), virtual._home)
    return OnArm(stands, tf_part, np.linalg.inv(tf_part) @ on_part, q)


def check_nearer(virtual, error_map, arm: OnArm, after: np.ndarray, corrected: np.ndarray) -> None:
    """Check that the places on the part come nearer to the tool if the program names the places `after`."""
    q_after = nearest_branch(virtual.robot.inverse(arm.stands @ np.linalg.inv(arm.tf_part @ after)), arm.q)
    before, now = (true_distance(virtual, error_map, q, arm.on_part, arm.stands)[corrected] for q in (arm.q, q_after))
    assert corrected.sum() >= 15
    assert (now < before).all()
    assert np.sqrt(np.mean(now**2)) < 0.5 * np.sqrt(np.mean(before**2))


@pytest.mark.parametrize("motion", ["MoveL", "MoveJ"])
def test_the_true_place_on_the_part_comes_to_the_tool(tmp_path, virtual, error_map, motion):
    """On an arm with errors, a corrected program brings the part nearer to the tool than the original, everywhere."""
    arm = on_arm(virtual, line=motion == "MoveL")
    text = module(arm.goals, motion, f"[FALSE,{rapid_pose(arm.stands)},[4,[0,0,1],[1,0,0,0],0,0,0]]")
    text = text.replace(rapid_pose(TF_UFRAME), rapid_pose(arm.tf_part)).replace(rapid_pose(TF_OFRAME), IDENTITY)
    done = correct_program(
        write(tmp_path, text), error_map, frames=FrameTable(), other_maker=True, on_guard="skip", resolution=1e-4
    )
    done.write(tmp_path / "out")
    after = goals_of(read_program(tmp_path / "out" / "held.mod", FrameTable()))
    check_nearer(virtual, error_map, arm, after, np.array(verdicts(done)) == "correct")


def krl(arm: OnArm, robot, positions: np.ndarray, motion: str, ipo: str = "#TCP") -> tuple[str, str]:
    """Return a KUKA module of inline forms; positions (n, 4, 4) [mm] under tool 2 and base 1."""
    status, turn = status_turn(robot, arm.q)
    abc = euler("kuka", Rotation.from_matrix(positions[:, :3, :3]))
    points, steps = [], []
    for k, (p, angles) in enumerate(zip(positions[:, :3, 3], abc, strict=True)):
        numbers = ",".join(f"{key} {v:.6f}" for key, v in zip("XYZABC", [*p, *angles], strict=True))
        points.append(f"DECL E6POS XP{k}={{{numbers},S {status[k]},T {turn[k]},E1 0.0,E2 0.0}}")
        fdat = f'TOOL_NO 2,BASE_NO 1,IPO_FRAME {ipo},POINT2[] " ",TQ_STATE FALSE'
        points.append(f"DECL FDAT FP{k}={{{fdat}}}")
        word = "PTP" if motion == "PTP" or (motion == "PTP, LIN" and k == 0) else "LIN"
        steps += [f"FDAT_ACT=FP{k}", f"BAS(#{'PTP' if word == 'PTP' else 'CP'}_PARAMS,100)", f"{word} XP{k}"]
    return "DEF held( )\n" + "\n".join(steps) + "\nEND\n", "DEFDAT HELD\n" + "\n".join(points) + "\nENDDAT\n"


def correct_krl(folder: Path, arm: OnArm, virtual, error_map, positions: np.ndarray, motion: str, **more):
    src, dat = krl(arm, virtual.robot, positions, motion, **more)
    (folder / "held.src").write_text(src)
    (folder / "held.dat").write_text(dat)
    frames = FrameTable(tools={2: arm.tf_part}, bases={1: arm.stands})
    done = correct_program(folder / "held.src", error_map, frames=frames, on_guard="skip", resolution=1e-4)
    done.write(folder / "out")
    after = read_program(folder / "out" / "held.src", frames).targets
    tfs = make_transform(euler("kuka", np.array([t.angles for t in after])), np.array([t.xyz for t in after]))
    return done, tfs


@pytest.mark.parametrize("counted", ["of the part at the tool", "of the tool on the part"])
@pytest.mark.parametrize("motion", ["PTP", "PTP, LIN"])
def test_a_part_is_brought_to_the_fixed_tool_of_kuka(tmp_path, virtual, error_map, motion, counted):
    """Status and Turn show how a program counts positions; either way the true place on the part comes to the tool."""
    arm = on_arm(virtual, line=motion != "PTP")
    way = np.linalg.inv if counted == "of the part at the tool" else np.asarray
    done, after = correct_krl(tmp_path, arm, virtual, error_map, way(arm.goals), motion)
    check_nearer(virtual, error_map, arm, way(after), np.array(verdicts(done)) == "correct")
    told = "20 targets: the robot holds the part to a tool that stands"
    assert any(warning.startswith(told) for warning in done.warnings)
    rows = done.to_dict()["targets"]
    assert np.allclose([row["base_mm"] for row in rows], arm.stands[:3, 3], atol=1e-3)
    frames = FrameTable(tools={2: arm.tf_part}, bases={1: arm.stands})
    readings = error_map.registration.tf_tracker_base @ (
        arm.stands @ np.linalg.inv(arm.on_part) @ virtual.tf_flange_tool
    )
    corrected = read_program(tmp_path / "out" / "held.src", frames)
    read_back = Readings(readings[:, :3, 3], np.arange(1, 21), "readings.txt")
    found = verify_program(error_map, corrected, read_back, tolerance_mm=0.2, uncertainty_mm=0.01)
    assert max(one.error_mm for one in found.targets) < 2e-3


def test_a_program_that_does_not_show_how_it_counts_is_refused(tmp_path, virtual, error_map):
    arm = on_arm(virtual, line=True)
    with pytest.raises(RefusedError, match="no PTP motion with Status and Turn shows how the program counts"):
        correct_krl(tmp_path, arm, virtual, error_map, np.linalg.inv(arm.goals), "LIN")
    with pytest.raises(RefusedError, match="no PTP motion with Status and Turn"):  # a map that knows no robot
        correct_krl(tmp_path, arm, virtual, FakeMap(), np.linalg.inv(arm.goals), "PTP")
    near = replace(arm, goals=arm.goals[:1], q=arm.q[:1])
    near.goals[:] = np.eye(4)  # the place of the tool on the part is that of the part at the tool
    near.q[:] = nearest_branch(virtual.robot.inverse(arm.stands @ np.linalg.inv(near.on_part)), virtual._home)
    with pytest.raises(RefusedError, match="fit whether positions are those of the part or of the tool"):
        correct_krl(tmp_path, near, virtual, error_map, near.goals, "PTP")
    turned = replace(arm, tf_part=arm.tf_part @ make_transform(euler("kuka", [170.0, 20.0, 40.0]), [300.0, 0.0, 0.0]))
    with pytest.raises(RefusedError, match="the joints do not fit Status and Turn: check TOOL_DATA"):
        correct_krl(tmp_path, turned, virtual, error_map, np.linalg.inv(arm.goals), "PTP")


@pytest.mark.parametrize(
    ("types", "why"),
    [
        ("TOOL_TYPE[2]=#BASE", "tool TOOL_DATA[2] is not marked as a part in the gripper, but"),
        ("BASE_TYPE[1]=#BASE", "base BASE_DATA[1] is not marked as a fixed tool, but"),
        ("TOOL_TYPE[2]=#TCP\nBASE_TYPE[1]=#TCP", ""),
        ("TOOL_TYPE[2]=#NONE", ""),
    ],
)
@pytest.mark.parametrize("ipo", ["#TCP", "#BASE"])
def test_the_controller_marks_parts_and_fixed_tools(tmp_path, virtual, types, why, ipo):
    arm = on_arm(virtual, line=False)
    root = tmp_path / "KRC" / "R1"
    (root / "System").mkdir(parents=True)
    (root / "Program").mkdir()
    numbers = [
        ",".join(f"{key} {v:.6f}" for key, v in zip("XYZABC", [*tf[:3, 3], *angles], strict=True))
        for tf in (arm.tf_part, arm.stands)
        for angles in euler("kuka", Rotation.from_matrix(tf[None, :3, :3]))
    ]
    config = [
        "DEFDAT $CONFIG PUBLIC",
        f"TOOL_DATA[2]={{{numbers[0]}}}",
        f"BASE_DATA[1]={{{numbers[1]}}}",
        types,
        "ENDDAT",
    ]
    (root / "System" / "$config.dat").write_text("\n".join(config) + "\n")
    src, dat = krl(arm, virtual.robot, np.linalg.inv(arm.goals), "PTP", ipo)
    (root / "Program" / "held.src").write_text(src)
    (root / "Program" / "held.dat").write_text(dat)
    (program,) = read_programs([tmp_path]).programs
    if ipo == "#BASE":  # the same marks for a tool on the flange
        why = "tool TOOL_DATA[2] is marked as a part in the gripper, but" if "TOOL_TYPE[2]=#TCP" in types else ""
        assert {t.verdict for t in program.targets} == {"refuse" if why else "correct"}
    else:
        why = why or "the robot holds the part to a fixed tool (IPO_FRAME #TCP): how its positions count is found"
        assert {t.verdict for t in program.targets} == {"refuse"}
    assert all(why in t.reason for t in program.targets), program.targets[0].reason


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"held": "FALSE"}, "(gun), but part is not of such a part"),
        ({"tool": f"[TRUE,{IDENTITY},[4,[0,0,1],[1,0,0,0],0,0,0]]"}, "(part), but gun is not of such a part"),
        ({"held": "bHolds"}, "whether the robot holds part is known at run time only"),
        ({"more": "gun.tframe.trans.x:=1400;"}, "gun is changed by the program"),
        ({"more": "part.oframe.trans.x:=3;"}, "part is changed by the program"),
    ],
)
def test_what_is_not_certain_is_refused(tmp_path, change, why):
    for options in ({}, {"tool_tolerance": "5mm", "frame_tolerance": "5mm"}):
        if options:
            options = {name: FrameTolerance.parse(text) for name, text in options.items()}
        program = read(tmp_path, module(places(2), **change), **options)
        assert {t.verdict for t in program.targets} == {"refuse"}
        assert all(why in t.reason for t in program.targets), program.targets[0].reason


def test_orientations_are_not_corrected_there(tmp_path):
    program = read(tmp_path, module(places(2)), orientation=True)
    assert {t.reason for t in program.targets} == {
        "the tool stands in the world and the robot holds the part: positions are corrected there, without orientations"
    }


def test_frames_of_the_cell_file_are_for_parts_that_stand(tmp_path):
    path = write(tmp_path, module(places(2)))
    program = read_program(path, FrameTable(tools={"gun": np.eye(4)}))
    assert all("gun is also in [frames]" in t.reason for t in program.targets)


def test_joints_and_derived_positions_are_refused(tmp_path):
    joints = "MoveAbsJ [[0,0,0,0,90,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,gun\\WObj:=part;"
    program = read(tmp_path, module(places(1), more=joints), joint_targets=True)
    assert "which point of it the joints bring to the tool is not known" in program.targets[1].reason
    shifted = "MoveL Offs(p0,0,0,20),v100,fine,gun\\WObj:=part;"
    program = read(tmp_path, module(places(1), more=shifted), derived=True)
    assert program.targets[0].verdict == "refuse"


def test_one_point_at_a_standing_and_a_moving_tool(tmp_path):
    both = "MoveL p0,v100,fine,tool0;"
    program = read(tmp_path, module(places(1), more=both))
    assert (program.targets[0].verdict, "moved to under" in program.targets[0].reason) == ("refuse", True)


def test_a_bend_is_judged_on_the_part(tmp_path):
    """One target that stays nominal in a row bends the path on the part by its neighbours' correction."""
    goals = places(1).repeat(5, axis=0)
    goals[:, 0, 3] += 12.0 * np.arange(5)
    error_map = FakeMap((0.4, 0.0, 0.0), guarded={2: "outside"}, std=0.01)
    done = correct_program(read(tmp_path, module(goals)), error_map, on_guard="skip")
    assert any("its whole path stays nominal" in row["reason"] for row in done.to_dict()["targets"])
    np.testing.assert_allclose(done.continuity.bend[1], 0.0, atol=1e-3)


def test_a_path_ends_where_the_tool_changes_from_standing_to_moving(tmp_path):
    near = rapid_pose(make_transform(euler("abb", [1.0, 0.0, 0.0, 0.0]), [900.0, 0.0, 700.0]))[1:-1]
    conf = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
    more = "\n".join(f"MoveL [{near},{conf}],v100,fine,tool0;" for _ in range(2))
    error_map = FakeMap((0.4, 0.0, 0.0), std=0.01)
    done = correct_program(read(tmp_path, module(places(2), more=more)), error_map)
    assert verdicts(done) == ["correct"] * 4
    assert np.isnan(done.continuity.bend).all()


def test_the_record_and_the_nominal_targets_are_at_the_tool(tmp_path):
    goals = places(4)
    done = correct_program(read(tmp_path, module(goals)), FakeMap((0.5, -0.25, 1.0)), resolution=1e-4)
    done.write(tmp_path / "out")
    record = json.loads((tmp_path / "out" / "held.corrections.json").read_text())
    for row in record["targets"]:
        before, after = (np.array(row[key]) for key in ("base_mm", "base_after_mm"))
        np.testing.assert_allclose(before, TF_TOOL[:3, 3], atol=1e-4)
        np.testing.assert_allclose(after - before, [0.5, -0.25, 1.0], atol=2e-3)
    corrected = read_program(tmp_path / "out" / "held.mod", FrameTable())
    nominal = nominal_targets(corrected, None, np.eye(4))
    np.testing.assert_allclose(nominal.tf_base_tool, np.broadcast_to(TF_TOOL, (4, 4, 4)), atol=1e-3)
    np.testing.assert_allclose(nominal.tf_flange_tool, TF_UFRAME @ TF_OFRAME @ goals, atol=1e-3)
    np.testing.assert_allclose(nominal.positions_of(np.eye(4)), flanges(goals)[:, :3, 3], atol=1e-3)
