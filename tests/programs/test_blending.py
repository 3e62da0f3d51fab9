"""Blended motions are counted and told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from truepose.programs import FrameTable, ReadOptions, correct_program, read_program
from truepose.programs.core.blending import in_words

RT = "[[1,2,3],[0,0,-1,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"
POINT = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
PROGRAMS = {
    "a.src": (
        (
            f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nPTP {POINT} C_PTP\nLIN {POINT} c_dis\nLIN {POINT}\n"
            f'LIN {POINT} C_DIS ; C_VEL\nLIN {POINT} ; C_DIS\nMSG("LIN C_DIS")\nEND\n'
        ),
        {"C_DIS": 2, "C_PTP": 1},
    ),
    "a.mod": (
        (
            f"MODULE m\nPROC main()\nMoveL {RT},v10,z10,tool0;\nMoveJ {RT},v10,fine,tool0;\n"
            f"MoveL {RT},\n v10,\n Z5,tool0\\WObj:=wobj0;\n! MoveL p1,v10,z50,tool0;\nENDPROC\nENDMODULE\n"
        ),
        {"z10": 1, "z5": 1},
    ),
    "a.ls": (
        (
            "/PROG A\n/MN\n 1:J P[1] 50% CNT100 ;\n 2:L P[1] 9mm/sec FINE ;\n 3:L P[1] 9mm/sec CNT0 ;\n"
            " 4: !L P[1] 9mm/sec CNT50 ;\n/POS\n/END\n"
        ),
        {"CNT": 1},
    ),
    "a.script": (
        (
            "def a():\n  movel(p[1,0,0,0,0,0],r=0.001)\n  movel(p[1,0,0,0,0,0],a=1,r=0)\n  movej(p[1,0,0,0,0,0])\n"
            "  # movel(p[0,0,0,0,0,0], r=0.5)\nend\n"
        ),
        {"r": 1},
    ),
    "a.jbi": (
        (
            "/JOB\n//NAME A\n//POS\n///TOOL 1\n///POSTYPE BASE\n///RECTAN\n"
            "C00000=1.000,2.000,3.000,0.0000,0.0000,0.0000\n//INST\nNOP\n"
            "MOVL C00000 V=9.0 PL=4\nMOVL C00000 V=9.0 PL=0\nMOVL C00000 V=9.0\n'MOVL C00000 PL=4\nEND\n"
        ),
        {"PL=4": 1},
    ),
    "a.csv": ("name,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\np,1,2,3,0,0,0\n", {}),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_blended_motions_are_counted(tmp_path: Path, name: str) -> None:
    text, expected = PROGRAMS[name]
    (tmp_path / name).write_text(text)
    program = read_program(tmp_path / name, FrameTable(tool=0, base=0), ReadOptions(whole_task=True))
    assert program.blended == expected
    assert program.to_dict()["blended"] == expected


def test_the_record_and_the_commands_tell(tmp_path: Path, make_map: Any, run: Any) -> None:
    (tmp_path / "a.src").write_text(PROGRAMS["a.src"][0])
    corrected = correct_program(tmp_path / "a.src", make_map([0.0, 0.0, 0.3]))
    corrected.write(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "a.corrections.json").read_text())["blended"] == {"C_DIS": 2, "C_PTP": 1}
    told = "3 motions are blended (C_DIS: 2, C_PTP: 1): the tool passes their targets at a distance"
    assert told in " ".join(run("check", tmp_path / "a.src").out.split())
    assert in_words({}) == ""
