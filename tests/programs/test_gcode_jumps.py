"""G-code that jumps back: lines that are passed again, and what is in force then."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from truepose.programs import FrameTable, ReadOptions, read_program

FRAMES = FrameTable(bases={"G54": np.eye(4)})
HEAD = "G21 G90 G54\nN10 G1 X300 Y0 Z400 A0 B0 C0 F100\nG1 X300 Y20 Z400\n"
CHANGES = ("G92 X5", "G68 X0 Y0 R30", "G91", "G55", "G41 D1", "TRANS X5")
BACK = ("GOTO 10", "GOTO N010", "IF [#1 EQ 2] GOTO 10", "M99 P10", "GOTO #5", "REPEAT N10 P=3", "GOTOB N10")
TURN = "G1 X300 Y40 Z400 A5 B0 C0"


def _verdicts(folder: Path, text: str, **options: bool) -> list[str]:
    path = folder / "p.nc"
    path.write_text(text)
    return [target.verdict for target in read_program(path, FRAMES, ReadOptions(angles="kuka", **options)).targets]


@pytest.mark.promise("G-code lines that a jump back repeats with other settings in force are refused.")
def test_lines_that_are_passed_again(tmp_path: Path, record_property: Callable[[str, object], None]) -> None:
    for change in CHANGES:
        for back in BACK:
            assert _verdicts(tmp_path, f"{HEAD}{change}\n{back}\n")[:2] == ["refuse", "refuse"], (change, back)
        assert _verdicts(tmp_path, f"{HEAD}{change}\n")[:2] == ["correct", "correct"], change
        assert _verdicts(tmp_path, f"{HEAD}{change}\nGOTO 10\n", calls_keep_frames=True)[0] == "correct", change
    record_property("cases", len(CHANGES) * len(BACK))


@pytest.mark.promise("G-code lines that are the same targets each time they are passed are corrected.")
@pytest.mark.parametrize("back", ["GOTO 10", "M99", "M99 P10", "GOTOS", "IF [#1 EQ 2] GOTO 10"])
def test_loops_that_change_nothing(tmp_path: Path, back: str) -> None:
    assert _verdicts(tmp_path, f"{HEAD}{back}\n") == ["correct", "correct"]
    assert _verdicts(tmp_path, f"{HEAD}{TURN}\n{back}\n") == ["correct"] * 3, "the orientation is stated again"


def test_settings_that_the_beginning_states_again(tmp_path: Path) -> None:
    assert _verdicts(tmp_path, f"{HEAD}G91\nM99\n") == ["correct", "correct"]
    assert set(_verdicts(tmp_path, f"{HEAD}G92 X5\nM99\n")) == {"refuse"}


def test_orientation_that_is_not_stated_again(tmp_path: Path) -> None:
    text = f"G21 G90 G54\nG1 X300 Y0 Z400 A0 B0 C0\nN10 G1 X300 Y20 Z400\n{TURN}\nGOTO 10\n"
    assert _verdicts(tmp_path, text) == ["correct", "refuse", "correct"]


def test_many_jumps_are_read_in_bounded_time(tmp_path: Path) -> None:
    jumps = "".join(f"N{k} GOTO {k}\n" for k in range(100, 2100))
    assert _verdicts(tmp_path, f"{HEAD}{jumps}") == ["refuse", "refuse"]
