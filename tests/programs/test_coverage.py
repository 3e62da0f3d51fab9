"""How much of a program is corrected is said, and a user may require a share."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pydantic import ValidationError

from truepose._io.units import parse_share
from truepose.cell.sections import Correction, FramesSection
from truepose.errors import DataError, RefusedError
from truepose.programs import correct_program

POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 10.0,C -170.0}"
SRC = f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nPTP {{A1 0}}\nLIN {POSE}\nLIN {POSE}\nLIN_REL {{X 1}}\nEND\n"
DAT = f"DEFDAT A\nDECL E6POS XUNUSED={POSE}\nENDDAT\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Two targets to correct, a joint target, a relative motion, and a point that no motion goes to."""
    (tmp_path / "a.dat").write_text(DAT)
    (tmp_path / "a.src").write_text(SRC)
    return tmp_path / "a.src"


@pytest.mark.promise("CorrectedShare counts the targets that motions go to, corrected and nominal.")
def test_coverage_counts_motion_targets(path: Path, make_map: Any) -> None:
    corrected = correct_program(path, make_map([0.5, 0.0, 0.0]))
    assert corrected.summary()["targets"] == 5
    assert str(corrected.coverage) == "2 of 4 motion targets corrected, 2 stay nominal"


@pytest.mark.promise("A program with fewer corrected targets than required is refused.")
@pytest.mark.parametrize("require", ["51%", 0.51, "0.51", 1])
def test_a_required_share_that_is_missed_refuses(path: Path, make_map: Any, require: Any) -> None:
    with pytest.raises(RefusedError, match=r"a\.src: 2 of 4 motion targets corrected, 2 stay nominal, but \d+ % must"):
        correct_program(path, make_map(), require=require)


@pytest.mark.parametrize("require", ["50%", 0.5, 0])
def test_a_required_share_that_is_reached(path: Path, make_map: Any, require: Any) -> None:
    assert correct_program(path, make_map(), require=require).coverage.corrected == 2


@pytest.mark.promise("A share that is required in [correction] holds, and an option replaces it.")
def test_the_cell_requires_a_share(path: Path, make_map: Any) -> None:
    cell = SimpleNamespace(
        robot_id=None, correction=Correction(require="95%"), config_dat=None, tools={}, bases={}, frames=FramesSection()
    )
    with pytest.raises(RefusedError, match="95 % must be corrected"):
        correct_program(path, make_map(), cell)
    assert correct_program(path, make_map(), cell, require="10 %").coverage.corrected == 2
    own = make_map()
    own.cell = cell
    with pytest.raises(RefusedError, match="95 % must be corrected"):
        correct_program(path, own)


@pytest.mark.parametrize("value", ["95", "-1%", "101%", 1.5, -0.1, float("nan"), True, None, "most", "1_0%", "\u0665%"])
def test_what_is_no_share(value: Any) -> None:
    with pytest.raises(DataError, match=r'expected a share such as "95%" or 0\.95'):
        parse_share(value)
    with pytest.raises(ValidationError, match="expected a share"):
        Correction(require=value)
