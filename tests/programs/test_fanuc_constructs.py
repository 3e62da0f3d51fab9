"""Constructs of FANUC programs as controllers write them: each is read, and judged target by target."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.programs.corpus_fanuc import LP, lp, ls

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, read_program

FRAMES = FrameTable(tools={1: np.eye(4)}, bases={1: np.eye(4), 2: np.eye(4)})


def read(tmp_path: Path, mn: str, positions: str, frames: FrameTable = FRAMES) -> Program:
    path = tmp_path / "c.ls"
    path.write_bytes(ls(mn, positions).encode("latin-1"))
    return read_program(path, frames)


def verdicts(program: Program) -> dict[str, str]:
    return {target.name: target.verdict for target in program.targets}


def test_several_applications(tmp_path: Path) -> None:
    path = tmp_path / "c.ls"
    text = ls("   1:J P[1] 9% FINE ;\n", lp(1))
    path.write_text(text.replace("/MN", "/APPL\n  ARC : TRUE ;\n/MN"))
    assert verdicts(read_program(path, FRAMES)) == {"P[1]": "correct"}
    path.write_text(text.replace("/MN", "/APPL\n  LINE_TRACK ;\n/APPL\n  ARC : TRUE ;\n/MN"))
    assert verdicts(read_program(path, FRAMES)) == {"P[1]": "refuse"}
    path.write_text(text.replace("/POS", "/MN\n/POS"))
    with pytest.raises(FileError, match="/MN is given a second time"):
        read_program(path, FRAMES)


def test_positions_of_a_remote_tcp_are_refused_one_by_one(tmp_path: Path) -> None:
    remote = LP.replace("W =", "RX=").replace("P =", "RY=").replace("R =", "RZ=")
    program = read(tmp_path, "   1:L P[1] 9mm/sec FINE ;\n   2:L P[2] 9mm/sec FINE ;\n", lp(1, pose=remote) + lp(2))
    assert verdicts(program) == {"P[1]": "refuse", "P[2]": "correct"}
    assert program.targets[0].reason == "remote TCP: tool and frame change roles"


OPEN_IF = """   1:  IF (DI[1]) THEN ;
   2:  UFRAME_NUM=2 ;
   3:J P[1] 9% FINE ;
   4:  IF (DI[2] AND (R[1:a)b]>3)) THEN ;
   5:  ENDIF ;
   6:L P[2] 9mm/sec FINE ;
"""


def test_an_if_may_stay_open(tmp_path: Path) -> None:
    assert verdicts(read(tmp_path, OPEN_IF, lp(1, uf=2) + lp(2, uf=2))) == {"P[1]": "correct", "P[2]": "correct"}
    # behind the open IF no other way leads to the motion
    assert verdicts(read(tmp_path, OPEN_IF, lp(1, uf=1) + lp(2, uf=1))) == {"P[1]": "refuse", "P[2]": "refuse"}
    looped = OPEN_IF.replace("   6:", "   6:  FOR R[1]=1 TO 3 ;\n   7:  IF (DI[3]) THEN ;\n   8:  ENDFOR ;\n   9:")
    assert verdicts(read(tmp_path, looped, lp(1, uf=2) + lp(2, uf=2))) == {"P[1]": "correct", "P[2]": "correct"}
    for broken in ("   1:  ENDIF ;\n", "   1:  ELSE ;\n", "   1:  FOR R[1]=1 TO 3 ;\n"):
        with pytest.raises(FileError, match=r"c\.ls:\d+: .*(without|not closed)"):
            read(tmp_path, broken, lp(1))


def test_frames_in_force(tmp_path: Path) -> None:
    def at(before: str, frames: FrameTable = FRAMES) -> tuple[str, str, str]:
        text = lp(1).replace("UF : 1, UT : 1", "UF : F, UT : F")
        (target,) = read(tmp_path, f"{before}   5:J P[1] 9% FINE ;\n", text, frames).targets
        return target.verdict, target.frame, target.reason

    tool = "   1:  UTOOL_NUM=1 ;\n"
    assert at(f"{tool}   2:  UFRAME_NUM=2 ;\n") == ("correct", "UFRAME[2]", "")
    assert at(tool)[2] == "the program names no base; state the one in force (--base NAME)"
    given = FrameTable(FRAMES.tools, FRAMES.bases, base=2)
    assert at(tool, given)[:2] == ("correct", "2")
    for uncertain in (
        "   2:  UFRAME_NUM=R[1] ;\n",
        "   2:  IF DI[1],JMP LBL[1] ;\n   3:  UFRAME_NUM=2 ;\n   4:  LBL[1] ;\n",
    ):
        verdict, _, reason = at(tool + uncertain)
        assert (verdict, reason[:25]) == ("refuse", "UF : F, the one in force,")


def test_logic_of_a_motion_in_lines_of_its_own(tmp_path: Path) -> None:
    mn = """   1:  UFRAME_NUM=1 ;
   2:J P[1] 100% CNT100 ACC100 TB    .10sec,P-SPS    ;
      1:  TC_ONLINE (DI[1] AND !DI[2]) ;
      2:  DO[23]=OFF ;
      3:  CALL MAKRO050    ;
      4:  WAIT (DI[23])    ;
       ------ ;
   3:L P[2] 1500mm/sec CNT0 ACC100 TB    .10sec,P-SPS    ;
      1:  IF (R[5]=2),CALL PART ;
       ------ ;
   4:L P[3] 1500mm/sec CNT0    ;
"""
    assert verdicts(read(tmp_path, mn, lp(1) + lp(2) + lp(3))) == dict.fromkeys(("P[1]", "P[2]", "P[3]"), "correct")


@pytest.mark.parametrize(
    "motion",
    [
        "L P[1] 500mm/sec CNT100 ACC80 TIME BEFORE   .20sec,CALL OPEN_GRP",
        "L P[1:above ; part] R[7:speed]mm/sec CNT R[8] Skip,LBL[9:next]",
        "J P[1] 100% CNT100 PTH TIME AFTER 1.00sec,DO[3:go]=ON",
        "L P[1] WELD_SPEED CNT80 Wjnt\n    :  Weave Sine[1]",
        "L P[1] 1500cm/min CR50 DA 20.0mm,CALL X(1,'L P[9]')",
        "L P[1] 2.5sec FINE BREAK EV50%",
    ],
)
def test_options_of_motions(tmp_path: Path, motion: str) -> None:
    program = read(tmp_path, f"   1:{motion} ;\n   2:  LBL[9:next] ;\n", lp(1))
    assert verdicts(program) == {"P[1]": "correct"}


GERMAN = {
    "BENUTZER_NUM=1": r"c\.ls:24: BENUTZER_NUM is a keyword of another language",
    "AUFRUF TEIL1": "AUFRUF is a keyword of another language",
    "L P[1] 100mm/sek FEIN": "mm/sek is a keyword of another language",
}


@pytest.mark.parametrize("code", GERMAN)
def test_other_languages_are_refused(tmp_path: Path, code: str) -> None:
    with pytest.raises(FileError, match=GERMAN[code]):
        read(tmp_path, f"   1:{code} ;\n", lp(1))


def test_other_languages_in_positions_and_header(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="KONFIG : is a keyword of another language; give the English copy"):
        read(tmp_path, "   1:J P[1] 9% FINE ;\n", lp(1).replace("CONFIG", "KONFIG"))
    path = tmp_path / "d.ls"
    path.write_text('/PROG D\n/ATTR\nPROPRIO\t= X;\nCOMMENTAIRE\t= "";\n/MN\n/POS\n/END\n')
    with pytest.raises(FileError, match=r"d\.ls:3: PROPRIO is a keyword of another language"):
        read_program(path, FRAMES)
    harmless = (
        "   1:  !AUFRUF TEIL1 ;\n   2:  LBL[1:AUFRUF] ;\n   3:  CALL A('BENUTZER_NUM') ;\n   4:J P[1] 9% FINE ;\n"
    )
    assert verdicts(read(tmp_path, harmless, lp(1))) == {"P[1]": "correct"}


def test_a_component_of_a_position_is_the_position(tmp_path: Path) -> None:
    motions = "   2:L P[1] 9mm/sec FINE ;\n   3:L P[2] 9mm/sec FINE ;\n"
    for code, verdict in (("P[1,3]=50", "skip"), ("R[1]=P[1,3]", "refuse"), ("P[1,R[2]]=50", "skip")):
        program = read(tmp_path, f"   1:  {code} ;\n{motions}", lp(1) + lp(2))
        assert verdicts(program)["P[1]"] == verdict, code
