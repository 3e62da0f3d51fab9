"""Many programs: one that is refused does not block the others, if the user says so."""

from __future__ import annotations

import errno
import json
import re
from pathlib import Path
from typing import Any

import pytest
from openpyxl import load_workbook

from truepose.errors import FileError, RefusedError
from truepose.programs import FrameTable, correct_program, correct_programs, read_program, record

HEAD = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"
GOOD = HEAD + "LIN {{X {0},Y 2,Z 3,A 0,B 0,C 0}}\nLIN {{X {0},Y 9,Z 3,A 0,B 0,C 0}}\n"


def module(name: str, body: str) -> str:
    return f"DEF {name}()\n{body}END\n"


@pytest.fixture
def folders(tmp_path: Path) -> list[Path]:
    """Three controllers; one module of the second sets no tool, the third cannot be read."""
    found = [tmp_path / name for name in ("one", "two", "three")]
    for k, folder in enumerate(found):
        (folder / "R1").mkdir(parents=True)
        for name in ("a", "b"):
            (folder / "R1" / f"{name}.src").write_text(module(name, GOOD.format(100 * k + ord(name))))
    (found[1] / "R1" / "bad.src").write_text(module("bad", "LIN {X 7,Y 7,Z 7,A 0,B 0,C 0}\n"))
    (found[2] / "R1" / "broken.src").write_text(module("broken", "LIN {X 1.2.3}\n"))
    return found


def test_all_or_none_without_keep_going(folders: list[Path], make_map: Any) -> None:
    with pytest.raises(FileError, match=r"1\.2\.3 is not a number"):
        correct_programs(folders, make_map([0.37, 0, 0]), frames=FrameTable())
    with pytest.raises(RefusedError, match=r"bad\.src:2"):
        correct_programs(folders[:2], make_map([0.37, 0, 0]), frames=FrameTable())


def test_a_program_is_corrected_as_a_whole_by_default(folders: list[Path], make_map: Any) -> None:
    with pytest.raises(RefusedError, match=r"bad\.src:2"):
        correct_program(folders[1], make_map([0.37, 0, 0]), frames=FrameTable())


def test_the_good_modules_are_corrected(folders: list[Path], make_map: Any, tmp_path: Path) -> None:
    batch = correct_programs(folders, make_map([0.37, 0, 0]), frames=FrameTable(), keep_going=True)
    assert [one.path for one in batch.refused] == [folders[2] / "R1/broken.src", folders[1] / "R1/bad.src"]
    assert "no $TOOL is set" in batch.refused[1].reason
    assert [target.verdict for target in batch.corrected[1].targets].count("refuse") == 1
    assert repr(batch) == "<CorrectedBatch: 6 programs, 2 refused; 12 of 13 motion targets corrected, 1 stays nominal>"
    out = tmp_path / "out"
    written = {str(path.relative_to(out)) for path in batch.corrected[1].write(out)}
    assert written == {
        f"two/{name}" for name in ("R1/a.src", "R1/b.src", "two.corrections.json", "two.corrections.csv")
    }
    record = json.loads((out / "two" / "two.corrections.json").read_text())
    assert list(record["refused"]) == [str(folders[1] / "R1/bad.src")]
    assert json.loads(json.dumps(batch.to_dict()))["refused"][1]["file"].endswith("bad.src")


def test_a_module_that_cannot_be_read_is_left_out(folders: list[Path], make_map: Any, tmp_path: Path) -> None:
    batch = correct_programs(folders[2:], make_map([0.37, 0, 0]), frames=FrameTable(), keep_going=True)
    assert [one.path for one in batch.refused] == [folders[2] / "R1/broken.src"]
    batch.write(tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").rglob("*.src")} == {"a.src", "b.src"}
    with pytest.raises(FileError, match=r"broken\.src:2"):
        read_program(folders[2])


def test_a_refused_project_counts_its_modules(folders: list[Path], make_map: Any) -> None:
    batch = correct_programs(
        folders[:1], make_map([0.37, 0, 0], guarded={0: "far", 2: "far"}), frames=FrameTable(), keep_going=True
    )
    assert (batch.n_corrected, batch.n_refused) == (0, 2)


def test_reasons_of_a_refused_program_are_grouped(folders: list[Path], make_map: Any) -> None:
    lines = "".join(f"LIN {{X {x},Y 7,Z 7,A 0,B 0,C 0}}\n" for x in range(20))
    (folders[1] / "R1" / "bad.src").write_text(module("bad", lines))
    with pytest.raises(
        RefusedError, match=r"bad\.src:2: LIN:2: no \$TOOL is set .* \(19 more alike\); leave"
    ) as caught:
        correct_programs(folders[1:2], make_map([0.37, 0, 0]), frames=FrameTable())
    assert str(caught.value).count("no $TOOL is set") == 1


def test_a_guard_refuses_a_module(folders: list[Path], make_map: Any) -> None:
    batch = correct_programs(
        folders[:1], make_map([0.37, 0, 0], guarded={2: "far away"}), frames=FrameTable(), keep_going=True
    )
    (one,) = batch.corrected
    assert [str(path) for path in one.refused] == [str(folders[0] / "R1/b.src")]
    assert [target.verdict for target in one.targets] == ["correct", "correct", "refuse", "skip"]
    assert "its module is refused" in one.targets[3].reason


def test_a_bend_refuses_the_modules_of_its_path(folders: list[Path], make_map: Any) -> None:
    path = folders[0] / "R1" / "b.src"
    path.write_text(module("b", HEAD + "".join(f"LIN {{X {x},Y 0,Z 0,A 0,B 0,C 0}}\n" for x in range(0, 50, 10))))
    shifts = [[0.0, 0, 0]] * 4 + [[0, 0, 5.0]] + [[0.0, 0, 0]] * 2
    batch = correct_programs(folders[:1], make_map(shifts, std=0.01), frames=FrameTable(), keep_going=True)
    assert [one.path for one in batch.refused] == [path]
    assert "would bend the path by" in batch.refused[0].reason


def test_a_project_without_a_good_module_is_refused(folders: list[Path], make_map: Any) -> None:
    error_map = make_map([0.37, 0, 0], guarded={0: "far away", 2: "far away"})
    batch = correct_programs(folders[:1], error_map, frames=FrameTable(), keep_going=True)
    assert not batch.corrected
    assert [one.path for one in batch.refused] == folders[:1]


def test_several_folders_keep_their_structure(folders: list[Path], make_map: Any, tmp_path: Path) -> None:
    batch = correct_programs(folders[:2], make_map([0.37, 0, 0]), frames=FrameTable(), keep_going=True)
    out = tmp_path / "out"
    batch.write(out)
    found = {str(path.relative_to(out)) for path in out.rglob("*.*")}
    assert found == {
        *("one/R1/a.src", "one/R1/b.src", "one/one.corrections.json", "one/one.corrections.csv"),
        *("two/R1/a.src", "two/R1/b.src", "two/two.corrections.json", "two/two.corrections.csv"),
    }


def test_one_folder_keeps_its_structure(folders: list[Path], make_map: Any, tmp_path: Path) -> None:
    deep = folders[0] / "R1" / "cell 3" / "seam.src"
    deep.parent.mkdir()
    deep.write_text(module("seam", GOOD.format(7)))
    (folders[0] / "R1" / "notes.txt").write_text("no program")
    out = tmp_path / "out"
    correct_programs(folders[:1], make_map([0.37, 0, 0]), frames=FrameTable()).write(out)
    found = {str(path.relative_to(out)) for path in out.rglob("*.src")}
    assert found == {"R1/a.src", "R1/b.src", "R1/cell 3/seam.src"}


def test_a_second_run_names_and_removes_what_it_does_not_write(
    folders: list[Path], make_map: Any, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    extra = folders[0] / "R1" / "old.src"
    kept = folders[0] / "R1" / "edited.src"
    for path in (extra, kept):
        path.write_text(module(path.stem, GOOD.format(len(path.stem))))
    correct_programs(folders[:1], make_map([0.37, 0, 0]), frames=FrameTable()).write(out)
    extra.unlink()
    kept.unlink()
    (out / "R1/edited.src").write_text("; by hand")
    (out / "R1/mine.src").write_text("; not by truepose")
    again = correct_programs(folders[:1], make_map([0.37, 0, 0]), frames=FrameTable())
    with pytest.warns(UserWarning, match="earlier run") as warned:
        again.write(out, force=True)
    (told,) = (str(one.message) for one in warned)  # one warning names all of them, at the line of the caller
    assert warned[0].filename == __file__
    assert re.search(r"removed .*old\.src, which an earlier run wrote", told)
    assert "edited.src: written by an earlier run and changed since" in told
    assert {path.name for path in out.rglob("*.src")} == {"a.src", "b.src", "edited.src", "mine.src"}


def test_without_force_leftovers_are_named(folders: list[Path], make_map: Any, tmp_path: Path) -> None:
    out = tmp_path / "out"
    one, other = folders[0] / "R1/a.src", folders[0] / "R1/b.src"
    correct_programs([one], make_map([0.37, 0, 0]), frames=FrameTable()).write(out)
    with pytest.warns(UserWarning, match=r"a\.src.*: are files of an earlier run and no part of this one"):
        correct_programs([other], make_map([0.37, 0, 0]), frames=FrameTable()).write(out)
    assert {path.name for path in out.rglob("*.src")} == {"a.src", "b.src"}


@pytest.mark.parametrize("in_place", [False, True])
def test_workbooks_are_written_with_the_rest_or_not_at_all(
    folders: list[Path], make_map: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_place: bool
) -> None:
    batch = correct_programs(folders[:1], make_map([0.37, 0, 0]), frames=FrameTable())
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def write() -> list[Path]:
        return batch.write_in_place(workbook=True) if in_place else batch.write(tmp_path / "out", workbook=True)

    with monkeypatch.context() as patch:
        patch.setattr("truepose.programs.corrected.to_workbook", fill_disk)
        with pytest.raises(FileError, match="No space left"):
            write()
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    (book,) = (path for path in write() if path.suffix == ".xlsx")
    assert book.name == "one.corrections.xlsx"
    assert load_workbook(book).active.max_row == len(book.with_suffix(".csv").read_text().splitlines())


def fill_disk(_: object) -> bytes:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_records_are_read_once_for_all_programs_beside_them(
    make_map: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs = [tmp_path / f"p{k}.src" for k in range(8)]
    for k, path in enumerate(programs):
        path.write_text(module(f"p{k}", GOOD.format(10 * k)))
    error_map, out = make_map([0.37, 0, 0]), tmp_path / "out"
    correct_programs(programs, error_map, frames=FrameTable()).write(out)
    for path in out.iterdir():
        if path.suffix != ".src":
            path.rename(tmp_path / path.name)  # eight records beside the originals
    read: list[Path] = []
    head_of = record.head_of
    monkeypatch.setattr(record, "head_of", lambda path: [read.append(path), head_of(path)][1])
    corrected = correct_programs(programs, error_map, frames=FrameTable())
    assert len(read) == 8
    assert corrected.n_corrected == 8
    with pytest.raises(RefusedError, match=r"p3\.src: was corrected already, see p3\.corrections\.json"):
        correct_programs([programs[0], out / "p3.src"], error_map, frames=FrameTable())
    assert len(read) == 16  # a new run looks again
