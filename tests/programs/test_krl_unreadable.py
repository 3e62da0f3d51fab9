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
        ("$IPO_MODE=#TCP", "caller", "whether the TCP is external depends on the run time"),
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
