"""Folders: a KRL project of several modules as one program, other languages file by file, bad members told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.errors import FileError, RefusedError
from truepose.programs import FrameTable, Target, correct_program, read_program, read_programs

POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 10.0,C -170.0}"
CONFIG = """DEFDAT $CONFIG PUBLIC
DECL FRAME TOOL_DATA[16]
DECL FRAME BASE_DATA[32]
TOOL_DATA[1]={X 1.0,Y 2.0,Z 150.0,A 0.0,B 0.0,C 0.0}
BASE_DATA[1]={X 900.0,Y 100.0,Z 40.0,A 0.0,B 0.0,C 0.0}
BASE_DATA[2]={X 0.0,Y 0.0,Z 40.0,A 90.0,B 0.0,C 0.0}
DECL E6AXIS XHOME={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 0.0,A6 0.0}
ENDDAT
"""
FILES = {
    "press/System/$config.dat": CONFIG,
    "press/Program/points.dat": f"DEFDAT POINTS PUBLIC\nDECL GLOBAL E6POS XG={POSE}\n"
    f"DECL GLOBAL FRAME GF={POSE}\nENDDAT\n",
    "press/Program/main.src": "DEF main()\nBAS(#TOOL,1)\nBAS(#BASE,1)\nPTP XHOME\nLIN XG\nsub()\nLIN XM\nhelp()\nEND\n"
    "DEF help()\nLIN XM\nEND\n",
    "press/Program/MAIN.DAT": f"DEFDAT MAIN\nDECL E6POS XM={POSE}\nENDDAT\n",
    "press/Program/deep/sub.src": f"DEF sub()\nLIN xg\nLIN {POSE}\nhelp()\nEND\nDEF help()\nEND\n",
    "press/readme.txt": "LIN {X 1",
    "press/curves.dat": "1 2 3\n",
}


def lay(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def named(folder: Path, name: str, **more: Any) -> Target:
    return next(t for t in read_program(folder, **more).targets if t.name == name)


def test_frames_points_and_calls_are_known_across_modules(tmp_path: Path) -> None:
    program = read_program(lay(tmp_path, FILES))
    assert {t.name: (t.verdict, t.reason) for t in program.targets if t.verdict != "correct"} == {
        "XHOME": ("skip", "joint target; allow joint_targets to correct it")
    }
    found = {t.name: (t.path.name, t.frame_number, t.uses) for t in program.targets if t.verdict == "correct"}
    assert found == {
        "XG": ("points.dat", 1, {"LIN": 2}),
        "XM": ("MAIN.DAT", 1, {"LIN": 2}),
        "LIN:3": ("sub.src", 1, {"LIN": 1}),
    }
    np.testing.assert_allclose(program.positions_base()[0], [900 + 812.5, 100 - 40.25, 40 + 1033.0])
    np.testing.assert_allclose(program.tools()[:, 2, 3], 150.0)


def test_a_global_point_alone_is_refused_as_before(tmp_path: Path) -> None:
    lay(tmp_path, {"a.src": "DEF a()\nLIN XG\nEND\n", "a.dat": f"DEFDAT A\nDECL GLOBAL E6POS XG={POSE}\nENDDAT\n"})
    assert "GLOBAL: other modules" in next(iter(read_program(tmp_path / "a.src").targets)).reason


def test_a_global_point_under_two_frames_is_refused_with_both_places(tmp_path: Path) -> None:
    sub = "DEF sub()\nBAS(#BASE,2)\nLIN xg\nEND\n"
    target = named(lay(tmp_path, {**FILES, "press/Program/deep/sub.src": sub}), "XG")
    assert (target.verdict, target.reason) == (
        "refuse",
        "moved to under BASE_DATA[1] (main.src, line 5) and BASE_DATA[2] (sub.src, line 3): teach two points",
    )


def test_a_base_changed_in_another_module_is_refused(tmp_path: Path) -> None:
    other = "DEF other()\nBASE_DATA[1].X=5\nEND\n"
    target = named(lay(tmp_path, {**FILES, "press/Program/other.src": other}), "XM")
    assert target.reason.startswith("BASE_DATA[1] is changed by the program (other.src, line 2); --frame-tolerance")


def test_an_imported_point_is_that_of_its_module(tmp_path: Path) -> None:
    files = {
        **FILES,
        "press/Program/im.src": "DEF im()\nBAS(#TOOL,1)\nBAS(#BASE,1)\nLIN P\nEND\n",
        "press/Program/im.dat": "DEFDAT IM\nIMPORT E6POS P IS /R1/MAIN..XM\nENDDAT\n",
    }
    assert named(lay(tmp_path, files), "XM").uses == {"LIN": 3}


def test_routines_of_one_name_in_two_modules_are_two(tmp_path: Path) -> None:
    files = {
        "a.src": f"DEF a()\nBAS(#TOOL,0)\nBAS(#BASE,0)\nhelp()\nLIN {POSE}\nEND\nDEF help()\nEND\n",
        "b.src": f"DEF b()\nhelp()\nLIN {POSE}\nEND\nDEF help()\nBAS(#TOOL,0)\nBAS(#BASE,0)\nEND\n",
    }
    program = read_program(lay(tmp_path, files))
    assert [(t.verdict, t.tool) for t in program.targets] == [("correct", "TOOL_DATA[0]")] * 2


def test_what_the_project_does_not_hold_is_not_known(tmp_path: Path) -> None:
    files = {"a.src": f"DEF a()\nBAS(#TOOL,0)\nBAS(#BASE,0)\nelsewhere()\nLIN {POSE}\nLIN XQ\nEND\n"}
    lay(tmp_path, files)
    assert "ELSEWHERE() was called, which is not in this project" in named(tmp_path, "LIN:5").reason
    assert named(tmp_path, "XQ").reason == "not defined in the files at hand"


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            {"press/Program/a/t.src": "DEF t()\nEND\n", "press/Program/b/t.src": "DEF t( )\nEND\n"},
            r"is another module of this name; keep the one that the controller loads",
        ),
        (
            {"press/p2.dat": f"DEFDAT P2\nDECL GLOBAL POS XG={POSE}\nENDDAT\n"},
            r"XG is GLOBAL here and in line 2 of",
        ),
        ({"press/t.src": "DEF main()\nEND\n"}, r"MAIN is defined twice"),
        ({"press/t.src": "DEF t()\nLIN {X 1.2.3}\nEND\n"}, r"t\.src:2: X .* is not a number"),
        ({"press/t.src": "DEF t()\n"}, r"t\.src:1: t has no END: the file is truncated"),
    ],
)
def test_broken_projects(tmp_path: Path, make_map: Any, more: dict[str, str], message: str) -> None:
    lay(tmp_path, {**FILES, **more})
    with pytest.raises(FileError, match=message):
        correct_program(tmp_path, make_map())
    assert len(read_programs([tmp_path]).unreadable) == 1


def test_the_output_mirrors_the_tree(tmp_path: Path, make_map: Any) -> None:
    folder = lay(tmp_path / "cell", FILES)
    corrected = correct_program(folder, make_map([0.5, 0, 0]))
    written = corrected.write(tmp_path / "out")
    out = {p.relative_to(tmp_path / "out").as_posix() for p in written}
    krl = {name for name in FILES if name.lower().endswith((".src", ".dat")) and "curves" not in name}
    assert out == krl | {"cell.corrections.json", "cell.corrections.csv"}
    assert {p for p in (tmp_path / "out").rglob("*") if p.is_file()} == set(written)
    assert (tmp_path / "out/press/Program/points.dat").read_text().count("{X 813.0,Y -40.25,Z") == 1
    assert (tmp_path / "out/press/System/$config.dat").read_text() == CONFIG
    with pytest.raises(RefusedError, match=r"was corrected already, see cell\.corrections\.json"):
        correct_program(tmp_path / "out", make_map())
    assert correct_program(folder, make_map()).files == {folder / name: (folder / name).read_bytes() for name in krl}
    corrected.write_in_place()
    assert (folder / "press/Program/MAIN.DAT.original").read_text() == FILES["press/Program/MAIN.DAT"]
    with pytest.raises(RefusedError, match="was corrected already"):
        correct_program(folder, make_map())


def test_links_are_not_followed(tmp_path: Path) -> None:
    folder, outside = lay(tmp_path / "cell", FILES), lay(tmp_path / "outside", {"x.src": "DEF x(\n"})
    (folder / "out").symlink_to(outside)
    (folder / "x.src").symlink_to(outside / "x.src")
    (folder / "loop").symlink_to(folder)
    (folder / "gone.src").symlink_to(folder / "nothing")
    assert {s.path.name for s in read_program(folder).sources}.isdisjoint({"x.src", "gone.src"})


def test_every_program_of_another_language_is_read_and_bad_ones_are_told(tmp_path: Path, make_map: Any) -> None:
    good = "def a():\n  movel(p[0.1,0.2,0.3,0,0,0])\nend\n"
    files = {"a.script": good, "line/b.script": good, "line/c.script": 'movel(p[0.1"', "d.ls": "\x00", "e.csv": "a,b\n"}
    found = read_programs([lay(tmp_path / "cell", files)], FrameTable(tool="map"))
    assert [p.path.name for p in found.programs] == ["a.script", "b.script"]
    assert sorted(error.path.name for error in found.unreadable) == ["c.script", "d.ls"]
    corrected = correct_program(found.programs[1], make_map([0, 0, 1]))
    written = corrected.write(tmp_path / "out")
    assert [p.relative_to(tmp_path / "out").as_posix() for p in written] == [
        "line/b.script", "line/b.corrections.json", "line/b.corrections.csv"
    ]  # fmt: skip
    (tmp_path / "cell" / "d.ls").unlink()
    (tmp_path / "cell" / "line" / "c.script").unlink()
    with pytest.raises(FileError, match="holds 2 programs; name one of them"):
        read_program(tmp_path / "cell")


def test_a_folder_of_tables_alone(tmp_path: Path) -> None:
    table = "name,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\np,1,2,3,0,0,0\n"
    lay(tmp_path, {"t.csv": table, "t.corrections.csv": "file,line\n"})
    assert read_program(tmp_path, FrameTable()).counts()["correct"] == 1


def test_a_circle_through_a_global_point_of_the_run_time_is_left(tmp_path: Path) -> None:
    files = {
        **FILES,
        "press/Program/points.dat": FILES["press/Program/points.dat"].replace(
            "ENDDAT", f"DECL GLOBAL E6POS XSEEN\nDECL GLOBAL E6POS XEND={POSE}\nENDDAT"
        ),
        "press/Program/arc.src": "DEF arc()\nBAS(#TOOL,1)\nBAS(#BASE,1)\nXSEEN=$POS_ACT\nCIRC XSEEN, XEND\nEND\n",
    }
    lay(tmp_path, files)
    assert named(tmp_path, "XSEEN").reason == "its value is known at run time only"
    assert named(tmp_path, "XEND").reason.startswith("its circle's other point XSEEN")


def test_a_circle_of_a_system_module_is_left(tmp_path: Path) -> None:
    circle = f"GLOBAL DEF sweep()\nBAS(#TOOL,1)\nBAS(#BASE,1)\nCIRC {POSE}, XG\nEND\n"
    files = {name.replace("press", "R1"): text for name, text in FILES.items()}
    files |= {"R1/System/tools.src": f"DEF tools()\nEND\n{circle}", "R1/Program/user.src": "DEF user()\nsweep()\nEND\n"}
    target = named(lay(tmp_path, files), "XG")
    assert (target.verdict, target.reason) == (
        "skip",
        "the other point of its circle has no numbers in the programs",
    )
