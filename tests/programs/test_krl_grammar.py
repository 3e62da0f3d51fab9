"""Any program made of the grammar's pieces: what is not a corrected digit stays, byte by byte.

The generator says of every number that it writes whether it is to be corrected, so that the check knows nothing of the
reader: it fits the result to a pattern made of the generator's own pieces.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from truepose.errors import TrueposeError
from truepose.programs import CorrectedProgram, ReadOptions, correct_program

Draw = Any
TRUSTING = ReadOptions(whole_task=True, calls_keep_frames=True)

WORDS = ["PTP", "LIN", "SPTP", "SLIN", "SPL"]
NUMBER_TOKENS = st.one_of(
    st.integers(-9999, 9999).map(lambda n: b"%d" % n),
    st.tuples(st.integers(-(10**7), 10**7), st.integers(1, 9)).map(lambda t: f"{t[0] / 10**3:.{t[1]}f}".encode()),
    st.sampled_from(
        [b"-0.0", b"+5.25", b".5", b"-.125", b"-2.6E-14", b"1E3", b"8.125e2", b"300.", b"0", b"+0", b"007"]
    ),
)
LINE_ENDS = st.sampled_from([b"\r\n", b"\n", b"\r\n", b"\n", b"\r"])
BLANKS = st.sampled_from([b" ", b"  ", b"\t", b" \t "])
NO_BLANKS = st.sampled_from([b"", b"", b" ", b"\t"])
REMARKS = st.sampled_from(
    [
        b"",
        b"",
        b" ;gr\xfc\xdfe {X 1}",
        b";LIN {X 5,Y 6",
        b'\t; P7 "open 12.5',
        b" ;ENDFOLD (INI)",
        b";%{PE}%R 8.3.31,%P 2:P7",
    ]
)
NO_TARGETS = [
    b"&PARAM EDITMASK = *",
    b";FOLD LIN P7 CONT Vel=2 m/s CPDAT1 Tool[3]:grip Base[1];%{PE}%R 8.3,%P 1:LIN, 2:P7, 5:2, 7:CPDAT1",
    b";ENDFOLD",
    b"",
    b"  ",
    b"WAIT SEC 0.5",
    b"$OUT[12]=TRUE",
    b"$VEL.CP=0.25",
    b"BAS(#VEL_PTP,100)",
    b"BASE_DATA[9]={X 1,Y 2,Z 3,A 0,B 0,C 0}",
    b"f({X 1,Y 2,Z 3,A 0,B 0,C 0})",
    b'MSG("LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}")',
    b"PTP {A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}",
    b"LIN {Z 500}",
    b"LIN_REL {X -10,Y 2.5} C_DIS #TOOL",
    b"LIN $POS_ACT",
    b"PTP XHOME",
    b"LIN {X dx+1.5,Y 2,Z 3,A 0,B 0,C 0}",
    b"TRIGGER WHEN DISTANCE=0 DELAY=20 DO $OUT[3]=FALSE",
    b"x=3.5+SIN(30.0)*1E-3",
    b"IF x>1.0 THEN",
]
DATA = [
    b'DECL BASIS_SUGG_T LAST_BASIS={POINT1[] "P7 {X 1",POINT2[] "P7"}',
    b"$CYLWORKSPACE[1]={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0,Z1 0.0,Z2 0.0,R 0.0,MODE #OFF}",
    b"DECL PDAT PPDAT1={VEL 100.0,ACC 100.0,APO_DIST 50.0}",
    b"DECL E6AXIS XJ={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 0.0,A6 0.0,E1 0.0}",
    b"DECL FRAME PALLET={X 12.5,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}",
    b"DECL LOAD L1={M 26.2,CM {X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}}",
    b"INT N=5",
    b"EXT BAS (BAS_COMMAND :IN,REAL :IN )",
    b";FOLD EXTERNAL DECLARATIONS;%{PE}%MKUKATPBASIS,%CEXT,%VCOMMON,%P",
]


@dataclass
class Text:
    """Bytes with marks: a piece is kept as it is, or is a number (axis 0, 1, 2) to be corrected."""

    pieces: list[tuple[bytes, int | None]] = field(default_factory=list)

    def __iadd__(self, data: bytes) -> Text:
        self.pieces.append((data, None))
        return self

    @property
    def data(self) -> bytes:
        return b"".join(data for data, _ in self.pieces)

    def check(self, result: bytes, shift: np.ndarray, *, some_stay: bool = False) -> None:
        """Require that `result` has every piece again, and numbers moved by the shift where they are marked.

        Where some targets stay, each marked number may also be as it was.
        """
        number = rb"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
        pattern = b"".join(re.escape(data) if axis is None else number for data, axis in self.pieces)
        found = re.fullmatch(pattern, result)
        assert found is not None
        marked = [(data, axis) for data, axis in self.pieces if axis is not None]
        for (old, axis), new in zip(marked, found.groups(), strict=True):
            if some_stay and new == old:
                continue
            assert abs(float(new) - float(old) - shift[axis]) <= 0.501e-3
            if abs(shift[axis]) < 0.499e-3:
                assert new == old


def case(draw: Draw, word: bytes) -> bytes:
    return draw(st.sampled_from([word, word, word.lower(), word.capitalize()]))


def pose(draw: Draw, text: Text, *, corrected: bool) -> None:
    """Write {X …}, in its many dresses."""
    text += b"{" + draw(NO_BLANKS) + draw(st.sampled_from([b"", b"", b"E6POS: ", b"pos:"]))
    for axis, key in enumerate([b"X", b"Y", b"Z", b"A", b"B", b"C"]):
        text += (b"," + draw(NO_BLANKS) if axis else b"") + case(draw, key) + draw(BLANKS)
        text.pieces.append((draw(NUMBER_TOKENS), axis if corrected and axis < 3 else None))
        text += draw(NO_BLANKS)
    text += draw(st.sampled_from([b"", b",S 2,T 10", b",S 'B010',T 'B100010'", b",S 6 ,T 27,E1 0.0,E2 -0.0"]))
    text += b"}"


@st.composite
def programs(draw: Draw) -> tuple[Text, Text]:
    """A pair: .src and .dat."""
    src, dat = Text(), Text()
    names = [b"XP%d" % i for i in range(draw(st.integers(1, 4)))]
    used: set[bytes] = set()

    def line(text: Text, *parts: bytes) -> None:
        text += draw(NO_BLANKS)
        for part in parts:
            text += part
        end(text)

    def end(text: Text) -> None:
        text += draw(REMARKS) + draw(LINE_ENDS)

    line(src, case(draw, b"DEF"), b" cell( )")
    line(src, case(draw, b"$TOOL=$NULLFRAME"))
    line(src, case(draw, b"BAS (#BASE, 0)"))
    opened = 0
    for _ in range(draw(st.integers(0, 12))):
        kind = draw(st.sampled_from(["none", "none", "inline", "named", "circle"]))
        word = case(draw, draw(st.sampled_from(WORDS)).encode())
        approach = draw(st.sampled_from([b"", b" C_DIS", b"\tC_PTP c_dis"]))
        if kind == "none":
            other = draw(st.sampled_from(NO_TARGETS))
            opened += other.startswith(b"IF")
            line(src, other)
        elif kind == "named":
            name = draw(st.sampled_from(names))
            used.add(name)
            line(src, word, draw(BLANKS), case(draw, name), approach)
        else:
            src += draw(NO_BLANKS) + (word if kind == "inline" else case(draw, b"CIRC")) + draw(BLANKS)
            pose(draw, src, corrected=True)
            if kind == "circle":
                src += draw(NO_BLANKS) + b"," + draw(NO_BLANKS)
                pose(draw, src, corrected=True)
                src += draw(st.sampled_from([b"", b", CA 90.5"]))
            src += approach
            end(src)
    for _ in range(opened):
        line(src, case(draw, b"ENDIF"))
    src += b"END" + draw(st.sampled_from([b"", b"\r\n", b"\n\n\x1a"]))

    line(dat, b"DEFDAT CELL PUBLIC")
    for name in names:
        if draw(st.booleans()):
            line(dat, draw(st.sampled_from(DATA[:3] + DATA[5:])))
        dat += draw(st.sampled_from([b"DECL E6POS ", b"decl pos ", b"E6POS\t"])) + case(draw, name) + b"="
        pose(draw, dat, corrected=name in used)
        end(dat)
        if draw(st.booleans()):
            line(dat, b"DECL FDAT F" + name[1:] + b'={TOOL_NO 0,BASE_NO 0,IPO_FRAME #BASE,POINT2[] "' + name + b'"}')
    for other in draw(st.lists(st.sampled_from(DATA), max_size=3, unique=True)):
        line(dat, other)
    dat += b"ENDDAT" + draw(st.sampled_from([b"", b"\r\n"]))
    return src, dat


def write(folder: Path, src: bytes, dat: bytes) -> Path:
    (folder / "cell.src").write_bytes(src)
    (folder / "cell.dat").write_bytes(dat)
    return folder / "cell.src"


def attempt(path: Path, error_map: Any, **more: Any) -> CorrectedProgram | str:
    """Return the corrected program, or our error's message; any other exception is a failure."""
    try:
        return correct_program(path, error_map, **more)
    except TrueposeError as error:
        return str(error)


ANY_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])


@pytest.mark.exhaustive
@ANY_FOLDER
@given(pair=programs())
def test_zero_correction_returns_every_byte(tmp_path: Path, make_map: Any, pair: tuple[Text, Text]) -> None:
    path = write(tmp_path, pair[0].data, pair[1].data)
    for policy in ("skip", "clip"):
        corrected = attempt(path, make_map(), on_guard=policy, options=TRUSTING)
        if isinstance(corrected, str):
            assert "nothing can be corrected" in corrected
            return
        assert list(corrected.files.values()) == [pair[0].data, pair[1].data]


@pytest.mark.exhaustive
@ANY_FOLDER
@given(pair=programs(), shift=st.tuples(*[st.floats(-3, 3)] * 3).map(np.array))
def test_a_correction_changes_the_digits_of_corrected_targets_alone(
    tmp_path: Path, make_map: Any, pair: tuple[Text, Text], shift: np.ndarray
) -> None:
    src, dat = pair
    path = write(tmp_path, src.data, dat.data)
    marked = any(axis is not None for text in pair for _, axis in text.pieces)
    corrected = attempt(path, make_map(shift), options=TRUSTING)
    some_stay = isinstance(corrected, str) and re.search("off the scale|from the base of the robot", corrected)
    if some_stay:
        corrected = attempt(path, make_map(shift), options=TRUSTING, on_guard="skip")
    if isinstance(corrected, str):
        assert "nothing can be corrected" in corrected
        assert not marked or some_stay
        return
    src.check(corrected.files[path], shift, some_stay=bool(some_stay))
    dat.check(corrected.files[path.with_suffix(".dat")], shift, some_stay=bool(some_stay))


REALISTIC_SRC = b"""&ACCESS RVP\r
&REL 12\r
&PARAM TEMPLATE = C:\\KRC\\Roboter\\Template\\vorgabe\r
DEF  panel( )\r
;FOLD INI;%{PE}\r
  ;FOLD BASISTECH INI\r
    GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )\r
    INTERRUPT ON 3\r
    BAS (#INITMOV,0 )\r
  ;ENDFOLD (BASISTECH INI)\r
;ENDFOLD (INI)\r
\r
;FOLD PTP P1 Vel=100 % PDAT1 Tool[3]:bohrer Base[1]:platte;%{PE}%R 8.3.31,%MKUKATPBASIS,%CMOVE,%VPTP,%P 1:PTP, 2:P1\r
$BWDSTART=FALSE\r
PDAT_ACT=PPDAT1\r
FDAT_ACT=FP1\r
BAS(#PTP_PARAMS,100)\r
PTP XP1\r
;ENDFOLD\r
FOR i=1 TO 4\r
  LIN {X 12.5,Y -40.25,Z 300,A 0,B 90,C 0} C_DIS ; \xfcber der Platte\r
  drill(i)\r
ENDFOR\r
SPLINE WITH $VEL.CP=0.25\r
  SPL XP2\r
  SCIRC XP3, {X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}, CA 90.0\r
ENDSPLINE\r
LIN_REL {Z 100}\r
PTP XHOME\r
END\r
\r
DEF drill(n:IN)\r
INT n\r
SWITCH n\r
CASE 1,2\r
  PULSE($OUT[n],TRUE,0.5)\r
DEFAULT\r
  WAIT SEC 0.1\r
ENDSWITCH\r
END\r
"""
REALISTIC_DAT = b"""&ACCESS RVP
DEFDAT  PANEL
EXT BAS (BAS_COMMAND :IN,REAL :IN )
DECL E6POS XP1={X 812.5,Y -40.25,Z 1033.0,A 90.0,B 0.0,C -180.0,S 2,T 10,E1 0.0}
DECL FDAT FP1={TOOL_NO 0,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}
DECL PDAT PPDAT1={VEL 100.000,ACC 100.000,APO_DIST 100.000}
DECL E6POS XP2={X 1.5E2,Y -0.0,Z .25,A 90.0,B -2.6E-14,C -180.0,S 'B010',T 'B001010'}
DECL E6POS XP3={X 10,Y 20,Z 30,A 90.0,B 0.0,C -180.0,S 2,T 10}
ENDDAT"""


def test_the_realistic_program_is_corrected(tmp_path: Path, make_map: Any) -> None:
    corrected = correct_program(write(tmp_path, REALISTIC_SRC, REALISTIC_DAT), make_map([0.5, 0, 0]))
    assert {t.name: t.verdict for t in corrected.targets} == {
        "LIN:21": "correct",
        "SCIRC:26 end": "correct",
        "LIN_REL:28": "skip",
        "XHOME": "skip",
        "XP1": "correct",
        "XP2": "correct",
        "XP3": "correct",
    }
