"""FANUC programs that move several groups: positioners, and further robots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.programs.corpus_fanuc import LP
from tests.programs.corpus_fanuc import ls as program_text

from truepose.cell import Cell, template
from truepose.errors import FileError
from truepose.geometry import euler, make_transform
from truepose.programs import FrameTable, Program, correct_program, read_program
from truepose.programs.core.program import MotionGroups

TURNED = make_transform(euler("fanuc", [0.0, 0.0, 90.0]), [1000.0, 0.0, 0.0])
TOOLS: dict[int | str, Any] = {1: np.eye(4), "gp2-1": np.eye(4)}
BASES: dict[int | str, Any] = {1: np.eye(4), "gp2-1": TURNED}
ALONE = MotionGroups()
WITH_TABLE = MotionGroups(1, frozenset([2]))
SECOND = MotionGroups(2, frozenset([1]))
TABLE = "   GP2:\n\tUF : 1, UT : 1,\t\n\tJ1=    30.000 deg,\tJ2=   -15.000 deg\n"
ROBOT = f"   GP2:\n\tUF : 1, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n\t{LP.replace('812.500', '600.000')}\n"


def both(n: int, other: str = TABLE) -> str:
    return f"P[{n}]{{\n   GP1:\n\tUF : 1, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n\t{LP}\n{other}}};\n"


def read(
    tmp_path: Path, lines: str, positions: str, groups: MotionGroups = ALONE, mask: str = "1,1,*,*,*", **more: Any
) -> Program:
    path = tmp_path / "g.ls"
    numbered = "".join(f"{k:>4}:{line} ;\n" for k, line in enumerate(lines.split("\n"), 1))
    path.write_bytes(program_text(numbered, positions).replace("1,*,*,*,*", mask).encode())
    return read_program(path, FrameTable(TOOLS, BASES, groups=groups), **more)


def verdicts(program: Program) -> dict[str, str]:
    return {target.name: target.verdict for target in program.targets}


def test_coordinated_motions_need_a_statement_about_the_other_group(tmp_path: Path) -> None:
    lines = "J P[1] 100% FINE\nL P[2] 100mm/sec CNT100 COORD\nC P[3] P[4] 20mm/sec FINE COORD"
    positions = "".join(map(both, (1, 2, 3, 4)))
    program = read(tmp_path, lines, positions)
    assert set(verdicts(program).values()) == {"refuse"}  # a frame that group 2 carries counts for P[1], too
    assert program.targets[1].reason == (
        "COORD: moves together with group 2; if this carries neither the robot nor a user frame of its targets, "
        "add it to [frames.groups] independent of the cell file"
    )
    assert set(verdicts(read(tmp_path, lines, positions, WITH_TABLE)).values()) == {"correct"}
    assert set(verdicts(read(tmp_path, lines, positions, MotionGroups(1, frozenset([3])))).values()) == {"refuse"}


def test_motions_without_coordination(tmp_path: Path) -> None:
    positions = both(1) + both(2)
    assert set(verdicts(read(tmp_path, "J P[1] 9% FINE\nL P[2] 9mm/sec FINE", positions)).values()) == {"correct"}
    stated = MotionGroups(1, frozenset([3]))  # group 2 is left out on purpose
    assert set(verdicts(read(tmp_path, "J P[1] 9% FINE", positions, stated)).values()) == {"refuse", "skip"}


def test_the_header_tells_who_moves_where_a_position_does_not(tmp_path: Path) -> None:
    alone = both(1, other="")
    lines = "L P[1] 9mm/sec FINE COORD"
    assert verdicts(read(tmp_path, lines, alone, WITH_TABLE)) == {"P[1]": "correct"}
    assert verdicts(read(tmp_path, lines, alone, WITH_TABLE, mask="1,1,1,*,*")) == {"P[1]": "refuse"}
    assert verdicts(read(tmp_path, lines, alone, WITH_TABLE, mask="1,*,*,*,*")) == {"P[1]": "refuse"}


def test_the_robot_of_the_map_may_be_another_group(tmp_path: Path, make_map: Any) -> None:
    lines = "UFRAME_NUM[GP1]=3\nUFRAME_NUM[GP2]=1\nJ P[1] 9% FINE"
    program = read(tmp_path, lines, both(1, ROBOT), SECOND)
    (target,) = program.targets
    assert (target.verdict, target.frame, target.tool) == ("correct", "UFRAME[GP2:1]", "UTOOL[GP2:1]")
    np.testing.assert_allclose(program.positions_base(), [[1040.25, 600.0, 1033.0]])
    patched = correct_program(program, make_map([0.0, 0.25, 0.0])).files[program.path]
    before = (tmp_path / "g.ls").read_bytes()
    assert patched == before.replace(b"600.000", b"600.250")  # of group 2 alone
    assert verdicts(read(tmp_path, "J P[1] 9% FINE", both(1, other=""), SECOND)) == {"P[1]": "skip"}
    assert verdicts(read(tmp_path, "UFRAME_NUM[GP2]=3\nJ P[1] 9% FINE", both(1, ROBOT), SECOND)) == {"P[1]": "refuse"}


@pytest.mark.parametrize(
    ("change", "first", "second"),
    [
        ("UFRAME[1]=PR[1]", "refuse", "refuse"),
        ("UFRAME[GP2:1]=PR[1]", "correct", "refuse"),
        ("$MNUFRAME[2,1]=PR[1]", "correct", "refuse"),
        ("$MNUFRAME[1,1]=PR[1]", "refuse", "correct"),
        ("$MNUFRAME[R[1],1]=PR[1]", "refuse", "refuse"),
        ("$GROUP[2].$UFRAME=PR[1]", "correct", "refuse"),
        ("$MNUFRAMENUM[2]=3", "correct", "refuse"),
        ("UFRAME_NUM=3", "refuse", "refuse"),
        ("UFRAME_NUM[GP1,GP2]=3", "refuse", "refuse"),
    ],
)
def test_frames_belong_to_a_group(tmp_path: Path, change: str, first: str, second: str) -> None:
    lines = f"{change}\nJ P[1] 9% FINE"
    assert verdicts(read(tmp_path, lines, both(1, ROBOT)))["P[1]"] == first
    assert verdicts(read(tmp_path, lines, both(1, ROBOT), SECOND))["P[1]"] == second


@pytest.mark.parametrize("kind", ["Independent", "Simultaneous"])
def test_one_motion_for_each_group(tmp_path: Path, kind: str) -> None:
    lines = f"{kind} GP\n    :  GP1 L P[1] 9mm/sec FINE\n    :  GP2 J P[2] 100% FINE"
    positions = both(1, ROBOT) + both(2, ROBOT)
    path = tmp_path / "g.ls"
    path.write_text(program_text(f"   1:  {lines} ;\n", positions))
    for groups, moved in ((ALONE, "P[1]"), (SECOND, "P[2]")):
        program = read_program(path, FrameTable(TOOLS, BASES, groups=groups))
        assert {t.name: t.motions for t in program.targets if t.verdict == "correct"}.keys() == {moved}


def test_the_cell_file_states_the_groups() -> None:
    text = template("fanuc-m10ia")
    assert FrameTable.from_cell(Cell.from_toml(text)).groups == ALONE
    stated = Cell.from_toml(f"{text}\n[frames.groups]\nrobot = 2\nindependent = [1, 3]\n")
    assert FrameTable.from_cell(stated).groups == MotionGroups(2, frozenset([1, 3]))
    again = Cell.from_toml(stated.to_toml())
    assert FrameTable.from_cell(again).groups == MotionGroups(2, frozenset([1, 3]))
    for wrong, message in (("robot = 0", "robot"), ("independent = [1]", "group 1 is this robot")):
        with pytest.raises(FileError, match=message):
            Cell.from_toml(f"{text}\n[frames.groups]\n{wrong}\n")
