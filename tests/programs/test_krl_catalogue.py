"""Every row of the catalogue of hazards that concerns KRL, by name, with its verdict. The programs are our own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from truepose.errors import FileError, RefusedError
from truepose.programs import FrameTable, Program, correct_program

SET = "BAS(#TOOL,3)\nBAS(#BASE,1)\n"
POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 0.0,C -180.0,S 2,T 10}"
OTHER = "{X 700.0,Y 10.0,Z 900.0,A 90.0,B 0.0,C -180.0,S 2,T 10}"
FDAT = "{TOOL_NO 3,BASE_NO 1,IPO_FRAME #BASE}"
Read = Callable[..., Program]


def verdicts(program: Program) -> dict[str, str]:
    return {target.name: target.verdict for target in program.targets}


def only(program: Program, name: str | None = None) -> Any:
    """The one target, or the one of this name."""
    found = [target for target in program.targets if name is None or target.name == name]
    assert len(found) == 1
    return found[0]


# all dialects


def test_frame_or_tool_not_known_is_refused(read: Read) -> None:
    target = only(read(f"BAS(#TOOL,7)\nBAS(#BASE,1)\nLIN {POSE}"))
    assert (target.verdict, target.line) == ("refuse", 4)
    assert (
        "tool TOOL_DATA[7] is not known; give it in [frames.tools.7] of the cell file, or a $config.dat"
        in target.reason
    )
    assert "base BASE_DATA[9] is not known" in only(read(f"BAS(#TOOL,3)\nBAS(#BASE,9)\nLIN {POSE}")).reason


def test_frame_or_tool_not_set_is_refused_unless_the_user_gives_it(read: Read, frames: FrameTable) -> None:
    target = only(read(f"LIN {POSE}"))
    assert target.verdict == "refuse"
    assert "no $TOOL is set before this motion" in target.reason
    given = FrameTable(frames.tools, frames.bases, tool=3, base=0)
    target = only(read(f"LIN {POSE}", table=given))
    assert (target.verdict, target.tool_number, target.frame_number) == ("correct", 3, 0)


def test_one_point_under_several_frames_is_refused(read: Read) -> None:
    body = f"{SET}LIN P1\nBAS(#BASE,2)\nLIN P1"
    target = only(read(body, f"DECL E6POS P1={POSE}"))
    assert target.verdict == "refuse"
    assert target.reason.startswith("moved to under BASE_DATA[1] (line 4) and BASE_DATA[2] (line 6)")
    assert only(read(body, f"DECL E6POS P1={POSE}", ambiguous="skip")).verdict == "skip"


def test_one_point_moved_to_and_read_by_arithmetic_is_refused(read: Read) -> None:
    for reading in ("P2=P1", "dz=P1.Z+10", "WAIT FOR $POS_ACT.X>P1.X", "GRIP(P1)", "LIN P1:{X 0,Y 0,Z 5,A 0,B 0,C 0}"):
        body = f"{SET}LIN P1\n{reading}"
        target = only(read(body, f"DECL E6POS P1={POSE}"), "P1")
        assert target.verdict == "refuse", reading
        assert "both moved to (line 4) and read by arithmetic (line 5)" in target.reason
        assert only(read(body, f"DECL E6POS P1={POSE}", ambiguous="skip"), "P1").verdict == "skip"


def test_joint_targets_are_skipped_and_counted(pair: Any, frames: FrameTable, make_map: Any) -> None:
    src = f"DEF cell( )\n{SET}PTP {{A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}}\nPTP HOME1\nLIN {POSE}\nEND\n"
    dat = "DEFDAT CELL\nDECL E6AXIS HOME1={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0,E1 0}\nENDDAT\n"
    corrected = correct_program(pair(src, dat), make_map([0.1, 0, 0]), frames=frames)
    reason = "joint target; allow joint_targets to correct it"
    assert [t.reason for t in corrected.targets if t.verdict == "skip"] == [reason, reason]
    assert (corrected.summary()["corrected"], corrected.summary()["skipped"]) == (1, 2)


def test_aggregates_that_look_like_poses_are_no_targets(read: Read) -> None:
    frame = "X 900,Y 0,Z 40,A 0,B 0,C 0}"
    body = f"$TOOL={{{frame}\n$BASE={{FRAME: {frame}\nBASE_DATA[2]={{{frame}"
    assert len(read(body, "DECL FRAME PALLET={X 1,Y 2,Z 3,A 0,B 0,C 0}").targets) == 0


def test_targets_of_the_run_time_are_skipped(read: Read) -> None:
    program = read(
        f"DECL POS seen\n{SET}seen=camera_pose\nLIN seen\nLIN $POS_ACT\nLIN XELSE\nLIN {POSE}", f"DECL E6POS P1={POSE}"
    )
    assert verdicts(program) == {
        "seen": "skip",
        "$POS_ACT": "skip",
        "XELSE": "skip",
        "LIN:9": "correct",
        "P1": "skip",
    }


def test_targets_of_the_run_time_alone_are_refused(pair: Any, frames: FrameTable, make_map: Any) -> None:
    path = pair(f"DEF cell( )\n{SET}LIN $POS_ACT\nEND\n")
    with pytest.raises(RefusedError, match=r"cell\.src: nothing can be corrected: .*cell\.src:4: \$POS_ACT"):
        correct_program(path, make_map(), frames=frames)


def test_circle_both_or_neither(read: Read) -> None:
    program = read(f"{SET}CIRC {POSE},{OTHER}, CA 270.0 C_DIS\nSCIRC XA, XB\nCIRC XA,XJ", f"DECL E6POS XA={POSE}\n"
                   f"DECL E6POS XB={OTHER}\nDECL E6AXIS XJ={{A1 0,A2 0,A3 0,A4 0,A5 0,A6 0}}")  # fmt: skip
    assert verdicts(program) == {
        "CIRC:4 auxiliary": "correct",
        "CIRC:4 end": "correct",
        "XA": "skip",
        "XB": "skip",
        "XJ": "skip",
    }
    assert "its circle's other point XJ (line 4) is left out: joint target" in only(program, "XA").reason


@pytest.mark.parametrize(("word", "turn"), [("PTP", 10), ("LIN", -1)])
def test_a_correction_that_would_change_the_configuration_is_refused(
    pair: Any, frames: FrameTable, make_map: Any, word: str, turn: int
) -> None:
    path = pair(f"DEF cell( )\n{SET}{word} {POSE}\nLIN {{X 1,Y 2,Z 3,A 0,B 0,C 0}}\nEND\n")
    error_map = make_map(guarded={0: "Status would change"})
    with pytest.raises(RefusedError, match=rf"cell\.src:4: {word}:4: Status would change"):
        correct_program(path, error_map, frames=frames)
    # the map judges it, so it gets the configuration; the controller ignores the Turn of a LIN
    assert error_map.calls[0]["status"].tolist() == [2, -1]
    assert error_map.calls[0]["turn"].tolist() == [turn, -1]


def test_the_same_text_retyped_is_patched_by_position(pair: Any, frames: FrameTable, make_map: Any) -> None:
    path = pair(f"DEF cell( )\n$BASE=$NULLFRAME\nBAS(#TOOL,3)\nLIN {POSE}\n;LIN {POSE}\nLIN {POSE}\nEND\n")
    corrected = correct_program(path, make_map([[0.5, 0, 0], [0.75, 0, 0]]), frames=frames)
    lines = corrected.files[path].decode().splitlines()
    assert [line.split("Y")[0] for line in lines[3:6]] == ["LIN {X 813.0,", ";LIN {X 812.5,", "LIN {X 813.25,"]


# KUKA KRL


def test_point_in_dat_with_motion_in_src_and_fdat(read: Read) -> None:
    program = read("LIN XP7", f"DECL E6POS XP7={POSE}\nDECL FDAT FP7={FDAT}")
    target = only(program)
    assert (target.verdict, target.tool, target.frame, target.line) == ("correct", "TOOL_DATA[3]", "BASE_DATA[1]", 2)
    assert (target.status, target.turn, target.motions) == (2, 10, ("LIN",))


def test_dat_without_its_src_is_an_error(pair: Any, frames: FrameTable, make_map: Any) -> None:
    path = pair(None, f"DEFDAT CELL\nDECL E6POS XP7={POSE}\nENDDAT\n")
    with pytest.raises(FileError, match=r"cell\.dat: is the data list of cell\.src, which is not beside it"):
        correct_program(path, make_map(), frames=frames)


def test_src_without_its_dat_is_an_error_only_if_it_needs_it(pair: Any, read: Read) -> None:
    with pytest.raises(FileError, match=r"cell\.src:4: moves to XP7, .* put cell\.dat beside it"):
        read(f"{SET}LIN XP7")
    assert only(read(f"{SET}LIN {POSE}")).verdict == "correct"


def test_point_without_fdat_and_frame_is_refused(read: Read) -> None:
    assert only(read("LIN XP7", f"DECL E6POS XP7={POSE}")).verdict == "refuse"


def test_inline_form_stays_byte_identical(pair: Any, frames: FrameTable, make_map: Any) -> None:
    form = (
        ";FOLD LIN P7 CONT Vel=2 m/s CPDAT1 Tool[3]:grip Base[1];%{PE}%R 8.3,%MKUKATPBASIS,%CMOVE,%P 1:LIN, 2:P7\n"
        "$BWDSTART=FALSE\nLDAT_ACT=LCPDAT1\nFDAT_ACT=FP7\nBAS(#CP_PARAMS,2)\nLIN XP7 C_DIS\n;ENDFOLD\n"
    )
    path = pair(f"DEF cell( )\n{form}END\n", f"DEFDAT CELL\nDECL E6POS XP7={POSE}\nDECL FDAT FP7={FDAT}\nENDDAT\n")
    corrected = correct_program(path, make_map([0.3, 0.2, 0.1]), frames=frames)
    assert corrected.files[path] == path.read_bytes()
    assert corrected.files[path.with_suffix(".dat")] != path.with_suffix(".dat").read_bytes()


def test_names_and_keywords_fold_case(read: Read) -> None:
    program = read("bas(#tool,3)\nBas (#Base, 1)\nptp xp7\nlin {x 12.5,y 1,z 2,a 0,b 0,c 0}", f"decl e6pos Xp7={POSE}")
    assert verdicts(program) == {"Xp7": "correct", "LIN:5": "correct"}


def test_joints_and_cartesian_behind_one_keyword(read: Read) -> None:
    program = read(
        f"{SET}PTP {{A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}}\nLIN {{X 18.7,Y 147.3,Z 3,A 0,B 0,C 0}}\n"
        "PTP {AXIS: A1 0,A2 0}\nPTP {E6POS: X 1,Y 2,Z 3,A 0,B 0,C 0}\nPTP {FRAME: X 1,Y 2,Z 3,A 0,B 0,C 0}\n"
        "f({FRAME: X 1,Y 2,Z 3,A 0,B 0,C 0})"
    )
    assert verdicts(program) == {
        "PTP:4": "skip",
        "LIN:5": "correct",
        "PTP:6": "skip",
        "PTP:7": "correct",
        "PTP:8": "skip",
    }


@pytest.mark.parametrize("kind", ["POS", "E6POS", "FRAME"])
def test_assignment_in_src_that_is_only_moved_to(read: Read, kind: str) -> None:
    pose = "{X -0.5,Y 137.6,Z 3,A 0,B 0,C 0}"
    program = read(f"DECL {kind} P1\n{SET}P1 = {pose}\nLIN P1\nP1 = {pose}\nLIN P1")
    assert [(t.verdict, t.line) for t in program.targets] == [("correct", 5), ("correct", 7)]


def test_assignment_in_src_otherwise_is_skipped(read: Read) -> None:
    pose = "{X -0.5,Y 137.6,Z 3,A 0,B 0,C 0}"
    assert only(read(f"DECL POS P1\n{SET}P1={pose}\nP1=f()\nLIN P1")).verdict == "skip"
    assert only(read(f"DECL E6AXIS P1\n{SET}P1={{A1 0,A2 0,A3 0,A4 0,A5 0,A6 0}}\nPTP P1")).verdict == "skip"
    assert verdicts(read(f"DECL MYTYPE P1\n{SET}P1={pose}\nLIN P1", "")) == {"P1": "skip"}


def test_partial_aggregate_is_skipped(read: Read) -> None:
    for partial in ("{Z 500}", "{X 1,Y 2,Z 3}", "{A 90}", "{E1 5}"):
        target = only(read(f"{SET}LIN {partial}"))
        assert target.verdict == "skip"
        assert target.reason.startswith("partial: ")


def test_expression_in_the_aggregate_is_skipped(read: Read) -> None:
    target = only(read(f"{SET}LIN {{X dx+10.5,Y 2,Z 3,A 0,B 0,C 0}}"))
    assert (target.verdict, target.reason) == ("skip", "X: an expression, known at run time only")


def test_without_status_binary_literals_exponents_minus_zero(read: Read) -> None:
    program = read(
        f"{SET}LIN {{X 1.123456789,Y -0.0,Z 3,A 0,B -2.6E-14,C 0}}\n"
        "LIN {X 1,Y 2,Z 3,A 0,B 0,C 0,S 'B010',T 'B100010'}\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0,S 'H2',T 'h0a'}"
    )
    assert [(t.verdict, t.status, t.turn) for t in program.targets] == [
        ("correct", None, None),
        ("correct", 2, 34),
        ("correct", 2, 10),
    ]


def test_relative_moves_are_skipped(read: Read) -> None:
    program = read(f"{SET}LIN_REL {{X -10}} C_DIS #TOOL\nSLIN_REL {{Z 300}}\nPTP_REL {{A1 5}}\nLIN_REL XP1", "")
    assert set(verdicts(program).values()) == {"skip"}
    assert len(program.targets) == 4


def test_geometric_operator(read: Read) -> None:
    body = f"{SET}LIN P3:{{X 0,Y 4,Z 0,A 0,B 0,C 0}}"
    assert verdicts(read(body, f"DECL POS P3={POSE}")) == {"LIN:4": "skip", "P3": "skip"}
    assert verdicts(read(f"{body}\nLIN P3", f"DECL POS P3={POSE}")) == {"LIN:4": "skip", "P3": "refuse"}


def test_component_arithmetic(read: Read) -> None:
    assert only(read(f"{SET}P.X = P.X + dx\nLIN P", f"DECL POS P={POSE}"), "P").verdict == "refuse"
    assert only(read(f"{SET}P.X = 5\nLIN P", f"DECL POS P={POSE}"), "P").verdict == "skip"
    assert only(read(f"{SET}XP[i].X = 5\nLIN XP[1]", f"DECL POS XP[3]\nXP[1]={POSE}"), "XP[1]").verdict == "skip"


def test_changed_base_is_refused(read: Read) -> None:
    for change in ("BASE_DATA[1].Z = 5", "BASE_DATA[n] = x", "TOOL_DATA[3]={X 1,Y 2,Z 3,A 0,B 0,C 0}", "$BASE.Z=5"):
        target = only(read(f"{SET}{change}\nLIN {POSE}"))
        assert target.verdict == "refuse", change
    assert only(read(f"{SET}BASE_DATA[2].Z = 5\nLIN {POSE}")).verdict == "correct"


def test_base_by_constant_or_variable(read: Read) -> None:
    for constant in ("$BASE = BASE_DATA[1]", "BAS(#BASE,1)", "bas ( #base , 1 )", "$base=base_data[ 1 ]"):
        assert only(read(f"BAS(#TOOL,3)\n{constant}\nLIN {POSE}")).frame_number == 1, constant
    for variable in (
        "$BASE=BASE_DATA[n]",
        "BAS(#BASE,n)",
        "$BASE=here()",
        "$BASE=MY_BASE",
        "$BASE={X 5}",
        "BAS(cmd,1)",
    ):
        target = only(read(f"BAS(#TOOL,3)\n{variable}\nLIN {POSE}", "DECL FRAME MY_BASE={X 1,Y 2,Z 3,A 0,B 0,C 0}"))
        assert target.verdict == "refuse", variable
        assert "is known at run time only" in target.reason


def test_nothing_behind_resume_runs(read: Read) -> None:
    body = (
        f"DEF cell( )\n{SET}GLOBAL INTERRUPT DECL 3 WHEN $IN[1] DO found( )\nINTERRUPT ON 3\n"
        f"work( )\nLIN {OTHER}\nEND\nDEF work( )\nLIN {POSE}\nEND\nDEF found( )\nBRAKE\nRESUME\nLIN {POSE}\nEND\n"
    )
    program = read(body)
    assert [t.verdict for t in program.targets] == ["correct", "correct", "skip"]
    assert program.targets[2].reason == "the program never reaches this motion"


def test_a_fixed_tool_waits_for_the_robot_of_a_map(read: Read) -> None:
    fdat = "{TOOL_NO 3,BASE_NO 1,IPO_FRAME #TCP}"
    target = only(read("LIN XP7", f"DECL E6POS XP7={POSE}\nDECL FDAT FP7={fdat}"))
    assert (target.verdict, "(IPO_FRAME #TCP)" in target.reason) == ("refuse", True)
    assert only(read(f"{SET}$IPO_MODE=#TCP\nLIN {POSE}")).verdict == "refuse"


def test_one_file_with_several_bases(read: Read) -> None:
    program = read(f"{SET}LIN {POSE}\nBAS(#BASE,2)\nLIN {POSE}\n$BASE=$NULLFRAME\nLIN {POSE}")
    assert [(t.verdict, t.frame_number) for t in program.targets] == [("correct", 1), ("correct", 2), ("correct", 0)]


def test_point_used_in_several_motions(read: Read) -> None:
    target = only(read(f"{SET}PTP XP1\nLIN XP1\nLIN XP1", f"DECL E6POS XP1={POSE}"))
    assert (target.verdict, target.uses) == ("correct", {"PTP": 1, "LIN": 2})


def test_global_points_are_refused_and_arrays_corrected(read: Read) -> None:
    target = only(read(f"{SET}LIN XP1", f"DECL GLOBAL E6POS XP1={POSE}"))
    assert (target.verdict, target.reason[:6]) == ("refuse", "GLOBAL")
    program = read(f"{SET}LIN XP[3]\nLIN XP[i]", f"DECL E6POS XP[5]\nXP[3]={POSE}\nXP[4]={OTHER}")
    assert {t.name: (t.verdict, t.uses) for t in program.targets} == {
        "XP[3]": ("correct", {"LIN": 2}),
        "XP[4]": ("correct", {"LIN": 1}),
    }


def test_pose_like_data_are_no_targets(read: Read) -> None:
    points = (
        "$CYLWORKSPACE[1]={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0,Z1 0.0,Z2 0.0,R 0.0,MODE #OFF}\n"
        "BASE_DATA[1]={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}\n"
        "DECL LOAD LOAD_P={M 26.2,CM {X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0},J {X 1.0,Y 1.0,Z 1.0}}\n"
        'DECL BASIS_SUGG_T LAST_BASIS={POINT1[] "P7 ",POINT2[] "P7 {X",CP_PARAMS[] "CPDAT1"}'
    )
    assert read("LIN {A1 0}", points).targets[0].reason == "joint target"
    assert len(read("LIN {A1 0}", points).targets) == 1


def test_s_moves_and_spline_blocks(read: Read) -> None:
    with_fdat = "WITH $VEL=SVEL_CP(2.0, , LCPDAT1), $LOAD=SLOAD(FA.TOOL_NO), $TOOL=STOOL2(FA), $BASE=SBASE(FA.BASE_NO)"
    program = read(
        f"SPTP XA {with_fdat}\nSLIN XA {with_fdat} C_SPL\nSCIRC XB, XC, CA 90.0 {with_fdat}\n"
        f"SPLINE WITH $TOOL=TOOL_DATA[3], $BASE=BASE_DATA[1], $IPO_MODE=#BASE\nSPL XA\nSPL {POSE}\nTIME_BLOCK START\n"
        "SLIN XA WITH $VEL.CP=0.5\nENDSPLINE C_DIS\n",
        f"DECL E6POS XA={POSE}\nDECL E6POS XB={POSE}\nDECL E6POS XC={OTHER}\nDECL FDAT FA={FDAT}",
    )
    assert set(verdicts(program).values()) == {"correct"}
    assert only(program, "XA").uses == {"SPTP": 1, "SLIN": 2, "SPL": 1}
    assert len(program.circles) == 1


def test_commented_out_moves_are_no_targets(read: Read) -> None:
    assert len(read(";LIN P1\n; LIN {X 1\n;FOLD LIN {X 1,Y 2}\n;ENDFOLD").targets) == 0


def test_poses_as_arguments_are_listed_and_skipped(read: Read) -> None:
    assert verdicts(read(f"f({POSE})\nx=g(1,{POSE})")) == {"f:2": "skip", "g:3": "skip"}


def test_what_looks_like_a_motion_is_refused(read: Read) -> None:
    for motion in (f"LINX {POSE}", "MoveL P1", "LIN", "LIN P1 P2", "CIRC P1", "LIN 5", "IF a THEN LIN P1", "LIN P1, P2",
                   "§ LIN P1", "TRIGGER WHEN DISTANCE=0 DELAY=0 DO LIN P1", "x LIN {X 1}", "LIN C_DIS"):  # fmt: skip
        end = "\nENDIF" if motion.startswith("IF") else ""
        program = read(f"{SET}{motion}{end}", f"DECL POS P1={POSE}")
        assert "refuse" in verdicts(program).values(), motion


def test_absolutely_accurate_robot_is_refused(read: Read) -> None:
    pose = POSE.replace("S 2", "S 18")
    target = only(read(f"{SET}LIN {pose}"))
    assert (target.verdict, "Status bit 4" in target.reason) == ("refuse", True)
    assert only(read(f"{SET}LIN {pose}", absolute_accuracy=True)).verdict == "correct"


def test_external_axis_in_use_is_refused(read: Read) -> None:
    pose = POSE.replace("T 10", "T 10,E1 812.0")
    assert only(read(f"{SET}LIN {pose}")).verdict == "refuse"
    assert only(read(f"{SET}LIN {pose}", external_axes=True)).verdict == "correct"
    assert only(read(f"{SET}LIN {POSE.replace('T 10', 'T 10,E1 0.0')}")).verdict == "correct"


def test_a_folder_is_no_program(tmp_path: Path, make_map: Any) -> None:
    with pytest.raises(FileError, match="holds no robot program; known endings"):
        correct_program(tmp_path, make_map())
