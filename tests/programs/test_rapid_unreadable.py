"""RAPID modules that cannot be read, and copies of modules: the others are read, and what they share is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.programs import FrameTable, ReadOptions, correct_program, read_programs
from truepose.programs.reading import Reading

RT = "[[600,0,800],[0,0,-1,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"
MOVE = f"MoveL {RT},v1,z1,tool0;"
ENDS = "MoveL ];"


def module(name: str, data: str = "", code: str = "", routine: str = "", more: str = "") -> str:
    return f"MODULE {name}\n{data}\nPROC {routine or f'r{name}'}()\n{code}\nENDPROC\n{more}\nENDMODULE\n"


DATA = (
    f"CONST robtarget p1:={RT};\nCONST robtarget p2:={RT};\nVAR num n1:=5;\n"
    "PERS tooldata t1:=[TRUE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"
)
MOVES = "MoveL p1,v1,z1,t1;\nMoveL p2,v1,z1,tool0;\nrX;\nMoveL p3,v1,z1,tool0;"
FILES: dict[str, str | bytes] = {
    "a.mod": module("A", DATA, MOVES, "main"),
    "b.mod": module("B", f"CONST robtarget p3:={RT};\nLOCAL CONST robtarget q:={RT};", "MoveL q,v1,z1,tool0;"),
}


def read(folder: Path, **more: str | bytes) -> Reading:
    for name, text in {**FILES, **more}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_programs([folder], FrameTable(tools={"tool0": np.eye(4)}), ReadOptions())


def left(found: Reading) -> dict[str, str]:
    """Return the targets that are not corrected, each with the reason."""
    return {t.name: t.reason for one in found.programs for t in one.targets if t.verdict != "correct"}


@pytest.mark.promise("A RAPID module that cannot be read is named; of the others, only what it names is refused.")
@pytest.mark.parametrize(
    ("code", "refused"),
    [
        ('TPWrite "p1"; ! p1 := p2', {"p1"}),
        ("! p1 := p2", set()),
        ("x:=1;", set()),
        ("MoveL p1,v1,z1,tool0\\WObj:=wobj0;", {"p1"}),
        (f"MoveL {RT},v1,z1,t1\\WObj:=wobj0;", set()),
        ("t1.tframe.trans.z:=4;", {"p1"}),
        ("PDispSet d;", {"p1", "p2", "p3"}),
        ("%s%;", {"p1", "p2", "p3", "q"}),
        ("WaitWObj w;", {"p1", "p2", "p3"}),
        ("SetDataVal s,p2;", {"p1", "p2"}),
    ],
)
def test_what_a_broken_module_names_is_not_trusted(tmp_path: Path, code: str, refused: set[str]) -> None:
    found = read(tmp_path, **{"x.mod": module("X", "", f"{code}\n{ENDS}")})
    assert ["x.mod" in str(error) and "closes nothing" in str(error) for error in found.unreadable] == [True]
    assert left(found).keys() - {"MoveL:8"} == refused


def test_what_a_broken_routine_calls_is_reached_with_its_displacement(tmp_path: Path) -> None:
    found = read(tmp_path, **{"x.mod": module("X", "", f"PDispSet d;\nrB;\n{ENDS}")})
    assert "x.mod cannot be read and may displace" in left(found)["q"]
    beside = module("X", "", "", more=f"LOCAL TRAP t\nPDispSet d;\n{ENDS}\nENDTRAP")
    assert left(read(tmp_path, **{"x.mod": beside})).keys() >= {"p1", "p2", "p3", "q"}


@pytest.mark.parametrize(
    "text", [b"\xfc\x01\x02", b"MODULE X\0\1\2\3\0ENDMODULE", module("X", "", MOVE)[:-25].encode()]
)
def test_a_module_that_does_not_show_what_it_names_refuses_all_data_of_the_task(tmp_path: Path, text: bytes) -> None:
    found = read(tmp_path, **{"x.sys": text})
    assert len(found.unreadable) == 1
    assert left(found).keys() == {"p1", "p2", "p3"}  # q is LOCAL


def test_an_encoded_file_on_the_disk_that_nothing_loads_leaves_data_that_it_may_write(tmp_path: Path) -> None:
    found = read(tmp_path, **{"HOME/TEMP/tune.sys": b"\xfc\x01\x02"})
    assert not left(found)
    assert "tune.sys: is encoded or no text" in str(found.unreadable[0])
    loads = module("C", "", 'Load "HOME:/TEMP/tune.sys";')
    assert left(read(tmp_path, **{"c.mod": loads})).keys() == {"p1", "p2", "p3"}


@pytest.mark.promise("Of several RAPID modules of one name, copies are named and left; without a choice, both are.")
@pytest.mark.parametrize("name", ["HOME/a.mod", "sample/old/A.mod", "a.prg", "z.mod"])
def test_a_copy_is_no_module(tmp_path: Path, name: str, make_map: Any) -> None:
    text = "%%%\n  VERSION:1\n%%%\n" + str(FILES["a.mod"]).replace("\n", "\r\n")
    found = read(tmp_path, **{name: text})
    assert not found.unreadable
    assert ["is a copy of module A" in text for text in found.left_out] == [True]
    assert not left(found)
    (program,) = found.programs
    corrected = correct_program(program, make_map([0.5, 0.0, 0.0]))
    assert set(corrected.files) == {tmp_path / "a.mod", tmp_path / "b.mod"}


def test_a_copy_that_differs_is_not_trusted_in_what_others_declare(tmp_path: Path) -> None:
    other = str(FILES["a.mod"]).replace("600", "601").replace("MoveL p3,v1,z1,tool0", "MoveL p3,v1,z1,t1")
    assert left(read(tmp_path, **{"sample/a.mod": other})).keys() == {"p3"}


def test_of_two_that_differ_none_is_corrected(tmp_path: Path) -> None:
    found = read(tmp_path, **{"a.prg": str(FILES["a.mod"]).replace("600", "601")})
    assert sorted(Path(error.path).name for error in found.unreadable) == ["a.mod", "a.prg"]
    assert "keep the one that the controller loads" in str(found.unreadable[0])
    assert [t.name for one in found.programs for t in one.targets] == ["p3", "q"]
    assert left(found).keys() == {"p3"}
    found = read(
        tmp_path / "folders", **{"PROGMOD/c.mod": module("C", "", MOVE), "HOME/C.mod": module("C", "", "x:=1;")}
    )
    assert not found.unreadable
    assert "HOME/C.mod: is a copy of module C" in found.left_out[0]


def test_modules_that_declare_the_same_do_not_stop_the_others(tmp_path: Path) -> None:
    found = read(tmp_path, **{"c.mod": module("C", f"CONST robtarget p3:={RT};")})
    assert "P3 is declared in" in str(found.unreadable[0])
    assert left(found) == {"p3": "declared in another module"}


def test_pers_that_a_module_left_out_of_another_task_names(tmp_path: Path) -> None:
    first = module(
        "A", f"PERS robtarget p:={RT};\nPERS robtarget r:={RT};", "MoveL p,v1,z1,tool0;\nMoveL r,v1,z1,tool0;"
    )
    for name, text in {
        "RAPID/TASK1/PROGMOD/a.mod": first,
        "RAPID/TASK2/PROGMOD/a.mod": module("A", "", "x:=1;"),
        "RAPID/TASK2/PROGMOD/b.mod": module("B", "PERS robtarget p;", f"p:=CRobT();\n{ENDS}"),
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    found = read_programs([tmp_path], FrameTable(tools={"tool0": np.eye(4)}), ReadOptions())
    assert len(found.unreadable) == 1
    assert left(found).keys() == {"p"}
