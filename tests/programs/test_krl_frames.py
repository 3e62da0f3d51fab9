"""What is in force at a motion: constants are followed through branches, loops, jumps and calls; nothing is guessed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from truepose.errors import FileError
from truepose.programs import FrameTable, FrameTolerance, Program, Target

POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 0.0,C -180.0}"
Read = Callable[..., Program]


def inline(program: Program) -> list[tuple[str, int | None]]:
    """Verdict and tool of every inline target, in the order of the text."""
    return [(t.verdict, t.tool_number) for t in program.targets]


@pytest.mark.parametrize(
    ("between", "expected"),
    [
        ("IF a THEN\nBAS(#TOOL,2)\nENDIF", "TOOL_DATA[1] or TOOL_DATA[2]"),
        ("IF a THEN\nBAS(#TOOL,2)\nELSE\nBAS(#TOOL,2)\nENDIF", 2),
        ("IF a THEN\nBAS(#TOOL,2)\nRETURN\nENDIF", 1),
        ("SWITCH a\nCASE 1\nBAS(#TOOL,2)\nCASE 2,3\nBAS(#TOOL,3)\nDEFAULT\nBAS(#TOOL,2)\nENDSWITCH", "TOOL_DATA[2] or"),
        ("SWITCH a\nCASE 1\nBAS(#TOOL,2)\nDEFAULT\nBAS(#TOOL,2)\nENDSWITCH", 2),
        ("SWITCH a\nCASE 1\nBAS(#TOOL,2)\nENDSWITCH", "TOOL_DATA[1] or TOOL_DATA[2]"),
        ("FOR i=1 TO 3\nBAS(#TOOL,2)\nENDFOR", "TOOL_DATA[1] or TOOL_DATA[2]"),
        ("WHILE a\nx=1\nENDWHILE", 1),
        ("REPEAT\nBAS(#TOOL,2)\nUNTIL a", "TOOL_DATA[1] or TOOL_DATA[2]"),
        ("LOOP\nBAS(#TOOL,2)\nIF a THEN\nEXIT\nENDIF\nENDLOOP", "TOOL_DATA[1] or TOOL_DATA[2]"),
        ("GOTO there\nBAS(#TOOL,2)\nthere:", 1),
        ("IF a THEN\nGOTO there\nENDIF\nBAS(#TOOL,2)\nthere:", "TOOL_DATA[1] or TOOL_DATA[2]"),
        ("other()", "other() was called, which is not in this file"),
        ("x=other(1)", "other() was called"),
        ("x=SIN(30)", 1),
        ("GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM( )\nINTERRUPT ON 3", 1),
        ("INTERRUPT DECL 4 WHEN $IN[1]==TRUE DO halt( )", "the interrupt program HALT() is not in this file"),
        ("BAS(#INITMOV,0)", "no $TOOL is set"),
        ("BAS(#VEL_PTP,100)", 1),
        ("$TOOL.Z=5", "$TOOL.Z=5 (line 4)"),
        ("FDAT_ACT={TOOL_NO 2,BASE_NO 1,IPO_FRAME #BASE}\nBAS(#PTP_PARAMS,10)", 2),
        ("FDAT_ACT={TOOL_NO 2,BASE_NO 1,IPO_FRAME #BASE}", 1),
        ("FDAT_ACT=here\nBAS(#CP_PARAMS,10)", "FDAT_ACT=here (line 4)"),
        ("BAS(#PTP_PARAMS,10)", "FDAT_ACT is not set"),
        ("SPLINE WITH $TOOL=TOOL_DATA[2]\nENDSPLINE", 1),
        ("$TOOL={X 1,Y 2,Z 3,A 0,B 0,C 0}", None),
    ],
)
def test_tool_after(read: Read, between: str, expected: int | str | None) -> None:
    target = read(f"BAS(#TOOL,1)\nBAS(#BASE,1)\n{between}\nLIN {POSE}").targets[-1]
    if isinstance(expected, str):
        assert target.verdict == "refuse"
        assert expected.lower() in target.reason.lower()
    else:
        assert (target.verdict, target.tool_number) == ("correct", expected)


def test_a_loop_brings_its_end_back_to_its_start(read: Read) -> None:
    program = read(f"BAS(#BASE,1)\nBAS(#TOOL,1)\nLOOP\nLIN {POSE}\nBAS(#TOOL,2)\nLIN {POSE}\nENDLOOP")
    assert inline(program) == [("refuse", None), ("correct", 2)]


def test_code_that_is_never_reached_is_left_as_it_is(read: Read) -> None:
    target = read(f"BAS(#BASE,1)\nBAS(#TOOL,1)\nRETURN\nLIN {POSE}").targets[0]
    assert (target.verdict, target.reason) == ("skip", "the program never reaches this motion")


def test_calls_in_this_file_are_followed(read: Read) -> None:
    program = read(
        f"DEF cell( )\nBAS(#TOOL,1)\nBAS(#BASE,1)\nsub()\nLIN {POSE}\nquiet()\nLIN {POSE}\nEND\n"
        f"DEF sub( )\nLIN {POSE}\nBAS(#TOOL,2)\nLIN {POSE}\nEND\n"
        f"DEF quiet( )\nLIN {POSE}\nEND\nGLOBAL DEF open( )\nLIN {POSE}\nEND\n"
    )
    # a subprogram sees what its callers have, and hands back what it set; a GLOBAL one may be called by anybody
    assert inline(program) == [
        ("correct", 2),
        ("correct", 2),
        ("correct", 1),
        ("correct", 2),
        ("correct", 2),
        ("refuse", None),
    ]


def test_a_quiet_subprogram_gives_each_caller_its_own_back(read: Read) -> None:
    program = read(
        f"DEF cell( )\nBAS(#BASE,1)\nBAS(#TOOL,1)\nquiet()\nLIN {POSE}\nBAS(#TOOL,2)\nquiet()\nLIN {POSE}\nEND\n"
        f"DEF quiet( )\nLIN {POSE}\nEND\n"
    )
    assert inline(program) == [("correct", 1), ("correct", 2), ("refuse", None)]


def test_calls_may_be_trusted(read: Read) -> None:
    body = f"BAS(#TOOL,1)\nBAS(#BASE,1)\nother()\nLIN {POSE}"
    assert read(body, calls_keep_frames=True).targets[0].verdict == "correct"


def test_fdat_must_agree_with_what_is_in_force(read: Read) -> None:
    points = f"DECL E6POS XP7={POSE}\nDECL FDAT FP7={{TOOL_NO 3,BASE_NO 1,IPO_FRAME #BASE}}"

    def only(body: str) -> Target:
        return read(body, points).targets[0]

    assert only("other()\nLIN XP7").verdict == "correct"
    assert only("BAS(#TOOL,3)\nLIN XP7").verdict == "correct"
    target = only("BAS(#TOOL,2)\nLIN XP7")
    assert (target.verdict, target.reason) == (
        "refuse",
        "taught with TOOL_DATA[3] (FDAT), but TOOL_DATA[2] may be in force",
    )
    assert only("$BASE=BASE_DATA[n]\nLIN XP7").verdict == "refuse"


def test_the_fdat_of_an_inline_form_is_in_force_behind_it(read: Read) -> None:
    program = read(
        f"FDAT_ACT=FP7\nBAS(#PTP_PARAMS,100)\nPTP XP7\nLIN {POSE}",
        f"DECL E6POS XP7={POSE}\nDECL FDAT FP7={{TOOL_NO 3,BASE_NO 1,IPO_FRAME #BASE}}",
    )
    assert inline(program) == [("correct", 3), ("correct", 3)]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("ENDIF", r"cell\.src:2: ENDIF without IF"),
        ("IF a THEN\nENDLOOP", r"cell\.src:3: ENDLOOP without LOOP"),
        ("LOOP", r"cell\.src:3: LOOP of line 2 is not closed"),
        ("ELSE", r"cell\.src:2: ELSE without IF"),
        ("GOTO nowhere", r"cell\.src:3: GOTO NOWHERE: there is no such label"),
        ("DEF sub( )", r"cell\.src:2: cell of line 1 has no END before this"),
        ("END\nEND", r"cell\.src:3: END without DEF"),
        ("END\nDEF cell( )", r"cell\.src:3: CELL is defined twice"),
    ],
)
def test_broken_structure(pair: Callable[..., object], body: str, message: str) -> None:
    from truepose.programs import read_program

    with pytest.raises(FileError, match=message):
        read_program(pair(f"DEF cell( )\n{body}\nEND\n"))  # type: ignore[arg-type]


@pytest.mark.promise("KRL: motions of interrupt and trigger programs have the frames of whatever they interrupt")
def test_interrupt_programs_have_the_frames_of_what_they_interrupt(read: Read, record_property: Any) -> None:
    table = FrameTable({1: np.eye(4), 2: np.eye(4), 3: np.eye(4)}, {1: np.eye(4)}, tool=3, base=0)
    handler = f"END\nDEF handler( )\nLIN {POSE}\nEND\n"
    declared = "INTERRUPT DECL 5 WHEN $IN[1] DO handler( )\nINTERRUPT ON 5"
    one = f"BAS(#TOOL,1)\nBAS(#BASE,1)\n{declared}\nLIN {{X 9}}"
    cases: dict[str, int | str] = {
        one: 1,
        f"{declared}\nLIN {{X 9}}": 3,
        f"BAS(#TOOL,1)\n{declared}\nBAS(#TOOL,2)\nLIN {{X 9}}": "TOOL_DATA[1] or TOOL_DATA[2]",
        f"{declared}\nBAS(#TOOL,1)\nLIN {{X 9}}": "TOOL_DATA[1]",
        f"BAS(#TOOL,2)\nLIN {{X 9}}\nBAS(#TOOL,1)\n{declared}\nsub()\nLIN {{X 9}}": "TOOL_DATA[1] or TOOL_DATA[2]",
        "BAS(#TOOL,1)\nTRIGGER WHEN DISTANCE=0 DELAY=0 DO handler( ) PRIO=-1\nBAS(#TOOL,2)\nLIN {X 9}": "TOOL_DATA",
        one.replace("INTERRUPT DECL", "GLOBAL INTERRUPT DECL"): 1,
    }
    record_property("cases", len(cases))
    sub = "DEF sub( )\nBAS(#TOOL,2)\nLIN {X 9}\nBAS(#TOOL,1)\nEND\n"
    for body, expected in cases.items():
        target = next(t for t in read(f"DEF cell( )\n{body}\n{handler}{sub}", table=table).targets if t.xyz)
        if isinstance(expected, int):
            assert (target.verdict, target.tool_number) == ("correct", expected), body
        else:
            assert target.verdict == "refuse", body
            assert expected in target.reason, (body, target.reason)


FRAME = "{X 10.0,Y 20.0,Z 30.0,A 0.0,B 0.0,C 0.0}"
CONSTANT = [
    ("$TOOL=TOOL_DATA[1]\n$BASE=FB", f"DECL CONST FRAME FB={FRAME}"),
    ("$TOOL=TOOL_DATA[1]\n$BASE=fb[2] ; the second", f"CONST FRAME FB[2]\nFB[2]={FRAME}"),
    (f"DECL FRAME FB\n$TOOL=TOOL_DATA[1]\nFB={FRAME}\n$BASE=FB", ""),
    ("$TOOL=TOOL_DATA[NT]\n$BASE=FB\nXOTHER.Z=FB.Z ;FB.Z=1", f"CONST INT NT=1\nCONST FRAME FB={FRAME}"),
    ("BAS(#TOOL,NT)\n$BASE=FB\nLIN XOTHER:FB", f"DECL CONST INT NT=1\nCONST FRAME FB={FRAME}"),
]
CHANGED = [
    ("BAS(#TOOL,1)\n$BASE=FB", f"DECL FRAME FB={FRAME}"),
    ("BAS(#TOOL,NT)\nBAS(#BASE,1)", "INT NT=1"),
    (f"BAS(#TOOL,1)\nFB={FRAME}\n$BASE=FB", f"CONST FRAME FB={FRAME}"),
    ("BAS(#TOOL,1)\nFB.Z=FB.Z+1\n$BASE=FB", f"CONST FRAME FB={FRAME}"),
    ("BAS(#TOOL,1)\nmeasure(FB)\n$BASE=FB", f"CONST FRAME FB={FRAME}"),
    ("BAS(#TOOL,1)\n$BASE=FB", "CONST FRAME FB={X 10.0,Z 3.0}"),
    (f"BAS(#TOOL,1)\nDECL FRAME FB\nFB={FRAME}:{FRAME}\n$BASE=FB", ""),
    (f"BAS(#TOOL,1)\nDECL FRAME FB\nFB={FRAME}\nFB={FRAME}\n$BASE=FB", ""),
    (f"BAS(#TOOL,1)\nDECL FRAME FB\nFB={FRAME}\nmeasure(FB)\n$BASE=FB", ""),
    (f"BAS(#TOOL,1)\nDECL FRAME FB[2]\nFB[I]={FRAME}\n$BASE=FB[1]", f"FB[1]={FRAME}"),
    ("BAS(#TOOL,NT)\nNT=NT+1\nBAS(#BASE,1)", "CONST INT NT=1"),
    ("BAS(#TOOL,NT)\nFOR NT=1 TO 2\nENDFOR\nBAS(#BASE,1)", "CONST INT NT=1"),
    ("DECL INT NT\nBAS(#TOOL,NT)\nBAS(#BASE,1)", "CONST INT NT=1"),
    ("BAS(#TOOL,1)\nX=1+\\\nFB.Z\n$BASE=FB", f"CONST FRAME FB={FRAME}"),
]


@pytest.mark.parametrize(("body", "dat"), CONSTANT)
def test_a_constant_frame_or_number_is_known(read: Any, body: str, dat: str) -> None:
    program = read(f"{body}\nLIN {{X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}}", dat or "DECL INT N")
    (target,) = [target for target in program.targets if target.name.startswith("LIN") and target.xyz]
    assert (target.verdict, target.tool) == ("correct", "TOOL_DATA[1]")
    np.testing.assert_allclose(program.positions_base(), [[11.0, 22.0, 33.0]])


@pytest.mark.parametrize(("body", "dat"), CHANGED)
def test_a_frame_or_number_that_may_change_is_not_known(read: Any, body: str, dat: str) -> None:
    (target,) = read(f"{body}\nLIN {{X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}}", dat or "DECL INT N").targets
    assert "is known at run time only" in target.reason


def test_a_constant_of_a_public_list_is_none_because_other_modules_may_change_it(read: Any) -> None:
    src = f"DEF cell( )\nBAS(#TOOL,1)\n$BASE=FB\nLIN {FRAME}\nEND\n"
    (target,) = read(src, f"ENDDAT\nDEFDAT CELL PUBLIC\nCONST FRAME FB={FRAME}").targets
    assert "is known at run time only" in target.reason


def test_an_fdat_that_the_program_sets_counts_for_nothing(read: Any) -> None:
    dat = f"DECL E6POS XP1={FRAME}\nDECL FDAT FP1={{TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE}}"
    moves = "FDAT_ACT=FP1\nBAS(#CP_PARAMS,0.5)\nLIN XP1"
    assert read(moves, dat).counts()["correct"] == 1
    for setting in ("FP1.BASE_NO=N", "FP1=FOTHER", "fp1 . TOOL_NO = 2"):
        (target,) = read(f"{setting}\n{moves}", dat).targets
        assert "FP1 is set at run time" in target.reason


@pytest.mark.parametrize(
    ("body", "dat", "known"),
    [
        ("$BASE=FB", f"DECL FRAME FB={FRAME}", True),
        ("$BASE=FB[2]", f"DECL FRAME FB[2]\nFB[2]={FRAME}", True),
        ("FB=measured( )\n$BASE=FB", f"DECL FRAME FB={FRAME}", True),
        ("FB.Z=FB.Z+500\n$BASE=FB", f"DECL FRAME FB={FRAME}", False),
        (f"FB={FRAME.replace('10.0', '900.0')}\n$BASE=FB", f"DECL FRAME FB={FRAME}", False),
        ("DECL FRAME FB\nFB=measured( )\n$BASE=FB", f"DECL FRAME FB={FRAME}", False),
        ("$BASE=FB", "DECL FRAME FB={X 10.0}", False),
        ("$BASE=FB", f"ENDDAT\nDEFDAT CELL PUBLIC\nDECL FRAME FB={FRAME}", False),
    ],
)
def test_a_frame_that_may_change_is_taken_within_a_tolerance(read: Any, body: str, dat: str, known: bool) -> None:
    src = f"BAS(#TOOL,1)\n{body}\nBAS(#TOOL,1)\nLIN {{X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}}"
    (target,) = read(src, dat, calls_keep_frames=True).targets
    assert ("; --frame-tolerance corrects with the stored frame" in target.reason) == known
    assert "is known at run time only: $BASE=FB" in target.reason
    (target,) = read(src, dat, calls_keep_frames=True, frame_tolerance=FrameTolerance(5.0)).targets
    assert (target.verdict == "correct", "may change" in target.frame_changed) == (known, known)


def test_a_literal_base_is_refused_where_the_world_moves_with_the_robot(read: Any, frames: FrameTable) -> None:
    table = replace(frames, problems={("base", 0): "cannot be used: an axis carries the robot"})
    for base in (f"$BASE={FRAME}", "$BASE=$NULLFRAME", "$BASE=$WORLD"):
        (target,) = read(f"BAS(#TOOL,1)\n{base}\nLIN {POSE}", table=table).targets
        assert target.verdict == "refuse"
        assert "cannot be used: an axis carries the robot" in target.reason


@pytest.mark.parametrize(
    ("call", "verdict"),
    [
        ("set(TOOL_DATA[1])", "refuse"),
        ("set( BASE_DATA[ 1 ] )", "refuse"),
        ("i=set(BASE_DATA[i])", "refuse"),
        ("gone(3,BASE_DATA[1])", "refuse"),
        ("gone(f(1,(2)),BASE_DATA[1])", "refuse"),
        ("i=gone(set(BASE_DATA[1]),1)", "refuse"),
        ("set(BASE_DATA[2])", "correct"),
        ("take(BASE_DATA[1],TOOL_DATA[1])", "correct"),
        ("f=INV_POS(BASE_DATA[1])", "correct"),
    ],
)
def test_a_tool_or_base_that_a_routine_gets_may_be_changed_there(read: Read, call: str, verdict: str) -> None:
    others = "DEF set(F:OUT)\nFRAME F\nF.Z=5\nEND\nDEF take(F:IN,G :IN)\nFRAME F,G\nEND\n"
    program = read(f"DEF cell( )\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\nLIN {POSE}\n{call}\nEND\n{others}")
    assert program.targets[0].verdict == verdict, program.targets[0].reason
    assert verdict == "correct" or "_DATA[1] is changed by the program (line 5)" in program.targets[0].reason
