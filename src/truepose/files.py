"""Reading and writing whole files: clear errors, and never a half-written result."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path

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
    """Write a file so that it holds either its old content or all of the new.

    The content goes to a temporary file in the same folder, which is then renamed. Folders above it are made.

    Raises
    ------
    FileError
        If the file cannot be written; nothing is changed then.
    """
    path = Path(path)
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary: str | None = None
    try:
        if path.is_dir():
            raise FileError(path, "is a folder; name a file in it")
        path.parent.mkdir(parents=True, exist_ok=True)
        mode = path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask()
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(mode)
        Path(temporary).replace(path)
        temporary = None
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}; choose another output path") from None
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                Path(temporary).unlink()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
