"""Random RAPID programs, executed directly: what a correction changes are the motions that it was judged for.

``TRUEPOSE_EXECUTED_PROGRAMS`` gives their number in the second tier.
"""

from __future__ import annotations

import os
from pathlib import Path
from random import Random

import pytest
from tests.programs.executors.rapid_check import Found, check, executed, read, reduced, still_wrong, text_of
from tests.programs.executors.rapid_programs import random_task

from truepose.programs import ReadOptions

MANY = int(os.environ.get("TRUEPOSE_EXECUTED_PROGRAMS", "2000"))


def execute(folder: Path, seed: int) -> Found:
    """Execute a random program; one that is corrected wrongly is reduced first."""
    dice = Random(seed)
    modules = random_task(dice)
    options = ReadOptions(whole_task=True, derived=dice.random() < 0.5)
    found = check(folder, {name: text_of(lines) for name, lines in modules.items()}, options, seed)
    if found.wrong:
        small = reduced(modules, still_wrong(folder, options, seed))
        wrong = check(folder, small, options, seed, runs=30).wrong
        pytest.fail(f"seed {seed}, derived={options.derived}: {wrong}\n" + "\n".join(small.values()))
    return found


def execute_all(folder: Path, seeds: range) -> None:
    found = [execute(folder, seed) for seed in seeds]
    assert sum(one.corrected for one in found) > len(seeds)
    assert sum(one.moved for one in found) > 10 * len(seeds)


def test_random_programs(tmp_path: Path) -> None:
    execute_all(tmp_path, range(16))


@pytest.mark.exhaustive
def test_many_random_programs(tmp_path: Path) -> None:
    execute_all(tmp_path, range(1000, 1000 + MANY))


TASK = """MODULE m
PERS tooldata t1:=[TRUE,[[0,0,120],[1,0,0,0]],[2,[0,0,60],[1,0,0,0],0,0,0]];
PERS wobjdata w1:=[FALSE,TRUE,"",[[850,-200,300],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
PERS wobjdata w2:=[FALSE,TRUE,"",[[950,-200,300],[0,0,0,1]],[[0,0,0],[1,0,0,0]]];
CONST robtarget p1:=[[100,50,20],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
VAR num h;
PROC main()
{}
MoveL p1,v100,z10,t1\\WObj:=w1;
ENDPROC
ENDMODULE
"""


@pytest.mark.parametrize(
    ("code", "wrong"),
    [
        ("PDispSet [[0,0,30],[1,0,0,0]];", "displaced"),
        ("CorrCon id1;", "displaced"),
        ("MoveL p1,v100,z10,t1\\WObj:=w2;", "the shift of no target in its frame"),
        ("MoveL Offs(p1,0,0,5),v100,z10,t1\\WObj:=w1;", "not a position of p1"),
        ("w1.oframe.trans.z:=5;", "other numbers of w1"),
        ("h:=p1.trans.z; SetAO ao1,h;", "became"),
        ("IF p1.trans.z>5 Stop;", "became"),
        ("w1.oframe.trans.z:=p1.trans.z;", "the frame or tool has other numbers"),
        ("WHILE p1.trans.z>20 DO RETURN; ENDWHILE", "became"),
    ],
)
def test_a_wrong_correction_is_noticed(tmp_path: Path, code: str, wrong: str) -> None:
    comment = TASK.format(f"!{code[1:]}")  # the reader gets it as a comment, so that p1 is corrected
    program = read(tmp_path, {"m.mod": comment}, ReadOptions(whole_task=True))
    assert [target.verdict for target in program.targets] == ["correct"]
    assert wrong in executed({"m.mod": TASK.format(code)}, program, 1).wrong
    assert not executed({"m.mod": comment}, program, 1).wrong
    assert executed({"m.mod": comment}, program, 1).moved > 0
