"""Reasons of one kind are one, whatever points, files, lines and numbers they name; those of frames are not."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from tests.programs.backups import small
from tests.programs.backups.test_makers import CORPORA
from tests.programs.conftest import FakeMap

from truepose.errors import RefusedError
from truepose.programs import FrameTable, Program, ReadOptions, correct_program, read_programs
from truepose.programs.core.program import MotionGroups
from truepose.programs.core.reasons import group_reasons, kind_of


@pytest.fixture(scope="module", params=CORPORA)
def backup(request: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The backup of a maker, as a .zip."""
    folder = tmp_path_factory.mktemp("backup")
    path = folder / "cell.zip"
    path.write_bytes(small.packed(CORPORA[request.param](folder / "made")))
    return path


def programs(backup: Path, **options: Any) -> list[Program]:
    found = read_programs([backup], FrameTable(groups=MotionGroups(1, frozenset([2]))), ReadOptions(**options))
    assert not found.unreadable
    return found.programs


def own_words(program: Program) -> re.Pattern[str]:
    """Return the names of the points and files of a program, and numbers of lines."""
    names = {target.name for target in program.targets if not target.name.isdigit()}
    files = {source.path.name for source in program.sources}
    words = "|".join(re.escape(word) for word in sorted(names | files, key=len, reverse=True))
    return re.compile(rf"(?<![\w.$])(?:{words})(?![\w(])|line \d")


@pytest.mark.parametrize("derived", [False, True])
@pytest.mark.sampled(1)
def test_kinds_of_reasons_name_no_point_no_file_and_no_line(backup: Path, derived: bool) -> None:
    seen = 0
    for program in programs(backup, derived=derived):
        words = own_words(program)
        try:
            why = correct_program(program, FakeMap(), on_guard="skip").targets.why
        except RefusedError:  # nothing of it can be corrected
            why = {}
        for reason in {*(target.reason for target in program.targets), *why.values()} - {""}:
            seen += 1
            assert not words.search(kind_of(reason)), reason
    assert seen


@pytest.mark.sampled(1)
def test_a_backup_has_few_kinds_of_reasons(backup: Path) -> None:
    left = [target for program in programs(backup) for target in program.targets if target.reason]
    groups = group_reasons(left)
    assert sum(len(group.targets) for group in groups) == len(left)
    assert len(groups) <= 12 < len(left)
    assert any(not group.alike for group in groups)


ALIKE = """
both moved to (a.src, line 4) and read by arithmetic (line 3): XAP = XPICK + (0, 0, 50) mm; --derived corrects both
both moved to (line 9) and read by arithmetic (line 7): LIN:26 = X2 + (0, 0, -8) mm; --derived corrects both

derived from XP1: it gets the correction of that point
derived from X2, X3: it gets the correction of that point

derived from P[1] (line 3), which is left out: joint target
derived from pGo (line 7), which is left out: joint target

its circle's other point XP5 is not corrected
its circle's other point CIRC:7 is not corrected

moved to under wA (a.mod, line 3) and wB (b.mod, line 4): teach two points
moved to under wC (c.mod, line 5) and wobj0 (c.mod, line 6): teach two points

SFTON (line 21 of SEARCH.JBI) shifts it at run time
SFTON (line 4 of ON.JBI) shifts it at run time

P007 is a variable of all jobs: OTHER.JBI, line 10, uses it, too
P012 is a variable of all jobs: A.JBI, line 1, uses it, too

position register, which LAYERS may write: known at run time only
position register, which MAIN may write: known at run time only

Touch Offset PR[30:Found] (line 28) may shift it at run time
Touch Offset PR[7] (line 2) may shift it at run time

moved to (line 35) and, in line 34, Offset: shifted by a register: teach two points
moved to (a.ls, line 3) and, in b.ls, line 4, Offset: shifted by a register: teach two points

at the position that is derived from it, LIN:26 = XP1 + (0, 0, 5) mm, the correction differs by 0.3 mm
at the position that is derived from it, Offs(p1,0,0,50), the correction differs by 0.46 mm

the correction would bend the path by 0.4 mm at XP1 (line 3), limit 0.2 mm
the correction would bend the path by 0.5 mm at LIN:4 (line 4), limit 0.25 mm
"""
APART = """
base BASE_DATA[1] is not known
base BASE_DATA[2] is not known

wVision is changed by the program (a.mod, line 3)
wCamera is changed by the program (a.mod, line 3)

derived from XP1 (line 3), which is left out: joint target
derived from XP1 (line 3), which is left out: its value is known at run time only

read by arithmetic (line 3)
read by arithmetic (line 3): XAP = XP1 + (0, 0, 5) mm; --derived corrects both alike

at the position that is derived from it, XAP = XP1 + (0, 0, 5) mm: out of reach
at the position that is derived from it, XAP = XP1 + (0, 0, 5) mm, the correction differs by 0.3 mm
"""


def pairs(text: str) -> list[list[str]]:
    return [pair.splitlines() for pair in text.strip().split("\n\n")]


@pytest.mark.parametrize(("one", "other"), pairs(ALIKE))
def test_reasons_of_one_kind_are_one(one: str, other: str) -> None:
    assert kind_of(one) == kind_of(other)


@pytest.mark.parametrize(("one", "other"), pairs(APART))
def test_reasons_with_other_remedies_stay_apart(one: str, other: str) -> None:
    assert kind_of(one) != kind_of(other)
