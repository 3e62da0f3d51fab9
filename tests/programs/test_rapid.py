"""Every row of the catalogue of hazards that concerns RAPID, by name, with its verdict."""

# ruff: noqa: E501
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, ReadOptions, correct_program, read_program

RT = "[[600,0,800],[0,0,-1,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"
FRAMES = FrameTable(tools={"tGrip": np.eye(4)}, bases={"wFix": np.eye(4), "wOther": np.eye(4)})
Read = Callable[..., Program]
WHOLE = ReadOptions(whole_task=True)


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def reading(code: str, data: str = "", frames: FrameTable = FRAMES, **options: Any) -> Program:
        path = tmp_path / "a.mod"
        text = f"MODULE m\n{data}\nPROC main()\n{code}\nENDPROC\nENDMODULE\n" if "MODULE" not in code else code
        path.write_bytes(text.encode("latin-1"))
        return read_program(path, frames, ReadOptions(**{"whole_task": True, **options}))

    return reading


def verdicts(program: Program) -> dict[str, str]:
    return {target.name: target.verdict for target in program.targets}


def only(program: Program, name: str | None = None) -> Any:
    found = [target for target in program.targets if name in (None, target.name)]
    assert len(found) == 1, verdicts(program)
    return found[0]


def test_declaration_also_over_several_lines_and_arrays(read: Read) -> None:
    long = RT.replace(",[0,0,-1,0]", ",\n ! why\n [0,0,-1,0]")
    program = read(
        "MoveL p1,v100,z1,tGrip;MoveJ a{2}, v100, fine, tGrip;\nFOR i FROM 1 TO 2 DO MoveL b{i},v1,z1,tool0; ENDFOR",
        f"CONST robtarget p1:={long};LOCAL CONST robtarget a{{2}}:=[{RT},{RT}];CONST robtarget b{{2}}:=[{RT},{RT}];",
    )
    assert verdicts(program) == {
        "p1": "correct", "a{1}": "skip", "a{2}": "correct", "b{1}": "correct", "b{2}": "correct",
    }  # fmt: skip
    target = only(program, "p1")
    assert (target.tool, target.frame, target.configuration, target.motions) == (
        "tGrip",
        "wobj0",
        "0,-1,0,1",
        ("MoveL",),
    )
    assert target.angles == (0, 0, -1, 0)  # the quaternion's sign is kept


def test_inline_in_a_move_and_wobj_with_or_without_comma(read: Read) -> None:
    program = read(
        f"MoveL {RT},v100,z1,tGrip\\WObj:=wFix;\nMoveL {RT},v100,z1,tGrip,\\WObj:=wOther;\nMoveJ {RT},v1,z1,tGrip;"
    )
    assert [(t.verdict, t.frame) for t in program.targets] == [
        ("correct", "wFix"), ("correct", "wOther"), ("correct", "wobj0"),
    ]  # fmt: skip


def test_expressions_inside_the_literal(read: Read) -> None:
    target = only(read("MoveL [[x-125,y,z],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,z1,tGrip;"))
    assert (target.verdict, "expression" in target.reason) == ("skip", True)


def test_offs_and_reltool_nested(read: Read) -> None:
    code = "MoveL p1,v1,z1,tGrip;\nMoveL Offs(p1,0,0,100),v1,z1,tGrip;\nMoveL RelTool(Offs(p1,0,30,-40),0,0,5),v1,z1,tGrip;"
    program = read(code, f"CONST robtarget p1:={RT};")
    target = only(program, "p1")
    assert target.verdict == "skip"
    assert "largest 100 mm, line 5" in target.reason
    assert only(read(code, f"CONST robtarget p1:={RT};", offsets=True), "p1").verdict == "correct"
    variable = only(read("MoveL Offs(p1,0,0,dz),v1,z1,tGrip;", f"CONST robtarget p1:={RT};"), "p1")
    assert "known at run time only" in variable.reason


def test_component_writes(read: Read) -> None:
    assert only(read("p1.trans.x:=0;\nMoveL p1,v1,z1,tGrip;", f"CONST robtarget p1:={RT};")).verdict == "skip"


@pytest.mark.parametrize(
    ("kind", "code", "reason"),
    [
        ("TASK PERS", "", ""),
        ("LOCAL PERS", "", ""),
        ("VAR", "", ""),
        ("PERS", "", "another task of the controller may write it"),
        ("TASK PERS", "p1:=x;", "PERS, assigned (line 5)"),
        ("VAR", "IF a THEN p1.trans.z:=0; ENDIF", "VAR, component set (line 5)"),
        ("LOCAL PERS", "SearchL di1,p1,q,v1,tGrip;", "PERS, found by SearchL (line 5)"),
        ("TASK PERS", "rTeach p1;", "PERS, passed to rTeach"),
        ("VAR", "b:=StrToVal(s,p1);", "VAR, read by arithmetic (line 5)"),
        ("TASK PERS", 'SetDataVal "P1",x;', "PERS, set by SETDATAVAL (line 5)"),
        ("LOCAL PERS", "SetDataVal n,x;", "a name that only the run time knows (line 5)"),
        ("VAR", 'SetAllDataVal "robtarget",x;', "a name that only the run time knows (line 5)"),
        ("LOCAL PERS", 'Load\\Dynamic,"HOME:/z.mod";', "a module that is loaded at run time may write it"),
    ],
)
def test_pers_and_var_that_nothing_writes_are_constant(read: Read, kind: str, code: str, reason: str) -> None:
    target = only(read(f"MoveL p1,v1,z1,tGrip;\n{code}", f"{kind} robtarget p1:={RT};"), "p1")
    assert reason in target.reason
    assert target.verdict == ("skip" if reason else "correct")
    alone = only(read(f"MoveL p1,v1,z1,tGrip;\n{code}", f"{kind} robtarget p1:={RT};", whole_task=False), "p1")
    assert alone.verdict != "correct"


def test_external_axes_in_use(read: Read) -> None:
    used = RT.replace("[9E9,", "[3079.8,")
    assert only(read(f"MoveL {used},v1,z1,tGrip;")).verdict == "refuse"
    assert only(read(f"MoveL {used},v1,z1,tGrip;", external_axes=True)).verdict == "correct"


def test_one_point_with_two_workobjects(read: Read) -> None:
    code, data = "MoveL p1,v1,z1,tGrip;\nMoveL p1,v1,z1,tGrip\\WObj:=wFix;", f"CONST robtarget p1:={RT};"
    assert only(read(code, data)).verdict == "refuse"
    assert "moved to under wobj0 (line 4) and wFix (line 5)" in only(read(code, data)).reason
    assert only(read(code, data, ambiguous="skip")).verdict == "skip"


@pytest.mark.parametrize(
    ("data", "why"),
    [
        ('PERS wobjdata w:=[FALSE,FALSE,"CNV1",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];', "mechanical unit"),
        (
            'PERS wobjdata w:=[TRUE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];',
            "the robot holds the part (w), but tGrip is not",
        ),
        (
            "PERS tooldata w:=[FALSE,[[0,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];",
            "the robot holds the part (w), but wobj0 is not",
        ),
    ],
)
def test_moving_or_robot_held_workobject(read: Read, data: str, why: str) -> None:
    frames = FrameTable(tools={"w": np.eye(4), "tGrip": np.eye(4)}, bases={"w": np.eye(4)})
    tool = "w" if "tooldata" in data else "tGrip\\WObj:=w"
    target = only(read(f"MoveL {RT},v1,z1,{tool};", data, frames))
    assert (target.verdict, why in target.reason) == ("refuse", True)


def test_frames_that_the_module_itself_gives(read: Read) -> None:
    data = (
        'PERS wobjdata w:=[FALSE,TRUE,"",[[500,0,0],[0.7071068,0,0,0.7071068]],[[0,10,0],[1,0,0,0]]];\n'
        "PERS tooldata t:=[TRUE,[[0,0,150],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"
    )
    program = read(f"MoveL {RT},v1,z1,t\\WObj:=w;", data, FrameTable())
    # uframe turns by 90 deg about z: oframe's y is the base's -x
    np.testing.assert_allclose(program.positions_base(), [[490, 600, 800]], atol=1e-3)
    np.testing.assert_allclose(program.tools()[0, :3, 3], [0, 0, 150])
    assert only(read(f"MoveL {RT},v1,z1,unknown\\WObj:=w;", data, FrameTable())).verdict == "refuse"


@pytest.mark.parametrize("change", ["wFix.uframe:=PoseMult(a,b);", "wFix.oframe.trans.x:=5;"])
def test_reassigned_workobject(read: Read, change: str) -> None:
    target = only(read(f"MoveL {RT},v1,z1,tGrip\\WObj:=wFix;\n{change}"))
    assert (target.verdict, "is changed by the program (line 5)" in target.reason) == ("refuse", True)


@pytest.mark.parametrize(
    ("on", "off"), [("PDispSet d;", "PDispOff;"), ("PDispOn p1,tGrip;", "PDispOff;"), ("EOffsSet e;", "EOffsOff;")]
)
def test_displacement_while_active(read: Read, on: str, off: str) -> None:
    move = f"MoveL {RT},v1,z1,tGrip;"
    program = read(f"{move}\n{on}\n{move}\n{off}\n{move}")
    assert [t.verdict for t in program.targets] == ["correct", "refuse", "correct"]
    assert "a displacement may be active" in program.targets[1].reason
    loop = read(f"WHILE TRUE DO\n{move}\nIF x {on}\nENDWHILE")
    assert [t.verdict for t in loop.targets] == ["refuse"]
    called = read(f"MODULE m\nPROC a()\n{on}\nb;\n{off}\nENDPROC\nPROC b()\n{move}\nENDPROC\nENDMODULE")
    assert [t.verdict for t in called.targets] == ["refuse"]


@pytest.mark.parametrize(
    "call",
    [
        "MoveLDO {},v1,z1,tGrip\\WObj:=wFix,do1,1;", "MoveJSync {},v1,z1,tGrip\\WObj:=wFix,\"f\";",
        "MoveL\\Conc,{},v1\\V:=5,z1\\Z:=2,tGrip\\WObj:=wFix;", "MoveL {}\\ID:=11,v1,z1,tGrip\\WObj:=wFix;",
        "TriggL {},v1,t1\\T2:=t2,z1,tGrip\\WObj:=wFix;", "TriggLIOs {},v1\\TriggData1:=t1,z1,tGrip\\WObj:=wFix;",
        "SearchL\\Stop,di1,pf,{},v1,tGrip\\WObj:=wFix;", "ArcL {},v1,s1,w1\\Weave:=we,z1,tGrip\\WObj:=wFix;",
        "ArcLStart {},v1,s1,w1,fine,tGrip\\WObj:=wFix;", "SpotL {},vmax,g1,sp,tGrip\\WObj:=wFix;",
        "PaintL {},v1,z1,tGrip\\WObj:=wFix;", "IF di1=1 MoveL {},v1,z1,tGrip\\WObj:=wFix;",
    ],
)  # fmt: skip
def test_other_motion_names(read: Read, call: str) -> None:
    for target in (RT, "p1"):
        program = read(call.format(target), f"CONST robtarget p1:={RT};" if target == "p1" else "")
        found = [t for t in program.targets if t.verdict == "correct"]
        assert [(t.tool, t.frame) for t in found] == [("tGrip", "wFix")], (call, program.targets[0].reason)


@pytest.mark.parametrize(
    "call",
    [
        "MoveC {0},{0},v1,z1,tGrip;",
        "TriggC {0},{0},v1,t,z1,tGrip;",
        "ArcC {0},{0},v1,s,w,z1,tGrip;",
        "SearchC di1,pf,{0},{0},v1,tGrip;",
    ],
)
def test_circle_both_or_neither(read: Read, call: str) -> None:
    program = read(call.format(RT))
    assert [(t.verdict, t.tool) for t in program.targets] == [("correct", "tGrip")] * 2
    program = read(call.replace("{0}", "p1", 1).format(RT) + "p1:=x;", f"VAR robtarget p1:={RT};")
    assert [t.verdict for t in program.targets] == ["skip", "skip"]


def test_motions_that_are_not_known_are_never_missed(read: Read) -> None:
    for call in (f"MyMove {RT},v1,z1,tGrip;", "GlideX p1,v100,fine,tGrip\\WObj:=wFix;"):
        assert "refuse" in verdicts(read(call, f"CONST robtarget p1:={RT};")).values(), call
    target = only(read("Pick p1,50;", f"CONST robtarget p1:={RT};"))
    assert (target.verdict, target.reason) == ("skip", "passed to Pick (line 4)")


def test_joint_targets(read: Read) -> None:
    program = read("MoveAbsJ j1,v1,z1,tGrip;\nMoveAbsJ [[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,z1,tGrip;")
    assert [t.reason for t in program.targets] == ["joint target", "joint target; allow joint_targets to correct it"]


def test_run_time_targets(read: Read) -> None:
    code = "MoveL CRobT(),v1,z1,tGrip;\nMoveL pOther,v1,z1,tGrip;\nMoveL loc,v1,z1,tGrip;"
    program = read(f"VAR robtarget loc;\n{code}")
    assert set(verdicts(program).values()) == {"skip"}
    assert len(program.targets) == 3


def test_routine_parameters_hide_points(read: Read) -> None:
    text = f"MODULE m\nCONST robtarget p:={RT};\nPROC go(robtarget p,\\num x)\nMoveL p,v1,z1,tGrip;\nENDPROC\nENDMODULE"
    program = read(text)
    assert [(t.line, t.verdict) for t in program.targets] == [(2, "skip"), (4, "skip")]


def test_data_that_look_like_poses_are_no_targets(read: Read) -> None:
    data = (
        "CONST pos a:=[1,2,3];CONST pose b:=[[1,2,3],[1,0,0,0]];CONST loaddata l:=[1,[0,0,1],[1,0,0,0],0,0,0];\n"
        "PERS tooldata t:=[TRUE,[[1,2,3],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\nRECORD r\n robtarget p;\nENDRECORD"
    )
    assert len(read('TPWrite "MoveL p1";', data).targets) == 0


def test_headers_letters_comments_and_case_are_kept(tmp_path: Path, make_map: Any) -> None:
    text = (
        f"%%%\r\n  VERSION:1\r\n%%%\r\nmodule Gr\xfc\xdfe\r\n\t! MoveL {RT},v1,z1,tGrip;\r\nconst RobTarget P\xe4:={RT};\r\n"
        "Proc main()\r\n\tmovel p\xe4, V100 ,z1,TGRIP\\wobj:=WFIX ; ! \xfc\nENDPROC endmodule"
    ).encode("latin-1")
    path = tmp_path / "a.PRG"
    path.write_bytes(text)
    corrected = correct_program(path, make_map([0.5, 0.25, -0.125]), frames=FRAMES, options=WHOLE)
    first, rest = text.split(b":=[[600,0,800]", 1)
    assert corrected.files[path] == first + b":=[[600.5,0.25,799.875]" + rest


@pytest.mark.parametrize(
    ("code", "message"),
    [
        (f"MoveL {RT.replace('600', '1.2.3')},v1,z1,tGrip;", r"a\.mod:4: MoveL:4: '1\.2\.3' is not a number"),
        (f"MoveL {RT.replace('600', '--5')},v1,z1,tGrip;", r"a\.mod:4: .*'--5' is not a number"),
        (f"MoveL {RT.replace('600', '9' * 400)},v1,z1,tGrip;", r"has 400 characters"),
        (f"MoveL {RT.replace('[0,0,-1,0]', '[0,0,-2,0]')},v1,z1,tGrip;", r"has length 2"),
        (f"MoveL {RT.replace('[600,0,800]', '[600,800]')},v1,z1,tGrip;", r"has \[3, 4, 4, 6\] numbers, this has \[2"),
        (f"MoveL {RT[:-1]},v1,z1,tGrip;", r"a\.mod:4: \[ is not closed"),
        ("MoveL p1];", r"a\.mod:4: \] closes nothing"),
        ('TPWrite "x;', r"a\.mod:4: a text that starts with \" is not closed"),
        ("IF x THEN", r"IF of line 4 is not closed"),
        ("ENDWHILE", r"ENDWHILE without WHILE"),
        (f"CONST robtarget q:={RT};CONST robtarget q:={RT};", r"declared twice"),
    ],
)  # fmt: skip
def test_broken_modules(read: Read, code: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        read(code)


def test_truncated_modules(read: Read) -> None:
    with pytest.raises(FileError, match=r"a\.mod:2: PROC has no ENDPROC: the file is truncated"):
        read("MODULE m\nPROC x()\nMoveL p,v1,z1,tGrip;")
    with pytest.raises(FileError, match="has no MODULE"):
        read("! MODULE")
    with pytest.raises(FileError, match="PROC of line 2 has no end before this"):
        read("MODULE m\nPROC x()\nPROC y()\nENDPROC\nENDMODULE")
