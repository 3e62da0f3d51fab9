"""Every row of the catalogue of hazards that concerns FANUC TP, by name, with its verdict."""

# ruff: noqa: E501
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, ReadOptions, correct_program, read_program

FRAMES = FrameTable(tools={1: np.eye(4), 2: np.eye(4)}, bases={2: np.eye(4), 3: np.eye(4)})
XYZ = "X =   300.000  mm,\tY =     -.858  mm,\tZ =   412.123  mm,\n\tW =  -171.986 deg,\tP =     0.000 deg,\tR =     -.858 deg"
JOINTS = "J1=     0.000 deg,\tJ2=   -30.000 deg,\tJ3=     0.000 deg,\n\tJ4=     0.000 deg,\tJ5=   -30.000 deg,\tJ6=     0.000 deg"
Read = Callable[..., Program]


def position(number: int = 1, body: str = XYZ, uf: str = "2", head: str = "", more: str = "") -> str:
    config = "" if body == JOINTS else "\t\tCONFIG : 'N U T, 0, 0, 0',"
    return f"P[{number}{head}]{{\n   GP1:\n\tUF : {uf}, UT : 1,{config}\n\t{body}{more}\n}};\n"


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def reading(code: str, positions: str | None = None, frames: FrameTable = FRAMES, **options: Any) -> Program:
        numbered = [line if line.startswith(":") else f"{k}:{line}" for k, line in enumerate(code.split("\n"), 1)]
        lines = "".join(f"{line:>4} ;\n" for line in numbered).replace(
            " ;\n:", "\n:"
        )  # an open line goes on in the next
        path = tmp_path / "a.ls"
        path.write_text(f"/PROG  A\n/ATTR\n/MN\n{lines}/POS\n{position() if positions is None else positions}/END\n")
        return read_program(path, frames, ReadOptions(**options))

    return reading


def verdicts(program: Program) -> dict[str, str]:
    return {target.name: target.verdict for target in program.targets}


def only(program: Program, name: str = "P[1]") -> Any:
    found = [target for target in program.targets if target.name == name]
    assert len(found) == 1, verdicts(program)
    return found[0]


def test_pos_block_keeps_width_decimals_and_missing_zeros(tmp_path: Path, make_map: Any) -> None:
    path = tmp_path / "a.LS"
    text = f"/PROG  A\r\n/MN\r\n   1:J P[1] 100% FINE    ;\r\n/POS\r\n{position()}/END\r\n".replace(
        "\n", "\r\n"
    ).replace("\r\r", "\r")
    path.write_bytes(text.encode())
    corrected = correct_program(path, make_map([-299.5, 0.1234, 600.0]), frames=FRAMES, resolution=1e-5)
    expected = text.replace("X =   300.000", "X =     0.500").replace("Y =     -.858", "Y =     -.735")
    assert corrected.files[path].decode() == expected.replace("Z =   412.123", "Z =  1012.123")


def test_layouts_key_on_the_number(read: Read) -> None:
    for head, call in ((':"ABOVE PART"', "P[1:ABOVE PART]"), ("", "P[1]"), (':"A]B"', "P[ 1 ]"), ("", "P[1:other]")):
        program = read(f"J {call} 100% FINE", position(head=head))
        assert (only(program).verdict, only(program).configuration) == ("correct", "N U T, 0, 0, 0"), head
    assert only(read("J P[1] 100% FINE", position().replace("]{", "] {"))).verdict == "correct"


def test_several_frames_in_one_program(read: Read) -> None:
    code = "UFRAME_NUM=2\nJ P[1] 100% FINE\nUFRAME_NUM=3\nL P[2] 100mm/sec FINE"
    program = read(code, position() + position(2, uf="3"))
    assert [(t.verdict, t.frame, t.tool) for t in program.targets] == [
        ("correct", "UFRAME[2]", "UTOOL[1]"),
        ("correct", "UFRAME[3]", "UTOOL[1]"),
    ]


def test_another_frame_in_force_is_refused(read: Read) -> None:
    target = only(read("UFRAME_NUM=3\nJ P[1] 100% FINE"))
    assert target.verdict == "refuse"
    assert target.reason == "UFRAME_NUM 3 is in force (line 5), but it was taught in UF 2"
    assert only(read("UTOOL_NUM=2\nJ P[1] 100% FINE")).verdict == "refuse"
    # where it may be right, the position is taken at its word: the controller stops otherwise
    for code in (
        "IF R[1]=1,JMP LBL[1]\nUFRAME_NUM=2\nLBL[1]",
        "UFRAME_NUM=R[1]",
        "UFRAME_NUM=3\nCALL FRAMES",
        "UFRAME_NUM=3\nIF (DI[1]) THEN\nUFRAME_NUM=2\nENDIF",
    ):
        assert only(read(f"{code}\nJ P[1] 100% FINE")).verdict == "correct", code


def test_uf_f_and_uninitialised(read: Read) -> None:
    assert only(read("J P[1] 100% FINE", position(uf="F"))).verdict == "refuse"
    stars = "X = ********  mm,\tY = ********  mm,\tZ = ********  mm,\n\tW = ******** deg,\tP = ******** deg,\tR = ******** deg"
    assert only(read("J P[1] 100% FINE", position(body=stars))).verdict == "skip"


def test_frame_values_are_not_in_the_file(read: Read) -> None:
    target = only(read("J P[1] 100% FINE", frames=FrameTable()))
    assert (target.verdict, "is not known; give it in [frames.tools.1]" in target.reason) == ("refuse", True)


def test_changed_frame_is_refused(read: Read) -> None:
    for change in ("UFRAME[2]=PR[1]", "UFRAME[R[1]]=PR[1]", "UTOOL[1]=PR[2]"):
        assert only(read(f"{change}\nJ P[1] 100% FINE")).verdict == "refuse", change
    assert only(read("UFRAME[3]=PR[1]\nJ P[1] 100% FINE")).verdict == "correct"


SYSTEM_VARIABLES = {
    "$MNUFRAME[1,2]=PR[1]": "refuse",
    "$MNUTOOL[1,1]=PR[1]": "refuse",
    "$MNUTOOL[1,R[3]]=PR[1]": "refuse",
    "$mnutool[ 1 , 1 ].$Z=R[1]": "refuse",
    "$GROUP[1].$UTOOL=PR[1]": "refuse",
    "$GROUP[1].$UFRAME=PR[1]": "refuse",
    "$MNUTOOLNUM[1]=2": "refuse",
    "$MNUFRAMENUM[1]=3": "refuse",
    "$MNUTOOL[1,2]=PR[1]": "correct",
    "$MNUFRAMENUM[1]=2": "correct",
    "PR[1]=$MNUTOOL[1,1]": "correct",
    "PR[1]=$GROUP[1].$UFRAME": "correct",
    "PR[2]=UTOOL[1]": "correct",
}


@pytest.mark.promise("A FANUC frame or tool that a program sets through a system variable counts as changed.")
def test_frames_set_through_system_variables(read: Read, record_property: Callable[[str, object], None]) -> None:
    for change, verdict in SYSTEM_VARIABLES.items():
        assert only(read(f"{change}\nJ P[1] 100% FINE")).verdict == verdict, change
    record_property("cases", len(SYSTEM_VARIABLES))


def test_external_axis_groups_and_coord(read: Read) -> None:
    assert only(read("J P[1] 100% FINE", position(more=",\n\tE1=   100.000  mm"))).verdict == "refuse"
    assert (
        only(read("J P[1] 100% FINE", position(more=",\n\tE1=   100.000  mm"), external_axes=True)).verdict == "correct"
    )
    groups = position(more="\n   GP2:\n\tUF : 0, UT : 1,\n\tJ1=    10.000  mm")
    assert only(read("J P[1] 100% FINE", groups)).verdict == "correct"
    assert only(read("J P[1] 100% FINE", groups.replace("GP1", "GP3"))).verdict == "skip"
    assert only(read("L P[1] 100mm/sec FINE RTCP")).verdict == "refuse"


def test_position_registers_and_their_arithmetic(read: Read) -> None:
    program = read("L PR[5] 100mm/sec FINE\nPR[5,1]=R[100]\nL PR[R[2]:x] 100mm/sec FINE\nJ P[1] 100% FINE")
    assert verdicts(program) == {"PR[5]": "skip", "PR[R[2]:x]": "skip", "P[1]": "correct"}
    assert only(read("PR[5]=P[1]\nJ P[1] 100% FINE")).verdict == "refuse"
    assert only(read("PR[5]=P[1]\nJ P[1] 100% FINE", ambiguous="skip")).verdict == "skip"
    assert only(read("P[1]=PR[5]\nJ P[1] 100% FINE")).verdict == "skip"


@pytest.mark.parametrize(
    "option", ["Offset,PR[3]", "Offset", "Tool_Offset,PR[2]", "INC", "VOFFSET,VR[1]", "ACC50 Offset,PR[1:x]"]
)
def test_offsets_and_increments(read: Read, option: str) -> None:
    target = only(read(f"L P[1] 100mm/sec FINE {option}"))
    assert target.verdict == "skip"
    both = only(read(f"L P[1] 100mm/sec FINE {option}\nL P[1] 100mm/sec FINE"))
    assert both.verdict == "refuse"


def test_circle_over_two_lines(read: Read) -> None:
    code = "C P[1]    \n:  P[2] 100mm/sec FINE"
    program = read(code, position() + position(2))
    assert (verdicts(program), len(program.circles)) == ({"P[1]": "correct", "P[2]": "correct"}, 1)
    assert verdicts(read(code, position() + position(2, body=JOINTS))) == {"P[1]": "skip", "P[2]": "skip"}
    arcs = read(
        "A P[1] 1mm/sec FINE\nA P[2] 1mm/sec FINE\nA P[3] 1mm/sec FINE", position() + position(2) + position(3, uf="F")
    )
    assert set(verdicts(arcs).values()) == {"refuse"}


def test_line_numbers_comments_and_other_words(read: Read, tmp_path: Path) -> None:
    path = tmp_path / "b.ls"
    path.write_text(
        f"/PROG  B\n/MN\n  7:J P[1] 100% FINE ;\n  7:  !L P[2] 100% FINE ;\n  3://L P[3] 9% FINE ;\n   :  ;\n/POS\n{position()}/END\n"
    )
    assert verdicts(read_program(path, FRAMES)) == {"P[1]": "correct"}
    program = read("PTP P[1] 100% FINE")
    assert program.targets[0].verdict == "refuse"
    assert "looks like a motion that is not known" in program.targets[0].reason


def test_joint_targets_and_points_that_are_not_taught(read: Read) -> None:
    program = read("J P[1] 100% FINE\nL P[7] 100mm/sec FINE\nL P[R[1]] 100mm/sec FINE", position(body=JOINTS))
    assert verdicts(program) == {"P[1]": "skip", "P[7]": "skip", "P[R[1]]": "skip"}


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (position(body=XYZ.replace("300.000", "1.2.3")), r"a\.ls:9: X: 1\.2\.3 is not a number"),
        (position(body=XYZ.replace("300.000", "9" * 400)), "has 400 characters"),
        (position(body=XYZ.replace("300.000  mm", "300.000  in")), "expected a number in mm"),
        (position(body=XYZ.split("W")[0]), r"P\[1\] has no W, P, R"),
        (position(body=XYZ + ", X = 1 mm"), r"P\[1\] gives X twice"),
        (position() + position(), r"P\[1\] is given twice, first in line 6"),
        (position().replace("};", ""), r"the brace of P\[1\] is not closed"),
        ("nonsense\n", "a position under /POS that is not understood"),
    ],
)
def test_broken_positions(read: Read, positions: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        read("J P[1] 100% FINE", positions)


def test_truncated_and_other_files(tmp_path: Path) -> None:
    path = tmp_path / "a.ls"
    path.write_text("/PROG A\n/MN\n/POS\n")
    with pytest.raises(FileError, match="has no /END: the file is truncated"):
        read_program(path)
    path.write_text("DEF a()\nEND\n")
    with pytest.raises(FileError, match="has no /PROG"):
        read_program(path)


def raw(tmp_path: Path, mn: str, positions: str) -> Program:
    path = tmp_path / "raw.ls"
    path.write_text(f"/PROG  RAW\n/ATTR\n/MN\n{mn}/POS\n{positions}/END\n")
    return read_program(path, FRAMES)


@pytest.mark.promise("FANUC: an instruction line without a number is an instruction of its own")
def test_lines_without_numbers(tmp_path: Path, record_property: Any) -> None:
    positions = "".join(position(n) for n in range(1, 5))
    listings = {
        "all": "    :J P[1] 100% FINE;\n    :L P[2] 100mm/sec FINE;\n    :L P[3] 100mm/sec FINE;\n    :L P[4] 9mm/sec FINE;\n",
        "mixed": "   1:J P[1] 100% FINE    ;\n    :L P[2] 100mm/sec FINE    ;\n   :L P[3] 1mm/sec FINE ;\n   2:L P[4] 9mm/sec FINE ;\n",
        "no colon": "J P[1] 100% FINE ;\nL P[2] 100mm/sec FINE ;\nL P[3] 1mm/sec FINE ;\nL P[4] 9mm/sec FINE ;\n",
        "continued": "   1:J P[1]\n    : 100% FINE ;\n   2:C P[2]\n    :  P[3] 80cm/min FINE\n\n    :  ACC50 ;\n    :L P[4] 9mm/sec FINE ;\n",
        "comment": "   1:J P[1:a;b] 100% FINE\n    : ;\n   2:  !note\n    :L P[2] 9mm/sec FINE ;\n    :  --x ;\n   :L P[3] 9mm/sec\n: FINE ;\n   :L P[4] 9mm/sec FINE ;\n",
    }
    record_property("cases", len(listings))
    for name, mn in listings.items():
        program = raw(tmp_path, mn, positions)
        assert verdicts(program) == dict.fromkeys(("P[1]", "P[2]", "P[3]", "P[4]"), "correct"), name
        assert [len(target.motions) for target in program.targets] == [1] * 4, name


@pytest.mark.promise("FANUC: a motion inside any other instruction refuses the program")
def test_a_motion_inside_another_instruction(tmp_path: Path, record_property: Any) -> None:
    listings = [
        "   1:J P[1] 100% FINE\n    :L P[2] 100mm/sec FINE ;\n",
        "   1:J P[1] 100% FINE ; L P[2] 100mm/sec FINE ;\n",
        "   1:  IF R[1]=1,L P[2] 100mm/sec FINE ;\n",
        "   1:  WAIT DI[1]=ON,\n    :  J P[1] 100% FINE ;\n",
        "   1:  R[1]=2\n    :J PR[2] 100% FINE ;\n",
    ]
    record_property("cases", len(listings))
    for mn in listings:
        with pytest.raises(FileError, match=r"raw\.ls:\d+: a motion inside another instruction"):
            raw(tmp_path, mn, position(1) + position(2))
    quoted = (
        "   1:J P[1] 100% FINE ;\n   2:  MESSAGE[GO L P[2]] ;\n   3:  !L P[2] 9% FINE ;\n   4:  CALL A('L P[2]') ;\n"
    )
    assert verdicts(raw(tmp_path, quoted, position(1))) == {"P[1]": "correct"}


@pytest.mark.promise("FANUC: points in reach of a run-time shift are refused by its name")
def test_run_time_shifts(read: Read, tmp_path: Path, record_property: Any) -> None:
    regions = [
        ("Touch Offset PR[2]", "Touch Offset End"),
        ("Touch Offset[2]", "TOUCH OFFSET END"),
        ("Track TAST[1]", "Track End"),
        ("Track {AVC}[1]".replace("{", "").replace("}", ""), "Track End"),
        ("Track Sensor[1]", "Track End"),
        ("Track DPM[1]", "Track End"),
        ("Track TAST[1] RPM[1]", "Track End"),
        ("MP Offset PR[3] RPM[1]", "MP Offset End"),
        ("SOFTFLOAT[1]", "SOFTFLOAT END"),
        ("FORCE CTRL[1]", "FORCE CTRL End"),
        ("LINE[1] ON", ""),
        ("SETTRIG LNSCH[1] R[5]", ""),
        ("SELBOUND LNSCH[1] BOUND[2]", ""),
    ]
    record_property("cases", len(regions) + 4)
    three = position() + position(2) + position(3)
    for begin, end in regions:
        code = f"J P[1] 100% FINE\n{begin}\nL P[2] 9mm/sec FINE\n{end or 'LBL[9]'}\nL P[3] 9mm/sec FINE"
        program = read(code, three)
        behind = "correct" if end else "refuse"
        assert verdicts(program) == {"P[1]": "correct", "P[2]": "refuse", "P[3]": behind}, begin
        assert only(program, "P[2]").reason.upper().startswith(begin.upper()[:5]), begin
    both = read(
        "Track TAST[1]\nMP Offset PR[1]\nTrack End\nL P[1] 9mm/sec FINE\nMP Offset End\nL P[2] 9mm/sec FINE", three
    )
    assert [(t.verdict, t.reason[:9]) for t in both.targets][:2] == [("refuse", "MP Offset"), ("correct", "")]
    loop = read("LBL[1]\nL P[1] 9mm/sec FINE\nTrack TAST[1]\nL P[2] 9mm/sec FINE\nJMP LBL[1]", three)
    assert verdicts(loop)["P[1]"] == "refuse"  # the second time round
    assert only(read("L P[1] 9mm/sec FINE Search[X]")).verdict == "skip"
    path = tmp_path / "conveyor.ls"
    head = "/APPL\n  LINE_TRACK ;\n    LINE_TRACK_SCHEDULE_NUMBER : 1 ;\n"
    path.write_text(f"/PROG  C\n/ATTR\n{head}/MN\n   1:L P[1] 9mm/sec FINE ;\n/POS\n{position()}/END\n")
    target = only(read_program(path, FRAMES))
    assert (target.verdict, target.reason[:20]) == ("refuse", "LINE_TRACK (line 4) ")


@pytest.mark.promise("FANUC: motions to palletising positions are listed")
def test_palletising_positions_are_listed(read: Read) -> None:
    program = read(
        "PALLETIZING-B_1\nJ PAL_1[A_1] 30% FINE\nL PAL_1[BTM] 9mm/sec FINE\nL PAL_1[R_1] 9mm/sec FINE\nJ P[1] 9% FINE"
    )
    assert verdicts(program) == {"PAL_1[A_1]": "skip", "PAL_1[BTM]": "skip", "PAL_1[R_1]": "skip", "P[1]": "correct"}
    assert program.targets[0].reason == "position of a palletising pattern, known at run time only"
    for unknown in ("L XP[1] 9mm/sec FINE", "LP[1] 9mm/sec FINE", "JPR[1] 9% FINE", "J @P[1] 9% FINE"):
        assert verdicts(read(unknown))[f"{unknown[0]}:4"] == "refuse", unknown


@pytest.mark.promise("FANUC: a position that a motion to another one names is not corrected")
def test_a_second_position_in_a_motion(read: Read) -> None:
    program = read("L P[1] 9mm/sec FINE DB 10mm,P[2]\nL P[2] 9mm/sec FINE", position() + position(2))
    assert verdicts(program) == {"P[1]": "correct", "P[2]": "refuse"}
