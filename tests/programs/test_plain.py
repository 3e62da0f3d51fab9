"""Plain targets in CSV, APT and G-code: the catalogue's rows, frames, units, orientation rules."""

# ruff: noqa: E501
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, ReadOptions, correct_program, read_program

TURNED = np.eye(4)
TURNED[:3, 3] = [1000, 0, 0]
FRAMES = FrameTable(tools={"t": np.eye(4)}, bases={"jig": TURNED, "G54": TURNED}, base=0)


def read(folder: Path, name: str, text: str, frames: FrameTable = FRAMES, **options: Any) -> Program:
    path = folder / name
    path.write_text(text)
    return read_program(path, frames, ReadOptions(**options))


def test_csv_units_and_orientations(tmp_path: Path) -> None:
    quaternion = read(tmp_path, "a.csv", "name,x_m,y_m,z_m,q1,q2,q3,q4\np,0.5,0,1,0,0,1,0\n")
    np.testing.assert_allclose(quaternion.positions_base(), [[500, 0, 1000]])
    wanted = Rotation.from_euler("ZYX", [30, 20, 10], degrees=True).as_matrix()
    for columns, numbers in (("a_deg;b_deg;c_deg", "30;20;10"), ("w_deg;p_deg;r_deg", "10;20;30")):
        program = read(tmp_path, "a.csv", f"name;x_mm;y_mm;z_mm;{columns}\np;1;2;3;{numbers}\n")
        np.testing.assert_allclose(program.poses_base()[0, :3, :3], wanted, atol=1e-12)
    text = "name,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\np,1,2,3,10,20,30\n"
    with pytest.raises(FileError, match="name their convention"):
        read(tmp_path, "a.csv", text)
    yaskawa = read(tmp_path, "a.csv", text, angles="yaskawa")
    np.testing.assert_allclose(yaskawa.poses_base()[0, :3, :3], wanted, atol=1e-12)


def test_csv_frames_by_row(tmp_path: Path) -> None:
    text = "name,frame,tool,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,motion\np,jig,t,1,2,3,0,0,0,LIN\nq,,,1,2,3,0,0,0,\nr,lost,t,1,2,3,0,0,0,PTP\n"
    program = read(tmp_path, "a.csv", text)
    assert [(t.verdict, t.frame, t.tool, t.motion) for t in program.targets] == [
        ("correct", "jig", "t", "LIN"), ("refuse", "", "", "target"), ("refuse", "lost", "t", "PTP"),
    ]  # fmt: skip
    np.testing.assert_allclose(program.positions_base(), [[1001, 2, 3]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no row of column names"),
        ("name,x_mm,y_mm\n", "expected columns x_mm, y_mm, z_mm"),
        ("x_mm,y_mm,z_mm\n", "expected the columns of one orientation"),
        ("x_mm,y_mm,z_mm,x_mm,a_deg,b_deg,c_deg\n", "names the column x_mm twice"),
        ("x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n1,2,3,0,0\n", r"a\.csv:2: has 5 columns, the first row has 6"),
        ("x_mm;y_mm;z_mm;a_deg;b_deg;c_deg\n1,5;2;3;0;0;0\n", r"a\.csv:2: x_mm: 1,5 is not a number"),
        ("x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n1,2,3,0,0,\n", r"a\.csv:2: c_deg: +is not a number"),
        ('x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n"1,2,3,0,0,0\n', "quotes do not pair"),
        ("x_mm,y_mm,z_mm,q1,q2,q3,q4\n1,2,3,2,0,0,0\n", "has length 2"),
    ],
)
def test_broken_csv(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        read(tmp_path, "a.csv", text)


def test_apt_with_frame_and_rule(tmp_path: Path) -> None:
    text = "PARTNO A\nUNITS/INCHES\nGOTO/1,2,3,0,0.6,0.8\nGOTO/$\n 1,2,4\n$$ GOTO/9,9,9\n"
    program = read(tmp_path, "a.apt", text, FrameTable(bases={"jig": TURNED}, base="jig"), angles="-z")
    assert [(t.verdict, t.line, t.frame) for t in program.targets] == [("correct", 3, "jig"), ("correct", 4, "jig")]
    np.testing.assert_allclose(program.positions_base(), [[1025.4, 50.8, 76.2], [1025.4, 50.8, 101.6]])
    np.testing.assert_allclose(program.poses_base()[:, :3, 2], [[0, -0.6, -0.8]] * 2, atol=1e-12)
    np.testing.assert_allclose(program.poses_base()[:, :3, 0], [[1, 0, 0]] * 2, atol=1e-12)
    along_x = read(tmp_path, "a.apt", "GOTO/1,2,3,1,0,0\n", angles="z").poses_base()[0, :3, :3]
    np.testing.assert_allclose(along_x, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)
    assert "--angles z or -z" in read(tmp_path, "a.apt", text).targets[0].reason
    nowhere = read(tmp_path, "a.apt", text, FrameTable(), angles="z").targets[0]
    assert (nowhere.verdict, "--base NAME" in nowhere.reason) == ("refuse", True)


def test_apt_other_motions(tmp_path: Path) -> None:
    text = "GOTO/1,2,3\nGODLTA/0,0,5\nMOVARC/1,2,3,0,0,1,5,ANGLE,90\nTRANS/1,0,0\nGOTO/1,2,3\n"
    program = read(tmp_path, "a.apt", text, angles="z")
    assert [t.verdict for t in program.targets] == ["correct", "skip", "refuse", "refuse"]
    for text, message in (
        ("GOTO/1,2", "has 2 numbers, expected 3 or 6"),
        ("GOTO/1,2,3,0,0,2", "does not have length 1"),
        ("GOTO/1,2,3.4.5", r"a\.apt:1: z: 3\.4\.5 is not a number"),
        ("GOTO/1,2,$", "it is truncated"),
        ("FINI", "has no GOTO"),
    ):
        with pytest.raises(FileError, match=message):
            read(tmp_path, "a.apt", text)


def test_gcode_with_frame_and_rule(tmp_path: Path) -> None:
    text = "%\nG21 G90 G54\nG0 X1 Y2 Z3 A30 B20 C10\nN3 G1X4.Y5Z-.5 (X9)\nG20\n"
    with pytest.raises(FileError, match="G20 changes the unit"):
        read(tmp_path, "a.nc", text, angles="kuka")
    program = read(tmp_path, "a.nc", text.replace("G20\n", ""), angles="kuka")
    assert [(t.verdict, t.name, t.frame) for t in program.targets] == [
        ("correct", "G0:3", "G54"),
        ("correct", "G1:4", "G54"),
    ]
    np.testing.assert_allclose(program.positions_base(), [[1001, 2, 3], [1004, 5, -0.5]])
    wanted = Rotation.from_euler("ZYX", [30, 20, 10], degrees=True).as_matrix()
    np.testing.assert_allclose(program.poses_base()[1, :3, :3], wanted, atol=1e-12)
    inches = read(tmp_path, "a.nc", "G20\nG1 X1 Y0 Z0 A0 B0 C0\n", angles="kuka")
    np.testing.assert_allclose(inches.positions_base(), [[25.4, 0, 0]])
    assert read(tmp_path, "a.nc", text.replace("G20\n", "")).targets[0].verdict == "refuse"
    two = "G54\nG1 X1 Y0 Z0 A0 B0 C0\nG55\nG1 X1 Y0 Z0\n"
    assert [t.verdict for t in read(tmp_path, "a.nc", two, angles="kuka").targets] == ["correct", "refuse"]
    assert [t.verdict for t in read(tmp_path, "a.nc", two, FrameTable(base=0), angles="kuka").targets] == ["refuse"] * 2


@pytest.mark.parametrize(
    ("line", "verdict", "reason"),
    [
        ("G1 Z5", "skip", "partial"),
        ("G91 G1 X1 Y2 Z3", "skip", "G91"),
        ("G1 X#101 Y2 Z3", "skip", "an expression"),
        ("G1 X[1+2] Y2 Z3", "skip", "an expression"),
        ("G1 A5", "skip", "an orientation alone"),
        ("G53 G0 X1 Y2 Z3", "refuse", "coordinates of the machine"),
        ("G41 G1 X1 Y2 Z3", "refuse", "compensation"),
        ("G92 X1 Y2 Z3", "refuse", "changes the coordinates"),
        ("G81 X1 Y2 Z3 R5", "refuse", "G81 is not known here"),
        ("G187 X1 Y2 Z3", "refuse", "G187 is not known"),
        ("M98 P100\nG1 X1 Y2 Z3", "refuse", "what is in force after line"),
        ("TRANS X5\nG1 X1 Y2 Z3", "refuse", "coordinates are changed"),
        ("G28 X1 Y2 Z3", "skip", "a reference point"),
        ("G4 X1.5\nG1 X1 Y2 Z3", "correct", ""),
        ("#100=#101+X1\nR1=5\nG1 X1 Y2 Z3", "correct", ""),
        ("IF [#1 GT 5] GOTO 20\nG1 X1 Y2 Z3 A0 B0 C0", "refuse", "what is in force after line 2 (IF) is not known"),
        ("N5 WHILE R1==1 G1 X5", "refuse", "a motion behind WHILE"),
        ("G1 X1 Y2 Z3 A3=0 B3=0 C3=1", "skip", "A, B, C: an expression"),
        ("G1 X1 Y2 Z3 A3=0 B3=0 C3=1\nX1 Y2 Z4", "refuse", "its orientation is not known"),
    ],
)
def test_gcode_modes(tmp_path: Path, line: str, verdict: str, reason: str) -> None:
    program = read(tmp_path, "a.nc", f"G0 X0 Y0 Z0 A0 B0 C0\n{line}\n", angles="kuka")
    assert (program.targets[-1].verdict, reason in program.targets[-1].reason) == (verdict, True), program.targets[-1]


def test_gcode_arcs_both_ends_or_neither(tmp_path: Path) -> None:
    program = read(
        tmp_path, "a.nc", "G1 X0 Y0 Z0 A0 B0 C0\nG1 X1 Y0 Z0\nG2 X2 Y0 Z0 I1 J0\nG1 X3 Y0 Z0\n", angles="kuka"
    )
    assert [t.verdict for t in program.targets] == ["correct", "skip", "skip", "correct"]


def test_gcode_digits_stay_where_letters_adhere(tmp_path: Path, make_map: Any) -> None:
    path = tmp_path / "a.nc"
    path.write_bytes(b"%\r\nN1G1X1.Y2.50Z-.5A0B90C0F500;X1\r\nN2 g1 x1 y1 z1")
    options = ReadOptions(angles="fanuc")
    corrected = correct_program(path, make_map([0.25, 0.25, 0.25]), frames=FrameTable(base=0), options=options)
    assert corrected.files[path] == b"%\r\nN1G1X1.25Y2.75Z-.25A0B90C0F500;X1\r\nN2 g1 x1.25 y1.25 z1.25"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G1 X1.2.3 Y0 Z0", r"a\.nc:1: X 1\.2\.3 is not a number"),
        ("G1 X--5 Y0 Z0", "X --5 is not a number"),
        (f"G1 X{'9' * 400} Y0", "has 400 characters"),
        ("G1 X1 X2", "names an axis twice"),
        ("hello", "it is no G-code"),
        ("G1 {", "is not understood"),
    ],
)
def test_broken_gcode(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        read(tmp_path, "a.nc", text, angles="kuka")
