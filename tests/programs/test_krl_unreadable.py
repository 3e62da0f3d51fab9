"""A KRL module that cannot be read: the others are read, and what they share with it is refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.errors import FileError
from truepose.programs import FrameTable, ReadOptions, read_programs

POSE = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
SET = "BAS(#TOOL,1)\nBAS(#BASE,1)\n"
FILES = {
    "own.src": f"DEF own()\n{SET}LIN {POSE}\nEND\n",
    "point.src": f"DEF point()\n{SET}LIN XG\nEND\n",
    "points.dat": f"DEFDAT POINTS PUBLIC\nDECL GLOBAL E6POS XG={POSE}\nDECL E6POS XI={POSE}\n"
    "DECL GLOBAL FDAT FG={TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE}\nENDDAT\n",
    "imports.src": f"DEF imports()\n{SET}LIN XP\nEND\n",
    "imports.dat": "DEFDAT IMPORTS\nIMPORT E6POS XP IS /R1/POINTS..XI\nENDDAT\n",
    "called.src": f"DEF called()\nLIN {POSE}\nEND\nGLOBAL DEF helper()\nEND\n",
    "starts.src": f"DEF starts()\n{SET}called()\nEND\n",
    "caller.src": f"DEF caller()\n{SET}broken()\nLIN {POSE}\nEND\n",
}
ALWAYS = {"caller": "BROKEN() was called, which cannot be read"}
"""Behind a call of the broken module tool and base are not known, whatever it says."""


def refused(folder: Path, statements: str, **more: Any) -> dict[str, str]:
    """Return the modules whose target is not corrected, each with the reason; another module is broken."""
    folder.mkdir(exist_ok=True)
    broken = f"DEF broken()\n{statements}\nLIN {{X 1.2.3}}\nEND\n"
    for name, text in {**FILES, "broken.src": broken, **more}.items():
        (folder / name).write_text(text)
    frames = FrameTable(tools={1: np.eye(4)}, bases={1: np.eye(4)})
    found = read_programs([folder], frames, ReadOptions())
    assert [Path(error.path).name for error in found.unreadable] == ["broken.src"]
    assert "1.2.3 is not a number" in str(found.unreadable[0])
    (program,) = found.programs
    return {target.path.stem: target.reason for target in program.targets if target.verdict != "correct"}


HARMLESS = [
    "",
    "GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )\nINTERRUPT ON 3",
    "BAS(#TOOL,2)\n$BASE=BASE_DATA[3]\n$TOOL = TOOL_DATA[2]\n$BASE=$WORLD",
    "INTERRUPT DECL 4 WHEN $IN[1] DO stop( )",
    "PTP XHOME\n$OUT[1]=TRUE",
]


@pytest.mark.parametrize("statements", HARMLESS)
def test_what_shares_nothing_with_it_is_corrected(tmp_path: Path, statements: str) -> None:
    found = refused(tmp_path, statements)
    assert found.keys() == ALWAYS.keys()
    assert ALWAYS["caller"] in found["caller"]


@pytest.mark.parametrize(
    ("statements", "module", "reason"),
    [
        ("LIN XG", "points", "named by BROKEN, which cannot be read (broken.src, line 1)"),
        ("fg.tool_no=2", "points", "named by BROKEN, which cannot be read"),
        ("BASE_DATA[1]={X 5}", "own", "BASE_DATA[1] is changed by the program (broken.src, line 1)"),
        ("measure(TOOL_DATA[1])", "own", "TOOL_DATA[1] is changed by the program (broken.src, line 1)"),
        ("$ROBROOT.X=5", "own", "the program moves the robot in its world ($ROBROOT.X= of BROKEN"),
        ("called( )", "called", "BROKEN() was called, which cannot be read"),
        ("GLOBAL INTERRUPT DECL 4 WHEN $IN[1] DO stop( )", "own", "the interrupt program STOP() is not in this file"),
        ("RET=RSI_ON(#RELATIVE)", "caller", "RSI_ON"),
        ("$IPO_MODE=#TCP", "caller", "whether the TCP is external (IPO_FRAME #TCP) depends on the run time"),
    ],
)
def test_what_it_names_is_refused(tmp_path: Path, statements: str, module: str, reason: str) -> None:
    assert reason in refused(tmp_path, statements)[module]


def test_its_imports_are_refused(tmp_path: Path) -> None:
    dat = "DEFDAT BROKEN\nIMPORT E6POS XQ IS /R1/POINTS..XI\nENDDAT\n"
    found = refused(tmp_path, "LIN XQ", **{"broken.dat": dat})
    assert "perhaps imported by BROKEN, which cannot be read" in found["points"]


def test_a_shift_that_it_may_begin_holds_behind_its_call(tmp_path: Path) -> None:
    point = f"DECL E6POS XT={POSE}\nDECL FDAT FT={{TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE}}"
    more = {"taught.src": "DEF taught()\nbroken()\nLIN XT\nEND\n", "taught.dat": f"DEFDAT TAUGHT\n{point}\nENDDAT\n"}
    assert "taught" not in refused(tmp_path / "a", "$OUT[1]=TRUE", **more)
    assert "RSI_ON" in refused(tmp_path / "b", "RET=RSI_ON(#RELATIVE)", **more)["taught"]


def test_an_encoded_module_may_use_every_global_point_and_nothing_else(tmp_path: Path) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "secret.src").write_bytes(b"\0\1\2" * 50)
    frames = FrameTable(tools={1: np.eye(4)}, bases={1: np.eye(4)})
    found = read_programs([tmp_path], frames)
    assert "secret.src:1: is encoded and cannot be read" in str(found.unreadable[0])
    reasons = {t.path.stem: t.reason for t in found.programs[0].targets if t.verdict != "correct"}
    assert "named by SECRET, which cannot be read" in reasons["points"]
    assert "own" not in reasons


def test_a_project_without_a_module_that_can_be_read_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "broken.src").write_text("DEF broken()\nLIN {X 1.2.3}\nEND\n")
    (error,) = read_programs([tmp_path]).unreadable
    assert isinstance(error, FileError)
    assert "1.2.3 is not a number" in str(error)


COPIED = {
    "Program/s.src": f"DEF s()\n{SET}LIN XP1\nEND\n",
    "Program/s.dat": f"DEFDAT s\nDECL E6POS XP1={POSE}\nENDDAT\n",
    "Program/points.dat": f"DEFDAT POINTS PUBLIC\nDECL GLOBAL E6POS XG={POSE}\nENDDAT\n",
    "Program/own.src": f"DEF own()\n{SET}LIN XG\nEND\n",
}


def read_copied(folder: Path, **more: str | bytes) -> tuple[Any, dict[str, str]]:
    for name, text in {**COPIED, **more}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    found = read_programs([folder], FrameTable(tools={1: np.eye(4)}, bases={1: np.eye(4)}), ReadOptions())
    return found, {t.name: t.reason for one in found.programs for t in one.targets if t.verdict != "correct"}


@pytest.mark.promise("Of several KRL modules of one name, the one of the program folder or the outer one is read.")
@pytest.mark.parametrize("folder", ["Extras/Bkp", "Program/Old/2019", "Spare"])
def test_copies_are_named_and_left(tmp_path: Path, folder: str) -> None:
    """What a copy names and does not declare itself is not trusted, unless it states the same as the module."""
    copies = {f"{folder}/{name}": COPIED[f"Program/{name}"] for name in ("s.src", "s.dat")}
    found, left = read_copied(tmp_path, **copies)
    assert (found.unreadable, left) == ([], {})
    assert sorted("is a copy of module S" in text for text in found.left_out) == [True, True]
    copies[f"{folder}/s.dat"] = copies[f"{folder}/s.dat"].replace("X 1", "X 2")
    copies[f"{folder}/s.src"] = f"DEF s()\n{SET}LIN XP1\nLIN XG\nEND\n"
    found, left = read_copied(tmp_path, **copies)
    assert found.unreadable == []
    assert left.keys() == {"XG"}
    assert "named by S, which cannot be read" in left["XG"]


def test_of_two_that_differ_none_is_read(tmp_path: Path) -> None:
    found, left = read_copied(
        tmp_path, **{"Program/A/t.src": f"DEF t()\n{SET}LIN XG\nEND\n", "Program/B/T.src": "DEF t()\nEND\n"}
    )
    assert "is another module of this name; keep the one that the controller loads" in str(found.unreadable[0])
    assert left.keys() == {"XG"}


@pytest.mark.parametrize(
    ("text", "refused"),
    [
        ("DEF t()\nEND\nGLOBAL DEF s()\nEND\n", {"XP1"}),
        ("GLOBAL DEF t()\nEND\nGLOBAL DEFFCT INT own(x:IN)\nINT x\nRETURN x\nENDFCT\n", {"XG"}),
    ],
)
def test_modules_that_define_one_routine_do_not_stop_the_others(tmp_path: Path, text: str, refused: set[str]) -> None:
    found, left = read_copied(tmp_path, **{"Program/t.src": text})
    assert len(found.unreadable) == 1
    assert "is defined twice" in str(found.unreadable[0])
    read = {t.name for one in found.programs for t in one.targets if t.verdict == "correct"}
    assert read == {"XP1", "XG"} - refused
    assert left.keys() <= refused


@pytest.mark.parametrize("blank", ["\u00a0".encode(), "\u3000".encode(), b"\xa0", b"\xef\xbb\xbf"])
def test_a_blank_of_unicode_swallows_nothing(tmp_path: Path, blank: bytes) -> None:
    dat = b"DEFDAT s\r\n" + blank + f"DECL E6POS XP1={POSE}\r\n".encode() + b" " + blank
    dat += f" DECL E6POS XP2={POSE}\r\nENDDAT\r\n".encode()
    src = f"DEF s()\r\n{SET}".encode() + blank + b"\r\n" + blank + b"LIN XP1\r\nLIN XP2\r\nEND\r\n"
    found, left = read_copied(tmp_path, **{"Program/s.dat": dat, "Program/s.src": src})
    assert (found.unreadable, left) == ([], {})
    assert len(found.programs[0].targets) == 3


def test_a_function_whose_end_is_commented_out_is_named(tmp_path: Path) -> None:
    text = f"DEF Station1()\n{SET}LIN {POSE}\nEND\nGLOBAL DEFFCT INT f(x:IN)\nINT x\nRETURN x\n;ENDFCT\n"
    found, left = read_copied(tmp_path, **{"Program/Station1.src": text})
    assert [Path(error.path).name for error in found.unreadable] == ["Station1.src"]
    assert left == {}
