"""The load that a program states against the payload that the correction is for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.errors import RefusedError
from truepose.programs import read_program
from truepose.programs.frame_table import FrameTable
from truepose.programs.load_data import check_loads, stated_loads

KRL = """DEF a()
;LOAD_DATA[3]={{M 9.0,CM {{X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}},J {{X 0.0,Y 0.0,Z 0.0}}}}
LOAD_DATA[1]={{M {kg},CM {{X 10.0,Y 0.0,Z 200.0,A 0.0,B 0.0,C 0.0}},J {{X 0.0,Y 0.0,Z 0.0}}}}
LOAD_DATA[2]={{M 400.0,CM {{X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}},J {{X 0.0,Y 0.0,Z 0.0}}}}
$TOOL=TOOL_DATA[1]
$BASE=$NULLFRAME
PTP {{X 1700,Y 0,Z 900,A 180,B 20,C 180}}
END
"""
RAPID = """MODULE A
  PERS tooldata tGun:=[TRUE,[[110,0,360],[1,0,0,0]],[{kg},[0,0,50],[1,0,0,0],0,0,0]];
  ! PERS tooldata tOld:=[TRUE,[[110,0,360],[1,0,0,0]],[9,[0,0,50],[1,0,0,0],0,0,0]];
  PERS tooldata tRest:=[TRUE,[[110,0,360],[1,0,0,0]],[400,[0,0,50],[1,0,0,0],0,0,0]];
  LOCAL CONST robtarget p1:=[[1700,0,900],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveL p1,v100,fine,tGun\\WObj:=wobj0;
  ENDPROC
ENDMODULE
"""
URSCRIPT = """def a():
  set_payload({kg}, [0.0, 0.0, 0.1])
  # set_payload(9.0)
  set_tcp(p[0.11, 0.0, 0.36, 0.0, 0.0, 0.0])
  movel(p[0.8, 0.1, 0.4, 0.0, 3.14, 0.0], a=1.2, v=0.25)
end
a()
"""
FORMS = {"a.src": (KRL, 1), "A.mod": (RAPID, "tgun"), "a.script": (URSCRIPT, None)}


def program(folder: Path, name: str, kg: float):
    (folder / name).write_text(FORMS[name][0].format(kg=kg))
    return read_program(folder / name, FrameTable(tools={1: np.eye(4)}))


def cell(**conditions):
    return tp.Cell.model_validate({"robot": {"model": "kuka-kr210-r2700-extra"}, "conditions": conditions})


@pytest.mark.parametrize("name", FORMS)
def test_a_load_that_differs_from_the_payload_of_the_correction_is_refused(tmp_path: Path, name: str) -> None:
    tool, plain = FORMS[name][1], cell()
    known = program(tmp_path, name, 30.0)
    assert {(load.tool, load.mass_kg) for load in stated_loads(known)} >= {(tool, 30.0)}
    assert 9.0 not in {load.mass_kg for load in stated_loads(known)}
    for payload in ((120.0, 120.0), (0.0, 20.0), (34.0, 120.0)):
        with pytest.raises(RefusedError, match=rf"{name}, line \d: states a load of 30 kg.*correction is for .* kg"):
            check_loads(known, plain, payload)
    for payload in ((30.0, 30.0), (32.9, 32.9), (20.0, 120.0), None):
        assert check_loads(known, plain, payload) == []
    assert check_loads(program(tmp_path, name, 0.001), plain, (120.0, 120.0)) == []


@pytest.mark.parametrize("name", ["a.src", "A.mod"])
def test_a_payload_that_the_cell_states_with_a_tool_counts(tmp_path: Path, name: str) -> None:
    known, tool = program(tmp_path, name, 30.0), FORMS[name][1]
    assert check_loads(known, cell(payloads={tool: {"mass_kg": 30.0}}), (120.0, 120.0)) == []
    (told,) = check_loads(known, cell(payloads={tool: {"mass_kg": 90.0}}), (120.0, 120.0))
    assert told.endswith(
        f"states a load of 30 kg with tool {tool}, the correction is for 90 kg, as [conditions.payloads] states"
    )


def test_a_program_with_another_load_than_measured_is_not_corrected(tmp_path: Path) -> None:
    """Of a map that was measured with one payload: 120 kg on the flange."""
    virtual = tp.VirtualCell("hard", seed=0)
    error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(30)), "registration")
    tool = {key: value for key, value in virtual.cell.tool.model_dump(exclude_unset=True).items() if key != "fit"}
    config = (
        "DEFDAT $CONFIG\nTOOL_DATA[1]={{X 110.0,Y 0.0,Z 360.0,A 0.0,B 0.0,C 0.0}}\n"
        "LOAD_DATA[1]={{M {kg},CM {{X 0.0}}}}\nENDDAT\n"
    )
    rows = virtual.cell.model_dump(exclude_unset=True)
    path = tmp_path / "b.src"
    path.write_text("DEF b()\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\nPTP {X 1700,Y 0,Z 900,A 180,B 20,C 180}\nEND\n")
    for kg, fails in ((30.0, True), (118.0, False), (-1.0, False)):
        (tmp_path / "$config.dat").write_text(config.format(kg=kg))
        frames = {"config_dat": str(tmp_path / "$config.dat"), "tools": {"1": tool}}
        own = tp.Cell.model_validate({**rows, "frames": frames})
        if fails:
            with pytest.raises(RefusedError, match=r"config.dat, line 3: states a load of 30 kg with tool 1, the corr"):
                tp.correct_program(path, error_map, own, on_guard="skip", accept_weak_map=True)
        else:
            assert tp.correct_program(path, error_map, own, on_guard="skip", accept_weak_map=True).targets is not None


def test_another_payload_of_the_cell_file_is_that_at_work(tmp_path: Path) -> None:
    """Before, it had no effect, and a map of one payload was as certain as with its own."""
    virtual = tp.VirtualCell("hard", seed=0)
    error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(40), seed=1), "kinematic-kriging")
    q = virtual.design(10, seed=4)
    light = virtual.cell.model_copy(update={"payload": virtual.cell.payload.model_copy(update={"mass_kg": 30.0})})
    assert error_map.at_work(virtual.cell) is error_map
    other = error_map.at_work(light)
    assert (error_map.predict(q).std < 0.1).all()
    assert (np.linalg.norm(other.predict(q).std, axis=1) > 0.5).all()
    assert [fact.size for fact in other.facts if fact.code == "work-not-measured"] == [90.0]


def test_a_piece_that_is_gripped_adds_to_the_load_of_the_tool(tmp_path: Path) -> None:
    form = "  PERS loaddata {}:=[{},[0,0,50],[1,0,0,0],0,0,0];\n"
    pieces = form.format("one", 25) + form.format("two", 70)
    text = RAPID.format(kg=30.0).replace("  PROC main()\n", pieces + "  PROC main()\n    GripLoad one;\n")
    (tmp_path / "A.mod").write_text(text.replace("    MoveL", "    GripLoad load0;\n    ! GripLoad two;\n    MoveL"))
    known = read_program(tmp_path / "A.mod")
    masses = [load.mass_kg for load in stated_loads(known) if load.tool == "tgun"]
    assert masses == [30.0, 55.0]
    with pytest.raises(RefusedError, match=r"A\.mod, line 9: states a load of 55 kg with tool tgun"):
        check_loads(known, cell(), (30.0, 30.0))
    assert not check_loads(known, cell(), (30.0, 55.0))


@pytest.mark.parametrize(("numbers", "said"), [((1, 1), False), ((1, 2), True)])
def test_a_fanuc_program_that_changes_its_payload_is_warned_of(tmp_path: Path, numbers, said) -> None:
    point = (
        "P[1]{\n   GP1:\n  UF : 0, UT : 1, CONFIG : 'N U T, 0, 0, 0',\n"
        "  X = 1700.000 mm, Y = 0.000 mm, Z = 900.000 mm,\n"
        "  W = 180.000 deg, P = 0.000 deg, R = 0.000 deg\n};\n"
    )
    first, last = numbers
    lines = f"1:  PAYLOAD[{first}] ;\n2:L P[1] 100mm/sec FINE ;\n3:  PAYLOAD[GP1:{last}] ;\n"
    (tmp_path / "a.ls").write_text(f"/PROG A\n/MN\n{lines}/POS\n{point}/END\n")
    warned = check_loads(read_program(tmp_path / "a.ls", FrameTable(tools={1: np.eye(4)})), cell(), (30.0, 30.0))
    assert [one.partition("selects ")[2][:22] for one in warned] == ["PAYLOAD[1], PAYLOAD[2]"] * said
