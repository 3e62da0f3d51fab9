"""How much is corrected of what controllers of plants have beside points that are taught once."""

from __future__ import annotations

import pytest
from benchmarks.coverage import corrected, readable
from tests.programs.joint_arms import Sagging
from tests.programs.typical import ARMS, FRAMES, TYPICAL, N, Typical

from truepose.programs import ReadOptions, read_programs
from truepose.robots import load_robot


@pytest.mark.parametrize("one", TYPICAL, ids=lambda one: f"{one.controller}: {one.what}")
def test_how_many_are_corrected(tmp_path, one: Typical):
    path, found = one.lay(tmp_path), []
    for options in ({}, one.options):
        read = read_programs([path], FRAMES, ReadOptions(**options))
        assert not read.unreadable
        found.append(readable(read.programs).cartesian)
    assert [share.done for share in found] == [one.by_default, one.allowed]
    assert found[0].targets == (N if "pallet" not in one.what else 1), found[0]
    with_map = corrected(read.programs, Sagging(load_robot(ARMS[one.controller]))).cartesian
    assert with_map.done == one.with_map
