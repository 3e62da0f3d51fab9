"""Errors as problem documents (RFC 9457): one description for the command line's events, for jobs and for the web."""

from __future__ import annotations

import errno
import os
from typing import Any, Final

from truepose.errors import FileError, TrueposeError, one_line

_KINDS: Final[dict[str, tuple[int, str]]] = {
    "FileError": (422, "File not accepted"),
    "DataError": (422, "Data not accepted"),
    "RobotError": (422, "Robot not accepted"),
    "IdentifiabilityError": (422, "Parameters not identifiable"),
    "KrigingError": (422, "Kriging not possible"),
    "RefusedError": (409, "Refused"),
    "MissingPackageError": (501, "Package not installed"),
    "StoreError": (503, "Store not available"),
    "TrueposeError": (422, "Not possible"),
    "UsageError": (400, "Wrong usage"),
    "DiskFullError": (507, "Disk full"),
    "OSError": (500, "File not readable or writable"),
    "MemoryError": (507, "Not enough memory"),
    "RecursionError": (422, "Input nested too deeply"),
    "Interrupted": (503, "Interrupted"),
    "ProcessError": (500, "The process failed"),
    "InternalError": (500, "Internal error"),
}
_NO_SPACE: Final = (errno.ENOSPC, errno.EDQUOT)


def problem(error: BaseException) -> dict[str, Any]:
    """Return the problem document of an error.

    Returns
    -------
    dict
        ``type`` (the name of the error's class), ``title``, ``status`` (of HTTP) and ``detail`` (one line, complete);
        ``file`` and ``line`` if they are known; ``remedy`` if the error has notes. An error may have its own
        ``status`` and ``title`` as attributes.

    Examples
    --------
    >>> problem(FileError("a.csv", "has no header", line=1))["line"]
    1
    """
    kind = _kind(error)
    notes = [one_line(note) for note in getattr(error, "__notes__", [])]
    made = document(kind, "; ".join([message(error), *notes]))
    made.update({name: value for name in ("status", "title") if (value := getattr(error, name, None)) is not None})
    if isinstance(error, FileError):
        made["file"] = one_line(str(error.path))
        if error.line is not None:
            made["line"] = error.line
    elif isinstance(error, OSError) and (name := _file_name(error)):
        made["file"] = one_line(name)
    if notes:
        made["remedy"] = "; ".join(notes)
    return made


def document(kind: str, detail: str) -> dict[str, Any]:
    """Return the problem document of a kind of error that is not in an exception, such as a process that was killed."""
    status, title = _KINDS[kind]
    return {"type": kind, "title": title, "status": status, "detail": one_line(detail)}


def message(error: BaseException) -> str:
    """Return the message of an error as one line, without its notes: what is wrong, where, and what to do."""
    if isinstance(error, TrueposeError):
        return str(error)
    if isinstance(error, OSError):
        return one_line(f"{_file_name(error) or 'the output'}: cannot be read or written: {error.strerror or error}")
    if isinstance(error, MemoryError):
        return "not enough memory; use fewer samples, another predictor or fewer workers"
    if isinstance(error, RecursionError):
        return "the input is nested too deeply; is it the right file?"
    what = f"internal error ({type(error).__name__}: {error}); set TRUEPOSE_TRACEBACK=1 for details and report it"
    return one_line(what)


def _file_name(error: OSError) -> str:
    """Return the name of the file of an error; empty for stdout, which has none."""
    name: object = error.filename
    return os.fsdecode(name) if isinstance(name, str | bytes | os.PathLike) else ""


def _kind(error: BaseException) -> str:
    cause = error.__cause__ if isinstance(error, FileError) else error
    if isinstance(cause, OSError) and cause.errno in _NO_SPACE:
        return "DiskFullError"
    return next((one.__name__ for one in type(error).__mro__ if one.__name__ in _KINDS), "InternalError")
