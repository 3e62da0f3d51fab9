import os

import pytest

from truepose import files
from truepose.errors import FileError


def test_write_then_read(tmp_path):
    path = tmp_path / "new" / "folder" / "a.txt"
    files.write_atomic(path, "Größe")
    assert files.read_text(path) == "Größe"
    assert [p.name for p in path.parent.iterdir()] == ["a.txt"]


def test_replaces_and_keeps_mode(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    path.chmod(0o640)
    files.write_atomic(path, b"new")
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == 0o640


def test_failed_rename_leaves_old_content_and_no_rubbish(tmp_path, monkeypatch):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")

    def fail(*_args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(FileError, match="cannot be written: No space left on device; choose another output path"):
        files.write_atomic(path, b"new")
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1


def test_several_files_are_written_all_or_none(tmp_path, monkeypatch):
    old, new, last = (tmp_path / name for name in ("old", "new", "last"))
    old.write_bytes(b"old")
    with files.writing(old, new) as (first, second):
        first.write(b"1")
        second.write(b"2")
    assert (old.read_bytes(), new.read_bytes()) == (b"1", b"2")
    new.unlink()
    real, calls = type(tmp_path).replace, []

    def third_fails(path, goal):
        calls.append(goal)
        if len(calls) == 3:
            raise OSError(5, "Input/output error")
        return real(path, goal)

    monkeypatch.setattr(type(tmp_path), "replace", third_fails)
    with pytest.raises(FileError, match="Input/output error"), files.writing(old, new, last) as opened:  # noqa: PT012
        for file in opened:
            file.write(b"x")
    monkeypatch.undo()
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"old": b"1"}
    with pytest.raises(KeyboardInterrupt), files.writing(old, new) as (first, _):  # noqa: PT012
        first.write(b"x")
        raise KeyboardInterrupt
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"old": b"1"}


def test_folder_as_output(tmp_path):
    with pytest.raises(FileError, match="is a folder"):
        files.write_atomic(tmp_path, b"")


def test_file_as_parent_folder(tmp_path):
    (tmp_path / "a").write_bytes(b"")
    with pytest.raises(FileError, match="cannot be written"):
        files.write_atomic(tmp_path / "a" / "b", b"")


@pytest.mark.parametrize(("name", "message"), [("none.txt", "no such file"), (".", "is a folder")])
def test_unreadable(tmp_path, name, message):
    with pytest.raises(FileError, match=message):
        files.read_bytes(tmp_path / name)


def test_text_with_byte_order_mark(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(b"\xef\xbb\xbfx_mm\n")
    assert files.read_text(path) == "x_mm\n"


def test_text_in_another_encoding(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes("Größe".encode("latin-1"))
    with pytest.raises(FileError, match="is not UTF-8 text"):
        files.read_text(path)
