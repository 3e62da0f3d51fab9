"""A program that names no tool: refused where its language could have named one, otherwise corrected and told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.programs.conftest import FakeMap

from truepose.errors import RefusedError
from truepose.programs import CorrectedProgram, FrameTable, ReadOptions, correct_program

TOOL = np.eye(4)
TOOL[:3, 3] = 10.0, -20.0, 150.0
MEASURED = np.eye(4)
MEASURED[:3, 3] = 0.0, 0.5, 237.25

KRL = "DEF a()\n$BASE=$NULLFRAME\nLIN {X 500,Y 0,Z 400,A 0,B 90,C 0}\nLIN {X 510,Y 0,Z 400,A 0,B 90,C 0}\nEND\n"
POSITION = (
    " GP1:\n UF : 0, UT : F, CONFIG : 'N U T, 0, 0, 0',\n X = 5{k}0.000 mm, Y = 0.000 mm, Z = 400.000 mm,\n"
    " W = 180.000 deg, P = 0.000 deg, R = 0.000 deg\n};\n"
)
TP = (
    "/PROG A\n/ATTR\n/APPL\n/MN\n   1:L P[1] 100mm/sec FINE ;\n   2:L P[2] 100mm/sec FINE ;\n/POS\n"
    + "".join(f"P[{k}]{{\n" + POSITION.replace("{k}", str(k)) for k in (1, 2))
    + "/END\n"
)
UR = "def a():\n  movel(p[0.5,0.1,0.4,0,3.14,0])\n  movel(p[0.51,0.1,0.4,0,3.14,0])\nend\n"
INFORM = (
    "/JOB\n//NAME A\n//POS\n///NPOS 2,0,0,0,0,0\n///POSTYPE BASE\n///RECTAN\n///RCONF 1,0,0,0,0,0,0,0\n"
    "C00000=500.000,0.000,400.000,180.0000,0.0000,0.0000\nC00001=510.000,0.000,400.000,180.0000,0.0000,0.0000\n"
    "//INST\n///DATE 2021/03/04 10:11\n///ATTR SC,RW\n///GROUP1 RB1\nNOP\n"
    "MOVL C00000 V=100.0\nMOVL C00001 V=100.0\nEND\n"
)
POINT = (
    '<Data name="p{k}" access="private" type="pointRx"><Value key="0" x="5{k}0" y="-.5" z="400" rx="0" ry="180" rz="0"'
    ' fatherId="world[0]" /></Data>'
)
VAL3 = "<Database><Datas>\n" + "\n".join(POINT.replace("{k}", k) for k in "12") + "\n</Datas></Database>\n"
RAPID = (
    "MODULE a\nPROC main()\n"
    + "".join(f"MoveL [[5{k}0,0,400],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine{{tool}};\n" for k in "12")
    + "ENDPROC\nENDMODULE\n"
)
CSV = "x_mm,y_mm,z_mm,a_deg,b_deg,c_deg{head}\n500,0,400,0,90,0{cell}\n510,0,400,0,90,0{cell}\n"

COLUMN = CSV.format(head=",tool", cell=",")
COULD = {"a.src": KRL, "a.ls": TP, "a.script": UR, "a.jbi": INFORM, "a.dtx": VAL3, "a.csv": COLUMN}
"""Programs of languages that can name a tool, without one."""
CANNOT = {
    "a.csv": CSV.format(head="", cell=""),
    "a.nc": "G21 G90\nG1 X500 Y0 Z400 A0 B90 C0\nG1 X510 Y0 Z400 A0 B90 C0\nM30\n",
    "a.apt": "UNITS/MM\nGOTO/500,0,400,0,0,1\nGOTO/510,0,400,0,0,1\nFINI\n",
}
"""Programs that cannot name one."""


class Map(FakeMap):
    """A map that knows the tool of its measurements."""

    tf_flange_tool = MEASURED


def corrected(folder: Path, name: str, text: str, **frames: Any) -> tuple[CorrectedProgram, Map]:
    """Return the corrected program, and the map that was asked."""
    (folder / name).write_text(text, newline="\r\n" if name == "a.jbi" else None)
    error_map = Map([0.1, 0.0, 0.0])
    table = FrameTable(tools={"grip": TOOL}, base=0, **frames)
    options = ReadOptions(angles="z" if name == "a.apt" else "kuka", whole_task=True)
    return correct_program(folder / name, error_map, frames=table, options=options), error_map


@pytest.mark.parametrize("name", COULD)
def test_where_the_language_could_name_a_tool_it_is_asked_for(tmp_path: Path, name: str) -> None:
    how = r"; (?:set it, or )?state the one in force \(--tool NAME, or --tool map for that of the map\)"
    with pytest.raises(RefusedError, match=how):
        corrected(tmp_path, name, COULD[name])


def test_a_motion_of_rapid_always_names_its_tool(tmp_path: Path) -> None:
    for tool in ("grip", "map", None):
        with pytest.raises(RefusedError):
            corrected(tmp_path, "a.mod", RAPID.format(tool=""), tool=tool)
    done, _ = corrected(tmp_path, "a.mod", RAPID.format(tool=",grip"))
    assert done.warnings == ()


@pytest.mark.parametrize("name", COULD)
def test_a_tool_that_the_user_states_is_used(tmp_path: Path, name: str) -> None:
    done, asked = corrected(tmp_path, name, COULD[name], tool="grip")
    assert done.coverage == (2, 2)
    np.testing.assert_allclose(asked.calls[0]["tf_flange_tool"], [TOOL, TOOL])
    assert done.warnings == ()


@pytest.mark.parametrize(
    ("name", "text", "stated"),
    [
        *((name, text, {"tool": "map"}) for name, text in COULD.items()),
        *((name, text, {}) for name, text in CANNOT.items()),
    ],
)
def test_the_tool_of_the_map_is_named_in_the_output_and_the_record(
    tmp_path: Path, name: str, text: str, stated: dict[str, str]
) -> None:
    done, asked = corrected(tmp_path, name, text, **stated)
    assert done.coverage == (2, 2)
    np.testing.assert_allclose(asked.calls[0]["tf_flange_tool"], [MEASURED, MEASURED])
    words = "2 targets name no tool: the tool that the map was measured with counts, at (0.000, 0.500, 237.250) mm"
    assert [text.partition(" from")[0] for text in done.warnings] == [words]
    done.write(tmp_path / "out")
    (record,) = (tmp_path / "out").glob("*.corrections.json")
    assert json.loads(record.read_text())["warnings"] == list(done.warnings)


def test_a_tool_of_the_cell_may_have_the_name_of_that_of_the_map(tmp_path: Path) -> None:
    (tmp_path / "a.script").write_text(UR)
    error_map = Map([0.1, 0.0, 0.0])
    done = correct_program(tmp_path / "a.script", error_map, frames=FrameTable(tools={"map": TOOL}, tool="map"))
    np.testing.assert_allclose(error_map.calls[0]["tf_flange_tool"], [TOOL, TOOL])
    assert done.warnings == ()


@pytest.mark.parametrize(("name", "more"), [("a.script", ("--tool", "map")), ("a.csv", ())])
def test_check_says_which_targets_name_no_tool(run: Any, tmp_path: Path, name: str, more: tuple[str, ...]) -> None:
    (tmp_path / name).write_text({**COULD, **CANNOT}[name])
    done = run("check", tmp_path / name, *more)
    assert "2 targets name no tool: the tool that the map was measured with counts;" in " ".join(done.out.split())
    (program,) = json.loads(run("check", tmp_path / name, *more, "--json").out)["programs"]
    assert program["without_tool"] == program["correct"] == 2
