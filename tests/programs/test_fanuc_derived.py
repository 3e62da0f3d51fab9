"""FANUC positions from which registers derive others: followed by constant shifts, refused where anything is open."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.programs.corpus_fanuc import lp, ls

from truepose.geometry import euler, make_transform
from truepose.programs import FrameTable, Program, ReadOptions
from truepose.programs.core.program import FrameTolerance
from truepose.programs.core.target import Target
from truepose.programs.tp.reader import read
from truepose.programs.tp.registers import Registers, StoredRegister, effects_of

FRAMES = FrameTable(tools={1: np.eye(4), 2: np.eye(4)}, bases={1: np.eye(4), 2: np.eye(4)})
IN_FORCE = "  UFRAME_NUM=1\n  UTOOL_NUM=1\n"
THREE = lp(1) + lp(2) + lp(3)
COPY = "  PR[1]=P[1]\n  PR[1,3]=PR[1,3]+50\n"


def text(code: str, positions: str = THREE, name: str = "A") -> str:
    lines = "".join(f"{k:>4}:{line} ;\n" for k, line in enumerate(code.split("\n"), 1))
    return ls(lines, positions, name)


def judged(
    tmp_path: Path, code: str, positions: str = THREE, registers: Registers | None = None, **options: Any
) -> Program:
    path = tmp_path / "a.ls"
    path.write_bytes(text(IN_FORCE + code, positions).encode())
    asked = {"derived": True, "whole_task": True, **options}
    return read(path, FRAMES, ReadOptions(**asked), registers=registers)


def with_programs(others: dict[str, str], own: str = "", **stored: tuple[float, ...]) -> Registers:
    programs = {name: effects_of(text(code, name=name).encode()) for name, code in others.items()}
    programs["A"] = effects_of(text(own).encode())
    return Registers({(1, int(number[2:])): StoredRegister(values) for number, values in stored.items()}, {}, programs)


def target(program: Program, name: str) -> Target:
    found = [one for one in program.targets if one.name == name]
    assert found, [one.name for one in program.targets]
    return found[-1]


def shifts(program: Program, name: str = "P[1]") -> set[tuple[float, ...]]:
    return {shift for one in target(program, name).derived for shift in one.shifts}


def follows(program: Program, name: str) -> list[str]:
    found = program.targets
    (i,) = [i for i, one in enumerate(found) if one.name == name and i in found.follows] or [-1]
    return [found[j].name for j in found.follows[i].sources] if i >= 0 else []


APPROACHES = {
    "z of a copy": (f"{COPY}L PR[1] 9mm/sec FINE", {(0.0, 0.0, 50.0)}),
    "several coordinates": (
        "  PR[1]=P[1]\n  PR[1,1]=PR[1,1]-10\n  PR[1,2]=(PR[1,2]+5.5)\n  PR[1,3]=PR[1,3]+2*R[9]\nL PR[1] 9mm/sec FINE",
        None,
    ),
    "register of its own": (
        "  PR[2]=LPOS-LPOS\n  PR[2,3]=80\n  PR[1]=P[1]+PR[2]\nL PR[1] 9mm/sec FINE",
        {(0.0, 0.0, 80.0)},
    ),
    "between words": (
        f"  COL DETECT OFF\n{COPY}  LOCK PREG\n  PAUSE\nL PR[1] 9mm/sec FINE\n  UNLOCK PREG\n  Weld End",
        {(0.0, 0.0, 50.0)},
    ),
    "difference": (
        "  PR[2]=PR[3]-PR[3]\n  PR[2,1]=(-20)\n  PR[1]=P[1:above]-PR[2:shift]\nJ PR[1:x] 9% CNT100",
        {(20.0, 0.0, 0.0)},
    ),
    "numbers": (
        "  R[1:h]=40\n  R[1]=R[1]*2\n  PR[1]=P[1]\n  PR[1,3]=PR[1,3]+R[1]\nL PR[1] 9mm/sec FINE",
        {(0.0, 0.0, 80.0)},
    ),
    "where it stands": (
        "L P[1] 9mm/sec FINE\n  PR[1]=LPOS\n  PR[1,3]=PR[1,3]+30\nL PR[1] 9mm/sec FINE",
        {(0.0, 0.0, 30.0)},
    ),
    "a turn": (f"{COPY}  PR[1,6]=PR[1,6]+90\nL PR[1] 9mm/sec FINE", None),
    "a coordinate of its own": ("  PR[1]=P[1]\n  PR[1,3]=400\nL PR[1] 9mm/sec FINE", None),
    "a point of another": ("  PR[1]=P[1]\n  PR[2]=P[2]\n  PR[1,3]=PR[2,3]\nL PR[1] 9mm/sec FINE", None),
    "an input": (f"  R[1]=GI[1]\n{COPY}  PR[1,3]=PR[1,3]+R[1]\nL PR[1] 9mm/sec FINE", None),
    "a camera": (f"  R[1]=20\n  VISION GET_NFOUND 'P' R[1]\n{COPY}  PR[1,3]=PR[1,3]+R[1]\nL PR[1] 9mm/sec FINE", None),
    "written by its number": (f"{COPY}  PR[R[1]]=P[2]\nL PR[1] 9mm/sec FINE", None),
    "an input of a condition": (f"{COPY}  IF PR[1,3]>100,JMP LBL[1]\n  LBL[1]\nL PR[1] 9mm/sec FINE", None),
    "another frame": (f"{COPY}  UFRAME_NUM=2\nL PR[1] 9mm/sec FINE", None),
    "another tool": (f"{COPY}  UTOOL_NUM=R[1]\nL PR[1] 9mm/sec FINE", None),
    "called": (f"{COPY}  CALL X\nL PR[1] 9mm/sec FINE", None),
    "a macro": (f"{COPY}  OPEN HAND\nL PR[1] 9mm/sec FINE", None),
    "no number": ("  PR[1]=P[1]\n  PR[1,3]=PR[1,3]+1e999\n  PR[1e999]=P[1]\nL PR[1] 9mm/sec FINE", None),
    "half a number": ("  PR[1]=P[1]\n  PR[1,3]=PR[1.5,3]+50\nL PR[1] 9mm/sec FINE", None),
    "division": ("  PR[1]=P[1]\n  R[1]=10 DIV 3\n  PR[1,3]=PR[1,3]+R[1]\nL PR[1] 9mm/sec FINE", None),
}


@pytest.mark.parametrize("case", APPROACHES)
def test_approach_points(tmp_path: Path, case: str) -> None:
    code, expected = APPROACHES[case]
    program = judged(tmp_path, f"{code}\nL P[1] 9mm/sec FINE")
    name = next(one.name for one in program.targets if one.name.startswith("PR"))
    if expected is None:
        assert target(program, "P[1]").verdict != "correct"
        return
    assert (target(program, "P[1]").verdict, shifts(program)) == ("correct", expected)
    assert follows(program, name) == ["P[1]"]
    without = judged(tmp_path, f"{code}\nL P[1] 9mm/sec FINE", derived=False)
    assert target(without, "P[1]").verdict == "refuse"
    assert "--derived corrects both alike" in target(without, "P[1]").reason
    assert "--derived corrects both alike" in target(without, name).reason


def test_where_it_stands_while_it_moves_is_not_followed(tmp_path: Path) -> None:
    code = "L P[1] 9mm/sec CNT50\n  PR[1]=LPOS\n  PR[1,3]=PR[1,3]+30\nL PR[1] 9mm/sec FINE"
    for early in (code, code.replace("CNT50", "FINE Skip,LBL[1]") + "\n  LBL[1]"):
        program = judged(tmp_path, early)
        assert (target(program, "P[1]").verdict, target(program, "PR[1]").verdict) == ("correct", "skip")
        assert follows(program, "PR[1]") == []


def test_where_it_stands_after_a_call(tmp_path: Path) -> None:
    code = "L P[1] 9mm/sec FINE\n  CALL X\n  PR[1]=LPOS\nL PR[1] 9mm/sec FINE"
    for other, found in (
        ("  RO[1]=ON", ["P[1]"]),
        ("  !L P[9] 9% FINE", ["P[1]"]),
        ("J P[2] 9% FINE", []),
        ("  UFRAME_NUM=2", []),
        ("  CALL Y", []),
    ):
        known = with_programs({"X": other}, code)
        assert follows(judged(tmp_path, code, registers=known), "PR[1]") == found, other


@pytest.mark.parametrize("other", ["UFRAME_NUM=2", "UTOOL_NUM=2", "$MNUFRAMENUM[1]=2", "UFRAME_NUM=R[1]"])
def test_where_it_stands_in_another_frame_is_not_followed(other: str, tmp_path: Path) -> None:
    back = f"{IN_FORCE}  PR[1,3]=PR[1,3]+50\nL PR[1] 9mm/sec FINE"
    code = f"L P[1] 9mm/sec FINE\n  {other}\n  PR[1]=LPOS\n{back}"
    program = judged(tmp_path, code)
    assert (target(program, "P[1]").verdict, target(program, "PR[1]").verdict) == ("correct", "skip")
    assert follows(program, "PR[1]") == []
    assert follows(judged(tmp_path, code.replace(f"  {other}\n", "")), "PR[1]") == ["P[1]"]


def test_reading_the_position_of_the_robot_is_no_use_of_a_taught_one(tmp_path: Path) -> None:
    code = "L P[1] 9mm/sec FINE\n  PR[1]=LPOS\n  PR[2]=JPOS\n  IF PR[1,3]>500,JMP LBL[1]\n  LBL[1]\n  CALL X"
    for options in ({}, {"derived": False}, {"whole_task": False}):
        assert target(judged(tmp_path, code, **options), "P[1]").verdict == "correct"


def test_registers_that_a_motion_writes_on_its_way(tmp_path: Path) -> None:
    code = f"{COPY}L P[2] 9mm/sec FINE Skip,LBL[1],PR[1]=LPOS\n  LBL[1]\nL PR[1] 9mm/sec FINE\nL P[1] 9mm/sec FINE"
    program = judged(tmp_path, code)
    assert (target(program, "P[1]").verdict, target(program, "P[2]").verdict) == ("refuse", "correct")


def test_both_ways_of_a_condition(tmp_path: Path) -> None:
    code = "  IF (DI[1]) THEN\n  PR[1]=P[1]\n  ELSE\n  PR[1]=P[2]\n  ENDIF\n  PR[1,2]=PR[1,2]+7\nL PR[1] 9mm/sec FINE"
    program = judged(tmp_path, f"{code}\nL P[1] 9mm/sec FINE\nL P[2] 9mm/sec FINE")
    assert follows(program, "PR[1]") == ["P[1]", "P[2]"]
    assert shifts(program) == shifts(program, "P[2]") == {(0.0, 7.0, 0.0)}
    half = code.replace("  ELSE\n  PR[1]=P[2]\n", "")  # the other way the register has an older value
    assert follows(judged(tmp_path, half), "PR[1]") == []


PALLET = """  FOR R[1]=0 TO 3
  FOR R[2:col]=2 DOWNTO 0
  PR[1]=P[1]
  R[3]=R[1]*80
  R[4]=R[2]*60.5
  PR[1,1]=PR[1,1]+R[3]
  PR[1,2]=PR[1,2]+R[4]
  PR[1,3]=PR[1,3]+100
L PR[1] 900mm/sec CNT30
  PR[1,3]=PR[1,3]-100
L PR[1] 100mm/sec FINE
  ENDFOR
  ENDFOR
L P[1] 100mm/sec FINE"""


def test_pallets_with_constant_pitch(tmp_path: Path) -> None:
    program = judged(tmp_path, PALLET)
    expected = {(80.0 * row, 60.5 * column, z) for row, column, z in product(range(4), range(3), (0.0, 100.0))}
    assert shifts(program) == expected
    assert target(program, "P[1]").verdict == "correct"
    open_end = judged(tmp_path, PALLET.replace("0 TO 3", "0 TO R[9]"))
    assert target(open_end, "P[1]").verdict == "refuse"
    endless = judged(tmp_path, PALLET.replace("0 TO 3", "0 TO 3000"))
    assert target(endless, "P[1]").verdict == "refuse"


def test_positions_by_a_counter(tmp_path: Path) -> None:
    code = "  FOR R[1]=1 TO 2\nL P[R[1]] 9mm/sec FINE\n  ENDFOR\nL P[3] 9mm/sec FINE"
    program = judged(tmp_path, code)
    assert follows(program, "P[R[1]]") == ["P[1]", "P[2]"]
    assert [target(program, f"P[{n}]").verdict for n in (1, 2, 3)] == ["correct"] * 3
    assert follows(judged(tmp_path, code.replace("=1 TO 2", "=1 TO R[5]")), "P[R[1]]") == []
    without = judged(tmp_path, code, derived=False)  # it goes to positions as they are
    assert [target(without, f"P[{n}]").verdict for n in (1, 2, 3)] == ["correct"] * 3


OFFSETS = {
    "of the program": ("  PR[2]=LPOS-LPOS\n  PR[2,3]=60", "Offset,PR[2]", {(0.0, 0.0, 60.0)}),
    "each component": (
        "\n".join(f"  PR[2,{k}]={20 if k == 1 else 0}" for k in range(1, 7)),
        "Offset,PR[2:up]",
        {(20.0, 0.0, 0.0)},
    ),
    "of the tool": ("  PR[2]=LPOS-LPOS\n  PR[2,3]=(-60)", "Tool_Offset,PR[2]", {(0.0, 0.0, -60.0)}),
    "stored": ("", "Offset,PR[10]", {(1.0, 2.0, 3.0)}),
    "stored, turned": ("", "Offset,PR[11]", None),
    "stored, written by another": ("", "Offset,PR[12]", None),
    "not all components": ("  PR[2,3]=60", "Offset,PR[2]", None),
    "turned": ("  PR[2]=LPOS-LPOS\n  PR[2,6]=5", "Offset,PR[2]", None),
    "by its number": ("", "Offset,PR[R[1]]", None),
    "of a condition": ("  OFFSET CONDITION PR[10]", "Offset", None),
    "measured": ("  PR[2]=LPOS-P[2]", "Offset,PR[2]", None),
    "increment": ("", "INC", None),
}


@pytest.mark.parametrize("case", OFFSETS)
def test_offsets(tmp_path: Path, case: str) -> None:
    before, option, expected = OFFSETS[case]
    code = f"{before}\nL P[1] 9mm/sec CNT50 {option}\nL P[1] 9mm/sec FINE"
    stored = {"PR10": (1.0, 2.0, 3.0, 0.0, 0.0, 0.0), "PR11": (1.0, 2.0, 3.0, 0.0, 0.0, 1.0)}
    known = with_programs({"B": "  PR[12,1]=5"}, code, **stored, PR12=stored["PR10"])
    program = judged(tmp_path, code, registers=known)
    if expected is None:
        assert target(program, "P[1]").verdict == "refuse"
        return
    own = next(one for one in program.targets if one.name == "P[1]" and one.derived)
    assert {shift for one in own.derived for shift in one.shifts} == expected
    assert own.derived[0].axes == ("tool" if "Tool" in option else "frame")
    assert (own.verdict, follows(program, "P[1]")) == ("correct", ["P[1]"])
    without = judged(tmp_path, code, registers=known, derived=False)
    assert "it is constant: --derived corrects both alike" in target(without, "P[1]").reason


OTHERS = {
    "leaves registers alone": ("  RO[1]=ON", "correct"),
    "uses another register": ("  PR[7]=P[1]\nL PR[7] 9% FINE", "correct"),
    "sets it for itself": ("  PR[1]=P[2]\nL PR[1] 9mm/sec FINE", "correct"),
    "reads it": ("L PR[1] 9mm/sec FINE", "refuse"),
    "may read it": ("  IF DI[1],JMP LBL[1]\n  PR[1]=P[2]\n  LBL[1]\nL PR[1] 9mm/sec FINE", "refuse"),
    "reads any": ("L PR[R[1]] 9mm/sec FINE", "refuse"),
    "calls an unknown program": ("  CALL Y", "refuse"),
}


@pytest.mark.parametrize("case", OTHERS)
def test_other_programs_of_the_backup(tmp_path: Path, case: str) -> None:
    other, verdict = OTHERS[case]
    code = f"{COPY}  CALL X\nL P[1] 9mm/sec FINE\n{COPY}L PR[1] 9mm/sec FINE"
    known = with_programs({"X": other}, code)
    assert target(judged(tmp_path, code, registers=known, whole_task=False), "P[1]").verdict == verdict
    behind = f"{COPY}L PR[1] 9mm/sec FINE\nL P[1] 9mm/sec FINE"  # not called, but it may run later
    later = target(judged(tmp_path, behind, registers=with_programs({"X": other}, behind), whole_task=False), "P[1]")
    assert later.verdict == ("correct" if case == "calls an unknown program" else verdict)


def test_a_program_alone_needs_the_statement_that_it_is(tmp_path: Path) -> None:
    code = f"{COPY}L PR[1] 9mm/sec FINE\nL P[1] 9mm/sec FINE"
    found = target(judged(tmp_path, code, whole_task=False), "P[1]")
    assert found.verdict == "refuse"
    assert "left in PR[1], which another program (give the whole backup, or --whole-task) may read" in found.reason


def test_a_call_that_leaves_frames_alone_leaves_them_certain(tmp_path: Path) -> None:
    code = f"  CALL X\n{COPY}L PR[1] 9mm/sec FINE\nL P[1] 9mm/sec FINE"
    for other, verdict in (("  RO[1]=ON", "correct"), (IN_FORCE, "refuse"), ("  UFRAME_NUM[GP2]=5", "correct")):
        known = with_programs({"X": other}, code)
        assert target(judged(tmp_path, code, registers=known), "P[1]").verdict == verdict, other


TOOL_1 = (12.5, 0.0, -186.25, 0.0, 90.0, -180.0)
COMPONENTS = "\n".join(f"  PR[50,{k}:x]={value:g}" for k, value in enumerate(TOOL_1, 1))
BEFORE = COMPONENTS.replace("=", "=(").replace("\n", ")\n") + ")"


@pytest.mark.promise("FANUC tools that a set-up program sets to constants are known where these are the stored values.")
@pytest.mark.parametrize(
    ("code", "verdict"),
    [
        (f"{COMPONENTS}\n  UTOOL[1]=PR[50]", "correct"),
        (f"{BEFORE}\n  UTOOL[1]=PR[50:scratch]", "correct"),
        (f"  PR[50]=PR[50]-PR[50]\n{COMPONENTS}\n  UTOOL[1]=PR[50]\n  PR[50,1]=3\n  UTOOL[9]=PR[50]", "correct"),
        (f"{COMPONENTS}\n  !a remark\n  UTOOL[1]=PR[50]", "correct"),
        (f"{COMPONENTS}\n  UTOOL[1]=PR[50]\n  PR[50,1]=3\n  UTOOL[1]=PR[50]", "refuse"),
        (f"{COMPONENTS.replace('12.5', '12.6')}\n  UTOOL[1]=PR[50]", "refuse"),
        (f"{COMPONENTS}\n  PR[50,1]=R[1]\n  UTOOL[1]=PR[50]", "refuse"),
        (f"{COMPONENTS}\n  PR[R[1],1]=3\n  UTOOL[1]=PR[50]", "refuse"),
        (f"{COMPONENTS}\n  PR[50]=LPOS\n  UTOOL[1]=PR[50]", "refuse"),
        (f"{COMPONENTS}\n  IF R[1]=1,PR[50,1]=3\n  UTOOL[1]=PR[50]", "refuse"),
        (f"{COMPONENTS}\n  LBL[1]\n  UTOOL[1]=PR[50]", "refuse"),
        (f"{COMPONENTS}\n  OPEN GRIPPER\n  UTOOL[1]=PR[50]", "refuse"),
        (f"{COMPONENTS}\n  CALL OTHER\n  UTOOL[1]=PR[50]", "refuse"),
        (f"{COMPONENTS}\n  UTOOL[R[1]]=PR[50]", "refuse"),
        ("\n".join([*COMPONENTS.split("\n")[:5], "  UTOOL[1]=PR[50]"]), "refuse"),
    ],
)
def test_tools_that_a_program_sets_to_constants(tmp_path: Path, code: str, verdict: str) -> None:
    tf = make_transform(euler("fanuc", list(TOOL_1[3:])), list(TOOL_1[:3]))
    frames = replace(FRAMES, tools={**FRAMES.tools, 1: tf})
    path = tmp_path / "a.ls"
    path.write_bytes(text(f"{IN_FORCE}L P[1] 9mm/sec FINE").encode())
    known = with_programs({"TOOLDATA": code}, "L P[1] 9mm/sec FINE")
    found = target(read(path, frames, ReadOptions(), registers=known), "P[1]")
    assert found.verdict == verdict, found.reason
    assert (verdict == "correct") or "UTOOL[1] is changed by the program (TOOLDATA.LS" in found.reason
    (tmp_path / "TOOLDATA.LS").write_bytes(text(code, name="TOOLDATA").encode())
    assert target(read(path, frames, ReadOptions()), "P[1]").verdict == verdict  # without a backup
    own = text(f"{code}\n{IN_FORCE}L P[1] 9mm/sec FINE")
    (tmp_path / "TOOLDATA.LS").unlink()
    path.write_bytes(own.encode())
    assert target(read(path, frames, ReadOptions()), "P[1]").verdict == verdict


@pytest.mark.promise("A position register that programs set to its stored constants is that of POSREG.VA.")
@pytest.mark.parametrize(
    ("code", "verdict"),
    [
        ("  PR[40,3]=80", "correct"),
        ("  PR[40,3:up]=(80)\n  PR[40,1]=0", "correct"),
        ("  PR[40,3]=81", "refuse"),
        ("  PR[40,3]=80\n  PR[40]=LPOS", "refuse"),
        ("  PR[40,3]=80\n  PR[R[1],1]=0", "refuse"),
        ("  PR[40]=PR[40]-PR[40]\n  PR[40,3]=80", "refuse"),
    ],
)
def test_registers_that_a_program_sets_to_stored_constants(tmp_path: Path, code: str, verdict: str) -> None:
    own = "L P[1] 9mm/sec FINE\nL P[1] 9mm/sec FINE Offset,PR[40]"
    known = with_programs({"SETUP": code}, own, PR40=(0.0, 0.0, 80.0, 0.0, 0.0, 0.0))
    assert target(judged(tmp_path, own, registers=known), "P[1]").verdict == verdict


def test_frames_that_another_program_sets(tmp_path: Path) -> None:
    code = "L P[1] 9mm/sec FINE"
    known = with_programs({"SETUP": "  UFRAME[1]=PR[40]"}, code, PR40=(0.0,) * 6)
    assert target(judged(tmp_path, code, registers=known), "P[1]").verdict == "correct"  # to its stored value
    known = with_programs({"SETUP": "  UFRAME[1]=PR[40]"}, code, PR40=(0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    found = target(judged(tmp_path, code, registers=known), "P[1]")
    assert found.verdict == "refuse"
    assert found.reason.startswith("UFRAME[1] is changed by the program (SETUP.LS, line 24)")
    loose = judged(tmp_path, code, registers=known, frame_tolerance=FrameTolerance(5.0))
    assert target(loose, "P[1]").verdict == "correct"
    known = with_programs({"SETUP": "  PR[40]=LPOS\n  UFRAME[1]=PR[40]"}, code, PR40=(0.0,) * 6)
    assert target(judged(tmp_path, code, registers=known), "P[1]").verdict == "refuse"


def test_a_register_that_goes_elsewhere_on_some_way_shares_what_is_known(tmp_path: Path) -> None:
    end = "L PR[1] 9mm/sec FINE\nL P[1] 9mm/sec FINE"
    on_one_way = f"  IF (DI[1]) THEN\n{COPY}  ENDIF\n{end}"
    at_the_next_start = f"L PR[1] 9mm/sec FINE\n{COPY}L P[1] 9mm/sec FINE"
    for code in (on_one_way, at_the_next_start):
        program = judged(tmp_path, code)
        assert shifts(program) == {(0.0, 0.0, 50.0)}, code
        assert follows(program, "PR[1]") == []
        assert (target(program, "P[1]").verdict, target(program, "PR[1]").verdict) == ("correct", "skip")
        assert target(judged(tmp_path, code, derived=False), "P[1]").verdict == "refuse"
    other = judged(tmp_path, on_one_way.replace(end, f"  UFRAME_NUM=2\n{end}"))
    assert target(other, "P[1]").verdict == "refuse"


@pytest.mark.parametrize("shift", ["Offset,PR[9]", "Tool_Offset,PR[9]", "Offset", "INC", "VOFFSET,VR[1]"])
@pytest.mark.parametrize("derived", [False, True])
def test_a_shift_counts_for_every_position_that_may_be_meant(shift: str, derived: bool, tmp_path: Path) -> None:
    code = f"L P[R[5]] 9mm/sec FINE {shift}\nL P[1] 9mm/sec FINE"
    program = judged(tmp_path, code, derived=derived)
    assert [target(program, f"P[{k}]").verdict for k in (1, 2, 3)] == ["refuse", "skip", "skip"]
    plain = judged(tmp_path, code.replace(f" {shift}", ""), derived=derived)
    assert [target(plain, f"P[{k}]").verdict for k in (1, 2, 3)] == ["correct"] * 3


OF_ANY = "  R[1]=DI[1]\n"


@pytest.mark.parametrize(
    "code",
    [
        "L P[AR[1]] 9mm/sec FINE Offset,PR[9]",
        "L P[R[1]] 9mm/sec FINE RTCP",
        "  PR[3]=P[R[1]]\n  PR[3,3]=PR[3,3]+R[7]\nL PR[3] 9mm/sec FINE",
        "L P[R[1]] 9mm/sec FINE\n  PR[3]=P[R[1]]\n  PR[3,3]=PR[3,3]+R[7]\nL PR[3] 9mm/sec FINE",
        "  PR[R[1]]=P[2]\nL PR[3] 9mm/sec FINE",
    ],
)
@pytest.mark.parametrize("derived", [False, True])
def test_a_position_whose_number_the_run_time_knows_may_be_any(tmp_path: Path, code: str, derived: bool) -> None:
    found = target(judged(tmp_path, f"{OF_ANY}{code}\nL P[2] 9mm/sec FINE", derived=derived), "P[2]")
    assert found.verdict == "refuse"
    plain = f"{OF_ANY}L P[R[1]] 9mm/sec FINE\nL P[2] 9mm/sec FINE"
    assert target(judged(tmp_path, plain, derived=derived), "P[2]").verdict == "correct"


@pytest.mark.parametrize("joints", ["JPOS-JPOS", "JPOS - JPOS"])
def test_a_register_of_joint_angles_is_no_shift_in_space(joints: str, tmp_path: Path) -> None:
    code = f"  PR[2]={joints}\n  PR[2,3]=20\nL P[1] 9mm/sec FINE Offset,PR[2]\nL P[1] 9mm/sec FINE"
    assert target(judged(tmp_path, code), "P[1]").verdict == "refuse"
    assert shifts(judged(tmp_path, code.replace(joints, "LPOS-LPOS"))) == {(0.0, 0.0, 20.0)}


def test_an_instruction_may_be_a_macro_of_which_the_backup_has_no_text(tmp_path: Path) -> None:
    code = f"{COPY}  OPEN GRIPPER\nL PR[1] 9mm/sec FINE\nL P[1] 9mm/sec FINE"
    known = with_programs({"X": "  R[1]=1"}, code)
    assert target(judged(tmp_path, code, registers=known), "P[1]").verdict == "refuse"
    without = code.replace("  OPEN GRIPPER\n", "")
    assert target(judged(tmp_path, without, registers=known), "P[1]").verdict == "correct"


@pytest.mark.parametrize("shift", ["Offset,PR[2],UFRAME[2]", "Tool_Offset,PR[2],UTOOL[2]", "Offset, PR[2] , UFRAME[1]"])
def test_a_shift_along_axes_that_the_motion_names_is_not_followed(shift: str, tmp_path: Path) -> None:
    code = f"  PR[2]=LPOS-LPOS\n  PR[2,3]=20\nL P[1] 9mm/sec FINE {shift}\nL P[1] 9mm/sec FINE"
    assert target(judged(tmp_path, code), "P[1]").verdict == "refuse"
