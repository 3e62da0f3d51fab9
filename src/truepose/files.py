"""Reading and writing whole files: clear errors, and never a half-written result."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from truepose.errors import FileError


def read_bytes(path: str | Path) -> bytes:
    """Return the content of a file.

    Raises
    ------
    FileError
        If there is no such file, it is a folder, or it may not be read.
    """
    try:
        return Path(path).read_bytes()
    except FileNotFoundError:
        raise FileError(path, "no such file") from None
    except IsADirectoryError:
        raise FileError(path, "is a folder; name a file in it") from None
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None


def read_text(path: str | Path) -> str:
    """Return the content of a UTF-8 text file, with or without a byte-order mark; see `read_bytes` for the errors."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(path, f"is not UTF-8 text (byte {error.start}); save it as UTF-8") from None


def write_atomic(path: str | Path, content: bytes | str) -> None:
    """Write a file so that it holds either its old content or all of the new; see `writing`."""
    with writing(path) as (file,):
        file.write(content.encode("utf-8") if isinstance(content, str) else content)


@contextlib.contextmanager
def writing(*paths: str | Path) -> Iterator[list[BinaryIO]]:
    """Open files to be written all together or not at all.

    What is written goes to temporary files in the same folders, which are renamed, in this order, when the block ends
    well. Folders above them are made.

    Raises
    ------
    FileError
        If a file cannot be written; nothing is changed then.
    """
    goals, drafts = [Path(path) for path in paths], list[Path]()
    path = goals[0]
    with contextlib.ExitStack() as stack:
        try:
            opened: list[BinaryIO] = []
            for path in goals:
                if path.is_dir():
                    raise FileError(path, "is a folder; name a file in it")
                path.parent.mkdir(parents=True, exist_ok=True)
                handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:100]}.")
                drafts.append(Path(name))
                opened.append(stack.enter_context(os.fdopen(handle, "wb")))
            yield opened
            for path, draft, file in zip(goals, drafts, opened, strict=True):
                file.flush()
                os.fsync(file.fileno())
                file.close()
                draft.chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask())
            _rename(drafts, goals)
        except OSError as error:
            what = f"cannot be written: {error.strerror or error}; choose another output path"
            raise FileError(path, what) from None
        finally:
            for draft in drafts:
                draft.unlink(missing_ok=True)


def _rename(drafts: list[Path], goals: list[Path]) -> None:
    """Rename files, all or none; what they replace comes back if one cannot be renamed."""
    pairs = list(zip(goals, drafts, strict=True))
    # the last one needs no way back
    old = {path: draft.with_name(f"{draft.name}.old") for path, draft in pairs[:-1] if path.exists()}
    done: list[Path] = []
    try:
        for path, kept in old.items():
            shutil.copy2(path, kept)
        for path, draft in pairs:
            draft.replace(path)
            done.append(path)
    except BaseException:
        for path in done:
            if path in old:
                old[path].replace(path)
            else:
                path.unlink()
        raise
    finally:
        for kept in old.values():
            kept.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
