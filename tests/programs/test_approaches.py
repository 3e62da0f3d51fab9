"""From where programs reach their targets: only where nothing else can be between two motions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.compensation import Starts
from truepose.error_map.correction import Targets
from truepose.geometry import make_transform
from truepose.programs import FrameTable, ReadOptions, read_program
from truepose.programs.core.approaches import starts_of
from truepose.robots import load_robot, status_turn

FRAMES = FrameTable(
    tools={**{n: np.eye(4) for n in range(3)}, "tGrip": np.eye(4)},
    bases={n: np.eye(4) for n in range(3)},
    tool=1,
    base=0,
)
ROBOT = load_robot("kuka-kr210-r2700-extra")

KRL = "DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{}\nEND\nDEF still()\nWAIT SEC 1\nEND\nDEF moves()\nLIN @999\nEND\n"
RAPID = (
    "MODULE a\nPROC main()\n{}\nENDPROC\nPROC still()\nWaitTime 1;\nENDPROC\n"
    "PROC moves()\nMoveL @999;\nENDPROC\nENDMODULE\n"
)
ROBTARGET = "[[{}00,0,1500],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
INFORM = (
    "/JOB\n//NAME A\n//POS\n///NPOS 3,0,0,0,0,0\n///TOOL 1\n///POSTYPE ROBOT\n///RECTAN\n///RCONF 0,0,0,0,0,0\n"
    "{points}//INST\n///DATE 2026/01/01 12:00\n///ATTR SC,RW,RJ\n////FRAME ROBOT\n///GROUP1 RB1\nNOP\n{}\nEND\n"
)
TP = "/PROG A\n/MN\n{}\n/POS\n{points}/END\n"
UR = "def still():\n  sleep(1)\nend\ndef moves():\n  movel(@999, a=1, v=1)\nend\n{}\n"
WAYS = (
    ("krl", "a line", True, ["LIN @1", "LIN @2"]),
    ("krl", "a joint motion", True, ["PTP @1", "PTP @2"]),
    ("krl", "another motion", False, ["LIN @1", "LIN_REL {X 5}", "LIN @2"]),
    ("krl", "a circle", False, ["LIN @1", "CIRC @3,@2"]),
    ("krl", "a spline", False, ["LIN @1", "SPL @2"]),
    ("krl", "a frame", True, ["LIN @1", "$BASE=BASE_DATA[1]", "LIN @2"]),
    ("krl", "a branch before", False, ["LIN @1", "IF $IN[1] THEN", "LIN @3", "ENDIF", "LIN @2"]),
    ("krl", "a branch without motion", False, ["LIN @1", "IF $IN[1] THEN", "$OUT[1]=TRUE", "ENDIF", "LIN @2"]),
    ("krl", "the other branch", False, ["LIN @1", "IF $IN[1] THEN", "LIN @3", "ELSE", "LIN @2", "ENDIF"]),
    ("krl", "a loop", False, ["LIN @1", "LOOP", "LIN @2", "ENDLOOP"]),
    ("krl", "a label", False, ["LIN @1", "AGAIN:", "LIN @2", "GOTO AGAIN"]),
    ("krl", "a call that waits", True, ["LIN @1", "still()", "LIN @2"]),
    ("krl", "a call that moves", False, ["LIN @1", "moves()", "LIN @2"]),
    ("krl", "a call of another program", False, ["LIN @1", "elsewhere()", "LIN @2"]),
    ("rapid", "a line", True, ["MoveL @1;", "MoveL @2;"]),
    ("rapid", "a joint motion", True, ["MoveJ @1;", "MoveJ @2;"]),
    ("rapid", "a circle", False, ["MoveL @1;", "MoveC @3,@2;"]),
    ("rapid", "a branch", False, ["MoveL @1;", "IF di1=1 THEN", "MoveL @3;", "ENDIF", "MoveL @2;"]),
    ("rapid", "a loop", False, ["MoveL @1;", "WHILE TRUE DO", "MoveL @2;", "ENDWHILE"]),
    ("rapid", "a label", False, ["MoveL @1;", "again:", "MoveL @2;", "GOTO again;"]),
    ("rapid", "a call that waits", True, ["MoveL @1;", "still;", "MoveL @2;"]),
    ("rapid", "a call that moves", False, ["MoveL @1;", "moves;", "MoveL @2;"]),
    ("tp", "a line", True, ["L P[1] @;", "L P[2] @;"]),
    ("tp", "a joint motion", True, ["J P[1] 10% FINE;", "J P[2] 10% FINE;"]),
    ("tp", "a label", False, ["L P[1] @;", "LBL[1];", "L P[2] @;", "JMP LBL[1];"]),
    ("tp", "a call", False, ["L P[1] @;", "CALL OTHER;", "L P[2] @;"]),
    ("tp", "a branch", False, ["L P[1] @;", "IF DI[1]=ON,JMP LBL[1];", "L P[3] @;", "LBL[1];", "L P[2] @;"]),
    ("inform", "a line", True, ["MOVL C1 V=10", "MOVL C2 V=10"]),
    ("inform", "a joint motion", True, ["MOVJ C1 VJ=10", "MOVJ C2 VJ=10"]),
    ("inform", "a label", False, ["MOVL C1 V=10", "*AGAIN", "MOVL C2 V=10", "JUMP *AGAIN"]),
    ("inform", "a call", False, ["MOVL C1 V=10", "CALL JOB:OTHER", "MOVL C2 V=10"]),
    ("inform", "a branch", False, ["MOVL C1 V=10", "JUMP *OUT IF IN#(1)=ON", "MOVL C3 V=10", "*OUT", "MOVL C2 V=10"]),
    ("gcode", "a line", True, ["G1 @1", "G1 @2"]),
    ("gcode", "a rapid motion", False, ["G1 @1", "G0 @2"]),
    ("gcode", "an arc", False, ["G1 @1", "G2 @2 R100"]),
    ("gcode", "a jump", False, ["G1 @1", "AGAIN:", "G1 @2", "GOTOB AGAIN"]),
    ("gcode", "a call", False, ["G1 @1", "M98 P100", "G1 @2"]),
    ("urscript", "a line", True, ["movel(@1, a=1, v=1)", "movel(@2, a=1, v=1)"]),
    ("urscript", "a joint motion", True, ["movej(@1, a=1, v=1)", "movej(@2, a=1, v=1)"]),
    (
        "urscript",
        "a branch",
        False,
        [*("movel(@1, a=1, v=1)", "if get_digital_in(1):", "  movel(@3, a=1, v=1)", "end", "movel(@2, a=1, v=1)")],
    ),
    ("urscript", "a loop", False, ["movel(@1, a=1, v=1)", "while True:", "  movel(@2, a=1, v=1)", "end"]),
    ("urscript", "a call that waits", True, ["movel(@1, a=1, v=1)", "still()", "movel(@2, a=1, v=1)"]),
    ("urscript", "a call that moves", False, ["movel(@1, a=1, v=1)", "moves()", "movel(@2, a=1, v=1)"]),
)
"""What stands between the motions to the points at x = 1 and 2 (100 mm), and whether the first is then the start."""


def _text(language: str, lines: list[str]) -> tuple[str, str]:
    body = "\n".join(lines)
    if language == "krl":
        at, name, text = "{{X {}00,Y 0,Z 1500,A 0,B 90,C 0}}", "a.src", KRL.format(body)
    elif language == "rapid":
        at, name = f"{ROBTARGET},v100,fine,tGrip", "a.mod"
        text = RAPID.format(body).replace("@3,", f"{ROBTARGET.format(3)},")
    elif language == "gcode":
        at, name, text = "X{}00 Y0 Z1500 A0 B90 C0", "a.nc", "G90 G21\n" + body + "\nM30\n"
    elif language == "inform":
        points = "".join(f"C{n:05}={n}00.000,0.000,1500.000,180.0000,0.0000,0.0000\n" for n in (1, 2, 3))
        return "A.JBI", INFORM.format(body.replace(" C", " C0000"), points=points)
    elif language == "urscript":
        at, name, text = "p[0.{},0,1.5,0,3.14,0]", "a.script", UR.format(body)
    else:
        point = (
            "P[{0}]{{\n   GP1:\n  UF : 0, UT : 1, CONFIG : 'N U T, 0, 0, 0',\n"
            "  X = {0}00.000 mm, Y = 0.000 mm, Z = 1500.000 mm,\n  W = 180.000 deg, P = 0.000 deg, R = 0.000 deg\n}};\n"
        )
        points = "".join(point.format(n) for n in (1, 2, 3))
        numbered = "\n".join(f"{n:4}:{line.replace('@', '100mm/sec FINE')}" for n, line in enumerate(lines, 1))
        return "a.ls", TP.format(numbered, points=points)
    for number in ("999", "1", "2", "3"):
        text = text.replace(f"@{number}", at.format(number))
    return name, text


@pytest.mark.parametrize(("language", "between", "known", "lines"), WAYS, ids=[" ".join(way[:2]) for way in WAYS])
def test_the_start_is_known_where_nothing_can_be_between(
    language: str, between: str, known: bool, lines: list[str], tmp_path: Path
) -> None:
    name, text = _text(language, lines)
    (tmp_path / name).write_text(text)
    options = ReadOptions(angles="kuka" if language == "gcode" else None)
    program = read_program(tmp_path / name, FRAMES, options)
    starts = starts_of(program, ROBOT, np.eye(4))
    x = [np.nan if target.xyz is None else target.xyz[0] for target in program.targets]
    (second,) = [i for i, value in enumerate(x) if value == pytest.approx(200.0)]
    assert starts.known[second] == known, [target.reason for target in program.targets]
    if known:
        assert starts.poses[second, :3, 3] == pytest.approx([100.0, 0.0, 1500.0], abs=0.5)
        assert starts.by_joints[second] == (between == "a joint motion")
    (first,) = [i for i, value in enumerate(x) if value == pytest.approx(100.0)]
    assert not starts.known[first]


def _starts(folder: Path, text: str, frames: FrameTable = FRAMES):
    (folder / "a.src").write_text(KRL.format(text).replace("LIN @999\n", ""))
    program = read_program(folder / "a.src", frames)
    return program, starts_of(program, ROBOT, np.eye(4))


def test_a_joint_target_is_a_start(tmp_path: Path) -> None:
    _, starts = _starts(tmp_path, "PTP {A1 10,A2 -80,A3 90,A4 5,A5 40,A6 20}\nPTP {X 1500,Y 0,Z 1500,A 0,B 90,C 0}")
    q = np.deg2rad([10.0, -80.0, 90.0, 5.0, 40.0, 20.0])
    np.testing.assert_allclose(starts.poses[1], ROBOT.forward(q), atol=1e-6)
    assert starts.by_joints[1]


def test_the_tool_that_moves_is_that_of_the_target(tmp_path: Path) -> None:
    tool = make_transform(Rotation.from_euler("y", 30, degrees=True), [0.0, 50.0, 200.0])
    frames = FrameTable(tools={1: np.eye(4), 2: tool}, bases={0: np.eye(4)})
    at = "{{X {},Y 0,Z 1500,A 0,B 90,C 0}}"
    lines = [
        *("$TOOL=TOOL_DATA[1]", "$BASE=BASE_DATA[0]", f"LIN {at.format(1500)}"),
        *("$TOOL=TOOL_DATA[2]", f"LIN {at.format(1600)}"),
    ]
    program, starts = _starts(tmp_path, "\n".join(lines), frames)
    np.testing.assert_allclose(starts.poses[1], program.poses_base()[0] @ tool, atol=1e-9)


def test_a_point_that_is_reached_from_several_is_unknown(tmp_path: Path) -> None:
    points = "".join(f"DECL E6POS XP{i}={{X {1400 + 100 * i},Y 0,Z 1500,A 0,B 90,C 0}}\n" for i in (1, 2, 3))
    (tmp_path / "a.dat").write_text(f"DEFDAT A\n{points}ENDDAT\n")
    program, starts = _starts(tmp_path, "LIN XP1\nLIN XP2\nLIN XP3\nLIN XP2\nLIN XP3")
    assert [target.name for target in program.targets] == ["XP1", "XP2", "XP3"]
    assert starts.known.tolist() == [False, False, True]  # XP3 comes from XP2 both times


def test_the_side_of_a_joint_motion_is_that_of_each_joint(tmp_path: Path) -> None:
    start = np.deg2rad([10.0, -80.0, 95.0, 5.0, 40.0, 20.0])
    end = start + np.deg2rad([3.0, -2.0, 0.0, 4.0, -1.0, -300.0])  # the last one turns by more than half a turn
    poses = ROBOT.forward(np.array([start, end]))
    status, turn = status_turn(ROBOT, np.array([start, end]))
    starts = Starts(poses[:1], np.array([True]), status[:1], turn[:1])
    targets = Targets.of(ROBOT, poses[1:], np.eye(4), status[1:], turn[1:], before=starts)
    signs = targets.approach(ROBOT, targets.branches(ROBOT, start[None], needed=True))
    np.testing.assert_array_equal(signs, [[1.0, -1.0, 0.0, 1.0, -1.0, -1.0]])
    far = make_transform(np.eye(3), [[9e3, 0.0, 0.0]])
    lost = Targets.of(ROBOT, poses[1:], np.eye(4), status[1:], turn[1:], before=starts._replace(poses=far))
    assert not lost.approach(ROBOT, lost.branches(ROBOT, start[None], needed=True)).any()
