"""Frames that a program sets at run time near their stored values."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from truepose.errors import DataError, RefusedError
from truepose.programs import FrameTable, FrameTolerance, ReadOptions, correct_program, read_program
from truepose.programs.core.reasons import group_reasons

POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 10.0,C -170.0}"
SET = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n"
MEASURED = f"BASE_DATA[1].X = BASE_DATA[1].X + touched\n{SET}LIN {POSE}\nLIN {POSE.replace('812.5', '800')}\n"
TOLERANCE = FrameTolerance(5.0)


class Field:
    """Corrects by `gradient` [mm per mm] (3, 3) times the position in the base frame, plus 0.5 mm along x."""

    def __init__(self, gradient: Any) -> None:
        self.gradient, self.asked = np.asarray(gradient, float), []

    def correct(self, poses: np.ndarray, **_: Any) -> Any:
        p, n = poses[:, :3, 3], len(poses)
        self.asked.append(p)
        shift = p @ self.gradient.T + [0.5, 0.0, 0.0]
        std = np.full((n, 3), 2.0)
        return SimpleNamespace(
            p_target=p, p_command=p + shift, e=-shift, std=std, verdict=np.full(n, "correct"), reason=[""] * n
        )


@pytest.mark.promise("A frame that the program sets at run time is refused by name; the option is named.")
def test_without_the_option(read: Any) -> None:
    program = read(MEASURED)
    assert {t.verdict for t in program.targets} == {"refuse"}
    words = "BASE_DATA[1] is changed by the program (line 2); --frame-tolerance corrects with the stored frame"
    assert {t.reason for t in program.targets} == {words}


def test_each_frame_says_how_many_targets_it_holds(read: Any) -> None:
    other = "BASE_DATA[2].X = BASE_DATA[2].X + touched\n$BASE=BASE_DATA[2]\n"
    groups = group_reasons(read(f"{MEASURED}{other}LIN {POSE}\n").targets)
    assert [(len(group.targets), group.reason[:12]) for group in groups] == [(2, "BASE_DATA[1]"), (1, "BASE_DATA[2]")]


@pytest.mark.promise("With a tolerance the stored frame counts, and the map is asked all around it.")
def test_within_the_tolerance(read: Any) -> None:
    program = read(MEASURED, frame_tolerance=TOLERANCE)
    assert {t.verdict for t in program.targets} == {"correct"}
    field = Field(np.diag([1e-3, 0.0, 0.0]))
    corrected = correct_program(program, field)
    around = field.asked[1].reshape(2, 8, 3) - field.asked[0][:, None]
    assert np.allclose(np.linalg.norm(around, axis=2), 5.0 * np.sqrt(3.0))
    assert np.allclose(around.mean(axis=1), 0.0, atol=1e-9)
    rows = corrected.to_dict()["targets"]
    largest = 1e-3 * np.abs(around[..., 0]).max()
    assert [row["difference_mm"] for row in rows] == pytest.approx([largest] * 2, abs=1e-6)
    assert all("stored frame: BASE_DATA[1] is changed by the program (line 2)" in row["note"] for row in rows)


@pytest.mark.promise("A correction that changes by more than the limit within the tolerance is refused.")
def test_beyond_the_limit(read: Any) -> None:
    program = read(MEASURED, frame_tolerance=TOLERANCE)
    with pytest.raises(RefusedError, match=r"frame at the border of the tolerance .*differs by .* limit 0\.2 mm"):
        correct_program(program, Field(np.diag([0.05, 0.0, 0.0])))
    left = correct_program(program, Field(np.diag([0.05, 0.0, 0.0])), on_guard="skip")
    assert left.coverage.corrected == 0


def test_turns_of_the_frame_count(read: Any) -> None:
    steep = Field(np.diag([5e-3, 0.0, 0.0]))
    assert correct_program(read(MEASURED, frame_tolerance=TOLERANCE), steep).coverage.corrected == 2
    turned = read(MEASURED, frame_tolerance=FrameTolerance(5.0, 2.0))  # at 1.3 m from its origin
    with pytest.raises(RefusedError, match="border of the tolerance"):
        correct_program(turned, steep)


@pytest.mark.parametrize("code", [f"BASE_DATA[1]={POSE}\n", "BASE_DATA[1]=BASE_DATA[2]\n"])
def test_a_constant_beyond_the_tolerance(code: str, read: Any) -> None:
    program = read(f"{code}{SET}LIN {POSE}\n", frame_tolerance=TOLERANCE)
    (target,) = program.targets
    assert target.verdict == "refuse"
    assert "beyond the tolerance around the stored frame" in target.reason


def test_tools_and_unknown_frames_stay_refused(read: Any, frames: FrameTable) -> None:
    tool = read(f"TOOL_DATA[1].Z = TOOL_DATA[1].Z + worn\n{SET}LIN {POSE}\n", frame_tolerance=TOLERANCE)
    assert {t.verdict for t in tool.targets} == {"refuse"}
    computed = read(f"{SET}$BASE = measured\nLIN {POSE}\n", frame_tolerance=TOLERANCE)
    assert {t.verdict for t in computed.targets} == {"refuse"}
    missing = read(MEASURED, frame_tolerance=TOLERANCE, table=replace(frames, bases={}))
    assert {t.verdict for t in missing.targets} == {"refuse"}


def test_derived_positions_within_the_tolerance(read: Any) -> None:
    code = f"{MEASURED}XAP = XP1\nXAP.Z = XAP.Z + 50\nLIN XAP\nLIN XP1\n"
    program = read(code, f"DECL E6POS XP1={POSE}\nDECL E6POS XAP", frame_tolerance=TOLERANCE, derived=True)
    field = Field(np.zeros((3, 3)))
    correct_program(program, field)
    asked = [len(p) for p in field.asked]
    assert sum(asked) == 3 + 2 * 8 + (2 * 9 - 1)


RAPID = """MODULE a
PERS wobjdata wFix:=[FALSE,TRUE,"",[[900,100,40],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
PERS tooldata tGrip:=[TRUE,[[0,0,150],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
LOCAL CONST robtarget p1:=[[600,0,800],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
PROC main()
wFix.uframe:=measured;
MoveL p1,v100,fine,tGrip\\WObj:=wFix;
ENDPROC
ENDMODULE
"""


@pytest.mark.promise("The stored value of a RAPID workobject counts within the tolerance.")
def test_a_workobject(tmp_path: Path) -> None:
    (tmp_path / "a.mod").write_text(RAPID)
    (target,) = read_program(tmp_path / "a.mod").targets
    assert target.verdict == "refuse"
    assert "wFix is changed by the program (line 6); --frame-tolerance" in target.reason
    program = read_program(tmp_path / "a.mod", options=ReadOptions(frame_tolerance=TOLERANCE))
    (target,) = program.targets
    assert target.verdict == "correct", target.reason
    field = Field(np.zeros((3, 3)))
    assert correct_program(program, field).coverage.corrected == 1
    assert [len(p) for p in field.asked] == [1, 8]


@pytest.mark.parametrize("text", ["", "5", "5 m", "mm", "-5mm", "0mm", "5mm,90deg", "1e9mm", "nan mm", "1.2.3mm"])
def test_what_is_no_tolerance(text: str) -> None:
    with pytest.raises(DataError):
        FrameTolerance.parse(text)


def test_tolerances() -> None:
    assert FrameTolerance.parse(" 5 mm ") == FrameTolerance(5.0)
    assert FrameTolerance.parse("0.5mm, 0.25°") == FrameTolerance(0.5, 0.25)
    with pytest.raises(DataError):
        ReadOptions(frame_tolerance=FrameTolerance(-1.0))


TOOL_MEASURED = f"TOOL_DATA[1].Z = TOOL_DATA[1].Z + worn\n{SET}LIN {POSE}\nLIN {POSE.replace('812.5', '800')}\n"


class Tools(Field):
    """Corrects by `gradient` times the place of the flange."""

    def correct(self, poses: np.ndarray, *, tf_flange_tool: np.ndarray, **_: Any) -> Any:
        flange = (poses @ np.linalg.inv(tf_flange_tool))[:, :3, 3]
        p, n = poses[:, :3, 3], len(poses)
        self.asked.append(flange)
        shift = flange @ self.gradient.T + [0.5, 0.0, 0.0]
        std = np.full((n, 3), 2.0)
        return SimpleNamespace(
            p_target=p, p_command=p + shift, e=-shift, std=std, verdict=np.full(n, "correct"), reason=[""] * n
        )


@pytest.mark.promise(
    "With a tolerance for tools the stored tool counts, and the map is asked with tools all around it."
)
def test_a_tool_that_the_program_sets(read: Any) -> None:
    words = "TOOL_DATA[1] is changed by the program (line 2); --tool-tolerance corrects with the stored tool"
    assert {t.reason for t in read(TOOL_MEASURED).targets} == {words}
    assert {t.reason for t in read(TOOL_MEASURED, frame_tolerance=TOLERANCE).targets} == {words}
    program = read(TOOL_MEASURED, tool_tolerance=FrameTolerance(2.0, 0.5))
    assert {t.verdict for t in program.targets} == {"correct"}
    field = Tools(np.diag([1e-3, 0.0, 0.0]))
    corrected = correct_program(program, field)
    around = field.asked[1].reshape(2, 64, 3) - field.asked[0][:, None]
    assert np.linalg.norm(around, axis=2).min() > 1.0
    rows = corrected.to_dict()["targets"]
    largest = 1e-3 * np.abs(around[..., 0]).max(axis=1)
    assert [row["difference_mm"] for row in rows] == pytest.approx(largest.tolist(), abs=1e-6)
    assert all("stored tool: TOOL_DATA[1] is changed by the program (line 2)" in row["note"] for row in rows)
    with pytest.raises(RefusedError, match=r"tool at the border of the tolerance .*differs by .* limit 0\.2 mm"):
        correct_program(program, Tools(np.diag([0.2, 0.0, 0.0])))


@pytest.mark.parametrize("code", [f"TOOL_DATA[1]={POSE}\n", "TOOL_DATA[1]=TOOL_DATA[2]\n"])
def test_a_constant_tool_beyond_the_tolerance(code: str, read: Any) -> None:
    (target,) = read(f"{code}{SET}LIN {POSE}\n", tool_tolerance=FrameTolerance(1.0)).targets
    assert target.verdict == "refuse"
    assert "beyond the tolerance around the stored tool" in target.reason


def test_a_tool_and_a_frame_are_not_both_within_a_tolerance(read: Any) -> None:
    code = f"TOOL_DATA[1].Z = TOOL_DATA[1].Z + worn\n{MEASURED}"
    program = read(code, tool_tolerance=TOLERANCE, frame_tolerance=TOLERANCE)
    assert {t.verdict for t in program.targets} == {"refuse"}
    assert "only one of both may be known within a tolerance" in program.targets[0].reason
