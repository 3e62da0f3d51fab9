import contextlib
import os
import stat

import pytest

from truepose._io import files
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


@pytest.mark.promise("Devices, pipes, folders and links are refused as outputs and stay what they are.")
def test_only_plain_files_are_written(tmp_path):
    target, link, dangling, pipe = (tmp_path / name for name in ("target", "link", "dangling", "pipe"))
    target.write_bytes(b"old")
    link.symlink_to(target)
    dangling.symlink_to(tmp_path / "nowhere")
    os.mkfifo(pipe)
    with contextlib.suppress(PermissionError):  # only root makes a device; never try this on a real one
        os.mknod(tmp_path / "device", stat.S_IFCHR | 0o600, os.makedev(1, 3))
    for path, message in (
        (link, "is a link; name the file that it points to"),
        (dangling, "is a link"),
        (pipe, "is a device or a pipe, not a file"),
        *((path, "is a device or a pipe, not a file") for path in tmp_path.glob("device")),
        (tmp_path, "is a folder"),
    ):
        before = os.lstat(path)
        with pytest.raises(FileError, match=message):
            files.write_atomic(path, b"new")
        assert os.lstat(path).st_ino == before.st_ino
        assert os.lstat(path).st_mode == before.st_mode
    assert target.read_bytes() == b"old"
    assert {path.name for path in tmp_path.iterdir()} - {"device"} == {"target", "link", "dangling", "pipe"}


@pytest.mark.promise(
    "A command never overwrites a file that it read, under whatever name or link, not even with --force."
)
def test_inputs_are_never_overwritten(tmp_path):
    first, second, linked, other = (tmp_path / name for name in ("first", "second", "linked", "other"))
    for path in (first, second, other):
        path.write_bytes(b"old")
    os.link(first, linked)
    (tmp_path / "folder").symlink_to(tmp_path)
    with files.watched():
        files.overwrite(True)
        files.read_bytes(first)
        for path in (first, linked, tmp_path / "folder" / "first"):
            with pytest.raises(FileError, match="is an input, and inputs are never overwritten"):
                files.write_atomic(path, b"new")
        with pytest.raises(FileError, match="second: is an input"):
            files.check_outputs(other, second, inputs=[second])
        files.write_atomic(other, b"new")
    files.write_atomic(first, b"new")  # a Python program may
    assert [path.read_bytes() for path in (first, second, linked, other)] == [b"new", b"old", b"old", b"new"]


@pytest.mark.promise(
    "A command overwrites existing files only with --force, and writes none of its files if one exists."
)
def test_existing_files_are_overwritten_only_when_told(tmp_path):
    old, new = tmp_path / "old", tmp_path / "new"
    old.write_bytes(b"old")
    with files.watched():
        with pytest.raises(FileError, match=r"old: exists already; .* overwrite it with --force"):
            files.write_all({new: b"new", old: b"new"})
        assert not new.exists()
        files.overwrite(True)
        with pytest.raises(FileError, match="exists already"), files.writing(old, force=False):
            pass
        files.write_all({new: b"new", old: b"new"})
    assert old.read_bytes() == new.read_bytes() == b"new"


@pytest.mark.promise("A limit on the size of files gives one clear line, and nothing is changed.")
def test_a_limit_of_size(tmp_path):
    resource = pytest.importorskip("resource")
    first, second = tmp_path / "first", tmp_path / "second"
    first.write_bytes(b"old")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
    try:
        with pytest.raises(FileError, match=r"second: cannot be written: File too large; choose another output path$"):
            files.write_all({first: b"new", second: b"x" * 100_000})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"first": b"old"}
