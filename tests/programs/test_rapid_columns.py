"""RAPID robtargets whose names differ in a number are read, corrected and recorded in runs as one by one."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.programs.test_runs import FRAMES, told
from tests.tiers import examples

from truepose.programs import ReadOptions, read_program
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.forms import Run

UNUSED = "[9E9,9E9,9E9,9E9,9E9,9E9]"
NAMES = ("p{}", "p0{}", "Target_{}", "aPose{}", "p{}")
OTHERS = (
    *("MoveL {},v5,fine,drill\\WObj:=wobj0;", "MoveL Offs({},0,0,5),v5,fine,drill;", "x:={}.trans.x;", "{}:=q;"),
    *('GetDataVal "{}",q;', "GetDataVal n,q;", 'SetDataVal "{}",q;', "SetDataVal n,q;", "own {};", "PDispSet d;"),
    *("MoveC {},p1,v5,fine,drill;", "MoveL {}\\ID:=5,v5,fine,drill;", "MoveL p 1,v5,fine,drill;", "PDispOff;"),
    *("MoveJ {},v5,fine,other;", "IF a THEN\nENDIF", "MoveL p99,v5,fine,drill;", "SearchL d,{},{},v5,drill;"),
    *("VAR robtarget p2;", "VAR num p3;", "MoveL {}\\Corr,v5,fine,drill;", "%n%;", "MoveL {},v5,fine,drill{{1}};"),
)
DATA = (
    "CONST robtarget p1:=[[1,2,3],[1,0,0,0],[0,0,0,0],{0}];",
    "PERS robtarget p2:=[[1,2,3],[1,0,0,0],[0,0,0,0],{0}];",
    *("LOCAL CONST robtarget p3:=[[1,2,3],[1,0,0,0],[0,0,0,0],{0}];", "VAR num p4;", "LOCAL VAR num p5;"),
    *("CONST robtarget q:=p2;", "CONST jointtarget p5:=[[1,2,3,4,5,6],{0}];"),
)


@st.composite
def tasks(draw: Any) -> list[str]:
    """Return the modules of a task: robtargets in runs, and motions to them, in the same module or another."""
    first = draw(st.integers(1, 4))
    numbers = draw(st.permutations(range(first, first + draw(st.integers(1, 14)))))
    scope, name = draw(st.sampled_from(["", "", "LOCAL "])), draw(st.sampled_from(NAMES))
    declared, moves = [], []
    for number in numbers if draw(st.booleans()) else sorted(numbers):
        xyz = ",".join(draw(st.decimals(-999, 999, places=3).map(str)) for _ in range(3))
        rotations = ["0.5,0.5,0.5,0.5", "0,1, 0,0", "2,0,0,0"] if number == 3 else []
        q = draw(st.sampled_from(["1,0,0,0"] * 12 + rotations))
        axes = draw(st.sampled_from([UNUSED] * 15 + ["[5,9E9,9E9,9E9,9E9,9E9]"]))
        word = draw(st.sampled_from(["0,0,0,0"] * 3 + ["-1,0,1,0"]))
        declared.append(f"  {scope}CONST robtarget {name.format(number)}:=[[{xyz}],[{q}],[{word}],{axes}];")
    more = draw(st.lists(st.sampled_from(DATA), max_size=2)) if draw(st.booleans()) else []
    odd = draw(st.sampled_from([0, 0, 1, 6]))
    again = draw(st.lists(st.sampled_from(numbers), max_size=3)) if draw(st.booleans()) else []
    line = draw(st.sampled_from(["MoveL {},v{},fine,drill;", "MoveJ {},v{},z5,drill\\WObj:=wobj0;"]))
    for number in [*sorted(numbers), *again]:
        text = line.format(name.format(number), draw(st.sampled_from([5, 10])))
        if draw(st.integers(1, 16)) <= odd:
            text = draw(st.sampled_from(OTHERS)).format(name.format(number), name.format(number))
        moves.append(f"    {text.swapcase() if odd == 6 and draw(st.booleans()) else text}")
    head = draw(st.sampled_from(["PROC main()"] * 4 + [f"PROC main(robtarget {name.format(first)})"]))
    data = "\n".join([*declared, *(one.format(UNUSED) for one in more)])
    body = "\n".join([head, *moves, "ENDPROC", "PROC own(INOUT robtarget p)", "ENDPROC"])
    if draw(st.booleans()):
        return [f"MODULE A\n{data}\n{body}\nENDMODULE\n"]
    return [f"MODULE A\n{data}\nENDMODULE\n", f"MODULE B\n{body}\nENDMODULE\n"]


@pytest.mark.exhaustive
@settings(max_examples=examples(100), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    modules=tasks(),
    options=st.sampled_from([ReadOptions(), ReadOptions(whole_task=True), ReadOptions(derived=True)]),
)
def test_runs_of_names_and_single_lines_agree(
    modules: list[str], options: ReadOptions, tmp_path_factory: pytest.TempPathFactory, make_map: Any
) -> None:
    folder = tmp_path_factory.mktemp("runs")
    for name, text in zip("ab", modules, strict=False):
        (folder / f"{name}.mod").write_text(text)
    path = folder if len(modules) > 1 else folder / "a.mod"
    assert told(path, make_map, 1, options) == told(path, make_map, 10**9, options)


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.exhaustive
def test_a_long_path_of_names_is_read_in_runs(tmp_path: Path, make_map: Any, several: bool) -> None:
    rows = np.random.default_rng(1).uniform(-180, 180, (2_500, 3))
    data = [
        f"  CONST robtarget Target_{k}0:=[[{x:.3f},{y:.3f},{z:.3f}],[1,0,0,0],[{k % 2},0,0,0],{UNUSED}];"
        for k, (x, y, z) in enumerate(rows, 1)
    ]
    moves = [f"  MoveL Target_{k}0,v{k % 3 + 1}0,z10,drill\\WObj:=wobj0;" for k in range(1, 2_501)]
    moves[1_000] += "\nx:=Target_70.trans.x;"
    between = ["ENDMODULE", "MODULE B"] if several else []
    text = "\n".join(["MODULE A", *data, *between, "PROC main()", *moves, "ENDPROC", "ENDMODULE", ""])
    for name, part in zip("ab", text.split("ENDMODULE\n"), strict=False):
        if part:
            (tmp_path / f"{name}.mod").write_text(part + "ENDMODULE\n")
    program = read_program(tmp_path, FRAMES)
    pieces = [piece for piece, _ in program.targets._pieces]
    assert Counter((type(piece), len(piece)) for piece in pieces) == {
        (TargetColumns, 7): 1, (Run, 2041): 1, (Run, 452): 1,
    }  # fmt: skip
    assert program.counts() == {"correct": 2_499, "skip": 0, "refuse": 1}
    assert told(tmp_path, make_map, 5) == told(tmp_path, make_map, 10**9)
