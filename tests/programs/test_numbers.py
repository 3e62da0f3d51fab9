"""Odd forms of numbers in every language: read as one number, or not corrected."""

# ruff: noqa: E501
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.programs.corpus import CORPUS
from tests.programs.numbers import changed_numbers, check_numbers, value
from tests.programs.test_corpus import lay

from truepose.errors import TrueposeError
from truepose.programs import FrameTable, ReadOptions, correct_program, read_program

FRAMES = FrameTable(tools={1: np.eye(4)}, bases={1: np.eye(4)}, tool=1, base=0)
RT = "[[{},2.5,3.5],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
LS = "P[1]{{\n   GP1:\n\tUF : 1, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n\tX =  {}  mm,\tY = 2.5 mm,\tZ = 3.5 mm,\n\tW = 0 deg,\tP = 0 deg,\tR = 0 deg\n}};\n"
PROGRAMS = {
    "inline.src": "DEF inline( )\nLIN {{X {},Y 2.5,Z 3.5,A 0,B 0,C 0}}\nEND\n",
    "run.src": "DEF run( )\n" + "LIN {{X {},Y 2.5,Z 3.5,A 0,B 0,C 0}}\n" * 20 + "END\n",
    "point.src": "DEF point( )\nDECL E6POS P1\nP1={{X {},Y 2.5,Z 3.5,A 0,B 0,C 0,S 2,T 1}}\nLIN P1\nEND\n",
    "const.mod": "MODULE m\nLOCAL CONST robtarget p1:="
    + RT
    + ";\nPROC main()\nMoveL p1,v10,fine,tool0;\nENDPROC\nENDMODULE\n",
    "inline.mod": "MODULE m\nPROC main()\nMoveL " + RT + ",v10,fine,tool0;\nENDPROC\nENDMODULE\n",
    "a.ls": "/PROG  A\n/MN\n   1:J P[1] 9% FINE ;\n/POS\n" + LS + "/END\n",
    "a.script": "def a():\n  movel(p[{},0.25,0.35,0,3.14,0], a=1)\nend\n",
    "named.script": "def a():\n  w = p[ {} ,0.25,0.35,0,3.14,0]\n  movel(w)\nend\n",
    "a.jbi": "/JOB\n//NAME A\n//POS\n///TOOL 1\n///POSTYPE BASE\n///RECTAN\nC00001={},2.5,3.5,0,0,0\n//INST\nNOP\nMOVL C00001 V=1.0\nEND\n",
    "a.dtx": '<?xml version="1.0"?>\n<Database><Datas><Data name="p" type="pointRx"><Value key="0" x="{}" y="2.5" z="3.5" rx="0" ry="0" rz="0" fatherId="world[0]" /></Data></Datas></Database>\n',
    "comma.csv": "name,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\np,{},2.5,3.5,0,0,0\n",
    "semicolon.csv": "name;x_mm;y_mm;z_mm;a_deg;b_deg;c_deg\np;{};2.5;3.5;0;0;0\n",
    "a.apt": "GOTO/{},2.5,3.5,0,0,1\n",
    "apart.nc": "G0 X0 Y0 Z0 A0 B0 C0\nG1 X{} Y2.5 Z3.5 F100\n",
    "packed.nc": "G0X0Y0Z0A0B0C0\nN10G1X{}Y2.5Z3.5F100\n",
    "last.nc": "G0X0Y0Z0A0B0C0\nG1 Z3.5 Y2.5 X{}\n",
    "blank.nc": "G0X0Y0Z0A0B0C0\nG1 X {} Y2.5 Z3.5\n",
}
FORMS = (
    *("5", "5.", "05.50", ".5", "+5", "+.5", "-.5", "-5.", "-0", "0", "1e1", "1E+1", "1.5e-1", "1.E1", ".5E1", "-2.6E-14", "1e0"),
    *("1D1", "1d+1", "1.5D-1", "1e", "1E+", "1.e", "e5", "1e1.5", "1e1e1", "1f5", "5mm", "0x10", "16#A", "'B01'", "5h"),
    *("#101", "#<x>", "[1+2]", "-#5", "R1", "=5", "=R1+2", "$x", "{{x}}", "x", "x+1", "5+1", "5-1", "2*3", "1/2", "(5)", "5**2"),
    *("--5", "+-5", "-+5", "- 5", "5-", "5+", "1.2.3", "1..2", ".", "-", "", "1 5", "1. 5", "1 .5", "1_0", "1'000", "1,5", "5%", "5@2", "5:2", "5=2"),
    *("nan", "inf", "1e999", "9" * 400, "１", "١", "²", "5\u00a0", "\u22125", "5\t", "5&", "5<6", "5^2", "5_", "5*71", "5/", "5,", "5.,"),
)  # fmt: skip


@pytest.mark.promise("every form of a number is read as one number or is not corrected, in every language")
@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.sampled(3)
def test_forms_of_numbers(tmp_path: Path, make_map: Any, name: str, record_property: Any) -> None:
    path = tmp_path / name
    options = ReadOptions(angles="z" if name.endswith(".apt") else "kuka", whole_task=True)
    corrected_forms = []
    for form in FORMS:
        path.write_bytes(PROGRAMS[name].format(*[form] * 20).encode())
        try:
            program = read_program(path, FRAMES, options)
            moved = [t for t in program.targets if t.verdict == "correct"]
            corrected = correct_program(path, make_map([0.25, 0.5, -0.125]), frames=FRAMES, options=options)
        except TrueposeError:
            continue
        if name.endswith(".mod"):
            form = form.rstrip("\u00a0")  # a blank in RAPID, whatever wrote it
        number = value(form[:1] if name.endswith(".nc") and form == "1f5" else form)  # F5
        for target in moved:
            if target.xyz is not None and target.xyz[2] != 0:  # not the start of the G-code
                assert number is not None, (form, target.xyz)
                assert target.xyz[0] == pytest.approx(number * target.unit, rel=1e-15), form
        assert check_numbers(corrected, {path: path.read_bytes()}) > 0 or not moved, form
        corrected_forms.append(form)
    record_property("cases", len(FORMS))
    assert {"5", "05.50", "-0"} <= set(corrected_forms)


@pytest.mark.exhaustive
@pytest.mark.promise("only the numbers of the record change, judged by a tokeniser that is independent of the readers")
def test_the_corpus_by_an_independent_tokeniser(tmp_path: Path, make_map: Any, record_property: Any) -> None:
    cases = 0
    for name, example in CORPUS.items():
        if example.correct:
            (tmp_path / name).mkdir()
            path = lay(tmp_path / name, example)
            originals = {path.parent / file: data for file, data in example.data().items()}
            more = {"frames": example.frames, "options": example.options, "on_guard": "skip"}
            cases += check_numbers(correct_program(path, make_map([0.5, -0.25, 0.125]), **more), originals)
    record_property("cases", cases)
    assert cases > 300


def test_the_tokeniser_takes_a_number_whole() -> None:
    assert changed_numbers(b"X1.2E+02Y3", b"X2.2E+02Y3") == [(120.0, 220.0)]
    assert changed_numbers(b"X1.5D3", b"X1.25D3") == [(None, None)]
    with pytest.raises(AssertionError):
        changed_numbers(b"X1 Y2", b"X1 Z2")


@pytest.mark.promise("a G-code number with an exponent is refused by name, and never corrected by half")
def test_gcode_exponents(tmp_path: Path, make_map: Any, record_property: Any) -> None:
    lines = ("X1.2E+02 Y2 Z3", "X1.2E2Y2Z3", "X1.2e-1 Y2 Z3", "X1 Y20.D5 Z3", "X1 Y2 Z3 A1E1", "X1E Y2 Z3")
    record_property("cases", len(lines))
    for line in lines:
        path = tmp_path / "a.nc"
        path.write_text(f"G0 X0 Y0 Z0 A0 B0 C0\nG1 {line}\nX4 Y5 Z6\n")
        program = read_program(path, FRAMES, ReadOptions(angles="kuka"))
        assert program.targets[1].verdict == "refuse", line
        assert "one number or two words" in program.targets[1].reason
        assert program.targets[2].verdict == ("refuse" if "A1E1" in line else "correct")
    path.write_text("G0 X0 Y0 Z0 A0 B0 C0\nG1 X10.5 Y2 Z3 E0.04\nG1 X1 Y2 Z3 E1E2\n")
    assert [t.verdict for t in read_program(path, FRAMES, ReadOptions(angles="kuka")).targets] == ["correct"] * 3


@pytest.mark.parametrize(
    "word",
    [
        "CIP",
        "BSPLINE",
        "POLY",
        "SUPA",
        "DIAMON",
        "AMIRROR X0",
        "TRANSMIT",
        "FTOCON",
        "G54.2 P1",
        "G505",
        "G154 P2",
        "G59.1",
        "G31.1",
    ],
)
def test_gcode_words_that_change_what_motions_mean(tmp_path: Path, word: str) -> None:
    path = tmp_path / "a.nc"
    path.write_text(f"G0 X0 Y0 Z0 A0 B0 C0\n{word}\nG1 X1 Y2 Z3\n")
    assert [t.verdict for t in read_program(path, FRAMES, ReadOptions(angles="kuka")).targets][-1] == "refuse"
