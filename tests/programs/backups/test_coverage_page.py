"""The page on how much of the project's own backups is corrected states the numbers of today."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import coverage

PAGE = Path(__file__).parents[3] / "docs" / "validation" / "coverage.md"
COLUMNS = ("by default", "`--derived`")


def stated() -> dict[str, dict[str, str]]:
    """Return the rows of the first table by maker: cells by the heads of their columns."""
    lines = PAGE.read_text("utf-8").split("## Targets with a pose")[1].split("##")[0].splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    return {row[0].partition(" (")[0]: dict(zip(rows[0], row, strict=True)) for row in rows[2:]}


def test_every_maker_is_on_the_page() -> None:
    assert set(stated()) == set(coverage.MAKERS) == set(coverage.CORPORA)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("maker", coverage.MAKERS)
def test_the_page_states_what_reading_allows(maker: str, tmp_path: Path) -> None:
    path = coverage.backup(maker, tmp_path)
    found = [coverage.readable(coverage.programs(path, coverage.OPTIONS[column])).cartesian for column in COLUMNS]
    assert [stated()[maker][column] for column in COLUMNS] == [str(share) for share in found], (
        "the page is of an earlier state: python -m benchmarks coverage --write"
    )
    assert found[1].done >= coverage.GOAL * found[1].targets


@pytest.mark.exhaustive
def test_the_script_writes_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coverage, "MAKERS", {"Stäubli": coverage.MAKERS["Stäubli"]})
    coverage.report(tmp_path / "coverage.md")
    text = (tmp_path / "coverage.md").read_text("utf-8")
    assert [line for line in text.splitlines() if line.startswith("| Stäubli")][:2] == [
        line for line in PAGE.read_text("utf-8").splitlines() if line.startswith("| Stäubli")
    ][:2]
    assert "target computed at run time: compose(pSide,geo:fMachine,{0,0,nHeight,…" in text
    assert "Below 85 % with `--derived`: none." in text


def test_shares_count_joint_targets_apart_and_followers_with_their_points(tmp_path: Path) -> None:
    head = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"
    pose = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 0.0,C -180.0}"
    points = f"DECL E6POS XP1={pose}\nDECL E6POS XP9={pose}\nDECL E6POS XAP\n"
    (tmp_path / "a.dat").write_text(f"DEFDAT A\n{points}ENDDAT\n")
    moves = "PTP {A1 0,A2 -90,A3 90,A4 0,A5 30,A6 0}\nLIN XP1\nXAP=XP1\nXAP.Z=XAP.Z+50\nLIN XAP\nLIN_REL {X 1}\n"
    (tmp_path / "a.src").write_text(f"DEF a()\n{head}{moves}END\n")
    shares = {name: coverage.readable(coverage.programs(tmp_path, more)) for name, more in coverage.OPTIONS.items()}
    assert {name: tuple(share.joint) for name, share in shares.items()} == {
        name: (int("joint" in name or "all" in name), 1) for name in coverage.OPTIONS
    }
    assert [tuple(shares[name].cartesian) for name in COLUMNS] == [(0, 3), (2, 3)]
