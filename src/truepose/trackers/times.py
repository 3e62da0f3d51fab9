"""Time stamps of vendors, loggers and spreadsheets as seconds since 1970, by the clock of the file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from truepose._io.strict import to_float
from truepose._typing import FloatArray, IntArray
from truepose.errors import FileError

EPOCH: Final = datetime(2025, 3, 7, 9, 15, 2, tzinfo=UTC).timestamp()
"""The time 0 of a virtual cell in exported files."""

_FORMS: Final = (
    "%m/%d/%y %H:%M:%S",
    "%m/%d/%Y %H:%M:%S",
    "%m/%d/%y %I:%M:%S %p",
    "%m/%d/%Y %I:%M:%S %p",
    "%m/%d/%y",
    "%m/%d/%Y",
    "%Y-%m-%d %H:%M:%S.%f",
    "%Y-%m-%d %H:%M:%S",
    "%Y/%m/%d %H:%M:%S.%f",
    "%Y/%m/%d %H:%M:%S",
    "%d.%m.%Y %H:%M:%S.%f",
    "%d.%m.%Y %H:%M:%S",
)
_ROUNDED: Final = re.compile(r"[0-9][.,][0-9]{0,6}[eE]\+[0-9]+")


def seconds(text: str, path: str | Path, line: int) -> float:
    """Return a date or a number of seconds as seconds since 1970.

    Slashes are month/day/year (US), dots day.month.year, hyphens year-month-day; a leading apostrophe is ignored.

    Raises
    ------
    FileError
        If the text is neither.
    """
    bare = text.strip().lstrip("'").replace("T", " ", 1)
    for form in _FORMS if bare.isascii() else ():
        try:
            return datetime.strptime(bare, form).replace(tzinfo=UTC).timestamp()
        except ValueError:
            continue
    try:
        return to_float(bare.replace(",", "."))
    except ValueError:
        known = "month/day/year hour:minute:second, year-month-day, day.month.year or seconds"
        raise FileError(path, f"the date {text.strip()!r} is not {known}", line=line) from None


def column_seconds(texts: Sequence[str], lines: IntArray, path: str | Path) -> FloatArray | None:
    """Return a column of time stamps (n,) [s]; None if a spreadsheet rounded them to a few digits (``2,02E+13``)."""
    if any(_ROUNDED.fullmatch(text.strip()) for text in texts):
        return None
    return np.array([seconds(text, path, int(line)) for text, line in zip(texts, lines, strict=True)])


def date(time: float, form: str) -> str:
    """Return a time [s] of a virtual cell as a date."""
    return datetime.fromtimestamp(EPOCH + time, tz=UTC).strftime(form)
