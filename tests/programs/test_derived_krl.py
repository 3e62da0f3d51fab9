"""Points from which KRL programs derive others by constant shifts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from truepose.errors import RefusedError
from truepose.programs import Program, correct_program

HEAD = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n"
POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 10.0,C -170.0}"
POINTS = f"DECL E6POS XP1={POSE}\nDECL E6POS XP2={POSE.replace('812.5', '700.0')}\nDECL E6POS XAP\nDECL E6POS XAQ\n"


class SlopedMap:
    """Its correction grows along z of the base frame by `slope` [mm per mm]; it refuses poses above `ceiling` [mm]."""

    def __init__(self, slope: float = 0.0, ceiling: float = np.inf) -> None:
        self.slope, self.ceiling, self.asked = slope, ceiling, 0

    def correct(self, poses: np.ndarray, **more: Any) -> Any:
        from types import SimpleNamespace

        p, n = poses[:, :3, 3], len(poses)
        self.asked += n
        shift = np.zeros((n, 3))
        shift[:, 0] = 0.5 + self.slope * p[:, 2]
        high = p[:, 2] > self.ceiling
        return SimpleNamespace(
            p_target=p,
            p_command=p + np.where(high[:, None], 0.0, shift),
            e=-shift,
            std=np.full((n, 3), 2.0),
            verdict=np.where(high, "refuse" if more["on_guard"] == "refuse" else "skip", "correct"),
            reason=["too high" if one else "" for one in high],
        )


def verdicts(program: Program) -> dict[str, str]:
    return {target.name: target.verdict for target in program.targets}


def by_name(program: Program, name: str) -> Any:
    return next(target for target in program.targets if target.name == name)


DERIVED = {
    "a component": ("XAP = XP1\nXAP.Z = XAP.Z + 50\nLIN XAP\nLIN XP1", [(0, 0, 50)]),
    "a component of the point": ("XAP = XP1\nXAP.Z = XP1.Z + 50.5\nLIN XAP\nLIN XP1", [(0, 0, 50.5)]),
    "two components": ("XAP = XP1\nXAP.X = XAP.X - 10\nXAP.Z = 2*25 + XAP.Z\nLIN XAP\nLIN XP1", [(-10, 0, 50)]),
    "there and back": ("XAP = XP1\nXAP.Z = XAP.Z + 50\nXAP.Z = XAP.Z - 50\nLIN XAP\nLIN XP1", [(0, 0, 0)]),
    "a copy": ("XAQ = XP1\nXAQ.Y = XAQ.Y + 5\nXAP = XAQ\nLIN XAP\nLIN XP1", [(0, 5, 0)]),
    "in the frame": ("LIN {X 0,Y 0,Z 50,A 0,B 0,C 0}:XP1\nLIN XP1", [(0, 0, 50)]),
    "along the tool": ("LIN XP1 : {X 0,Y 0,Z -50,A 0,B 0,C 0} C_DIS\nLIN XP1", [(0, 0, -50)]),
    "in the last assignment": ("XAP = XP2\nXAP = XP1\nXAP.Z = XAP.Z + 50\nLIN XAP\nLIN XP1", [(0, 0, 50)]),
    "on either way": (
        "XAP = XP1\nIF $IN[1] THEN\nXAP.Z = XAP.Z + 50\nELSE\nXAP.X = XAP.X + 20\nENDIF\nLIN XAP\nLIN XP1",
        [(0, 0, 50), (20, 0, 0)],
    ),
    "on one way": ("XAP = XP1\nIF $IN[1] THEN\nXAP.Z = XAP.Z + 50\nENDIF\nLIN XAP\nLIN XP1", [(0, 0, 0), (0, 0, 50)]),
    "in a loop": (
        "INT i\nFOR i = 0 TO 3\nXAP = XP1\nXAP.X = XAP.X + i*25.5\nLIN XAP\nENDFOR\nLIN XP1",
        [(0, 0, 0), (25.5, 0, 0), (51, 0, 0), (76.5, 0, 0)],
    ),
    "step by step": (
        "INT i\nXAP = XP1\nFOR i = 3 TO 1 STEP -1\nLIN XAP\nXAP.Y = XAP.Y + 10\nENDFOR\nLIN XP1",
        [(0, 0, 0), (0, 10, 0), (0, 20, 0)],
    ),
    "in nested loops": (
        "INT i,j\nFOR i = 0 TO 1\nFOR j = 0 TO 1\nLIN {X i*100,Y j*100,Z 0,A 0,B 0,C 0}:XP1\nENDFOR\nENDFOR\nLIN XP1",
        [(0, 0, 0), (0, 100, 0), (100, 0, 0), (100, 100, 0)],
    ),
    "after an early return": (
        "XAP = XP1\nIF $IN[1] THEN\nRETURN\nENDIF\nXAP.Z = XAP.Z + 50\nLIN XAP\nLIN XP1",
        [(0, 0, 50)],
    ),
    "with a number": ("REAL h\nh = 12.5\nXAP = XP1\nXAP.Z = XAP.Z + h*2\nLIN XAP\nLIN XP1", [(0, 0, 25)]),
}


@pytest.mark.promise("Points from which KRL derives others by constant shifts are corrected with --derived.")
@pytest.mark.parametrize("name", DERIVED)
def test_constant_shifts(name: str, read: Any) -> None:
    code, shifts = DERIVED[name]
    program = read(HEAD + code, POINTS, derived=True)
    target = by_name(program, "XP1")
    assert (target.verdict, target.reason) == ("correct", "")
    found = [shift for one in target.derived for shift in one.shifts]
    assert sorted(found) == sorted(tuple(map(float, shift)) for shift in shifts)
    assert {one.axes for one in target.derived} == {"tool" if "tool" in name else "frame"}
    followers = [t for t in program.targets if t.follows]
    assert [t.follows for t in followers] == [("XP1",)]
    assert {t.verdict for t in followers} == {"skip"}


@pytest.mark.promise("Without --derived such a point is left, and the reason names the option.")
@pytest.mark.parametrize("name", DERIVED)
def test_the_option_is_named(name: str, read: Any) -> None:
    target = by_name(read(HEAD + DERIVED[name][0], POINTS), "XP1")
    assert target.verdict == "refuse"
    assert "both moved to" in target.reason
    assert "read by arithmetic" in target.reason
    assert "--derived" in target.reason


WHOLE = {
    "in a subprogram": (
        "XAP = XP1\nup( )\nLIN XAP\nLIN XP1\nEND\nDEF up( )\nXAP.Z = XAP.Z + 50",
        [(0, 0, 50)],
    ),
    "moved to in a subprogram": (
        "LIN XP1\nXAP = XP1\nXAP.Z = XAP.Z + 50\ngo( )\nXAP = XP1\nXAP.Z = XAP.Z + 100\ngo( )\nEND\nDEF go( )\nLIN XAP",
        [(0, 0, 50), (0, 0, 100)],
    ),
    "from one call to the next": (
        "LIN XP1\nXAP = XP1\nnext( )\nnext( )\nEND\nDEF next( )\nLIN XAP\nXAP = XP1\nXAP.Y = XAP.Y + 7",
        [(0, 0, 0), (0, 7, 0)],
    ),
    "behind a jump": (
        "LIN XP1\nXAP = XP1\nGOTO on\nXAP.Z = XAP.Z + 50\non:\nXAP.X = XAP.X + 5\nLIN XAP",
        [(5, 0, 0)],
    ),
    "in a loop that ends early": (
        "LIN XP1\nXAP = XP1\nFOR i = 1 TO 3\nXAP.X = XAP.X + 10\nIF $IN[1] THEN\nEXIT\nENDIF\nENDFOR\nLIN XAP",
        [(10, 0, 0), (20, 0, 0), (30, 0, 0)],
    ),
    "with an array of the data list": (
        "LIN XP1\nFOR i = 1 TO 2\nXAP = XP1\nXAP.Y = XAP.Y + PITCH[i]\nLIN XAP\nENDFOR",
        [(0, 40, 0), (0, 90, 0)],
    ),
    "in an element": ("LIN XP1\nXA[2] = XP1\nXA[2].Z = XA[2].Z + 8\nLIN XA[2]", [(0, 0, 8)]),
    "of an element": (
        "LIN XB[1]\nFOR i = 1 TO 1\nXAP = XB[i]\nXAP.Z = XAP.Z + 8\nLIN XAP\nENDFOR",
        [(0, 0, 8)],
    ),
    "with a number of the data list": ("LIN XP1\nXAP = XP1\nXAP.Z = XAP.Z + UP\nLIN XAP", [(0, 0, 33.5)]),
}
DATA = (
    f"{POINTS}REAL UP=33.5\nINT i\nDECL REAL PITCH[2]\nPITCH[1]=40.0\nPITCH[2]=90\nDECL E6POS XA[2]\n"
    f"DECL E6POS XB[2]\nXB[1]={POSE}\n"
)


@pytest.mark.promise("Shifts are followed through routines, jumps, loops and arrays.")
@pytest.mark.parametrize("name", WHOLE)
def test_the_ways_through_the_program(name: str, read: Any) -> None:
    code, shifts = WHOLE[name]
    program = read(f"DEF cell( )\n{HEAD}{code}\nEND\n", DATA, derived=True)
    target = by_name(program, "XB[1]" if "XB" in code else "XP1")
    assert (target.verdict, target.reason) == ("correct", "")
    found = {shift for one in target.derived for shift in one.shifts}
    assert found == {tuple(map(float, shift)) for shift in shifts}


SPOILED = {
    "a measured shift": "XAP = XP1\nXAP.Z = XAP.Z + $ANIN[1]\nLIN XAP",
    "a shift of a caller": "XAP = XP1\nXAP.Z = XAP.Z + shift\nLIN XAP",
    "a height that is set": "XAP = XP1\nXAP.Z = 500\nLIN XAP",
    "a scaled coordinate": "XAP = XP1\nXAP.Z = XAP.Z * 2\nLIN XAP",
    "another coordinate": "XAP = XP1\nXAP.Z = XAP.X + 5\nLIN XAP",
    "a coordinate of another point": "XAP = XP1\nXAP.Z = XP2.Z + 5\nLIN XAP",
    "a turn": "XAP = XP1\nXAP.A = XAP.A + 90\nLIN XAP",
    "a turning shift": "LIN XP1 : {X 0,Y 0,Z -50,A 90,B 0,C 0}",
    "an incomplete shift": "LIN XP1 : {Z -50}",
    "a condition": "IF XP1.Z > 500 THEN\nHALT\nENDIF",
    "a condition on the copy": "XAP = XP1\nIF XAP.Z > 500 THEN\nHALT\nENDIF\nLIN XAP",
    "a number of it": "REAL h\nh = XP1.Z\nXAP = XP2\nXAP.Z = XAP.Z + h\nLIN XAP",
    "a subprogram": "XAP = XP1\nmy_move(XAP)\nLIN XAP",
    "an endless loop": "XAP = XP1\nLOOP\nXAP.Z = XAP.Z + 1\nLIN XAP\nENDLOOP",
    "a loop over an input": "INT i\nXAP = XP1\nFOR i = 1 TO n\nXAP.Z = XAP.Z + 1\nLIN XAP\nENDFOR",
    "a loop that is too long": "INT i\nFOR i = 1 TO 5000\nXAP = XP1\nXAP.Z = XAP.Z + i*0.1\nLIN XAP\nENDFOR",
    "whole numbers alone": "INT n\nn = 2.5\nXAP = XP1\nXAP.Z = XAP.Z + n\nLIN XAP",
    "a number of the data list that a routine may set": "my_set(UP)\nXAP = XP1\nXAP.Z = XAP.Z + UP\nLIN XAP",
    "an array that the program sets": "PITCH[1] = $ANIN[1]\nXAP = XP1\nXAP.Z = XAP.Z + PITCH[1]\nLIN XAP",
    "an element that is not known": "XA[n] = XP1\nLIN XA[1]",
    "an element of any index": "XA[1] = XP1\nLIN XA[n]",
    "a jump back": "XAP = XP1\nback:\nXAP.Z = XAP.Z + 1\nLIN XAP\nIF $IN[1] THEN\nGOTO back\nENDIF",
    "a call within a motion": "REAL h\nh = 5\nLIN far(h)\nXAP = XP1\nXAP.Z = XAP.Z + h\nLIN XAP",
    "a trigger": "REAL h\nh = 5\nTRIGGER WHEN DISTANCE=0 DELAY=0 DO h = 7\nXAP = XP1\nXAP.Z = XAP.Z + h\nLIN XAP",
    "an interrupt program": "INTERRUPT DECL 3 WHEN $IN[1] DO stop( )\nXAP = XP1\nLIN XAP\nEND\nDEF stop( )\n"
    "XAP.Z = XAP.Z + 100\nLIN XAP",
}


@pytest.mark.promise("A point whose digits reach anything but a constant shift stays refused with --derived.")
@pytest.mark.parametrize("name", SPOILED)
def test_what_the_data_decide(name: str, read: Any) -> None:
    program = read(f"DEF cell( )\n{HEAD}LIN XP1\n{SPOILED[name]}\nEND\n", DATA, derived=True, calls_keep_frames=True)
    target = by_name(program, "XP1")
    assert target.verdict == "refuse"
    assert "both moved to" in target.reason
    assert not any(t.verdict == "correct" for t in program.targets if t.name == "XP1")


def test_a_derived_motion_counts_for_the_frame(read: Any) -> None:
    code = f"{HEAD}LIN XP1\n$BASE=BASE_DATA[2]\nXAP = XP1\nXAP.Z = XAP.Z + 50\nLIN XAP"
    target = by_name(read(code, POINTS, derived=True), "XP1")
    assert target.verdict == "refuse"
    assert "BASE_DATA[1]" in target.reason
    assert "BASE_DATA[2]" in target.reason


def test_a_follower_of_two_points(read: Any, make_map: Any) -> None:
    either = "IF $IN[1] THEN\nXAP = XP1\nELSE\nXAP = XP2\nENDIF\nXAP.Z = XAP.Z + 50\nLIN XAP\n"
    code = f"{HEAD}{either}LIN XP1\nPTP XHOME\nLIN XP2"
    program = read(code, POINTS, derived=True)
    assert by_name(program, "XAP").follows == ("XP1", "XP2")
    corrected = correct_program(program, make_map([0.5, 0.0, 0.0]))
    assert str(corrected.coverage) == "3 of 4 motion targets corrected, 1 stays nominal"
    stays = correct_program(program, make_map([0.5, 0.0, 0.0], guarded={1: "no"}), on_guard="skip")
    assert str(stays.coverage) == "1 of 4 motion targets corrected, 3 stay nominal"


@pytest.mark.promise("The map is asked at every derived position, and the record states the largest difference.")
def test_the_map_is_asked_at_derived_positions(read: Any) -> None:
    program = read(HEAD + DERIVED["a component"][0], POINTS, derived=True)
    a_map = SlopedMap(slope=1e-3)
    corrected = correct_program(program, a_map)
    assert a_map.asked == 2
    row = next(row for row in corrected.to_dict()["targets"] if row["name"] == "XP1")
    assert 0.02 < row["difference_mm"] <= 0.05 + 1e-6
    assert "shared with the position derived from it" in row["note"]
    assert corrected.summary()["following"] == 1
    assert str(corrected.coverage) == "2 of 2 motion targets corrected, 0 stay nominal"
    follower = next(row for row in corrected.to_dict()["targets"] if row["name"] == "XAP")
    assert follower["reason"] == "derived from XP1: gets the correction of that point"


@pytest.mark.promise("A point is left if the correction at a derived position differs by more than the limit.")
def test_a_correction_that_differs(read: Any) -> None:
    program = read(HEAD + DERIVED["a component"][0], POINTS, derived=True)
    with pytest.raises(
        RefusedError, match=r"XP1: at the position that is derived from it, XAP = XP1 \+ \(0, 0, 50\) mm"
    ):
        correct_program(program, SlopedMap(slope=0.02))
    with pytest.raises(RefusedError, match="too high"):
        correct_program(program, SlopedMap(ceiling=program.positions_base()[0, 2] + 1.0))
    left = correct_program(program, SlopedMap(slope=0.02), on_guard="skip")
    assert str(left.coverage) == "0 of 2 motion targets corrected, 2 stay nominal"
    assert left.files == {source.path: source.data for source in program.sources}
