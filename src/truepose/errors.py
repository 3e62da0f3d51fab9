"""Exceptions and warnings of truepose.

Every error that a user can cause is a `TrueposeError`. The command line prints its message on one line and exits with
1. A message says what is wrong, where (file with row or line, or target), what was expected, and what to do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

_LONGEST: Final = 4000


def one_line(text: str) -> str:
    r"""Return a text as one printable line.

    Line ends become blanks. Control characters and undecodable bytes of file names become escapes such as ``\x1b``
    and ``\xff``. The middle of a very long text is left out.

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
    """The base class of all errors caused by the input; the message is one printable line."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))

    def __reduce__(self) -> tuple[Any, ...]:
        """Let errors of workers arrive whole, whatever their constructors take."""
        return _again, (type(self), str(self)), self.__dict__


def _again(kind: type[TrueposeError], message: str) -> TrueposeError:
    return kind.__new__(kind, message)


class FileError(TrueposeError):
    """An error of a file that cannot be read, interpreted or written.

    Parameters
    ----------
    path : str or Path
        The file as the user named it.
    message : str
        The problem and its remedy.
    line : int, optional
        The line of the file, from 1; 0 for the header of a table in memory, which is not shown.
    """

    def __init__(self, path: str | Path, message: str, *, line: int | None = None) -> None:
        self.path = Path(path)
        self.line = line or None
        where = f"{path}:{line}" if line else f"{path}"
        super().__init__(f"{where}: {message}")


class DataError(TrueposeError):
    """An error of arrays, samples or settings: NaN, wrong shape or unit, contradicting duplicates, invalid values."""


class RobotError(TrueposeError):
    """An error of a robot: unknown or unsupported, joints beyond limits, poses out of reach."""


class IdentifiabilityError(TrueposeError):
    """The data do not determine the parameters: rank, condition number, and the names that cannot be separated."""


class KrigingError(TrueposeError):
    """An error of a variogram or Kriging system that cannot be fitted or solved.

    Parameters
    ----------
    message : str
        The problem and its remedy; ``{rows}`` in it stands for the samples that it is about.
    rows : sequence of int
        The rows of these samples in the arrays of the fit, from 0.
    """

    def __init__(self, message: str, rows: Sequence[int] = ()) -> None:
        self.rows = tuple(map(int, rows))
        self._message = message
        super().__init__(message.replace("{rows}", f"rows {', '.join(map(str, self.rows))}"))

    def of_rows(self, rows: Sequence[int]) -> KrigingError:
        """Return the error with the rows of a larger array: `rows` holds the place there of each row of this one."""
        return KrigingError(self._message, [rows[row] for row in self.rows])

    def with_names(self, source: str, name: Callable[[Sequence[int]], str]) -> KrigingError:
        """Return the error with the names of its samples instead of their rows, after the file that holds them."""
        return KrigingError(f"{source}: {self._message.replace('{rows}', name(self.rows))}")


class RefusedError(TrueposeError):
    """A correction or file operation that a guard refuses under the current policy."""


class MissingPackageError(TrueposeError):
    """A function needs a package that is not installed; the message names the extra of the installation that has it."""


class StoreError(TrueposeError):
    """An error of a team's store: it cannot be reached, is busy, damaged, or of another version than the program."""


class IllConditionedWarning(UserWarning):
    """A system that was solved with few remaining digits: its condition number, and the remedy."""


class RecoveryWarning(UserWarning):
    """An earlier run was interrupted while it wrote files; they were completed, restored or removed."""


class TrueposeDeprecationWarning(FutureWarning):
    """A former name of a function, argument or option: what to write instead, and the version that removes it.

    Python shows it by default, unlike `DeprecationWarning`, because those who call truepose are its users.
    """


class VariogramWarning(UserWarning):
    """A variogram model that the samples do not support: a parameter at its bound, or no sill within the samples."""
