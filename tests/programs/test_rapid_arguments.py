"""RAPID robtargets that procedures get as copies, error handlers beside them, and modules that are read alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.programs import FrameTable, Program, ReadOptions, Target, read_program

RT = "[[600,0,800],[0.7071068,0,0.7071068,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"
FRAMES = FrameTable(tools={"t": np.eye(4)}, bases={"w": np.eye(4)})
DATA = f"CONST robtarget p1:={RT};CONST robtarget p2:={RT};VAR robtarget pA;"
DATA += "CONST num aOff{2,3}:=[[0,0,10],[80,5,20]];"
TO = "PROC rTo(robtarget p,num n)\nMoveL p,v1,z1,t;\nMoveL Offs(p,0,0,9),v1,z1,t;\nENDPROC\n"


def read(folder: Path, code: str, more: str = TO, **options: Any) -> Program:
    path = folder / "a.mod"
    path.write_text(f"MODULE m\n{DATA}\nPROC main()\n{code}\nENDPROC\n{more}\nENDMODULE\n")
    return read_program(path, FRAMES, ReadOptions(**{"whole_task": True, "derived": True, **options}))


def only(program: Program, name: str) -> Target:
    (found,) = (target for target in program.targets if target.name == name)
    return found


def shifts(target: Target) -> set[tuple[float, ...]]:
    return {shift for one in target.derived for shift in one.shifts if any(shift)}


@pytest.mark.promise("Motions to an argument of a RAPID procedure count for the robtargets that calls hand over.")
@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("rTo p1,3;", {(0, 0, 9)}),
        ("rTo p1,3;\nrTo p2,4;", {(0, 0, 9)}),
        ("rTo Offs(p1,1,0,0),3;", {(1, 0, 0), (1, 0, 9)}),
        ("rVia p1;", {(0, 0, 9)}),
        ("pA:=p1;\nrTo pA,1;", {(0, 0, 9)}),
        ("rLift p1;", {(0, 0, 25)}),
        ("FOR i FROM 1 TO 2 DO\nMoveL Offs(p1,aOff{i,1},aOff{i,2},aOff{i,3}),v1,z1,t;\nENDFOR",
         {(0, 0, 10), (80, 5, 20)}),
    ],
)  # fmt: skip
def test_points_that_procedures_get(tmp_path: Path, code: str, expected: set[tuple[float, ...]]) -> None:
    via = "PROC rVia(robtarget q)\nrTo q,1;\nENDPROC\n"
    lift = "PROC rLift(robtarget q)\nq.trans.z:=q.trans.z+25;\nMoveL q,v1,z1,t;\nENDPROC\n"
    program = read(tmp_path, code, TO + (via if "rVia" in code else "") + lift)
    target = only(program, "p1")
    assert (target.verdict, target.reason) == ("correct", "")
    assert shifts(target) == expected
    if "rTo" in code:
        assert all(one.follows for one in program.targets if one.line > 7 and one.name != "q")


def test_copies_and_arguments_without_a_shift_need_no_option(tmp_path: Path) -> None:
    more = "PROC rTo(robtarget p,num n)\nMoveL p,v1,z1,t\\WObj:=w;\nENDPROC"
    program = read(tmp_path, "pA:=p2;\nMoveL pA,v1,z1,t;\nrTo p1,5;", more, derived=False)
    assert {t.name: (t.verdict, t.frame) for t in program.targets if t.xyz} == {
        "p1": ("correct", "w"), "p2": ("correct", "wobj0"),
    }  # fmt: skip
    program = read(tmp_path, "MoveL p1,v1,z1,t;\nrTo p1,5;", more)
    assert "moved to under wobj0 (line 4) and w (line 8)" in only(program, "p1").reason


@pytest.mark.parametrize(
    ("code", "more"),
    [
        ("rTo p1;", "PROC rTo(INOUT robtarget p)\nMoveL p,v1,z1,t;\nENDPROC"),
        ("rTo p1;", "PROC rTo(VAR robtarget p)\nMoveL p,v1,z1,t;\nENDPROC"),
        ("rTo\\p:=p1;", "PROC rTo(\\robtarget p)\nMoveL p,v1,z1,t;\nENDPROC"),
        ("rTo p1;", "PROC rTo(robtarget p)\nx:=p.trans.z;\nMoveL p,v1,z1,t;\nENDPROC"),
        ("rTo p1;", "PROC rTo(robtarget p)\np.rot:=q;\nMoveL p,v1,z1,t;\nENDPROC"),
        ("rTo p1,5;", "PROC rTo(robtarget p,num n)\nMoveL Offs(p,0,0,n),v1,z1,t;\nENDPROC"),
        ("rTo p1;", "PROC rTo(robtarget p)\nfar p;\nENDPROC"),
        ('%"rTo"% p1,5;', TO),
        ("x:=f(p1);", "FUNC num f(robtarget p)\nMoveL p,v1,z1,t;\nRETURN 1;\nENDFUNC"),
    ],
)
def test_arguments_that_are_not_followed(tmp_path: Path, code: str, more: str) -> None:
    assert only(read(tmp_path, code, more), "p1").verdict != "correct"


def test_error_handlers_of_other_routines(tmp_path: Path) -> None:
    other = "PROC rX()\nERROR\nRETRY;\nENDPROC"
    assert only(read(tmp_path, "rTo p1,1;\nrX;", TO + other), "p1").verdict == "correct"
    own = TO.replace("ENDPROC", "ERROR\nRETRY;\nENDPROC")
    assert shifts(only(read(tmp_path, "rTo p1,1;", own), "p1")) == {(0, 0, 9)}
    caller = "rTo p1,1;\nERROR\nRETRY;"
    assert shifts(only(read(tmp_path, caller), "p1")) == {(0, 0, 9)}
    changing = TO.replace("MoveL p,", "p:=Offs(p,0,0,5);\nMoveL p,")
    for more in (changing, changing.replace("ENDPROC", "ERROR\nRETRY;\nENDPROC")):
        assert shifts(only(read(tmp_path, caller, more), "p1")) == {(0, 0, 5), (0, 0, 14)}
    # a constant shift is the same, whichever way control comes
    inside = "PROC rX()\nERROR\nMoveL Offs(p1,0,0,5),v1,z1,t;\nRETRY;\nENDPROC"
    assert shifts(only(read(tmp_path, "rX;", inside), "p1")) == {(0, 0, 5)}


@pytest.mark.promise("An error of RAPID may end a routine between any two statements, with what they have set so far.")
def test_errors_between_two_assignments(tmp_path: Path) -> None:
    code = "MoveL p1,v1,z1,t;\nrSet;\nMoveL pA,v1,z1,t\\WObj:=w;\nERROR\nTRYNEXT;"
    more = "PROC rSet()\npA:=p1;\nWaitDI di1,1\\MaxTime:=1;\npA:=p2;\nENDPROC"
    assert "moved to under wobj0 (line 4) and w (line 6)" in only(read(tmp_path, code, more), "p1").reason
    stops = code.replace("\nERROR\nTRYNEXT;", "")
    assert only(read(tmp_path, stops, more), "p1").verdict == "correct"
    inside = "MoveL p1,v1,z1,t;\nMoveL pA,v1,z1,t\\WObj:=w;\nrSet;\nERROR\nTRYNEXT;"
    assert only(read(tmp_path, inside, more), "p1").verdict == "refuse"


@pytest.mark.promise("Read alone, a RAPID module's points without LOCAL are refused also where only others derive.")
def test_a_module_alone(tmp_path: Path) -> None:
    for code in ("MoveL Offs(p1,0,0,5),v1,z1,t;", "pA:=p1;\nMoveL pA,v1,z1,t;", "rTo p1,1;"):
        target = only(read(tmp_path, code, whole_task=False), "p1")
        assert target.verdict != "correct"
        assert only(read(tmp_path, code), "p1").verdict == "correct"


def test_a_workobject_of_the_caller_is_named(tmp_path: Path) -> None:
    more = f"PROC rTo(\\PERS wobjdata o)\nMoveL {RT},v1,z1,t\\WObj?o;\nENDPROC"
    program = read(tmp_path, "rTo;", more)
    assert "workobject of the caller is known at run time only" in {target.reason for target in program.targets}
