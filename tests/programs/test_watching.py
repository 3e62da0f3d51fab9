"""Programs that are put into a folder are corrected once they are complete, and again when they change."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from truepose.errors import FileError
from truepose.programs import FolderWatch, FrameTable

HEAD = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"


def text(x: float) -> str:
    return f"DEF a()\n{HEAD}LIN {{X {x},Y 2,Z 3,A 0,B 0,C 0}}\nEND\n"


@pytest.fixture
def watch(tmp_path: Path, make_map: Any) -> FolderWatch:
    (tmp_path / "in" / "cell 1").mkdir(parents=True)
    return FolderWatch(tmp_path / "in", tmp_path / "out", make_map([0.37, 0, 0]), frames=FrameTable(), settle_s=2.0)


def test_a_program_is_taken_when_it_has_settled(watch: FolderWatch) -> None:
    path = watch.in_dir / "cell 1" / "a.src"
    path.write_text(text(1)[:40])  # half copied
    assert not list(watch.poll(0.0))
    assert not list(watch.poll(1.9))
    path.write_text(text(1))
    assert not list(watch.poll(2.1))
    (event,) = watch.poll(4.2)
    assert str(event) == f"{path}: 1 of 1 motion targets corrected, 0 stay nominal"
    assert {str(file.relative_to(watch.out_dir)) for file in event.written} == {
        f"cell 1/a{ending}" for ending in (".src", ".corrections.json", ".corrections.csv")
    }
    assert "X 1.37" in (watch.out_dir / "cell 1" / "a.src").read_text()
    assert not list(watch.poll(9.0))
    path.touch()  # another time, the same content
    assert not list(watch.poll(10.0))
    assert not list(watch.poll(13.0))


def test_a_changed_program_replaces_its_own_result(watch: FolderWatch) -> None:
    path = watch.in_dir / "a.src"
    path.write_text(text(1))
    assert [event.refused for event in watch.once(lambda _: None)] == [""]
    path.write_text(text(500))
    assert [event.refused for event in watch.once(lambda _: None)] == [""]
    assert "X 500.37" in (watch.out_dir / "a.src").read_text()
    (watch.out_dir / "a.src").write_text("; by hand")
    path.write_text(text(900))
    (event,) = watch.once(lambda _: None)
    assert "exists already" in event.refused
    assert (watch.out_dir / "a.src").read_text() == "; by hand"


def test_a_refused_program_is_reported_once_and_again_when_it_changes(watch: FolderWatch) -> None:
    path = watch.in_dir / "a.src"
    path.write_text(text(1).replace("$TOOL=$NULLFRAME\n", ""))
    (event,) = watch.once(lambda _: None)
    assert "no $TOOL is set" in event.refused
    assert str(event).startswith("refused: ")
    assert watch.once(lambda _: None) == []
    path.write_text(text(1).replace("X 1", "X 1.2.3"))
    (event,) = watch.once(lambda _: None)
    assert "1.2.3 is not a number" in event.refused
    path.write_text(text(1))
    (event,) = watch.once(lambda _: None)
    assert event.to_dict()["coverage"] == {"corrected": 1, "targets": 1}


def test_a_new_watch_does_not_repeat_what_is_done(watch: FolderWatch) -> None:
    (watch.in_dir / "a.src").write_text(text(1))
    assert len(watch.once(lambda _: None)) == 1
    again = FolderWatch(watch.in_dir, watch.out_dir, watch.error_map, frames=FrameTable())
    assert again.once(lambda _: None) == []


def test_pairs_are_one_program_and_other_files_are_ignored(watch: FolderWatch) -> None:
    for name in ("a.csv", "notes.txt", ".a.src.part", ".hidden.src", "alone.dat"):
        (watch.in_dir / name).write_text("x")
    (watch.in_dir / "p.src").write_text(f"DEF p()\n{HEAD}LIN XP1\nEND\n")
    (watch.in_dir / "p.dat").write_text("DEFDAT P\nDECL E6POS XP1={X 1,Y 2,Z 3,A 0,B 0,C 0}\nENDDAT\n")
    inside = FolderWatch(watch.in_dir, watch.in_dir / "done", watch.error_map, frames=FrameTable())
    (event,) = inside.once(lambda _: None)
    assert {file.name for file in event.written} == {"p.src", "p.dat", "p.corrections.json", "p.corrections.csv"}
    assert inside.once(lambda _: None) == []


def test_the_folders_are_checked(watch: FolderWatch) -> None:
    with pytest.raises(FileError, match="holds the watched folder"):
        FolderWatch(watch.in_dir, watch.in_dir.parent, watch.error_map)
    with pytest.raises(FileError, match="is no folder"):
        FolderWatch(watch.in_dir / "absent", watch.out_dir, watch.error_map)
