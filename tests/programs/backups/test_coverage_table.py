"""The table of docs/programs.md: how much of each maker's own backup can be corrected, by default and with options."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from tests.programs.backups import small
from tests.programs.backups.test_makers import CORPORA

from truepose.programs import Coverage, FrameTable, ReadOptions, read_programs
from truepose.programs.core.program import FrameTolerance, MotionGroups

PAGE = Path(__file__).parents[3] / "docs" / "programs.md"
JOINTS = {"joint_targets": True, "controller_kinematics": True}
ALL = {
    "derived": True,
    **JOINTS,
    "external_axes": True,
    "absolute_accuracy": True,
    "frame_tolerance": FrameTolerance(5.0),
}
COLUMNS: dict[str, tuple[FrameTable | None, dict[str, Any]]] = {
    "by default": (None, {}),
    "with `--derived`": (None, {"derived": True}),
    "with `--joint-targets`": (None, JOINTS),
    "with all": (FrameTable(groups=MotionGroups(1, frozenset({2}))), ALL),
}
_SLACK = 1.6  # points: the table is rounded, and a reader that learns more need not change it at once


def table() -> dict[str, list[str]]:
    """Return the rows of the table by maker."""
    rows = [
        [cell.strip() for cell in line.strip("| \n").split("|")]
        for line in PAGE.read_text().splitlines()
        if "|" in line
    ]
    head = next(k for k, row in enumerate(rows) if row[0] == "backup of our own")
    assert rows[head][2:] == list(COLUMNS)
    return {row[0]: row[1:] for row in rows[head + 2 : head + 2 + len(CORPORA)]}


@pytest.mark.exhaustive
@pytest.mark.parametrize("maker", CORPORA)
def test_the_table_states_what_is_covered(maker: str, tmp_path: Path) -> None:
    path = tmp_path / "cell.zip"
    path.write_bytes(small.packed(CORPORA[maker](tmp_path / "made")))
    targets, *shares = (float(re.sub(r"[ ,%]", "", cell)) for cell in table()[maker])
    for (given, options), stated in zip(COLUMNS.values(), shares, strict=True):
        total = Coverage.of_programs(read_programs([path], given, ReadOptions(**options)).programs).total
        assert 100 * total.share == pytest.approx(stated, abs=_SLACK)
        assert total.targets == pytest.approx(targets, rel=0.05)
