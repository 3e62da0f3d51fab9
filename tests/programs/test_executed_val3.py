"""Random VAL3 applications run with their own numbers and with corrected ones: only what was corrected may differ."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.programs.executors.running import for_a_while, try_programs
from tests.programs.executors.val3 import VAL3


def test_nothing_but_corrected_targets_moves(tmp_path: Path) -> None:
    _, count = try_programs(tmp_path, VAL3, range(40))
    assert count > 30


@pytest.mark.exhaustive
def test_further_programs(tmp_path: Path) -> None:
    programs, count = try_programs(tmp_path, VAL3, for_a_while())
    assert count > programs // 2
