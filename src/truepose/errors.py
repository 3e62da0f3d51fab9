"""Typed exceptions: what was wrong, what came, what was expected, where, and what to do.

Every error that a user can cause derives from `TrueposeError`. The command line prints its message on one line and
exits with 1, so a message stands alone: it names the file with its row or line, or the target, and ends with the
remedy.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

_LONGEST: Final = 4000


def one_line(text: str) -> str:
    r"""Return a text as one line that any terminal and any encoding can show.

    Line ends become blanks. Control characters, and bytes of a file name that are not UTF-8, become
    escapes such as ``\x1b`` and ``\xff``. The middle of a very long text is left out.

    Examples
    --------
    >>> one_line("two\nlines, \udcff and \x1b[31m")
    'two lines, \\xff and \\x1b[31m'
    """
    if len(text) > _LONGEST:
        text = f"{text[: _LONGEST // 2]} … {text[-_LONGEST // 4 :]}"
    text = " ".join(line.strip() for line in text.splitlines()) if len(text.splitlines()) > 1 else text.rstrip("\r\n")
    return text if text.isprintable() else "".join(c if c.isprintable() else _escaped(c) for c in text)


def _escaped(character: str) -> str:
    code = ord(character)
    code -= 0xDC00 if 0xDC80 <= code <= 0xDCFF else 0  # a byte of a file name, see os.fsdecode
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


class TrueposeError(ValueError):
    """Base of all errors that the input, not the program, causes; the message is one printable line."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


class FileError(TrueposeError):
    """A file that cannot be read, understood or written.

    Parameters
    ----------
    path : str or Path
        The file, as the user named it.
    message : str
        What is wrong and what to do.
    line : int, optional
        Line of the file, counted from 1.
    """

    def __init__(self, path: str | Path, message: str, *, line: int | None = None) -> None:
        self.path = Path(path)
        self.line = line
        where = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{where}: {message}")


class DataError(TrueposeError):
    """Arrays or samples that cannot be right: NaN, wrong shape, wrong unit, duplicates that contradict each other."""


class RobotError(TrueposeError):
    """A robot that is not known or not supported, joints beyond limits, poses out of reach."""


class IdentifiabilityError(TrueposeError):
    """The data cannot tell what was asked of them: rank, condition number, and the names that cannot be told apart."""


class KrigingError(TrueposeError):
    """A variogram or Kriging system that cannot be fitted or solved."""


class RefusedError(TrueposeError):
    """A correction that a guard forbids under the policy in force."""


class IllConditionedWarning(UserWarning):
    """A system that was solved, but with few digits left: its condition number, and the remedy."""


class RecoveryWarning(UserWarning):
    """A run that was stopped while it wrote files, and what was done with them: finished, undone, or removed."""


class VariogramWarning(UserWarning):
    """A variogram model that the samples do not support: a parameter at its bound, or no sill within the samples."""
