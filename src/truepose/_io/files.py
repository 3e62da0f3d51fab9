"""Reading and writing whole files: clear errors, never a half-written result, and nothing overwritten unasked."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final

from truepose._io.commits import Commit, recover, written
from truepose.errors import FileError

__all__ = [
    "Commit",
    "check_outputs",
    "check_regular",
    "overwrite",
    "path_exists",
    "read_bytes",
    "read_text",
    "recover",
    "watched",
    "write_all",
    "write_atomic",
    "writing",
]

LARGEST_FILE: Final = 2**28
"""Bytes of a table, a program or a file of readings that is read: 256 MiB, some million rows."""
LARGEST_CONFIG: Final = 2**20
"""Bytes of a cell file, a robot file or a mapping of columns that is read: 1 MiB."""


@dataclass
class Watch:
    """What a command read, and whether it may overwrite what is there."""

    force: bool = False
    read: set[tuple[int, int]] = field(default_factory=set)


_WATCH: ContextVar[Watch | None] = ContextVar("watch", default=None)


@contextlib.contextmanager
def watched() -> Iterator[Watch]:
    """Within the block, refuse to write over files that were read in it, and over any other unless `force` is set."""
    token = _WATCH.set(watch := Watch())
    written.clear()
    try:
        yield watch
    finally:
        _WATCH.reset(token)


def overwrite(force: bool) -> None:
    """Set whether the command that is watched may overwrite existing files; inputs it may not."""
    if (watch := _WATCH.get()) is not None:
        watch.force = force


def read_bytes(path: str | Path, largest: int = LARGEST_FILE) -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    path : str or Path
    largest : int
        Bytes; a larger file is not opened.

    Raises
    ------
    FileError
        If there is no such file, it is a folder, a device or a pipe, it is too large, or it may not be read.
    """
    try:
        check_regular(path, largest)
        with Path(path).open("rb") as file:
            if (watch := _WATCH.get()) is not None:
                watch.read.add(_identity(os.fstat(file.fileno())))
            return file.read()
    except FileNotFoundError:
        raise FileError(path, "no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a path with a zero byte
        if isinstance(error, FileError):
            raise
        raise FileError(path, f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    except MemoryError:
        raise FileError(path, "is too large for the memory of this machine; split it") from None


def path_exists(path: str | Path) -> bool:
    """Return whether there is such a file or folder.

    Raises
    ------
    FileError
        If the path cannot be followed: a circle of links, a name too long, a zero byte in it.
    """
    try:
        Path(path).stat()
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as error:
        raise FileError(path, f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    return True


def check_regular(path: str | Path, largest: int = LARGEST_FILE) -> None:
    """Refuse what is no regular file, before it is opened: opening a pipe would wait for ever.

    Raises
    ------
    FileError
        If it is a folder, a device, a pipe or a socket, or larger than `largest` bytes.
    OSError, ValueError
        If there is no such file, or its path cannot be followed.
    """
    status = Path(path).stat()
    if stat.S_ISDIR(status.st_mode):
        raise FileError(path, "is a folder; name a file in it")
    if not stat.S_ISREG(status.st_mode):
        raise FileError(path, "is no file but a device or a pipe; save what it holds as a file")
    if status.st_size > largest:
        size = f"{status.st_size / 2**20:,.0f} MiB"
        raise FileError(path, f"has {size}, at most {largest / 2**20:,.0f} MiB are read; is it the right file?")


def read_text(path: str | Path, largest: int = LARGEST_FILE) -> str:
    """Return the content of a UTF-8 text file, with or without a byte-order mark; see `read_bytes` for the errors."""
    try:
        return read_bytes(path, largest).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(path, f"is not UTF-8 text (byte {error.start}); save it as UTF-8") from None


def check_outputs(*paths: str | Path, force: bool = True, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse outputs that must not be written; what a run that was stopped left in their folders is settled before.

    Parameters
    ----------
    paths : str or Path
        The files that are to be written.
    force : bool
        Existing files may be overwritten. Within a command (`watched`), only if the command, too, was told so.
    inputs : iterable of str or Path
        Files that are never overwritten, by whatever name or link; those that the command read are added.

    Raises
    ------
    FileError
        If an output is a folder, a link, no plain file, an input, or exists and may not be overwritten.
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
            raise FileError(path, "is a link; name the file that it leads to")
        if stat.S_ISDIR(status.st_mode):
            raise FileError(path, "is a folder; name a file in it")
        if not stat.S_ISREG(status.st_mode):
            raise FileError(path, "is no plain file but a device or a pipe; choose another output path")
        if _identity(status) in kept:
            raise FileError(path, "is an input, and inputs are never overwritten; choose another output path")
        if not (force and watch.force):
            raise FileError(
                path, "exists already; choose another output path, or overwrite it with --force (force=True)"
            )


def _identity(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino


def write_atomic(path: str | Path, content: bytes | str) -> None:
    """Write a file so that it holds either its old content or all of the new; see `writing`."""
    write_all({Path(path): content})


def write_all(contents: Mapping[Path, bytes | str]) -> None:
    """Write files all together or not at all; see `writing`."""
    with writing(*contents) as opened:
        for file, content in zip(opened, contents.values(), strict=True):
            file.write(content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content)


@contextlib.contextmanager
def writing(*paths: str | Path, force: bool = True) -> Iterator[list[BinaryIO]]:
    """Open files to be written all together or not at all; see `truepose._io.commits.Commit`.

    Folders above them are made.

    Raises
    ------
    FileError
        If a file must not be written (see `check_outputs`) or cannot be; nothing is changed then.
    """
    goals = [Path(path) for path in paths]
    with Commit() as commit, contextlib.ExitStack() as stack:
        check_outputs(*goals, force=force)
        yield [stack.enter_context(commit.open(goal)) for goal in goals]
