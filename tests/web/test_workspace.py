"""The workspace: what it finds, what it does not follow, and the names of new files."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from truepose.studies.demo import run_demo
from truepose.web import Workspace
from truepose.web.problems import WebError
from truepose.web.uploads import safe_name

CELL = '[robot]\nmodel = "kuka-kr150-2"\n'


def lay(folder: Path, text: str = CELL) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cell.toml").write_text(text)
    return folder


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    folder = tmp_path_factory.mktemp("work")
    run_demo(folder / "cell", progress=lambda _: None)
    return Workspace(folder)


def test_cells_are_found_at_any_level_that_is_looked_at(tmp_path: Path) -> None:
    for name in ("a", "hall 2/b", "x/y/z", "too/deep/for/us", ".hidden", "a/inner"):
        lay(tmp_path / name)
    assert [cell.name for cell in Workspace(tmp_path).cells()] == ["a", "a/inner", "hall 2/b", "x/y/z"]


def test_a_workspace_that_is_a_cell_has_the_name_of_its_folder(tmp_path: Path) -> None:
    assert [cell.name for cell in Workspace(lay(tmp_path / "drilling")).cells()] == ["drilling"]


@pytest.mark.exhaustive
def test_what_the_command_line_wrote_is_known_by_its_content(demo: Workspace) -> None:
    (cell,) = demo.cells()
    kinds = {kind: sorted(file.name for file in cell.files(kind)) for kind in ("map", "samples", "plan", "record")}
    assert kinds == {
        "map": ["map.truepose"],
        "samples": ["fit_samples.csv", "held_out_samples.csv"],
        "plan": ["fit_plan.csv", "held_out_plan.csv"],
        "record": ["corrected/panel.corrections.json"],
    }
    assert [file.name for file in cell.files("report")] == ["report.html"]


@pytest.mark.exhaustive
def test_a_map_is_found_by_its_hash_and_read_once(demo: Workspace) -> None:
    ((_, file),) = demo.maps()
    first, again = demo.map(demo.hash_of(file))[2], demo.map(demo.hash_of(file))[2]
    assert first is again
    with pytest.raises(WebError, match="this map is not in this workspace"):
        demo.map("0" * 64)


def test_files_of_a_cell_inside_another_are_its_own(tmp_path: Path) -> None:
    for folder in (lay(tmp_path / "a"), lay(tmp_path / "a" / "inner")):
        (folder / "held.truepose").write_bytes(b"")
    outer, inner = Workspace(tmp_path).cells()
    assert [file.name for file in outer.files()] == [file.name for file in inner.files()] == ["held.truepose"]
    assert outer.files()[0].path != inner.files()[0].path


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links here")
def test_links_are_not_followed(tmp_path: Path) -> None:
    outside = lay(tmp_path / "outside")
    (outside / "secret.truepose").write_bytes(b"")
    cell = lay(tmp_path / "work" / "cell")
    (tmp_path / "work" / "linked").symlink_to(outside, target_is_directory=True)
    (cell / "more").symlink_to(outside, target_is_directory=True)
    (cell / "file.truepose").symlink_to(outside / "secret.truepose")
    (found,) = Workspace(tmp_path / "work").cells()
    assert found.name == "cell"
    assert found.files() == []


def test_new_names_never_meet_old_ones_whatever_their_case(tmp_path: Path) -> None:
    cell = Workspace(lay(tmp_path / "a").parent).cells()[0]
    first = cell.new("maps", "Map.truepose")
    first.parent.mkdir()
    first.write_bytes(b"")
    assert cell.new("maps", "MAP.truepose").name == "MAP-2.truepose"
    assert Workspace(tmp_path).new_cell("A").name == "A-2"


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("../../x.src", "x.src"),
        ("/etc/passwd", "passwd"),
        ("C:\\w\\x.src", "x.src"),
        ("..", "file"),
        ("", "file"),
        ("con.src", "_con.src"),
        ("a\x00b\n.src", "a_b_.src"),
        ("<img src=x>.src", "_img src=x_.src"),
        ("A\u0308.src", "\u00c4.src"),
        ("程序.src", "程序.src"),
        (".truepose", "truepose"),
    ],
)
def test_a_name_is_never_a_path(given: str, kept: str) -> None:
    assert safe_name(given) == kept


def test_a_very_long_name_keeps_its_ending() -> None:
    assert len(safe_name("x" * 400 + ".src")) == 150
    assert safe_name("x" * 400 + ".src").endswith(".src")


@pytest.mark.parametrize(("typed", "name"), [("Hall 3/Cell 2", "Hall 3_Cell 2"), ("a\\b", "a_b"), ("../x", "_x")])
def test_a_slash_in_the_name_of_a_cell_starts_no_folder(tmp_path: Path, typed: str, name: str) -> None:
    assert Workspace(tmp_path).new_cell(typed).folder == tmp_path / name
