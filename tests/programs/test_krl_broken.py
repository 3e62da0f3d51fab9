"""Broken programs: one line with file and line, and never anything but an error of ours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from truepose.errors import FileError
from truepose.programs import read_program

POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 0.0,C -180.0}"


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("LIN {X 1.2.3,Y 2,Z 3,A 0,B 0,C 0}", r"cell\.src:2: X 1\.2\.3 is not a number"),
        ("LIN {X --5,Y 2,Z 3,A 0,B 0,C 0}", r"cell\.src:2: X --5 is not a number"),
        ("LIN {X 12mm,Y 2,Z 3,A 0,B 0,C 0}", r"cell\.src:2: X 12mm is not a number"),
        ("LIN {X ,Y 2,Z 3,A 0,B 0,C 0}", r"cell\.src:2: X +is not a number"),
        (f"LIN {{X {'9' * 400},Y 2,Z 3,A 0,B 0,C 0}}", r"cell\.src:2: X: number 9{20}… has 400 characters"),
        ("LIN {X 1E300,Y 2,Z 3,A 0,B 0,C 0}", r"cell\.src:2: X: number 1E300 is beyond 1e\+06"),
        ("LIN {X 1,Y 2,Z 3,A 0,B 0,C 0,X 5}", r"cell\.src:2: aggregate .* names X twice"),
        ("LIN {X 1,Y 2,Z 3,A 0,B 0,Q 0}", r"cell\.src:2: broken aggregate .*: no point has Q here"),
        ("LIN {X 1,Y 2,A1 3}", r"cell\.src:2: broken aggregate .*: no point has X, Y here"),
        ("LIN {X 1 Y 2}", r"cell\.src:2: X 1 Y 2 is not a number"),
        ("LIN {X 1,,Y 2}", r"cell\.src:2: broken aggregate"),
        ("LIN {}", r"cell\.src:2: "),
        ("LIN {X 1,Y 2", r"cell\.src:2: "),
        ("LIN X 1,Y 2}", r"cell\.src:2: LIN: brackets do not pair"),
        ('x="open', r'cell\.src:2: a text that starts with " is not closed'),
    ],
)
def test_broken_source(pair: Any, body: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        read_program(pair(f"DEF cell( )\n{body}\nEND\n"))


STRAYS = (
    "x=1 LIN",
    "$VEL.CP=1 LIN",
    "P[2]=XP1 SPTP",
    "BAS(#VEL_PTP,100) LIN",
    "WAIT SEC 0 PTP",
    "IF a THEN LIN",
    "a: LIN",
)


@pytest.mark.promise("A KRL motion behind another statement in its line is refused, not passed over.")
def test_motion_behind_another_statement(pair: Any, record_property: Callable[[str, object], None]) -> None:
    for stray in STRAYS:
        end = "\nENDIF" if stray.startswith("IF") else ""
        program = read_program(pair(f"DEF cell( )\n{stray} {POSE}{end}\nEND\n"))
        assert [target.verdict for target in program.targets] == ["refuse"], stray
        assert "a motion inside another statement" in program.targets[0].reason, stray
    record_property("cases", len(STRAYS))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (f"DECL E6POS XP1={POSE}\nDECL E6POS xp1={POSE}", r"cell\.dat:3: XP1 is declared twice, first in line 2"),
        (f"DECL E6POS XP[2]\nXP[1]={POSE}\nXP[1]={POSE}", r"cell\.dat:4: XP already has a value in line 3"),
        ("DECL E6POS XP1={X 1,Y 2", r"cell\.dat:2: "),
        ("DECL E6POS XP1={X 1.5.2,Y 2}", r"cell\.dat:2: X 1\.5\.2 is not a number"),
        ("DECL FDAT FP1={TOOL_NO 1.2.3}", r"cell\.dat:2: TOOL_NO 1\.2\.3 is not a number"),
        (f"LIN {POSE}", r"cell\.dat:2: LIN is a motion, and a data list has none"),
        ("DECL E6POS 5X={X 1}", r"cell\.dat:2: .* expected a name"),
    ],
)
def test_broken_data_list(pair: Any, points: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        read_program(pair("DEF cell( )\nEND\n", f"DEFDAT CELL\n{points}\nENDDAT\n"))


def test_truncated_programs(pair: Any) -> None:
    with pytest.raises(FileError, match=r"cell\.src:1: cell has no END: the file is truncated"):
        read_program(pair(f"DEF cell( )\nLIN {POSE}\n"))
    with pytest.raises(FileError, match=r"cell\.dat:1: DEFDAT has no ENDDAT: the file is truncated"):
        read_program(pair("DEF cell( )\nEND\n", f"DEFDAT CELL\nDECL E6POS XP1={POSE}\n"))


def test_no_file_and_other_languages(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"a\.src: no such file"):
        read_program(tmp_path / "a.src")
    with pytest.raises(FileError, match=r"a\.dat: is the data list of a\.src, which is not beside it"):
        read_program(tmp_path / "a.dat")
    (tmp_path / "a.txt").touch()
    with pytest.raises(
        FileError, match=r"a\.txt: is not a robot program in a known language; known endings: \.src, \.dat"
    ):
        read_program(tmp_path / "a.txt")


@pytest.mark.parametrize(
    "data", [b"", b"\x00", b"\xff\xfe\x00L", b"{", b"}" * 1000, b"LIN " + b"(" * 5000, b"\\\n" * 99]
)
def test_bytes_that_are_no_program(pair: Callable[..., Path], data: bytes) -> None:
    try:
        program = read_program(pair(data))
    except FileError:
        return
    assert not len(program.correctable())


def test_the_other_file_of_a_pair_is_found_whatever_its_case(tmp_path: Path) -> None:
    (tmp_path / "Cell.SRC").write_text("DEF cell( )\n$TOOL=$NULLFRAME\n$BASE=$WORLD\nLIN P1\nEND\n")
    (tmp_path / "CELL.dat").write_text(f"DEFDAT CELL\nDECL POS P1={POSE}\nENDDAT\n")
    for name in ("Cell.SRC", "CELL.dat"):
        assert read_program(tmp_path / name).targets[0].verdict == "correct"


def test_a_statement_may_go_on_behind_a_backslash(pair: Any) -> None:
    motions = "LIN {X 1,\\\r\n Y 2,Z 3, \\ \n A 0,B 0,C 0} \\\n C_DIS\nLIN {X 1}\n"
    program = read_program(pair(f"DEF cell( )\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{motions}END\n"))
    assert [(t.line, t.verdict) for t in program.targets] == [(4, "correct"), (8, "skip")]
