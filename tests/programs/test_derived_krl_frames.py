"""Points from which KRL programs derive others by FRAME variables: `LIN XP1:FUP`, `XAP = FUP:XP1`."""

from __future__ import annotations

from typing import Any

import pytest

POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 10.0,C -170.0}"
POINTS = (
    f"DECL E6POS XP1={POSE}\nDECL E6POS XAP\nDECL FRAME FUP={{X 0.0,Y 0.0,Z 50.0,A 0.0,B 0.0,C 0.0}}\n"
    "DECL FRAME FA[2]\nFA[1]={X 5.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}\nFA[2]={X 0.0,Y 7.0,Z 0.0,A 0.0,B 0.0,C 0.0}\n"
    f"DECL FRAME FTURNED={{X 0.0,Y 0.0,Z 50.0,A 5.0,B 0.0,C 0.0}}\nDECL FRAME FPICK={POSE}\n"
    "DECL INT N\nDECL FRAME FNONE\n"
)
HEAD = "BAS(#TOOL,1)\nBAS(#BASE,1)\n"
DERIVED = {
    "behind the point": ("LIN XP1:FUP C_DIS", [(0, 0, 50)], "tool"),
    "before the point": ("LIN fup:XP1", [(0, 0, 50)], "frame"),
    "an element": ("LIN XP1:FA[2]", [(0, 7, 0)], "tool"),
    "in an assignment": ("XAP=XP1:FUP\nLIN XAP", [(0, 0, 50)], "tool"),
    "two frames": ("LIN XP1:FUP:FA[1]", [(5, 0, 50)], "tool"),
    "with a literal": ("LIN FUP:{X 1,Y 0,Z 0,A 0,B 0,C 0}:XP1", [(1, 0, 50)], "frame"),
}
NOT_CONSTANT = {
    "a component set": "LIN XP1:FUP\nFUP.Z=FUP.Z+1",
    "a second value": "LIN XP1:FUP\nFUP={X 0.0,Y 0.0,Z 70.0,A 0.0,B 0.0,C 0.0}",
    "handed over": "LIN XP1:FUP\nmeasure(FUP)",
    "turned": "LIN XP1:FTURNED",
    "an element of the run time": "LIN XP1:FA[N]",
    "without a value": "LIN XP1:FNONE",
    "two points": "LIN XP1:XAP",
}


@pytest.mark.parametrize("name", DERIVED)
def test_a_frame_that_nothing_changes_is_a_constant_shift(read: Any, name: str) -> None:
    body, shifts, axes = DERIVED[name]
    program = read(f"{HEAD}{body}\nLIN XP1", POINTS, derived=True)
    found = {target.name: target for target in program.targets if target.motions}
    assert found["XP1"].verdict == "correct"
    assert [(one.axes, list(one.shifts)) for one in found["XP1"].derived] == [(axes, shifts)]
    (follower,) = [target for target in found.values() if target.follows]
    assert follower.follows == ("XP1",)
    (target,) = [target for target in read(f"{HEAD}{body}\nLIN XP1", POINTS).targets if target.name == "XP1"]
    assert "--derived corrects both alike" in target.reason


@pytest.mark.parametrize("name", NOT_CONSTANT)
def test_a_frame_that_may_change_or_turns_is_none(read: Any, name: str) -> None:
    program = read(f"{HEAD}{NOT_CONSTANT[name]}\nLIN XP1", POINTS, derived=True)
    (target,) = [target for target in program.targets if target.name == "XP1"]
    assert target.verdict == "refuse"
    assert "both moved to" in target.reason


def test_a_point_that_is_a_frame_itself(read: Any) -> None:
    program = read(f"{HEAD}LIN FPICK:FUP\nLIN FPICK", POINTS, derived=True)
    (target,) = [target for target in program.targets if target.name == "FPICK"]
    assert (target.verdict, target.derived[0].shifts) == ("correct", ((0.0, 0.0, 50.0),))


@pytest.mark.parametrize(("whole", "verdict"), [(True, "correct"), (False, "refuse")])
def test_a_global_frame_counts_only_if_no_other_module_can_change_it(read: Any, whole: bool, verdict: str) -> None:
    points = POINTS.replace("DECL FRAME FUP", "DECL GLOBAL FRAME FUP")
    program = read(f"{HEAD}LIN XP1:FUP\nLIN XP1", points, derived=True, whole_task=whole)
    assert [target.verdict for target in program.targets if target.name == "XP1"] == [verdict]
