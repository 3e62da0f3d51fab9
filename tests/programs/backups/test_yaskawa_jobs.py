"""What the jobs of a Yaskawa controller do to each other: tools, user frames and shifts that another job changes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.programs.backups import yaskawa as corpus

from truepose.programs import FrameTable, ReadOptions, read_programs
from truepose.programs.core.target import Target

FRAMES = FrameTable(tools={1: np.eye(4)}, bases={1: np.eye(4)})
DATA = {name: data for name, data in corpus.backup().items() if not name.endswith(".JBI")}
TAUGHT = "///TOOL 1\n///POSTYPE USER\n///USER 1\n///RECTAN\n"
POSITIONS = "".join(f"C0000{k}={100 + 10 * k}.000,50.000,20.000,180.0000,0.0000,0.0000\n" for k in range(3))
MOVE = "MOVL C00000 V=100.0"
SHIFTED = f"SFTON P010 UF#(1)\n{MOVE}\nSFTOF"


def job(name: str, code: str) -> bytes:
    head = f"/JOB\n//NAME {name}\n//POS\n///NPOS 3,0,0,0,0,0\n{TAUGHT}{POSITIONS}//INST\n///GROUP1 RB1\nNOP\n"
    return f"{head}{code}\nEND\n".replace("\n", "\r\n").encode("latin-1")


def target(folder: Path, code: str, other: str | bytes = "") -> Target:
    """Return C00000 of job A in the backup of a controller with another job."""
    files = {**DATA, "A.JBI": job("A", code), "B.JBI": other if isinstance(other, bytes) else job("B", other)}
    for name, data in files.items():
        (folder / name).write_bytes(data)
    programs = read_programs([folder], None, ReadOptions(derived=True)).programs
    program = next(program for program in programs if program.path.stem == "A")
    return next(target for target in program.targets if target.name == "C00000")


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("MFRAME UF#(1) C00000 C00001 C00002", "USER 1"),
        ("MFRAME UF#( 1 ) PX001 PX002 PX003", "USER 1"),
        ("SETUFRM UF#(1) P001", "USER 1"),
        ("MFRAME UF#(B000) PX001 PX002 PX003", "USER 1"),
        ("SETTOOL TL#(1) P001", "TOOL 1"),
        ("SETTOOL TL#(B000) P001", "TOOL 1"),
    ],
)
@pytest.mark.parametrize("broken", [False, True])
def test_a_frame_that_another_job_changes_is_not_the_stored_one(
    tmp_path: Path, change: str, what: str, broken: bool
) -> None:
    other = job("B", change)
    found = target(tmp_path, MOVE, other.replace(b"\r\nEND\r\n", b"\r\n") if broken else other)
    assert found.verdict == "refuse"
    assert f"{what} is changed by the program (B.JBI, line " in found.reason


@pytest.mark.parametrize(
    "code",
    [
        "MFRAME UF#(2) C00000 C00001 C00002",
        "SETTOOL TL#(2) P001",
        "GETTOOL PX001 TL#(1)",
        "CNVRT PX001 PX002 UF#(1)",
        "MSHIFT PX001 UF#(1) PX002 PX003",
    ],
)
def test_other_frames_and_instructions_that_read_them_are_no_hindrance(tmp_path: Path, code: str) -> None:
    assert target(tmp_path, MOVE, code).verdict == "correct"


@pytest.mark.parametrize(
    "code",
    [
        "SET P[I000] P005",
        "SETE P[B000] (3) 5000",
        "GETPOS PX[B000] STEP#(1)",
        "ADD P[B000] P011",
        "CLEAR P000 ALL",
        "CLEAR P005 10",
    ],
)
def test_a_variable_whose_number_the_run_time_knows_may_be_that_of_a_shift(tmp_path: Path, code: str) -> None:
    assert target(tmp_path, SHIFTED).derived[0].shifts == ((0.0, 0.0, 80.0),)
    for own, other in ((f"{code}\n{SHIFTED}", ""), (SHIFTED, code)):
        found = target(tmp_path, own, other)
        assert found.verdict == "skip"
        assert "shifts it at run time" in found.reason


def test_a_frame_that_gives_a_shift_its_direction_may_change(tmp_path: Path) -> None:
    code = SHIFTED.replace("UF#(1)", "UF#(2)")
    assert target(tmp_path, code).verdict == "correct"
    assert "along axes that are not known" in target(tmp_path, code, "MFRAME UF#(2) C00000 C00001 C00002").reason


@pytest.mark.parametrize("code", ["MOVL P[I000] V=10.0", "SET P[B000] P001"])
def test_a_copy_of_a_variable_that_any_number_may_mean_is_left(tmp_path: Path, code: str) -> None:
    copy = f"{TAUGHT}P00050=100.000,50.000,20.000,180.0000,0.0000,0.0000\n//INST"
    for more, verdict in (("NOP", "correct"), (code, "refuse")):
        path = tmp_path / "A.JBI"
        path.write_bytes(job("A", f"MOVL P00050 V=10.0\n{more}").replace(b"//INST", copy.encode()))
        (program,) = read_programs([path], FRAMES, ReadOptions(whole_task=True)).programs
        assert {t.name: t.verdict for t in program.targets}["P00050"] == verdict


@pytest.mark.parametrize("tail", [" TL#(2)", " UF#(2)", " UF#(B000) PL=0"])
def test_a_motion_with_a_tool_or_frame_of_its_own_is_left(tmp_path: Path, tail: str) -> None:
    found = target(tmp_path, MOVE + tail)
    assert (found.verdict, "not with the tool and frame it was taught with" in found.reason) == ("skip", True)
