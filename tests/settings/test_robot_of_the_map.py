"""A map corrects programs of its own robot: the maker, the configuration words and the cell file must agree."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.errors import RefusedError
from truepose.programs import FrameTable

RAPID = """MODULE M
LOCAL CONST robtarget p:=[[{xyz}],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
PROC main()
MoveL p,v100,fine,tool0\\WObj:=wobj0;
ENDPROC
ENDMODULE
"""
FANUC = """/PROG A
/MN
   1:  UFRAME_NUM=0 ;
   2:  UTOOL_NUM=1 ;
   3:L P[1] 100mm/sec FINE    ;
/POS
P[1]{{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X = {x}  mm,	Y = {y}  mm,	Z = {z}  mm,
	W = 180.000 deg,	P = 0.000 deg,	R = 0.000 deg
}};
/END
"""
UR = "def a():\n  movel(p[{xyz_m},3.14159,0,0])\nend\n"
INFORM = """/JOB
//NAME A
//POS
///NPOS 1,0,0,0,0,0
///TOOL 1
///POSTYPE BASE
///RECTAN
///RCONF 0,0,0,0,0,0,0,0
C00000={x},{y},{z},180.0000,0.0000,0.0000
//INST
///DATE 2026/01/01 00:00
///ATTR SC,RW
///GROUP1 RB1
NOP
MOVL C00000 V=100.0
END
"""
VAL3 = """<?xml version="1.0" encoding="utf-8" ?>
<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns="http://www.staubli.com/robotics/VAL3/Data/2">
  <Datas>
    <Data name="p" access="private" xsi:type="array" type="pointRx" size="1">
      <Value key="0" x="{x}" y="{y}" z="{z}" rx="180.0" ry="0" rz="0" shoulder="lefty" elbow="epositive" wrist="wpositive" fatherId="world[0]" />
    </Data>
  </Datas>
</Database>
"""  # noqa: E501
OTHERS = {"a.mod": RAPID, "a.ls": FANUC, "a.script": UR, "a.jbi": INFORM, "a.dtx": VAL3}
NAMES = {"a.mod": "ABB", "a.ls": "FANUC", "a.script": "Universal Robots", "a.jbi": "Yaskawa", "a.dtx": "Stäubli"}


def write(folder: Path, name: str, virtual, samples) -> Path:
    """Write a program of a maker that moves to the place of a sample."""
    p = virtual.robot.forward(samples.q[:1], tool=virtual.tf_flange_tool)[0, :3, 3]
    x, y, z = (f"{value:.3f}" for value in p)
    text = OTHERS[name].format(x=x, y=y, z=z, xyz=f"{x},{y},{z}", xyz_m=",".join(f"{value / 1000:.6f}" for value in p))
    (folder / name).write_text(text, newline="\r\n" if name == "a.jbi" else None)
    return folder / name


@pytest.fixture
def frames(virtual) -> FrameTable:
    tool = virtual.tf_flange_tool
    return FrameTable(tools={1: tool, "tool0": tool}, bases={"wobj0": np.eye(4), "world": np.eye(4)}, tool="map")


@pytest.mark.promise("A map corrects no program of another maker unless the user allows it.")
@pytest.mark.parametrize("name", OTHERS)
def test_a_program_of_another_maker_is_refused(name, error_map, frames, virtual, samples, tmp_path):
    path = write(tmp_path, name, virtual, samples)
    with pytest.raises(RefusedError, match=f"a program for {NAMES[name]}, but the map is of kuka-.*--other-maker"):
        tp.correct_program(path, error_map, frames=frames, on_guard="skip")
    allowed = tp.correct_program(path, error_map, frames=frames, on_guard="skip", other_maker=True)
    assert f"a program for {NAMES[name]}, corrected with the map of a robot of KUKA" in allowed.warnings[0]


@pytest.mark.promise("The command refuses a program of another maker; --other-maker allows it.")
def test_the_command_asks_for_other_maker(run, map_path, virtual, samples, tmp_path):
    path = write(tmp_path, "a.script", virtual, samples)
    arguments = ("correct", map_path, path, "--out", tmp_path / "out", "--on-guard", "skip", "--tool", "map")
    assert "a program for Universal Robots, but the map is of kuka-" in run(*arguments).failed()
    done = run(*arguments, "--other-maker")
    assert done.code == 0, done.err
    assert "corrected with the map of a robot of KUKA" in done.out


@pytest.mark.promise("For a robot without a maker, a message says that the makers were not compared.")
def test_a_robot_without_a_maker_is_said(error_map, krl, virtual, samples, tmp_path):
    nameless = replace(error_map, robot=replace(error_map.robot, maker=""))
    corrected = tp.correct_program(krl(), nameless)
    assert "names no maker" in corrected.warnings[0]
    assert corrected.summary()["corrected"] == 2
    plain = replace(error_map, robot=replace(error_map.robot, maker="KUKA Roboter GmbH"))
    assert tp.correct_program(krl(), plain).warnings == ()


@pytest.mark.promise("Tables of targets, APT and G-code belong to no maker and need no permission.")
def test_tables_have_no_maker(error_map, samples, virtual, tmp_path):
    p = virtual.robot.forward(samples.q[:1], tool=virtual.tf_flange_tool)[0, :3, 3]
    path = tmp_path / "a.csv"
    path.write_text("x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n{:.3f},{:.3f},{:.3f},180,0,180\n".format(*p))
    warnings = tp.correct_program(path, error_map, on_guard="skip").warnings
    assert [text.partition(":")[0] for text in warnings] == ["1 target names no tool"]


@pytest.mark.promise("A cell file of another robot is refused, and tables of it that have no effect are named.")
def test_a_cell_file_of_another_robot_is_refused(error_map, krl, cell_text):
    other = tp.Cell.from_toml(cell_text.replace("kuka-kr210-r2700-extra", "kuka-kr150-2"))
    with pytest.raises(RefusedError, match="the cell file is of kuka-kr150-2, the map of kuka-kr210"):
        tp.correct_program(krl(), error_map, other)
    longer = tp.Cell.from_toml(cell_text.replace("z_mm = 360.0", "z_mm = 365.0", 1))
    warnings = tp.correct_program(krl(), error_map, longer).warnings
    assert warnings == (warnings[0],)
    assert warnings[0].startswith("[tool] of the cell file differ from what the map was fitted with")


@pytest.mark.promise("A correction with a map whose arm and tool were not checked says so.")
def test_an_unchecked_arm_is_said(krl, cell_text, samples):
    bare = replace(samples, p_cmd=None, rotation_cmd=None)
    error_map = tp.fit_cell(tp.Cell.from_toml(cell_text), bare, "ordinary-kriging")
    assert "were not checked" in tp.correct_program(krl(), error_map).to_dict()["warnings"][-1]
