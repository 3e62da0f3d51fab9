"""When KRL evaluates what it calls: conditions at every turn, indices before the motion, triggers during it."""

from __future__ import annotations

from typing import Any

import pytest

HEAD = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n"
POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 10.0,C -170.0}"
POINTS = (
    f"DECL E6POS XP1={POSE}\nDECL E6POS XP2={POSE.replace('812.5', '700.0')}\nDECL E6POS XAP\n"
    f"DECL E6POS XA[2]\nXA[1]={POSE.replace('812.5', '600.0')}\nXA[2]={POSE.replace('812.5', '650.0')}\n"
)


def program_of(read: Any, body: str, rest: str = "", **options: Any) -> Any:
    return read(f"DEF cell( )\n{HEAD}{body}\nEND\n{rest}", POINTS, derived=True, **options)


def verdict_of(program: Any, name: str) -> tuple[str, str]:
    return next((one.verdict, one.frame) for one in program.targets if one.name == name and one.xyz)


def function(statement: str, kind: str = "BOOL", value: str = "TRUE") -> str:
    return f"DEFFCT {kind} f(n:IN)\nINT n\n{statement}\nRETURN {value}\nENDFCT\n"


@pytest.mark.parametrize("opener", ["WHILE f(1)", "WHILE $IN[1] AND f(2)"])
def test_the_condition_of_while_is_evaluated_again_behind_each_turn(opener: str, read: Any) -> None:
    program = program_of(
        read, f"XAP=XP1\n{opener}\nLIN XAP\nENDWHILE\nLIN XP1", function("XAP.Z=XAP.Z+50")
    )  # the shifts grow turn by turn: 50, 100, 150 and so on
    assert verdict_of(program, "XP1")[0] == "refuse"
    once = program_of(read, f"{opener}\nXAP=XP1\nLIN XAP\nENDWHILE\nLIN XP1", function("$OUT[1]=TRUE"))
    assert verdict_of(once, "XP1")[0] == "correct"
    both = program_of(
        read,
        "WHILE f(1)\nWHILE $IN[2]\nXAP.Z=XAP.Z+1\nLIN XAP\nENDWHILE\nENDWHILE\nLIN XP1",
        function("XAP=XP1"),
    )
    assert verdict_of(both, "XP1")[0] == "refuse"


@pytest.mark.parametrize("motion", ["LIN XA[f(1)]", "PTP XA[1+f(1)] C_PTP", "CIRC XP1,XA[f(1)]", "SLIN XA[f(1)]"])
def test_calls_in_a_motion_run_before_it(motion: str, read: Any) -> None:
    program = program_of(read, f"{motion}\nLIN XP2", function("$BASE=BASE_DATA[2]", "INT", "1"))
    for name in ("XA[1]", "XP2"):
        assert verdict_of(program, name) == ("correct", "BASE_DATA[2]"), name
    unknown = program_of(read, f"{motion}\nLIN XP2")
    assert {verdict_of(unknown, name)[0] for name in ("XA[1]", "XP2")} == {"refuse"}


def test_what_a_trigger_runs_may_come_before_or_behind_any_motion(read: Any) -> None:
    trigger = "TRIGGER WHEN DISTANCE=0 DELAY=0 DO g( ) PRIO=-1\n"
    for body in (f"{trigger}LIN XP1", f"{trigger}$BASE=BASE_DATA[1]\nLIN XP1"):
        program = program_of(read, body, "DEF g( )\n$BASE=BASE_DATA[2]\nEND\n")
        assert verdict_of(program, "XP1")[0] == "refuse"
    harmless = program_of(read, f"{trigger}LIN XP1", "DEF g( )\n$OUT[1]=TRUE\nEND\n")
    assert verdict_of(harmless, "XP1") == ("correct", "BASE_DATA[1]")


@pytest.mark.parametrize("part", ["{Z 500}", "{X 1,Y 2,Z 3}", "{X h}", "{A 0,B 0,C 0}", "{POS: X 1}"])
@pytest.mark.parametrize("derived", [False, True])
def test_an_aggregate_with_some_components_keeps_the_others(part: str, derived: bool, read: Any) -> None:
    body = f"DEF cell( )\nREAL h\n{HEAD}XAP=XP1\nXAP={part}\nLIN XAP\nLIN XP1\nEND\n"
    assert verdict_of(read(body, POINTS, derived=derived), "XP1")[0] == "refuse"
    whole = body.replace(part, POSE)
    assert verdict_of(read(whole, POINTS, derived=True), "XP1")[0] == "correct"


@pytest.mark.parametrize("part", ["{Z 500}", "{X 1,Y 2,Z 3}", "{X h}", "{A 0,B 0,C 0}"])
def test_numbers_of_which_the_program_sets_some_are_left(part: str, read: Any) -> None:
    full = f"XAP={POSE}\nLIN XAP\n"
    body = (
        f"DEF cell( )\nREAL h\n{HEAD}XP1={part}\nLIN XP1\nXA[2]={part}\n{full}XAP={part}\nLIN XA[1]\nLIN XA[2]\nEND\n"
    )
    targets = read(body, POINTS, derived=True).targets
    assert {one.name for one in targets if one.verdict == "correct"} == {"XA[1]"}


def test_a_point_of_the_data_list_may_get_numbers_twice(read: Any) -> None:
    one, two = POSE.replace("812.5", "500.0"), POSE.replace("812.5", "510.0")
    program = program_of(read, f"XAP={one}\nLIN XAP\nXAP={two}\nLIN XAP\nLIN XP1")
    found = [(target.xyz[0], target.verdict) for target in program.targets if target.name == "XAP"]
    assert found == [(500.0, "correct"), (510.0, "correct")]
    other = program_of(read, f"XAP={one}\nLIN XAP\nXAP={two}\n$BASE=BASE_DATA[2]\nLIN XAP\nLIN XP1")
    assert {target.verdict for target in other.targets if target.name == "XAP"} == {"refuse"}
