"""A folder of blobs: complete or absent, checked when read, and no way out of the folder."""

from __future__ import annotations

import errno
import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from truepose._io.blobs import BlobFolder
from truepose.errors import DataError, FileError

DATA = b"DEF MAIN()\nEND\n"
SHA = hashlib.sha256(DATA).hexdigest()


@pytest.fixture
def blobs(tmp_path: Path) -> BlobFolder:
    return BlobFolder(tmp_path / "blobs")


def test_bytes_and_files_have_the_same_place(blobs: BlobFolder, tmp_path: Path) -> None:
    (tmp_path / "a.src").write_bytes(DATA)
    assert SHA not in blobs
    assert blobs.put(DATA) == blobs.put_file(tmp_path / "a.src") == SHA
    assert SHA in blobs
    assert blobs.read(SHA) == DATA
    assert blobs.path(SHA) == blobs.root / SHA[:2] / SHA[2:]
    assert list(blobs.list()) == [SHA]
    assert not list(blobs.root.glob(".draft-*"))


def test_large_files_are_copied_in_parts(blobs: BlobFolder, tmp_path: Path) -> None:
    data = os.urandom(2**21 + 17)
    (tmp_path / "a").write_bytes(data)
    assert blobs.read(blobs.put_file(tmp_path / "a")) == data


def test_many_put_the_same_at_once(blobs: BlobFolder) -> None:
    with ThreadPoolExecutor(8) as pool:
        assert set(pool.map(blobs.put, [DATA] * 64)) == {SHA}
    assert list(blobs.list()) == [SHA]
    assert [path for path in blobs.root.rglob("*") if path.is_file()] == [blobs.path(SHA)]


@pytest.mark.parametrize(
    "bad", ["", "../../etc/passwd", SHA.upper(), SHA[:-1], f"{SHA}\n", f"/{SHA[1:]}", "ab/" + SHA[3:]]
)
def test_what_is_no_hash_is_no_path(blobs: BlobFolder, bad: str) -> None:
    assert bad not in blobs
    with pytest.raises(DataError, match="64 lower-case hexadecimal digits"):
        blobs.path(bad)
    with pytest.raises(DataError, match="64 lower-case hexadecimal digits"):
        blobs.read(bad)


def test_a_missing_blob_and_a_missing_file_are_named(blobs: BlobFolder, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"blob is missing; restore it"):
        blobs.read(SHA)
    with pytest.raises(FileError, match="cannot be read"):
        blobs.put_file(tmp_path / "none")
    assert list(blobs.list()) == []


@pytest.mark.parametrize("content", [b"", DATA[:-1], b"X" * len(DATA)])
def test_changed_content_is_refused(blobs: BlobFolder, content: bytes) -> None:
    blobs.put(DATA)
    blobs.path(SHA).write_bytes(content)
    with pytest.raises(FileError, match="does not match its name"):
        blobs.read(SHA)


@pytest.mark.parametrize("content", [b"", DATA[:-1]])
def test_a_truncated_blob_is_replaced_by_the_next_put(blobs: BlobFolder, content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(DATA)
    for put in (lambda: blobs.put(DATA), lambda: blobs.put_file(tmp_path / "a")):
        blobs.put(DATA)
        blobs.path(SHA).write_bytes(content)
        put()
        assert blobs.read(SHA) == DATA


def test_a_full_disk_leaves_nothing(blobs: BlobFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("truepose._io.blobs.os.fsync", full)
    with pytest.raises(FileError, match="a blob cannot be written"):
        blobs.put(DATA)
    assert SHA not in blobs
    assert [path for path in blobs.root.rglob("*") if path.is_file()] == []


def test_folders_of_many_blobs_are_flushed_once_before_the_block_ends(
    blobs: BlobFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    flushed: list[Path] = []
    monkeypatch.setattr("truepose._io.blobs.sync_folder", flushed.append)
    with blobs.synced_at_end():
        shas = [blobs.put(b"%d" % i) for i in range(600)]
        assert flushed == []
    assert flushed == sorted({blobs.root, *(blobs.path(sha).parent for sha in shas)})
    flushed.clear()
    blobs.put(DATA)
    assert blobs.path(SHA).parent in flushed  # at once again


def test_drafts_of_a_process_that_was_killed_are_no_blobs(blobs: BlobFolder) -> None:
    blobs.put(DATA)
    (blobs.root / ".draft-abc").write_bytes(b"half")
    (blobs.root / SHA[:2] / "notes.txt").write_text("x")
    assert list(blobs.list()) == [SHA]
