"""Backups as folders and .zip files: what is read, what is refused, and that nothing is unpacked."""

from __future__ import annotations

import os
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest
from tests.programs.backups import small

from truepose._io import zips
from truepose._io.files import read_bytes
from truepose._io.folders import files_within
from truepose._io.zip_writer import write_changed
from truepose.errors import FileError
from truepose.programs import read_programs

pytestmark = pytest.mark.usefixtures("small_format")


def zipped(path: Path, files: dict[str, bytes]) -> Path:
    path.write_bytes(small.packed(files))
    return path


def test_a_zip_reads_as_its_folder_does(tmp_path: Path) -> None:
    folder = small.lay(tmp_path / "a", small.files_of())
    archive = zipped(tmp_path / "a.zip", small.files_of())
    one, other = read_programs([folder]), read_programs([archive])
    assert not one.unreadable
    assert not other.unreadable
    (a,), (b,) = one.programs, other.programs
    assert len(a.targets) == 2
    assert a.counts() == b.counts() == {"correct": 2, "skip": 0, "refuse": 0}
    assert (a.positions_base() == b.positions_base()).all()
    assert [s.path.relative_to(folder) for s in a.sources] == [s.path.relative_to(archive) for s in b.sources]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "a.zip"]  # nothing is unpacked


def test_a_zip_in_a_zip_and_in_a_folder_is_read(tmp_path: Path) -> None:
    inner = small.packed(small.files_of())
    archive = zipped(tmp_path / "outer.zip", {"readme.txt": b"x", "R1/Inner.ZIP": inner})
    folder = small.lay(tmp_path / "folder", {"Inner.ZIP": inner})
    for path, name in ((archive, "R1/Inner.ZIP"), (folder, "Inner.ZIP")):
        found = read_programs([path])
        assert [one.name for one in found.backups[0].controllers] == [name]
        assert found.programs[0].sources[0].path == path / name / "programs/p0.src"
        assert found.programs[0].counts()["correct"] == 2


def test_a_broken_zip_in_a_backup_is_told_and_the_rest_is_read(tmp_path: Path) -> None:
    broken = small.packed({"a.src": b"DEF a()\nEND\n"})[:-30]
    found = read_programs([zipped(tmp_path / "a.zip", {**small.files_of(), "copy.zip": broken})])
    assert found.programs[0].counts()["correct"] == 2
    (warning,) = found.backups[0].warnings
    assert warning.startswith(f"{tmp_path}/a.zip/copy.zip: is no .zip or is truncated")


def test_damage_in_one_file_names_it_as_the_user_knows_it(tmp_path: Path) -> None:
    data = bytearray(small.packed(small.files_of()))
    at = data.index(b"programs/p0.src") + len("programs/p0.src") + 10
    data[at] ^= 0xFF
    path = tmp_path / "a.zip"
    path.write_bytes(data)
    with pytest.raises(FileError, match=r"is damaged in its \.zip") as caught:
        read_bytes(path / "programs/p0.src")
    assert caught.value.path == path / "programs/p0.src"
    assert read_bytes(path / "programs/p1.src") == small.files_of()["programs/p1.src"]


def named(*names: str) -> Callable[[bytes], bytes]:
    """Put other names of the same length in place of the first files' names."""

    def change(data: bytes) -> bytes:
        for k, name in enumerate(names):
            data = data.replace(f"file{k}".ljust(len(name), "_")[: len(name)].encode(), name.encode())
        return data

    return change


def directory_field(offset: int, form: str, value: int) -> Callable[[bytes], bytes]:
    """Change a field of the first entry of the directory."""

    def change(data: bytes) -> bytes:
        made = bytearray(data)
        struct.pack_into(form, made, data.index(b"PK\x01\x02") + offset, value)
        return bytes(made)

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (named("../ab"), "'../ab' leads out of the .zip"),
        (named("/etcx"), "'/etcx' leads out"),
        (named("C:abc"), "'C:abc' leads out"),
        (named("a\\..\\"), "leads out"),
        (named("a\0bcd"), "leads out"),
        (named("filex", "filex"), "two files of the name filex"),
        (named("FILEx", "filex"), "FILEx and filex differ only in case"),
        (named("file1", "file1/x"), "is a file and, for file1/x, a folder"),
        (directory_field(8, "<H", 1), "is encrypted"),
        (directory_field(24, "<L", 2**24), r"would unpack from \d+ to 16777216 bytes"),
        (directory_field(42, "<L", 2**20), "overlaps another member"),
        (lambda data: data[: len(data) // 2], "is truncated"),
        (lambda data: data[:-1], "is truncated|impossible size"),
        (lambda data: b"", "is no .zip or is truncated"),
    ],
)
def test_a_zip_that_could_do_harm_is_refused(tmp_path: Path, change: Callable[[bytes], bytes], message: str) -> None:
    files = {"file0": b"one\n" * 50, "file1": b"two\n", "controller.txt": b"KR 10"}
    if message.endswith("a folder"):
        files = {"file0": b"one", "file1__": b"two"}
    data = change(small.packed(files))
    path = tmp_path / "a.zip"
    path.write_bytes(data)
    with pytest.raises(FileError, match=message) as caught:
        files_within(path)
    assert str(caught.value).startswith(f"{path}")
    found = read_programs([path])
    assert len(found.unreadable) == 1
    assert not found.programs


def test_a_member_that_unpacks_to_more_than_it_states_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    path.write_bytes(directory_field(24, "<L", 10)(small.packed({"file0": b"0" * 2**20, "b": b""})))
    with pytest.raises(FileError, match="size or check sum are not as stated"):
        read_bytes(path / "file0")


def test_zips_that_unpack_to_too_much_together_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = zipped(tmp_path / "a.zip", {f"{k}.txt": bytes(range(256)) * 8 for k in range(8)})
    assert len(files_within(path).files) == 8
    monkeypatch.setattr(zips, "LARGEST_UNPACKED", 1000)
    zips._directory.cache_clear()
    with pytest.raises(FileError, match="would unpack from"):
        files_within(path)


def test_links_in_a_zip_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        link = zipfile.ZipInfo("link.src")
        link.create_system, link.external_attr = 3, 0o120777 << 16
        archive.writestr(link, "/etc/passwd")
        archive.writestr("a.src", "x")
    found = files_within(path)
    assert [file.name for file in found.files] == ["a.src"]
    assert found.warnings == [f"{path}/link.src: is a link and is left out"]


def test_a_zip_without_a_backup_asks_for_a_folder(tmp_path: Path) -> None:
    found = read_programs([zipped(tmp_path / "a.zip", {"a.src": b"DEF a()\nEND\n"})])
    assert "holds no backup that is recognised; unpack it" in str(found.unreadable[0])


def test_a_folder_that_is_no_backup_is_read_as_before(tmp_path: Path) -> None:
    files = {name: data for name, data in small.files_of().items() if name.endswith(".src")}
    found = read_programs([small.lay(tmp_path / "a", files)])
    assert not found.backups
    assert found.programs[0].counts() == {"correct": 0, "skip": 0, "refuse": 2}


def test_a_path_below_a_plain_file_is_no_file(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(FileError, match="no such file"):
        read_bytes(tmp_path / "a.txt" / "b")


def test_what_is_no_file_is_said_before_it_is_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.zip")
    for name, message in (("missing.zip", "no such file"), ("a/b.zip", "no such file"), ("pipe.zip", "is a device")):
        (error,) = read_programs([tmp_path / name]).unreadable
        assert str(error).startswith(f"{tmp_path / name}: {message}")


def test_a_program_in_a_zip_is_not_read_alone(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.zip", small.files_of())
    (error,) = read_programs([path / "programs/p0.src"]).unreadable
    assert "lies in a .zip; give a.zip itself" in str(error)


def test_damaged_zips_are_read_refused_or_written_but_never_crash(tmp_path: Path) -> None:
    inner = small.packed({"a.src": b"abc" * 50, "b": b""})
    data = small.packed({"x/a.src": b"LIN P1\n" * 60, "in.zip": inner, "c": bytes(range(256))}, comment=b"hello")
    random, path, new = Random(7), tmp_path / "a.zip", tmp_path / "b.zip"
    outcomes = set()
    for _ in range(150):
        damaged = bytearray(data)
        at = random.randrange(len(data))
        damaged[at : at + random.choice((0, 1, 1, 9))] = random.randbytes(random.choice((0, 1, 1, 5)))
        path.write_bytes(damaged)
        zips._directory.cache_clear()
        zips._nested.cache_clear()
        try:
            found = files_within(path).files
            contents = [read_bytes(file) for file in found]
            with new.open("w+b") as out:
                write_changed(path, {found[0].relative_to(path).as_posix(): lambda: b"new"}, out)
            with zipfile.ZipFile(new) as archive:
                assert archive.testzip() is None
            outcomes.add("read" if b"LIN P1\n" * 60 in contents else "read otherwise")
        except FileError:
            outcomes.add("refused")
    assert outcomes == {"read", "refused"}  # check sums show every other content
