"""Where a robot stands in its controller's world is used, or the program is refused; never ignored."""

from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.errors import DataError, FileError
from truepose.geometry import invert_transform, make_transform
from truepose.programs import FrameTable, read_program, read_programs

ROOT = "{X 100.0,Y -50.0,Z 500.0,A 30.0,B 0.0,C 0.0}"
TF_ROOT = make_transform(tp.euler("kuka", [30.0, 0.0, 0.0]), [100.0, -50.0, 500.0])
NULL = "{X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}"
BASE = "{X 900,Y 10,Z 20,A 0,B 0,C 0}"
TF_BASE = make_transform(translation=[900.0, 10.0, 20.0])
POSE = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
P = np.array([1.0, 2.0, 3.0, 1.0])


def machine(root: str) -> str:
    return f"&ACCESS RV\nDEFDAT $MACHINE PUBLIC\nINT $EX_AX_NUM=0\nFRAME $ROBROOT={root}\nENDDAT\n"


def backup(folder: Path, root: str, base: str = "BASE_DATA[1]") -> Path:
    """Write a KUKA backup with a program; return its folder."""
    files = {
        "Mada/$machine.dat": machine(root),
        "System/$config.dat": f"DEFDAT $CONFIG PUBLIC\nBASE_DATA[1]={BASE}\nTOOL_DATA[1]={NULL}\n"
        'TOOL_NAME[1,]="pen"\nENDDAT\n',
        "Program/a.src": f"DEF a()\n$TOOL=TOOL_DATA[1]\n$BASE={base}\nLIN {POSE}\nEND\n",
    }
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


BASES = {
    "BASE_DATA[1]": TF_BASE,
    BASE: TF_BASE,
    "$NULLFRAME": np.eye(4),
    "$WORLD": np.eye(4),
}


@pytest.mark.promise("$ROBROOT of $machine.dat is used: bases are seen from the robot that stands there.")
@pytest.mark.parametrize("base", BASES)
def test_robroot_of_the_machine_data_is_used(base, tmp_path):
    folder = backup(tmp_path / "R1", ROOT, base)
    expected = (invert_transform(TF_ROOT) @ BASES[base] @ P)[:3]
    table = FrameTable.from_config_dat(folder / "System" / "$config.dat")
    for path, frames in ((folder, None), (folder / "Program" / "a.src", table)):
        np.testing.assert_allclose(read_program(path, frames).positions_base(), [expected], atol=1e-9)
    assert not np.allclose(expected, (BASES[base] @ P)[:3], atol=1.0)
    other = backup(tmp_path / "R2", NULL, base)
    np.testing.assert_allclose(read_program(other).positions_base(), [(BASES[base] @ P)[:3]], atol=1e-9)


@pytest.mark.promise("Bases of the cell file are seen from the robot already; $ROBROOT does not move them.")
def test_bases_of_the_cell_file_stay(tmp_path):
    path = backup(tmp_path, ROOT) / "Program" / "a.src"
    cell = tp.Cell.from_toml(
        '[robot]\nmodel = "kuka-kr210-r2700-extra"\n[frames]\nconfig_dat = "System/$config.dat"\n'
        "[frames.bases.1]\nx_mm = 7.0\n",
        folder=tmp_path,
    )
    np.testing.assert_allclose(read_program(path, FrameTable.from_cell(cell)).positions_base(), [[8.0, 2.0, 3.0]])


@pytest.mark.promise("A world that the cell file states is used, and must agree with $machine.dat.")
def test_the_world_may_be_stated_in_the_cell_file(tmp_path):
    def cell(z: float) -> tp.Cell:
        text = '[robot]\nmodel = "kuka-kr210-r2700-extra"\n[frames]\nconfig_dat = "$config.dat"\n'
        text += f"[frames.bases.0]\nz_mm = {z}\n"
        return tp.Cell.from_toml(text, folder=tmp_path)

    (tmp_path / "$config.dat").write_text(f"BASE_DATA[1]={BASE}\n")
    path = tmp_path / "a.src"
    path.write_text(f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=BASE_DATA[1]\nLIN {POSE}\nEND\n")
    frames = FrameTable.from_cell(cell(-500.0))
    np.testing.assert_allclose(read_program(path, frames).positions_base(), [[901.0, 12.0, -477.0]])
    (tmp_path / "$machine.dat").write_text(machine(NULL.replace("Z 0.0", "Z 500.0")))
    np.testing.assert_allclose(read_program(path, frames).positions_base(), [[901.0, 12.0, -477.0]])
    with pytest.raises(DataError, match=r"machine.dat: places the robot at \(0, 0, 500\) mm .* but \(0, 0, 400\) mm"):
        read_program(path, FrameTable.from_cell(cell(-400.0)))


SETS = {
    f"$ROBROOT={ROOT}": True,
    f"$WORLD={ROOT}": True,
    "$ROBROOT.Z=500": True,
    "$robroot = base_data[2]": True,
    "IF x THEN\n$WORLD=f\nENDIF": True,
    "$ROBROOT=$NULLFRAME": False,
    f"$WORLD={NULL}": False,
    "; $ROBROOT=f": False,
}


@pytest.mark.promise("A program that sets $ROBROOT or $WORLD is refused, unless to the null frame.")
def test_a_program_that_moves_its_robot_is_refused(tmp_path, record_property):
    for text, refused in SETS.items():
        path = tmp_path / "a.src"
        path.write_text(f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {POSE}\n{text}\nEND\n")
        (target,) = read_program(path).targets
        assert target.verdict == ("refuse" if refused else "correct"), text
        assert ("moves the robot in its world" in target.reason) == refused
    record_property("cases", len(SETS))


@pytest.mark.promise("A $ROBROOT that cannot be understood, or two that differ, refuse the program.")
def test_a_root_that_is_no_frame_is_refused(tmp_path):
    from truepose.programs.robot_base import standing

    path = backup(tmp_path, ROOT) / "Program" / "a.src"
    for root in ("{X 1,Y 2}", "f(1)", "{X a,Y 0,Z 0,A 0,B 0,C 0}"):
        (tmp_path / "Mada" / "$machine.dat").write_text(machine(root))
        with pytest.raises(FileError, match=r"machine.dat:4: \$ROBROOT is not the null frame"):
            read_program(path)
    (tmp_path / "Mada" / "$machine.dat").write_text(machine(ROOT) + f"FRAME $WORLD={BASE}\n")
    with pytest.raises(FileError, match=r"\$WORLD is not the null frame"):
        read_program(path)
    backup(tmp_path, ROOT)
    backup(tmp_path / "other", NULL)
    with pytest.raises(DataError, match=r"but .* mm was stated before"):
        standing(FrameTable(), tmp_path, "krl")


MOC = """MOC:CFG_1.0:6:0::

#
ROBOT:

      -name "ROB_1" -use_robot_type "ROB1_1600" -use_joint_0 "rob1_1"\\
      -base_frame_pos_x 0.1 -base_frame_pos_y -0.05 \\
      -base_frame_pos_z 0.5{more}
#
SINGLE:

      -name "S1" -base_frame_pos_x 9
"""
ROBOTS = {
    "": make_transform(translation=[100.0, -50.0, 500.0]),
    " -base_frame_orient_u0 0.5 -base_frame_orient_u3 0.8660254037844386": make_transform(
        tp.euler("abb", [0.5, 0.0, 0.0, 0.75**0.5]), [100.0, -50.0, 500.0]
    ),
}
RAPID = """MODULE M
LOCAL CONST robtarget p:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
TASK PERS wobjdata w:=[FALSE,TRUE,"",[[900,10,20],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
LOCAL PROC main()
MoveL p,v100,fine,tool0\\WObj:={wobj};
ENDPROC
ENDMODULE
"""


def abb(folder: Path, moc: str, wobj: str) -> Path:
    module = folder / "RAPID" / "TASK1" / "PROGMOD" / "M.mod"
    module.parent.mkdir(parents=True, exist_ok=True)
    (folder / "SYSPAR").mkdir(exist_ok=True)
    module.write_text(RAPID.format(wobj=wobj))
    (folder / "SYSPAR" / "MOC.cfg").write_text(moc, newline="\r\n")
    return module


@pytest.mark.promise("The base frame of an ABB robot in MOC.cfg is used: work objects are seen from the robot.")
def test_abb_base_frame_is_used(tmp_path, record_property):
    for k, (more, tf) in enumerate(ROBOTS.items()):
        for wobj, tf_world_frame in (("w", TF_BASE), ("wobj0", np.eye(4))):
            folder = tmp_path / f"{k}{wobj}"
            module = abb(folder, MOC.format(more=more), wobj)
            expected = (invert_transform(tf) @ tf_world_frame @ P)[:3]
            for path in (module, folder):
                found = read_programs([path], FrameTable(tools={"tool0": np.eye(4)}))
                (target,) = found.programs[0].targets
                np.testing.assert_allclose((target.tf_base_frame @ P)[:3], expected, atol=1e-9, err_msg=target.reason)
    record_property("cases", 4 * len(ROBOTS))


@pytest.mark.promise("Robots of one ABB controller that stand in different places, or on a track, are refused.")
def test_abb_bases_that_cannot_be_used_are_refused(tmp_path):
    module = abb(tmp_path, MOC.format(more='\n\n      -name "ROB_2" -base_frame_pos_x 3'), "w")
    with pytest.raises(DataError, match="the robots ROB_1, ROB_2 stand in different places"):
        read_program(module)
    abb(tmp_path, MOC.format(more=' -base_frame_coordinated "TRACK_1"'), "w")
    with pytest.raises(FileError, match="the base of ROB_1 is carried by TRACK_1"):
        read_program(module)
    abb(tmp_path, MOC.format(more=" -base_frame_orient_u0 2"), "w")
    with pytest.raises(FileError, match="ROB_1: base_frame_orient"):
        read_program(module)
