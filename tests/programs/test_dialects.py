"""Every dialect but KRL (which has its own grammar): zero correction, nothing but digits changes, injured files.

A dialect's grammar is made of pieces of text with marks: ``<x>``, ``<y>``, ``<z>`` are numbers that are to be corrected,
``<n>`` numbers that are not, ``<i>`` the number of the piece. So the check knows nothing of the reader. `tests/programs/fuzz.py`
injures these programs and others for as long as one likes.
"""

# ruff: noqa: E501
from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.tiers import examples

from truepose.errors import TrueposeError
from truepose.programs import CorrectedProgram, FrameTable, ReadOptions, correct_program

FRAMES = FrameTable(
    tools={1: np.eye(4), "tGrip": np.eye(4)}, bases={2: np.eye(4), "wFix": np.eye(4)}, tool="map", base=0
)


@dataclass(frozen=True)
class Dialect:
    """Endings, and for each section of a file: what stands before the pieces, between, and after."""

    ending: str
    sections: tuple[str, ...]
    pieces: tuple[tuple[str, ...], ...]
    unit: float = 1.0
    options: ReadOptions = ReadOptions()  # noqa: RUF009 - frozen
    exponents: bool = True
    columns: bool = False


RT = "[[<x>,<y>,<z>],[0,0,-1,0],[0,-1,0,1],[9E9,9E+09,9E9,9E9,9E9,9E9]]"
RT_KEPT = "[[<n>,<n>,<n>],[0.5,-0.5,0.5,0.5],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
LS = "X = <x>  mm,\tY = <y>  mm,\tZ = <z>  mm,\n\tW =  -171.986 deg,\tP =     0.000 deg,\tR =     -.858 deg"
LS_KEPT = LS.replace("<x>", "<n>").replace("<y>", "<n>").replace("<z>", "<n>")
LS_HEAD = "   GP1:\n\tUF : 2, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n\t"
JBI = "C0000<i>=<x>,<y>,<z>,180.0000,0.0000,-90.0000\n"
DTX = 'rx="0" ry="180" rz="-.5" shoulder="lefty" elbow="epositive" wrist="wpositive" fatherId="world[0]" />'

DIALECTS = {
    "rapid": Dialect(
        ".mod",
        ("%%%\n  VERSION:1\n%%%\nMODULE Main(SYSMODULE)\n", "PROC main()\n", "ENDPROC\nENDMODULE\n"),
        (
            (f"  CONST robtarget p<i>:={RT};\n", "    MoveL p<i>,v100,z1,tGrip\\WObj:=wFix;\n"),
            (f"CONST\trobtarget P<i> :=\n {RT} ; ! gr\xfcn [[1,2\n", "movej p<i>, v100, fine, tool0;\n"),
            (
                f"CONST robtarget a<i>{{2}}:=[{RT},\n{RT}];\n",
                "FOR i FROM 1 TO 2 DO\n MoveL a<i>{i},v1,z1,tGrip;\nENDFOR\n",
            ),
            ("", f"MoveL {RT},\\V:=50, v100, z1 \\Z:=5, tGrip, \\WObj:=wFix;\n"),
            (f"CONST robtarget c<i>:={RT};CONST robtarget d<i>:={RT};\n", "MoveC c<i>,d<i>,v10,fine,tGrip;\n"),
            (f"PERS robtarget v<i>:={RT_KEPT};\n", "MoveL v<i>,v100,z1,tGrip;\n"),
            (f"TASK PERS robtarget u<i>:={RT_KEPT};\n", "MoveJ Offs(u<i>,0,<n>,50),v100,z1,tGrip;\n"),
            (f"CONST robtarget o<i>:={RT_KEPT};\n", "MoveL RelTool(o<i>,0,0,-50\\Rz:=5),v100,z1,tGrip;\n"),
            (
                "PERS tooldata t<i>:=[TRUE,[[<n>,<n>,<n>],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n",
                'TPWrite "p1:=[[1,2";\n',
            ),
            ('PERS wobjdata w<i>:=[FALSE,TRUE,"",[[<n>,<n>,<n>],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n', "WaitTime <n>;\n"),
            (
                "CONST jointtarget j<i>:=[[0,<n>,30,0,90,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n",
                "MoveAbsJ j<i>,v100,fine,tGrip;\n",
            ),
            ("VAR num n<i>:=<n>;\n", "IF n<i>>3 THEN\n  n<i>:=n<i>-125;\nELSEIF n<i>=2 THEN\nELSE\n Stop;\nENDIF\n"),
            ("", "TEST 1\nCASE 1,2:\n SetDO do1,1;\nDEFAULT:\nENDTEST\n"),
            ("", "MoveL [[x-125,<n>,<n>],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,z1,tGrip;\n"),
            (f"CONST robtarget l<i>:={RT};\n", "TriggL l<i>,v100,trig\\T2:=t2,z1,tGrip\\WObj:=wFix;\n"),
            (f"CONST robtarget s<i>:={RT};\n", "SearchL\\Stop,di1,pFound,s<i>,v10,tGrip\\WObj:=wFix;\n"),
            (f"CONST robtarget k<i>:={RT};\n", "IF x=1 MoveLDO k<i>,v100,z1,tGrip\\WObj:=wFix,do1,1;\n"),
            (f"CONST robtarget g<i>:={RT};\n", "ArcLStart g<i>\\ID:=11,v100,seam1,weld1\\Weave:=w1,fine,tGrip;\n"),
        ),
        options=ReadOptions(whole_task=True),
    ),
    "fanuc": Dialect(
        ".ls",
        (
            '/PROG  PANEL\n/ATTR\nCOMMENT\t\t= "gr\xfcn";\nLINE_COUNT\t= 7;\n/MN\n   1:  UFRAME_NUM=2 ;\n',
            "/POS\n",
            "/END\n",
        ),
        (
            ("   1:J P[<i>] 100% FINE    ;\n", f"P[<i>]{{\n{LS_HEAD}{LS}\n}};\n"),
            ("  12:L P[<i>:ABOVE PART] 100mm/sec CNT50    ;\n", f'P[<i>:"ABOVE PART"]{{\n{LS_HEAD}{LS}\n}};\n'),
            (
                "   2:C P[<i>]    \n    :  P[9<i>] 100mm/sec FINE    ;\n",
                f"P[<i>]{{\n{LS_HEAD}{LS}\n}};\nP[9<i>] {{\n{LS_HEAD}{LS}\n}};\n",
            ),
            ("   2:L P[<i>] 100mm/sec FINE Offset,PR[3]    ;\n", f"P[<i>]{{\n{LS_HEAD}{LS_KEPT}\n}};\n"),
            ("   2:L P[<i>] 100mm/sec FINE INC    ;\n", f"P[<i>]{{\n{LS_HEAD}{LS_KEPT}\n}};\n"),
            (
                "   2:J P[<i>] 10% FINE    ;\n",
                "P[<i>]{\n   GP1:\n\tUF : 2, UT : 1,\n\tJ1= <n> deg,\tJ2= <n> deg,\n};\n",
            ),
            ("   2:L PR[5] 100mm/sec FINE    ;\n   3:  PR[5,1]=R[<i>]    ;\n", ""),
            ("   3:  !L P[1] 100mm/sec ;\n", f"P[<i>]{{\n{LS_HEAD}{LS_KEPT}\n}};\n"),
            ("   3://J P[1] 100% FINE ;\n   4:  LBL[<i>:again] ;\n   5:  IF R[1]=1,JMP LBL[<i>] ;\n", ""),
            ("   3:  CALL GRIP(1,'P[1]') ;\n", ""),
            (
                "   3:  IF (DI[1]) THEN ;\n   3:  ELSE ;\n   3:  ENDIF ;\n   3:  FOR R[1]=1 TO 3 ;\n   3:  ENDFOR ;\n",
                "",
            ),
            (
                "   2:L P[<i>] 100mm/sec FINE    ;\n",
                "P[<i>]{\n"
                + LS_HEAD
                + "X = ********  mm,\tY = ********  mm,\tZ = ********  mm,\n\tW = ******** deg,\tP = ******** deg,\tR = ******** deg\n};\n",
            ),
            (
                "   2:L P[<i>] 100mm/sec FINE    ;\n",
                f"P[<i>]{{\n{LS_HEAD}{LS}\n   GP2:\n\tUF : 2, UT : 1,\n\tJ1= <n>  mm\n}};\n",
            ),
        ),
        exponents=False,
        columns=True,
    ),
    "urscript": Dialect(
        ".script",
        ("def prog():\n  set_tcp(p[0,0,0.1,0,0,0])\n", "", "end\n"),
        (
            ("  movel(p[<x>,<y>,<z>,0,3.14,0], a=1.2, v=0.25)\n", ""),
            ("\tmovej( p[ <x> , <y>,<z>, 2.2,-2.2,0.0 ] ) # p[1,2\n", ""),
            ("  movec(p[<x>,<y>,<z>,0,3.14,0],p[<x>,<y>,<z>,0,3.14,0], a=1)\n", ""),
            ("  global w<i>=p[<x>,<y>,<z>,0,3.14,0]\n  movep(w<i>, a=1, v=0.1, r=0.01)\n", ""),
            ("  w<i>=p[<x>,<y>,<z>,0,3.14,0]\n  movej(get_inverse_kin(w<i>, qnear=[<n>,0,0,0,0,0]), a=1)\n", ""),
            ("  movej([<n>,-1.57,1.57,0,0,0], a=1, v=1)\n", ""),
            ("  w<i>=p[<n>,<n>,<n>,0,0,0]\n  movel(pose_trans(w<i>, p[<x>,<y>,<z>,0,0,0]))\n", ""),
            ("  w<i>=get_target()\n  movel(pose_trans(w<i>, p[<n>,0,0,0,0,0]))\n", ""),
            ("  def go<i>(t, v):\n    movel(t, v=v)\n  end\n  go<i>(p[<x>,<y>,<z>,0,3.14,0], <n>)\n", ""),
            ("  pts<i> = [p[<x>,<y>,<z>,0,3.14,0],\n    p[<x>,<y>,<z>,0,3.14,0]]\n  movel(pts<i>[k], a=1)\n", ""),
            (
                "  f<i>=p[<n>,<n>,<n>,0,0,0]\n  u<i>=pose_trans(pose_inv(f<i>), p[<x>,<y>,<z>,0,3,0])\n  movel(pose=u<i>)\n",
                "",
            ),
            ("  movel(p[<n>+x,<n>,<n>,0,3.14,0])\n  movel(p[{{x}},<n>,<n>,0,3.14,0])\n", ""),
            (
                '  if x > <n>:\n    set_payload(<n>)\n  elif y:\n    sleep(0.1)\n  else:\n    textmsg("movel(p[1,2")\n  end\n',
                "",
            ),
            ("  servoj([<n>,0,0,0,0,0])\n  speedl([<n>,0,0,0,0,0], 0.5)\n", ""),
            ("  wrench_<i> = p[<n>,<n>,<n>,0,0,0]\n  force_mode(wrench_<i>,[0,0,1,0,0,0])\n  end_force_mode()\n", ""),
            ("  # gr\xfcn movel(p[1,2,3,0,0,0])\n", ""),
        ),
        unit=1000.0,
    ),
    "inform": Dialect(
        ".jbi",
        (
            "/JOB\n//NAME PANEL\n//POS\n///NPOS 9,0,0,0,0,0\n///TOOL 1\n",
            "//INST\n///DATE 2024/01/01 10:00\n///ATTR SC,RW\n///GROUP1 RB1\nNOP\n",
            "END\n",
        ),
        (
            (f"///POSTYPE BASE\n///RECTAN\n///RCONF 1,0,0,0,0,0,0,0\n{JBI}", "MOVL C0000<i> V=100.0\n"),
            (f"///POSTYPE ROBOT\n///RECTAN\n{JBI}", "MOVJ C0000<i> VJ=50.00 PL=0 NWAIT\n"),
            (f"///POSTYPE USER\n///USER 2\n///RECTAN\n{JBI}", "MOVC C0000<i> V=100.0\n"),
            ("///POSTYPE PULSE\n///PULSE\nC0000<i>=100,-2000,30,4,5,6\n", "MOVJ C0000<i> VJ=50.00\n"),
            (
                "///POSTYPE BASE\n///RECTAN\nP0000<i>=<n>,<n>,<n>,180.0000,0.0000,0.0000\n",
                "SET P00<i> (1) 5\nMOVL P00<i> V=10.0\n",
            ),
            ("", "'MOVL C00001 V=1 <n>\nTIMER T=1.00\nDOUT OT#(1) ON\nCALL JOB:OTHER\n"),
            (
                f"///POSTYPE BASE\n///RECTAN\n{JBI.replace('<x>', '<n>').replace('<y>', '<n>').replace('<z>', '<n>')}",
                "SFTON P001\nMOVL C0000<i> V=1.0\nSFTOF\n",
            ),
            ("", "*L<i>\nJUMP *L<i> IF IN#(1)=ON\n"),
        ),
        exponents=False,
    ),
    "val3": Dialect(
        ".dtx",
        (
            '<?xml version="1.0" encoding="iso-8859-1" ?>\n<Database xmlns="http://www.staubli.com/robotics/VAL3/Data/2">\n<Datas>\n',
            "",
            "</Datas>\n</Database>\n",
        ),
        (
            (
                f'<Data name="p<i>" access="private" type="pointRx" size="1">\n <Value key="0" x="<x>" y="<y>" z="<z>" {DTX}\n</Data>\n',
                "",
            ),
            (
                f'<Data access="private" type="pointRx" name="p<i>"  size="2"><Value key="0" y="<y>" x="<x>"\n z=\'<z>\' {DTX}<Value  key="1" x="<x>" y="<y>" z="<z>" {DTX}</Data>',
                "",
            ),
            (
                '<Data name="f<i>" type="frame"><Value key="0" x="<n>" y="<n>" z="<n>" rx="0" ry="0" rz="0" fatherId="world[0]" /></Data>\n',
                "",
            ),
            (
                '<Data name="t<i>" type="tool"><Value key="0" x="<n>" y="<n>" z="<n>" rx="0" ry="0" rz="0" fatherId="flange[0]" /></Data>\n',
                "",
            ),
            (
                '<Data name="j<i>" type="jointRx"><Value key="0" j1="<n>" j2="0" j3="0" j4="0" j5="0" j6="0" /></Data>\n',
                "",
            ),
            (
                '<!-- gr\xfcn <Value x="<n>" y="<n>" /> -->\n<Data name="n<i>" type="num"><Value key="0" value="<n>" /></Data>\n',
                "",
            ),
        ),
    ),
    "table": Dialect(
        ".csv",
        ("# gr\xfcn\nname,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,note\n", "", ""),
        (
            ("p<i>,<x>,<y>,<z>,90,0,-180,<n>\n", ""),
            ('"a, <n>", <x> ,\t<y>,"<z>",90,0,-180,"x ""y"" z"\n', ""),
            ("empty,,,,,,,<n>\n", ""),
            ("\n", ""),
        ),
    ),
    "apt": Dialect(
        ".apt",
        ("PARTNO PANEL\nUNITS/MM\nMULTAX/ON\n", "", "FINI\n"),
        (
            ("GOTO/<x>,<y>,<z>,0.0000,0.6,0.8\n", ""),
            ("GOTO / <x>, <y>,$\n  <z>, 0, 0, 1 $$ gr\xfcn <n>\n", ""),
            ("GOTO/<x>,<y>,<z>\n", ""),
            ("FEDRAT/<n>,MMPM\nLOADTL/5\nSPINDL/RPM,8000,CLW\n", ""),
            ("GODLTA/<n>,<n>,<n>\n", ""),
            ("$$ GOTO/1,2,3\nPPRINT GOTO/1,2\n", ""),
        ),
        options=ReadOptions(angles="-z"),
    ),
    "gcode": Dialect(
        ".nc",
        ("%\n(gr\xfcn X1 Y2)\nN10 G21 G90 G54\nG0 A0 B90 C0\n", "", "M30\n%\n"),
        (
            ("N20 G1 X<x> Y<y> Z<z> A1.5 B90 C-3 F500\n", ""),
            ("g1x<x>y<y>z<z>f500 ; X<n>\n", ""),
            ("G0 X<x>Y<y>Z<z>\n", ""),
            ("G1 Z<n>\nG4 X1.5\nM3 S8000\n", ""),
            ("G91\nG1 X<n> Y<n> Z<n>\nG90\n", ""),
            ("G1 X#101 Y<n> Z<n>\nG28 Z0\n", ""),
            ("G1 X<n> Y<n> Z<n>\nG2 X<n> Y<n> I<n> J0\n", ""),
        ),
        options=ReadOptions(angles="kuka"),
        exponents=False,
    ),
}

PLAIN = st.one_of(
    st.integers(-9999, 9999).map(str),
    st.tuples(st.integers(-(10**7), 10**7), st.integers(1, 6)).map(lambda t: f"{t[0] / 10**4:.{t[1]}f}"),
    st.sampled_from(["-0.0", ".5", "-.125", "300.", "0", "007", "+5.25"]),
)
EXPONENTS = st.sampled_from(["-2.6E-14", "1E3", "8.125e2", "+9E+01"])
MARK = re.compile(r"<([xyzni])>")


@st.composite
def programs(draw: Any, dialect: Dialect) -> list[tuple[bytes, int | None]]:
    """Bytes with marks: a piece is kept as it is, or is a number (axis 0, 1, 2) to be corrected."""
    numbers = st.one_of(PLAIN, EXPONENTS) if dialect.exponents else PLAIN
    chosen = draw(st.lists(st.sampled_from(dialect.pieces), max_size=7))
    line_end = draw(st.sampled_from(["\n", "\r\n"]))
    parts = []
    for k, opening in enumerate(dialect.sections):
        parts.append(opening)
        if k < 2:
            parts += [piece[k].replace("<i>", str(i)) for i, piece in enumerate(chosen, 1)]
    text = "".join(parts).replace("\n", line_end)
    found: list[tuple[bytes, int | None]] = []
    position = 0
    for m in MARK.finditer(text):
        found.append((text[position : m.start()].encode("latin-1"), None))
        token = draw(numbers)
        token = token.rjust(9) if dialect.columns and draw(st.booleans()) else token
        found.append((token.encode(), None if m[1] == "n" else "xyz".index(m[1])))
        position = m.end()
    return [*found, (text[position:].encode("latin-1"), None)]


def attempt(path: Path, error_map: Any, **more: Any) -> CorrectedProgram | str:
    """Return the corrected program, or our error's message; any other exception is a failure."""
    try:
        return correct_program(path, error_map, frames=FRAMES, **more)
    except TrueposeError as error:
        return str(error)


ANY_FOLDER = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=examples(60)
)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", DIALECTS)
@ANY_FOLDER
@given(data=st.data(), shift=st.tuples(*[st.floats(-3, 3)] * 3).map(np.array))
def test_a_correction_changes_the_digits_of_corrected_targets_alone(
    tmp_path: Path, make_map: Any, name: str, data: st.DataObject, shift: np.ndarray
) -> None:
    dialect = DIALECTS[name]
    pieces = data.draw(programs(dialect))
    path = tmp_path / f"a{dialect.ending}"
    original = b"".join(text for text, _ in pieces)
    path.write_bytes(original)
    marked = [(text, axis) for text, axis in pieces if axis is not None]
    for wanted in (shift, np.zeros(3)):
        corrected = attempt(path, make_map(wanted), options=dialect.options)
        some_stay = isinstance(corrected, str) and re.search("off the scale|from the base of the robot", corrected)
        if some_stay:
            corrected = attempt(path, make_map(wanted), options=dialect.options, on_guard="skip")
        if isinstance(corrected, str):
            assert re.search(r"nothing can be corrected|has no (GOTO|<Data>)", corrected)
            assert not marked or some_stay
            return
        result = corrected.files[path]
        if not wanted.any():
            assert result == original
            continue
        number = rb"([ ]*[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
        found = re.fullmatch(b"".join(re.escape(t) if axis is None else number for t, axis in pieces), result)
        assert found is not None
        for (old, axis), new in zip(marked, found.groups(), strict=True):
            if some_stay and new == old:
                continue
            assert abs(float(new) - float(old) - wanted[axis] / dialect.unit) <= 0.501e-3 / dialect.unit
            if abs(wanted[axis]) < 0.499e-3:
                assert new == old
            if dialect.columns and old.startswith(b"   "):
                digits = len(new.strip())  # wider only where these need it; one blank may belong to the text before
                assert max(len(old), digits) <= len(new) <= max(len(old), digits + 1)


def whole(dialect: Dialect) -> bytes:
    """A program with every piece of the grammar."""
    rng = np.random.default_rng(5)
    parts = []
    for k, opening in enumerate(dialect.sections):
        parts.append(opening)
        if k < 2:
            parts += [piece[k].replace("<i>", str(i)) for i, piece in enumerate(dialect.pieces, 1)]
    return MARK.sub(lambda _: f"{rng.normal() * 500:.3f}", "".join(parts)).encode("latin-1")


@pytest.mark.parametrize("name", DIALECTS)
@ANY_FOLDER
@given(
    data=st.one_of(st.binary(max_size=300), st.sampled_from(["", "\x00", "\ufeff", "(((((", "GOTO/"]).map(str.encode))
)
def test_any_bytes_give_our_errors(tmp_path: Path, make_map: Any, name: str, data: bytes) -> None:
    path = tmp_path / f"a{DIALECTS[name].ending}"
    for content in (data, data.decode("latin-1").encode("utf-16")):
        path.write_bytes(content)
        result = attempt(path, make_map(), options=DIALECTS[name].options)
        assert isinstance(result, str) or result.files[path] == content


@pytest.mark.parametrize("name", DIALECTS)
def test_a_program_of_another_language_is_told(tmp_path: Path, make_map: Any, name: str) -> None:
    path = tmp_path / f"a{DIALECTS[name].ending}"
    for other in DIALECTS:
        if other != name:
            path.write_bytes(whole(DIALECTS[other]))
            assert isinstance(attempt(path, make_map([1, 1, 1]), options=DIALECTS[name].options), str), other


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", DIALECTS)
def test_numbers_of_thousands_of_digits(tmp_path: Path, make_map: Any, name: str) -> None:
    dialect = DIALECTS[name]
    path, data = tmp_path / f"a{dialect.ending}", whole(dialect)
    for m in list(re.finditer(rb"\d+", data))[::3]:
        path.write_bytes(data[: m.start()] + b"7" * 5000 + data[m.end() :])
        attempt(path, make_map(), options=dialect.options)  # an error of ours, or none
