"""KRL: what shifts motions at run time, names that hide points, and poses that subprograms are given."""

from __future__ import annotations

from typing import Any

import pytest

from truepose.programs import Program

POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 10.0,C -170.0,S 2,T 10}"
HEAD = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n"
POINTS = "".join(
    f"DECL E6POS XP{k}={POSE}\nDECL FDAT FP{k}={{TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE}}\n" for k in (1, 2, 3)
)


def verdicts(program: Program) -> dict[str, str]:
    return {target.name: target.verdict for target in program.targets}


@pytest.mark.promise("KRL: points in reach of a run-time shift are refused by its name, those with FDAT, too")
def test_run_time_shifts(read: Any, record_property: Any) -> None:
    regions = {
        "RSI_ON(#RELATIVE)": "RSI_OFF()",
        "ret=RSI_ON()": "ret=RSI_OFF()",
        "RSI_MOVECORR()": "RSI_OFF()",
        "err = ST_ON1(#BASE,1)": "err=ST_OFF()",
        "$TECH[1].MODE=#CYCLE": "$TECH[1].MODE=#OFF",
        "TOUCH_ON()": "TOUCH_OFF()",
        "SEAM_ON(1)": "SEAM_OFF()",
        "CORRON(CD1)": "CORROFF()",
        "CONV_FOLLOW(1,2)": "CONV_QUIT()",
        "CONVEYOR.ON(1)": "CONVEYOR.QUIT()",
        "SET_TORQUE_LIMITS(1,tq)": "RESET_TORQUE_LIMITS(1)",
        "TRIGGER WHEN DISTANCE=0 DELAY=0 DO RSI_ON() PRIO=-1": "RSI_OFF()",
    }
    record_property("cases", 2 * len(regions) + 6)
    for begin, end in regions.items():
        for keep in (False, True):
            body = f"{HEAD}LIN XP1\n{begin}\nLIN XP2\n{end}\n{HEAD}LIN XP3"
            program = read(body, POINTS, calls_keep_frames=keep)
            assert verdicts(program) == {"XP1": "correct", "XP2": "refuse", "XP3": "correct"}, (begin, keep)
            assert "(line 5) may shift it at run time" in program.targets[1].reason
    for begin in ("$OFFSET={X 1,Y 0,Z 0}", "$CORRECTION[1].X=2", "$PROG_PAF=TRUE", "$TORQUE_AXIS=1"):
        program = read(f"{HEAD}LIN XP1\n{begin}\nLIN XP2\n", POINTS)
        assert verdicts(program) == {"XP1": "correct", "XP2": "refuse", "XP3": "skip"}, begin
    inline = "".join(f"LIN {{X {k},Y 2,Z 3,A 0,B 0,C 0}}\n" for k in range(20))
    run = read(f"{HEAD}RSI_ON()\n{inline}", calls_keep_frames=True)
    assert set(verdicts(run).values()) == {"refuse"}
    main = f"DEF cell( )\n{HEAD}INTERRUPT DECL 5 WHEN $IN[1] DO corr( )\nLIN XP1\nEND\n"
    handler = main + "DEF corr( )\nRSI_ON()\nRSI_OFF()\nEND\n"
    assert verdicts(read(handler, POINTS, calls_keep_frames=True))["XP1"] == "refuse"


@pytest.mark.promise("KRL: a parameter or local variable is never read as the module's point of its name")
def test_parameters_and_local_variables_hide_points(read: Any, record_property: Any) -> None:
    routines = {
        "declared": "DEF go(XP1 :IN)\nDECL E6POS XP1\nLIN XP1\nEND\n",
        "not declared": "DEF go(XP1 :IN)\nLIN XP1\nEND\n",
        "second": "DEF go(n :IN, xp1 :OUT)\nINT n\nE6POS xp1\nLIN xp1\nEND\n",
        "function": "DEFFCT INT go(XP1 :IN)\nDECL E6POS XP1\nLIN XP1\nRETURN 1\nENDFCT\n",
        "changed": "DEF go(XP1 :OUT)\nDECL E6POS XP1\nXP1.X=XP1.X+5\nLIN XP1\nEND\n",
        "local": "DEF go( )\nDECL E6POS XP1\nXP1=$POS_ACT\nLIN XP1\nEND\n",
    }
    record_property("cases", len(routines))
    for name, routine in routines.items():
        program = read(f"DEF cell( )\n{HEAD}LIN XP1\nEND\n{routine}", POINTS)
        found = [(t.verdict, t.path.suffix) for t in program.targets if t.name.upper() == "XP1"]
        assert sorted(found) == [("correct", ".dat"), ("skip", ".src")], (name, found)


@pytest.mark.promise("KRL: poses handed to subprograms are listed")
def test_poses_handed_to_subprograms_are_listed(read: Any) -> None:
    body = (
        f"DEF cell( )\n{HEAD}my_move({POSE})\nmy_move({{E6POS: X 1,Y 2,Z 3,A 0,B 0,C 0}}, 2)\nr=reach(1,{POSE})\n"
        'msg("my_move({X 1")\nLIN XP1\nEND\nDEF my_move(p :IN)\nE6POS p\nEND\nDEFFCT INT reach(n :IN, p :IN)\nENDFCT\n'
    )
    program = read(body, POINTS.splitlines()[0], calls_keep_frames=True)
    assert verdicts(program) == {"my_move:4": "skip", "my_move:5": "skip", "reach:6": "skip", "XP1": "correct"}
    assert program.targets[0].reason == "handed to my_move(): where that moves is known at run time only"
    handed = read(f"{HEAD}my_move(XP1)\nLIN XP2", POINTS, calls_keep_frames=True)
    assert verdicts(handed)["XP1"] == "skip"
