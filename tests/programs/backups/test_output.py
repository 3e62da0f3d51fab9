"""Corrected backups: only changed files with a list, or the whole, in which nothing else differs."""

from __future__ import annotations

import csv
import hashlib
import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.programs.backups import small
from tests.programs.conftest import FakeMap

from truepose._io.zip_writer import write_changed
from truepose.errors import DataError, FileError, RefusedError
from truepose.programs.batch import CorrectedBatch, correct_programs

pytestmark = pytest.mark.usefixtures("small_format")


@pytest.fixture(autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path_factory.mktemp("state")))


def tree(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def corrected(path: Path, shift: Any = (1.0, 0.0, 0.0), **more: Any) -> CorrectedBatch:
    return correct_programs([path], FakeMap(shift), **more)


FILES = small.files_of(n=3) | {"last.bin": bytes(range(256)) * 20}
FIRST = [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
"""A map that corrects the first of three targets."""


def test_only_changed_files_are_written_with_a_list_of_both_hashes(tmp_path: Path) -> None:
    backup = small.lay(tmp_path / "cell", FILES)
    corrected(backup, FIRST).write(tmp_path / "out")
    new = FILES["programs/p0.src"].replace(b"X 10.0", b"X 11.0")
    found = tree(tmp_path / "out")
    assert found.pop("programs/p0.src") == new
    rows = list(csv.DictReader(io.StringIO(found.pop("changed-files.csv").decode())))
    hashes = [hashlib.sha256(data).hexdigest() for data in (FILES["programs/p0.src"], new)]
    assert rows == [{"file": "programs/p0.src", "sha256_before": hashes[0], "sha256_after": hashes[1]}]
    assert sorted(found) == ["cell.corrections.csv", "cell.corrections.json"]
    assert tree(backup) == FILES


def test_the_whole_folder_differs_in_the_changed_file_alone(tmp_path: Path) -> None:
    files = FILES | {".hidden/a": b"1", "empty.txt": b""}
    backup = small.lay(tmp_path / "cell", files)
    corrected(backup, FIRST).write(tmp_path / "out", whole=True)
    new = tree(tmp_path / "out" / "cell")
    assert new.pop("programs/p0.src") == FILES["programs/p0.src"].replace(b"X 10.0", b"X 11.0")
    assert new == {name: data for name, data in files.items() if name != "programs/p0.src"}
    assert not (tmp_path / "out" / "programs").exists()
    old, copy = ((folder / "run.log").stat().st_mtime_ns for folder in (backup, tmp_path / "out" / "cell"))
    assert old == copy


def raw(path: Path) -> dict[str, tuple[Any, ...]]:
    """Return what a .zip holds of each member: what the directory says, and the packed bytes."""
    data = path.read_bytes()
    found = {}
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        for info in archive.infolist():
            start = (
                info.header_offset
                + 30
                + sum(
                    int.from_bytes(data[info.header_offset + at : info.header_offset + at + 2], "little")
                    for at in (26, 28)
                )
            )
            kept = (
                info.date_time,
                info.external_attr,
                info.comment,
                info.extra,
                info.compress_type,
                info.create_system,
            )
            found[info.filename] = (*kept, data[start : start + info.compress_size])
        found[""] = (archive.comment,)
    return found


def test_the_whole_zip_differs_in_the_changed_member_alone(tmp_path: Path) -> None:
    backup = tmp_path / "cell.zip"
    backup.write_bytes(small.packed(FILES, comment=b"of the line"))
    corrected(backup, FIRST).write(tmp_path / "out", whole=True)
    before, after = raw(backup), raw(tmp_path / "out" / "cell.zip")
    assert list(before) == list(after)  # the order, too
    assert [name for name in before if before[name] != after[name]] == ["programs/p0.src"]
    assert before["programs/p0.src"][:-1] == after["programs/p0.src"][:-1]
    with zipfile.ZipFile(tmp_path / "out" / "cell.zip") as archive:
        assert archive.read("programs/p0.src") == FILES["programs/p0.src"].replace(b"X 10.0", b"X 11.0")


def test_a_correction_of_zero_gives_the_same_bytes(tmp_path: Path) -> None:
    backup = tmp_path / "cell.zip"
    backup.write_bytes(small.packed(FILES | {"more.ZIP": small.packed(small.files_of(n=1))}, comment=b"x"))
    with pytest.warns(UserWarning, match="left as they are: more.ZIP"):
        batch = corrected(backup, (0.0, 0.0, 0.0), controllers=["."])
    batch.write(tmp_path / "out", whole=True)
    assert (tmp_path / "out" / "cell.zip").read_bytes() == backup.read_bytes()
    assert tree(tmp_path / "out")["changed-files.csv"] == b"file,sha256_before,sha256_after\n"


def test_a_member_of_a_zip_in_a_zip_is_corrected_in_place(tmp_path: Path) -> None:
    backup = tmp_path / "cell.zip"
    backup.write_bytes(small.packed({"notes.txt": b"abc", "in/R1.ZIP": small.packed(FILES), "z.bin": b"z" * 999}))
    corrected(backup, FIRST).write(tmp_path / "out", whole=True)
    before, after = raw(backup), raw(tmp_path / "out" / "cell.zip")
    assert [name for name in before if before[name] != after[name]] == ["in/R1.ZIP"]
    for folder in (tmp_path, tmp_path / "out"):
        with zipfile.ZipFile(folder / "cell.zip") as archive:
            (folder / "inner.zip").write_bytes(archive.read("in/R1.ZIP"))
    before, after = raw(tmp_path / "inner.zip"), raw(tmp_path / "out" / "inner.zip")
    assert [name for name in before if before[name] != after[name]] == ["programs/p0.src"]


def test_a_zip_in_a_folder_is_corrected_in_place(tmp_path: Path) -> None:
    backup = small.lay(tmp_path / "cell", {"R1.zip": small.packed(FILES), "notes.txt": b"abc"})
    corrected(backup, FIRST).write(tmp_path / "out", whole=True)
    before, after = raw(backup / "R1.zip"), raw(tmp_path / "out" / "cell" / "R1.zip")
    assert [name for name in before if before[name] != after[name]] == ["programs/p0.src"]
    corrected(small.lay(tmp_path / "again", {"R1.zip": small.packed(FILES)}), FIRST).write(tmp_path / "files")
    assert b"X 11.0" in (tmp_path / "files" / "R1.zip" / "programs" / "p0.src").read_bytes()


def streamed(files: dict[str, bytes]) -> bytes:
    """Return a .zip as programs write it that cannot seek: with a record behind each member."""

    class Pipe(io.BytesIO):
        def seekable(self) -> bool:
            return False

        def tell(self) -> int:
            raise OSError

        def seek(self, *_: Any) -> int:
            raise OSError

    out = Pipe()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return out.getvalue()


@pytest.mark.parametrize("before", [b"", b"#!/bin/sh\nexit\n"])
@pytest.mark.parametrize("pack", [small.packed, streamed])
@pytest.mark.parametrize("names", [["a"], ["c"], ["a", "b", "c"], []])
def test_members_are_replaced_in_zips_of_other_writers(
    tmp_path: Path, before: bytes, pack: Any, names: list[str]
) -> None:
    files = {"a": b"a" * 500, "b": b"b", "c": bytes(range(256)), "d": b""}
    old, new = tmp_path / "old.zip", tmp_path / "new.zip"
    old.write_bytes(before + pack(files))
    with new.open("w+b") as out:
        write_changed(old, {name: lambda name=name: name.encode() * 77 for name in names}, out)
    with zipfile.ZipFile(new) as archive:
        assert archive.testzip() is None
        assert {i.filename: archive.read(i) for i in archive.infolist()} == files | {n: n.encode() * 77 for n in names}
    assert (old.read_bytes() == new.read_bytes()) == (not names)


def test_a_zip_is_never_written_over(tmp_path: Path) -> None:
    backup = tmp_path / "cell.zip"
    backup.write_bytes(small.packed(FILES))
    with pytest.raises(FileError, match=r"cell\.zip/programs/p0\.src: lies in a \.zip, which is never written over"):
        corrected(backup).write_in_place()
    with pytest.raises(FileError, match="is an input"):
        corrected(backup).write(tmp_path, whole=True)
    assert backup.read_bytes() == small.packed(FILES)


def test_the_output_must_lie_outside_of_the_backup(tmp_path: Path) -> None:
    backup = small.lay(tmp_path / "cell", FILES)
    with pytest.raises(FileError, match="lies in the backup"):
        corrected(backup).write(backup / "out")
    assert tree(backup) == FILES


def test_a_whole_without_a_backup_is_an_error(tmp_path: Path) -> None:
    text = b"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n"
    with pytest.raises(DataError, match="only on the backup of a controller"):
        corrected(small.lay(tmp_path / "a", {"a.src": text})).write(tmp_path / "out", whole=True)


def test_nothing_is_written_if_one_file_cannot_be(tmp_path: Path) -> None:
    backup = small.lay(tmp_path / "cell", FILES)
    (tmp_path / "out" / "cell" / "last.bin").mkdir(parents=True)
    with pytest.raises(FileError, match=r"last\.bin"):
        corrected(backup).write(tmp_path / "out", whole=True)
    assert tree(tmp_path / "out") == {}


def test_links_are_not_copied(tmp_path: Path) -> None:
    backup = small.lay(tmp_path / "cell", FILES)
    (backup / "link").symlink_to(tmp_path)
    with pytest.raises(FileError, match="is a link"):
        corrected(backup).write(tmp_path / "out", whole=True)


@pytest.mark.parametrize("how", ["whole zip", "whole folder", "changed files", "list alone", "zip of results"])
def test_a_corrected_backup_is_recognised(tmp_path: Path, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    backup = tmp_path / "cell.zip"
    backup.write_bytes(small.packed(FILES))
    folder = small.lay(tmp_path / "cell", FILES)
    given, out = (backup if how == "whole zip" else folder), tmp_path / "out"
    corrected(given).write(out, whole=how.startswith("whole"))
    monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path / "another"))  # the records alone
    again = {"whole zip": out / "cell.zip", "whole folder": out / "cell"}.get(how, out)
    if how in ("changed files", "list alone", "zip of results"):
        small.lay(out, {name: data for name, data in FILES.items() if not name.endswith(".src")})
    if how == "list alone":
        for record in out.glob("*.corrections.*"):
            record.unlink()
    if how == "zip of results":
        again = tmp_path / "results.zip"
        again.write_bytes(small.packed(tree(out)))
    with pytest.raises(RefusedError, match="was corrected already"):
        corrected(again)


def test_names_of_members_are_the_users_everywhere(tmp_path: Path) -> None:
    backup = tmp_path / "cell.zip"
    backup.write_bytes(small.packed(FILES))
    batch = corrected(backup)
    record = batch.to_dict()["programs"][0]
    assert {entry["file"] for entry in record["files"]} == {f"{backup}/programs/p{k}.src" for k in range(3)}
    assert {target["file"] for target in record["targets"]} == {f"{backup}/programs/p{k}.src" for k in range(3)}
    assert np.allclose([target["correction_mm"] for target in record["targets"]], [1.0, 0.0, 0.0])
    assert f"--- {backup}/programs/p0.src" in batch.corrected[0].diff()
