"""Runs of lines of one form are read, corrected and recorded as line by line, at their edges too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.tiers import examples

from truepose.errors import TrueposeError
from truepose.programs import FrameTable, Program, ReadOptions, Target, correct_program, read_program
from truepose.programs.core import forms
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.digits import without_blanks
from truepose.programs.core.forms import BLANKS, Form, Run, RunFinder
from truepose.programs.core.program import MotionGroups
from truepose.programs.core.source import Source

FRAMES = FrameTable(
    tools={0: np.eye(4), 1: np.eye(4), "drill": np.eye(4)},
    bases={0: np.eye(4), 1: np.eye(4)},
    groups=MotionGroups(1, frozenset([2])),
)
GOOD = st.one_of(
    st.decimals(-99999, 99999, places=3).map(str), st.sampled_from(["0", "-0.0", "+7.25", "1e-3", "12.", "8.5E-1"])
)
FANUC_GOOD = st.one_of(GOOD, st.sampled_from([".858", "-.020", "   .5"]))
METRES = st.one_of(st.decimals(-3, 3, places=5).map(str), st.sampled_from(["0", "-0.0", "+1.25", "1e-3", "1."]))
ODD = st.one_of(
    st.from_regex(r"\A[+-]?[0-9]{1,7}(\.[0-9]{0,17})?([eE][+-]?[0-9]{1,2})?\Z"),
    st.sampled_from(["1.2.3", "12mm", "", "x", "1+2", "p1.trans.x", "-", "1e", "٣", ".5", "1 2", "9E9"]),
)
BLANK = st.sampled_from(["", "", "", " ", "  ", "\t"])


def pick(draw: Any, wild: bool, usual: list[str], *broken: str) -> str:
    """Return one of the usual texts; where it is wild, sometimes another."""
    return draw(st.sampled_from(usual * 6 + list(broken) if wild else usual))


@st.composite
def rapid_line(draw: Any, wild: bool) -> Callable[[Any], str]:
    """Return a maker of lines that are alike, or nearly."""
    words = ["MoveL", "MoveL", "MoveL", "MoveJ", "movel", "TriggL", "!MoveL", "MoveLDO", "IF a MoveL"]
    word = pick(draw, wild, words, "MoveC", "MoveAbsJ", "x: MoveL", "x:=MoveL")
    tools = ["drill", "drill", "tool0", "other", "inner", "drill\\WObj:=wobj0", "drill\\WObj:=fixture", "drill\\Corr"]
    tool = pick(draw, wild, tools, "", "drill{1}", "drill,2")
    unused = "9E9,9E9,9E9,9E9,9E9,9E9"
    axes = pick(draw, wild, [unused] * 5 + ["9E9,9E9,9E9,9E9,9E9,9e9", "5,0,0,0,0,0", "0,0,0,0,0,a"], "1", "[9E9]")
    end = pick(
        draw, wild, [";"] * 6 + ["; ! MoveL", ";;", " ; ", "; MoveL p1,v1,fine,tool0;", "\\x;"], "", ",2;", "];", '";'
    )
    indent, gap = draw(BLANK), draw(BLANK)

    def one(draw: Any) -> str:
        numbers = ",".join(draw(BLANK) + draw(ODD if wild and draw(st.integers(0, 9)) == 0 else GOOD) for _ in range(3))
        rotations = ["1,0,0,0", "0.5,0.5,-0.5,0.5", "0.707107, 0,0.707107,0", "-1,0,0,0", " 1.0,0, 0,0.0"]
        quaternion = pick(draw, wild, rotations, "1,1,0,0", "0,0,0", "[1],0,0,0", "1,0,0,.0")
        words = ["0,0,0,0"] * 4 + ["-1,0,-2,1", "0,1,0,0", "+1,0,0,0", "01,0,0,0", "1,-0,0,0", "0, 1.0,0,0", "a,0,0,0"]
        speed = pick(
            draw, wild, ["v100,fine"] * 3 + ["v5,z10", "vmax,z1", "v200\\V:=5,z10", "v9,own{2}", "[1,2,3,4],fine"], "v5"
        )
        tail = f"[{pick(draw, wild, words, '0,0,0')}],[{axes}]],{gap}{speed},{tool}{end}"
        return f"{indent}{word} [[{numbers}],[{quaternion}],{tail}"

    return one


@st.composite
def ur_line(draw: Any, wild: bool) -> Callable[[Any], str]:
    """Return a maker of lines that are alike, or nearly."""
    words = ["movel", "movel", "movel", "movep", "movej", "servoj", "#movel", "x=movel", "own", "x = 1+movel"]
    word = pick(draw, wild, words, "movec", "p1=movel")
    end = pick(draw, wild, [")"] * 5 + [") # movel(", ")  ", ', "a")', ")\tmovel(p[0,0,0,0,0,0])"], "", "))", ", own)")
    indent, gap = draw(BLANK), draw(BLANK)

    def one(draw: Any) -> str:
        numbers = [draw(ODD if wild and draw(st.integers(0, 9)) == 0 else METRES) for _ in range(3)]
        turn = pick(draw, wild, ["0,0,0", "0,3.14,0", "-1.5, +2,1e-3", "9,0,0", "a,0,0"], "0,90,0", "0,0", "0,0,0,0")
        tail = pick(
            draw, wild, [", a=1.2, v=0.25"] * 4 + [", a=1, v=2,r=0.001", "", ",a=x", ",1.2,0.25", ", v=2e3"], ","
        )
        return f"{indent}{word}({gap}p[{', '.join(numbers)},{draw(BLANK)}{turn}]{tail}{end}"

    return one


@st.composite
def fanuc_parts(draw: Any) -> str:
    """Return a FANUC program whose positions and motions are alike, or nearly."""
    wild = draw(st.integers(0, 3)) == 0
    numbers = draw(st.lists(st.integers(1, 30), unique=True, min_size=1, max_size=12))
    numbers = sorted(numbers) if draw(st.booleans()) else numbers
    positions, motions, first = [], [], 1
    while first <= len(numbers):
        frames = pick(
            draw, wild, ["UF : 0, UT : 1"] * 4 + ["UF : 1, UT : 1", "UF : F, UT : 1", "UF : 0, UT : 7"], "UF : 0"
        )
        config = draw(st.sampled_from(["N U T, 0, 0, 0", "F U T, 0, 0, -1"]))
        shape = pick(draw, wild, ["{}"] * 8 + ["{}:x", '{}:"a"', " {}"], "0{}", "R[{}]")
        more = pick(
            draw,
            wild,
            [""] * 8
            + [",\tE1 = 5.0 mm", ",\n\tJ1 = 5.0 deg", "\n  GP2:\n UF : 0, UT : 1,\n J1 = @ deg"]
            + ["\n  GP2:\n\tUF : 0, UT : 1,\t\n\tJ1=  @ deg,\tJ2 = @ mm"],
            "X = 1 mm",
        )
        units = pick(draw, wild, ["mm"] * 9, "deg", "")
        group, end = (
            pick(draw, wild, ["GP1"] * 6 + ["GP2", "gp1"], ""),
            pick(draw, wild, ["};"] * 6 + ["}", "} ;", "};\n"], ""),
        )
        count = draw(st.integers(1, 6))
        for number in numbers[first - 1 : first - 1 + count]:
            values = [draw(ODD if wild and draw(st.integers(0, 9)) == 0 else FANUC_GOOD) for _ in range(6)]
            values = [
                "********" if draw(st.integers(0, 40)) == 0 else text.rjust(draw(st.sampled_from([1, 9])))
                for text in values
            ]
            x, y, z, w, p, r = values
            axes = more.replace("@", draw(FANUC_GOOD))
            positions.append(
                f"P[{shape.format(number)}]{{\n   {group}:\n\t{frames},\t\tCONFIG : '{config}',\n\tX = {x}  {units},"
                f"\tY = {y}  mm,\tZ = {z}  mm,\n\tW = {w} deg,\tP = {p} deg,\tR = {r} deg{axes}\n{end}"
            )
        first += count
    words = ["L P[{}] 100mm/sec FINE    ;", "J P[{}] 50% CNT100 ;", "L P[{}] 9mm/sec CNT 50;"]
    words += ["L P[{}] 9mm/sec CNT100 COORD    ;"]
    words = words if draw(st.booleans()) else [draw(st.sampled_from(words))]
    others = [
        *(
            "L P[{}] 5mm/sec FINE Offset,PR[1] ;",
            "C P[{}]\n : P[3] 5mm/sec FINE ;",
            "A P[{}] 5mm/sec FINE ;",
            "PR[1]=P[{}] ;",
        ),
        *(
            "P[{}]=LPOS ;",
            "UTOOL_NUM=2 ;",
            "UTOOL_NUM=1 ;",
            "UFRAME_NUM=1 ;",
            "CALL FAR ;",
            "L P[R[1]] 5mm/sec FINE ;",
            "! P[{}] ;",
        ),
        *(
            "LBL[1] ;",
            "JMP LBL[1] ;",
            "L P[{}:x] 5mm/sec FINE ;",
            "R[1]=1",
            "IF R[1]=1 THEN ;\n : ENDIF ;",
            "L P[99] 5mm/sec FINE ;",
        ),
    ]
    line, odd = 1, draw(st.sampled_from([0, 0, 1, 8]))
    again = draw(st.lists(st.sampled_from(numbers), max_size=3)) if draw(st.booleans()) else []
    for number in [*(numbers if draw(st.booleans()) else draw(st.permutations(numbers))), *again]:
        text = draw(st.sampled_from(others if draw(st.integers(1, 16)) <= odd else words)).format(number)
        motions.append(f"{line:4d}:{text}")
        line += 1
    text = "\n".join(["/PROG A", "/MN", "   1:  UFRAME_NUM=0 ;", *motions, "/POS", *positions, "/END", ""])
    return text.replace("\n", draw(st.sampled_from(["\n", "\r\n", "\r"])))


@st.composite
def bodies(draw: Any, maker: Any, between: tuple[str, ...], broken: tuple[str, ...]) -> str:
    """Return lines of a few forms, some of them repeated often, with other lines between."""
    wild = draw(st.integers(0, 3)) == 0
    lines: list[str] = []
    for one in draw(st.lists(maker(wild), min_size=1, max_size=4)):
        lines += [one(draw) for _ in range(draw(st.integers(1, 6)))]
        lines += draw(st.lists(st.sampled_from(between + broken if wild else between), max_size=2))
    ends = draw(st.sampled_from([["\n"], ["\r\n"], ["\n", "\r\n", "\r", "\n\n"]]))
    return "".join(line + draw(st.sampled_from(ends)) for line in lines)


RAPID = (
    "MODULE M\nTASK PERS tooldata drill:=[TRUE,[[0,0,90],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
    "LOCAL CONST robtarget p1:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    "PROC main(PERS tooldata inner)\n%sENDPROC\nPROC own()\nENDPROC\nENDMODULE\n"
)
RAPID_BETWEEN = (
    *("MoveL p1,v5,fine,drill;", "PDispOff;", "PDispSet d;", "! x", "IF a THEN\nENDIF", "own;", "far;", "IF b"),
    *("GOTO end;\nend:", "RETURN;", "SoftAct 1,5;", "d:=p1;"),
)
RAPID_BROKEN = ("ENDIF", "IF a THEN", "ENDPROC", "ENDMODULE", "x:=[", '"')
UR = "p1 = p[1,2,3,0,0,0]\ndef own(x):\nend\ndef main():\nset_tcp(p[0,0,0.1,0,0,0])\n%send\n"
UR_BETWEEN = ("movel(p1)", "set_tcp(p[0,0,0.2,0,0,0])", "# x", "own(p1)", "force_mode(1)", "x = [1,\n2]", "if x:\nend")
UR_BROKEN = ("if x:", "end", "x = [1,", "'", "def own():", "thread t():")


def facts(program: Program) -> list[Any]:
    names = [f.name for f in fields(Target) if not f.name.startswith("tf_")]
    found: list[Any] = [tuple(getattr(target, name) for name in names) for target in program.targets]
    frames = [(t.tf_base_frame, t.tf_flange_tool) for t in program.targets]
    found += [[None if tf is None else tf.tobytes() for tf in pair] for pair in frames]
    return [*found, program.circles, *(part.tolist() for part in program.targets.motions)]


def told(path: Path, make_map: Any, fewest: int, options: ReadOptions | None = None) -> list[Any]:
    """Return all targets, and the bytes of the corrected program and its record."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(forms, "FEWEST", fewest)
        try:
            program = read_program(path, FRAMES, options)
            found = facts(program)
            corrected = correct_program(program, make_map([0.5, -0.25, 0.125]), on_guard="skip")
        except TrueposeError as error:
            return [str(error)]
        return [*found, corrected.files, corrected.to_csv(), corrected.to_dict()]


@pytest.mark.exhaustive
@settings(max_examples=examples(150), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    body=bodies(rapid_line, RAPID_BETWEEN, RAPID_BROKEN),
    options=st.sampled_from([ReadOptions(), ReadOptions(external_axes=True)]),
)
def test_rapid_runs_and_single_lines_agree(
    body: str, options: ReadOptions, tmp_path_factory: pytest.TempPathFactory, make_map: Any
) -> None:
    path = tmp_path_factory.mktemp("runs") / "a.mod"
    path.write_bytes((RAPID % body).encode())
    assert told(path, make_map, 1, options) == told(path, make_map, 10**9, options)


@pytest.mark.exhaustive
@settings(max_examples=examples(150), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(body=bodies(ur_line, UR_BETWEEN, UR_BROKEN))
def test_urscript_runs_and_single_lines_agree(
    body: str, tmp_path_factory: pytest.TempPathFactory, make_map: Any
) -> None:
    path = tmp_path_factory.mktemp("runs") / "a.script"
    path.write_bytes((UR % body).encode())
    assert told(path, make_map, 1) == told(path, make_map, 10**9)


@pytest.mark.exhaustive
@settings(max_examples=examples(300), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=fanuc_parts())
def test_fanuc_runs_and_single_lines_agree(text: str, tmp_path_factory: pytest.TempPathFactory, make_map: Any) -> None:
    path = tmp_path_factory.mktemp("runs") / "a.ls"
    path.write_bytes(text.encode())
    assert told(path, make_map, 1) == told(path, make_map, 10**9)


LINES = {
    "a.mod": (
        RAPID,
        "  MoveL [[{:.3f},{:.3f},{:.3f}],[1,0,0,0],[{k},0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v{v},z10,drill;",
    ),
    "a.script": (UR, "  movel(p[{:.6f}, {:.6f},{:.6f}, 0.1, 0, 0], a=1.2, v=0.{v})"),
}


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("name", LINES)
@pytest.mark.exhaustive
def test_a_long_program_is_read_in_runs(tmp_path: Path, make_map: Any, name: str, ending: str) -> None:
    frame, line = LINES[name]
    rows = np.random.default_rng(1).uniform(-180, 180, (2_500, 3))
    lines = [line.format(*row, k=i % 3 - 1, v=i % 4 + 1) for i, row in enumerate(rows)]
    path = tmp_path / name
    path.write_text((frame % "\n".join([*lines, ""])).replace("\n", ending), newline="")
    program = read_program(path, FRAMES)
    pieces = [piece for piece, _ in program.targets._pieces]
    assert [type(piece) for piece in pieces if len(piece) > 1] == [Run] * 2
    assert told(path, make_map, 16) == told(path, make_map, 10**9)


@pytest.mark.exhaustive
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_a_long_fanuc_program_is_read_in_runs(tmp_path: Path, make_map: Any, ending: str) -> None:
    n, frames = 2_500, "UF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0'"
    motions = [f"{k + 3:4d}:L P[{k}] 100mm/sec CNT{k % 100}    ;" for k in range(1, n + 1)]
    positions = [
        f"P[{k}]{{\n   GP1:\n\t{frames},\n\tX = {x:9.3f}  mm,\tY = {y:9.3f}  mm,\tZ = {z:9.3f}  mm,\n\t"
        "W = 180.0 deg,\tP = 0.0 deg,\tR = 0.0 deg\n};"
        for k, (x, y, z) in enumerate(np.random.default_rng(1).uniform(-1800, 1800, (n, 3)), 1)
    ]
    path = tmp_path / "a.ls"
    motions[1_000] += "\n  :PR[1]=P[7] ;"
    text = "\n".join(["/PROG A", "/MN", *motions, "/POS", *positions, "/END", ""])
    path.write_text(text.replace("\n", ending), newline="")
    pieces = [piece for piece, _ in read_program(path, FRAMES).targets._pieces]
    assert [(type(piece), len(piece)) for piece in pieces if len(piece) > 1] == [
        (TargetColumns, 7),
        (Run, 2041),
        (Run, 452),
    ]
    assert told(path, make_map, 16) == told(path, make_map, 10**9)


@pytest.mark.parametrize(
    ("name", "bad"), [("a.mod", "[1,1,0,0],[0,0,0,0]"), ("a.script", "90, 0, 0]")], ids=["quaternion", "degrees"]
)
def test_a_wrong_orientation_in_a_run_is_named_with_its_line(tmp_path: Path, name: str, bad: str) -> None:
    frame, line = LINES[name]
    lines = [line.format(k, 2, 3, k=0, v=1) for k in range(100)]
    good = {"a.mod": "[1,0,0,0],[0,0,0,0]", "a.script": "0.1, 0, 0]"}[name]
    lines[70] = lines[70].replace(good, bad)
    path = tmp_path / name
    path.write_text(frame % "\n".join([*lines, ""]))
    at = 1 + next(k for k, text in enumerate(path.read_text().splitlines()) if bad in text)
    with pytest.raises(TrueposeError, match=rf":{at}: Move.*length|:{at}: movel.*length"):
        read_program(path, FRAMES)


def test_holes_are_found_again() -> None:
    form = Form([b"P ", b" mm, Q=", b";\n"], [BLANKS + forms.NUMBER] * 2)
    data = b"x\nP 1.5 mm, Q=  -2e-3;\nP  7 mm, Q=0;\nP 7 mm, Q=;\n"
    end, count = form.follow(data, 2)
    assert (count, data[end:]) == (2, b"P 7 mm, Q=;\n")
    spans = without_blanks(data, form.spans(data, 2, end))
    assert [[data[a:b] for a, b in item] for item in spans.tolist()] == [[b"1.5", b"-2e-3"], [b"7", b"0"]]
    with pytest.raises(ValueError, match="separates"):
        Form([b"P ", b" ", b";\n"], [forms.NUMBER] * 2)


def test_short_runs_are_no_runs() -> None:
    import re

    line = re.compile(rb"P ([0-9])\n")
    source = Source(Path("a"), b"P 1\n" * 15 + b"Q\n" + b"P 1\n" * 20)
    finder = RunFinder(source, line, {1: b"[0-9]"})
    assert finder.find(0) is None
    assert finder.find(4) is None
    found = finder.find(62)
    assert found is not None
    assert (found.line, found.start, found.end, found.items) == (17, 62, 142, 20)
