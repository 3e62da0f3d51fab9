"""The list of all targets: what reading says without a map, and what a correction would write."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from truepose.programs import FrameTable, ReadOptions, correct_programs, read_programs
from truepose.programs.listing import write_checked, write_corrected

HEAD = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"
LIN = "LIN {{X {0},Y 2,Z 3,A 0,B 0,C 0}}\n"


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Two programs with names that need care: targets that are refused, skipped, relative and in joints."""
    bodies = {
        "a%s.src": LIN.format(1) + HEAD + LIN.format(2) + "LIN_REL {X 1}\n",
        'b".src': HEAD + LIN.format(4) + "PTP {A1 0,A2 -90,A3 90,A4 0,A5 45,A6 0}\n",
    }
    found = [tmp_path / name for name in bodies]
    for k, (path, body) in enumerate(zip(found, bodies.values(), strict=True)):
        path.write_text(f"DEF p{k}()\n{body}END\n")
    return found


def test_a_list_without_a_map_has_the_verdicts_of_reading(files: list[Path], tmp_path: Path) -> None:
    programs = read_programs(files, FrameTable(), ReadOptions(joint_targets=True)).programs
    write_checked(tmp_path / "list.json", programs)
    listed = json.loads((tmp_path / "list.json").read_text())
    targets = [target for program in programs for target in program.targets]
    assert listed["corrected"] is False
    assert listed["summary"] == {"targets": len(targets)}
    assert [one["file"] for one in listed["files"]] == [str(path) for path in files]
    for one, target in zip(listed["targets"], targets, strict=True):
        assert (one["verdict"], one["reason"], one["line"]) == (target.verdict, target.reason, target.line)
        assert one["after_mm"] == one["correction_mm"] == [None] * 3
        assert one["std_mm"] is None
        assert "joints_after" not in one
    assert {one["verdict"] for one in listed["targets"]} == {"correct", "skip", "refuse"}
    assert listed["targets"][1]["before_mm"] == listed["targets"][1]["base_mm"] == [2.0, 2.0, 3.0]


def test_a_list_of_corrected_programs_holds_their_records(files: list[Path], make_map: Any, tmp_path: Path) -> None:
    batch = correct_programs(files, make_map([0.37, 0, 0]), frames=FrameTable(), keep_going=True)
    write_corrected(tmp_path / "list.json", batch.corrected)
    listed = json.loads((tmp_path / "list.json").read_text())
    assert listed["corrected"]
    assert listed["targets"] == [one for program in batch.corrected for one in program.to_dict()["targets"]]


def test_points_derived_from_corrected_ones_follow_them_in_the_list(tmp_path: Path) -> None:
    path = tmp_path / "a.src"
    shifted = "LIN XP1\nLIN XP1:{X 0,Y 0,Z 5,A 0,B 0,C 0}\n"
    path.write_text(f"DEF a()\n{HEAD}DECL E6POS XP1={{X 1,Y 2,Z 3,A 0,B 0,C 0}}\n{shifted}END\n")
    (program,) = read_programs([path], FrameTable(), ReadOptions(derived=True, whole_task=True)).programs
    write_checked(tmp_path / "list.json", [program])
    reasons = [one["reason"] for one in json.loads((tmp_path / "list.json").read_text())["targets"]]
    assert reasons.count("derived from XP1: gets the correction of that point") == program.following == 1


def test_the_commands_write_the_list_and_never_over_a_file(
    files: list[Path], tmp_path: Path, run: Callable[..., Any]
) -> None:
    out = tmp_path / "list.json"
    done = run("check", *files, "--targets", out)
    assert (done.code, str(out) in done.out) == (0, True)
    assert len(json.loads(out.read_text())["targets"]) == 5
    before = out.read_bytes()
    assert run("check", *files, "--targets", out).code != 0
    assert out.read_bytes() == before
    assert run("check", *files, "--targets", files[0], "--force").code != 0
    assert files[0].read_text().startswith("DEF")
