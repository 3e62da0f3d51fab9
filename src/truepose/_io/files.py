"""Read and write whole files: clear errors, no partly written results, nothing overwritten without permission."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final

from truepose._io import zips
from truepose._io.commits import Commit, recover, written
from truepose.errors import FileError

__all__ = [
    "Commit",
    "check_outputs",
    "check_regular",
    "note_read",
    "overwrite",
    "path_exists",
    "read_bytes",
    "read_text",
    "reads_noted",
    "recover",
    "watched",
    "write_all",
    "write_atomic",
    "writing",
]

LARGEST_FILE: Final = 2**28
"""The largest size of a table, a program or a measurement file in bytes: 256 MiB, some million rows."""
LARGEST_CONFIG: Final = 2**20
"""The largest size of a cell file, a robot file or saved columns in bytes: 1 MiB."""


@dataclass
class Watch:
    """The files that a command has read, and whether it may overwrite existing ones."""

    force: bool = False
    read: set[tuple[int, int]] = field(default_factory=set)


_WATCH: ContextVar[Watch | None] = ContextVar("watch", default=None)


@contextlib.contextmanager
def watched() -> Iterator[Watch]:
    """Within the block, refuse to overwrite files that were read in it, and other files unless `force` is set."""
    token = _WATCH.set(watch := Watch())
    written.clear()
    try:
        yield watch
    finally:
        _WATCH.reset(token)


def overwrite(force: bool) -> None:
    """Set whether the watched command may overwrite existing files; inputs are never overwritten."""
    if (watch := _WATCH.get()) is not None:
        watch.force = force


@contextlib.contextmanager
def reads_noted() -> Iterator[set[tuple[int, int]]]:
    """Within the block, collect the identities of the files that are read, for `note_read` in another process."""
    before = _WATCH.get()
    token = _WATCH.set(watch := Watch(force=before is None or before.force))
    try:
        yield watch.read
    finally:
        _WATCH.reset(token)


def note_read(identities: Iterable[tuple[int, int]]) -> None:
    """Count files that another process has read for the watched command among its inputs."""
    if (watch := _WATCH.get()) is not None:
        watch.read.update(identities)


def read_bytes(path: str | Path, largest: int = LARGEST_FILE) -> bytes:
    """Return the content of a file, which may lie in a .zip (`truepose._io.zips`).

    Parameters
    ----------
    path : str or Path
        The file, or a path that leads into a .zip.
    largest : int
        The largest size in bytes; a larger file is not opened.

    Raises
    ------
    FileError
        If the file does not exist, is a folder, a device or a pipe, is too large, or cannot be read.
    """
    try:
        check_regular(path, largest)
        with Path(path).open("rb") as file:
            if (watch := _WATCH.get()) is not None:
                watch.read.add(_identity(os.fstat(file.fileno())))
            return file.read()
    except (FileNotFoundError, NotADirectoryError):
        return _read_in_zip(Path(path), largest)
    except (OSError, ValueError) as error:  # ValueError: a path with a zero byte
        if isinstance(error, FileError):
            raise
        raise FileError(path, f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    except MemoryError:
        raise FileError(path, "is too large for the memory of this machine; split it") from None


def _read_in_zip(path: Path, largest: int) -> bytes:
    if (found := zips.read_member(path, largest)) is None:
        raise FileError(path, "no such file")
    if (watch := _WATCH.get()) is not None:
        watch.read.add(_identity(zips.on_disk(path).stat()))
    return found


def path_exists(path: str | Path) -> bool:
    """Return whether a file or folder exists.

    Raises
    ------
    FileError
        If the path cannot be resolved: a loop of links, a name that is too long, a zero byte.
    """
    try:
        Path(path).stat()
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as error:
        raise FileError(path, f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    return True


def check_regular(path: str | Path, largest: int = LARGEST_FILE) -> None:
    """Refuse a path that is not a regular file before it is opened: opening a pipe could wait for ever.

    Raises
    ------
    FileError
        If it is a folder, a device, a pipe or a socket, or larger than `largest` bytes.
    OSError, ValueError
        If the file does not exist, or its path cannot be resolved.
    """
    status = Path(path).stat()
    if stat.S_ISDIR(status.st_mode):
        raise FileError(path, "is a folder; name a file in it")
    if not stat.S_ISREG(status.st_mode):
        raise FileError(path, "is a device or a pipe, not a file; save its content as a file")
    if status.st_size > largest:
        size = f"{status.st_size / 2**20:,.0f} MiB"
        raise FileError(path, f"has {size}, expected at most {largest / 2**20:,.0f} MiB; is it the right file?")


def read_text(path: str | Path, largest: int = LARGEST_FILE) -> str:
    """Return the content of a UTF-8 text file, with or without a byte-order mark; see `read_bytes` for the errors."""
    try:
        return read_bytes(path, largest).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(path, f"is not UTF-8 text (byte {error.start}); save it as UTF-8") from None


def check_outputs(*paths: str | Path, force: bool = True, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse outputs that must not be written, after recovery from interrupted runs in their folders.

    Parameters
    ----------
    paths : str or Path
        The files to write.
    force : bool
        Whether existing files may be overwritten; within a command (`watched`), its own permission is also required.
    inputs : iterable of str or Path
        Further files that are never overwritten, under any name or link, besides those that the command has read.

    Raises
    ------
    FileError
        If an output is a folder, a link, not a regular file, an input, or exists and may not be overwritten.
    """
    for folder in dict.fromkeys(Path(path).parent for path in paths):
        recover(folder)
    watch = _WATCH.get() or Watch(force=True)
    kept = watch.read | {_identity(Path(path).stat()) for path in inputs}
    for path in map(Path, paths):
        try:
            status = path.lstat()
        except FileNotFoundError:
            continue
        except OSError as error:
            raise FileError(path, f"cannot be written: {error.strerror}; choose another output path") from None
        if stat.S_ISLNK(status.st_mode):
            raise FileError(path, "is a link; name the file that it points to")
        if stat.S_ISDIR(status.st_mode):
            raise FileError(path, "is a folder; name a file in it")
        if not stat.S_ISREG(status.st_mode):
            raise FileError(path, "is a device or a pipe, not a file; choose another output path")
        if _identity(status) in kept:
            raise FileError(path, "is an input, and inputs are never overwritten; choose another output path")
        if not (force and watch.force):
            raise FileError(
                path, "exists already; choose another output path, or overwrite it with --force (force=True)"
            )


def _identity(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino


def write_atomic(path: str | Path, content: bytes | str) -> None:
    """Write a file so that it contains either the old or the complete new content; see `writing`."""
    write_all({Path(path): content})


def write_all(contents: Mapping[Path, bytes | str]) -> None:
    """Write files all together or not at all; see `writing`."""
    with writing(*contents) as opened:
        for file, content in zip(opened, contents.values(), strict=True):
            file.write(content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content)


@contextlib.contextmanager
def writing(*paths: str | Path, force: bool = True) -> Iterator[list[BinaryIO]]:
    """Open files that are written all together or not at all; see `truepose._io.commits.Commit`.

    Missing folders are created.

    Raises
    ------
    FileError
        If a file must not (see `check_outputs`) or cannot be written; no file is changed then.
    """
    goals = [Path(path) for path in paths]
    with Commit() as commit, contextlib.ExitStack() as stack:
        check_outputs(*goals, force=force)
        yield [stack.enter_context(commit.open(goal)) for goal in goals]
