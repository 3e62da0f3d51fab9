"""Text in columns: one parser for every table with a header line, with the line in each message."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose._io.strict import LARGEST, to_float
from truepose._typing import FloatArray, IntArray
from truepose.errors import FileError

LONGEST_LINE: Final = 20_000
"""Characters of a line of a table."""
MOST_COLUMNS: Final = 500
_LARGEST_TABLE: Final = 2**31  # bytes of a table's fields
_FORMULA: Final = re.compile("'*[=+@\\t\\r-]")

_DECIMAL_COMMA: Final = re.compile(r"[+-]?[0-9]+,[0-9]*([eE][+-]?[0-9]+)?")
_DECIMAL_POINT: Final = re.compile(r"[+-]?[0-9]+\.[0-9]*([eE][+-]?[0-9]+)?")


@dataclass(frozen=True)
class TextTable:
    """A header and the fields under it, as text.

    Attributes
    ----------
    path : str or Path
        For messages.
    delimiter : str
    header : list of str
    header_line : int
        Line of the header in the file, from 1.
    fields : (n, k) array of str
    line : (n,) array of int
        Line of each row in the file, from 1.
    """

    path: str | Path
    delimiter: str
    header: list[str]
    header_line: int
    fields: NDArray[np.str_]
    line: IntArray

    def numbers(self, columns: Sequence[int]) -> FloatArray:
        """Return some columns as numbers, (n, len(columns)); decimal commas are taken where they are not the delimiter.

        Raises
        ------
        FileError
            If a field is no number: its line, its column and what stands there.
        """
        text = self.fields[:, list(columns)]
        self._check_plain(text, columns)
        values = self._converted(text, columns)
        if (beyond := np.isfinite(values) & (np.abs(values) > LARGEST)).any():
            row, k = np.argwhere(beyond)[0]
            message = f"{self.header[columns[k]]} is {values[row, k]:g}, beyond {LARGEST:g}; correct or remove the row"
            raise FileError(self.path, message, line=int(self.line[row]))
        return values

    def _check_plain(self, text: NDArray[np.str_], columns: Sequence[int]) -> None:
        """Refuse what Python takes for a number, and people do not: ``1_000``, digits of other scripts."""
        letters = np.ascontiguousarray(text).view(np.uint32).reshape(*text.shape, -1)
        odd = ((letters > 0x7F) | (letters == ord("_"))).any(axis=2)
        if odd.any():
            row, k = np.argwhere(odd)[0]
            message = f"{self.header[columns[k]]} is {_shown(str(text[row, k]))}, which is not a number"
            raise FileError(self.path, message, line=int(self.line[row]))

    def _converted(self, text: NDArray[np.str_], columns: Sequence[int]) -> FloatArray:
        try:
            return text.astype(np.float64)
        except ValueError:
            pass
        if self.delimiter != ",":
            if any(_DECIMAL_POINT.fullmatch(field) for field in self.fields.ravel().tolist()):
                comma = next((f for f in text.ravel().tolist() if _DECIMAL_COMMA.fullmatch(f)), None)
                if comma is not None:
                    raise FileError(
                        self.path, f"holds decimal points and decimal commas ({comma}); write all with points"
                    )
            try:
                return np.strings.replace(text, ",", ".").astype(np.float64)
            except ValueError:
                pass
        for row, fields in enumerate(text.tolist()):
            for column, field in zip(columns, fields, strict=True):
                if not is_number(field):
                    message = f"{self.header[column]} is {_shown(field)}, which is not a number"
                    raise FileError(self.path, message, line=int(self.line[row]))
        raise AssertionError("numpy and Python disagree on what a number is")  # pragma: no cover


def parse(text: str, path: str | Path) -> TextTable:
    """Split a table with one header line. The delimiter is a comma, semicolon or tab; ``#`` begins a comment line.

    Raises
    ------
    FileError
        If the text is empty, has no rows under its header, or a row has more or fewer fields than the header.
    """
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and line.lstrip()[0] != "#"
    ]
    if not lines:
        raise FileError(path, "is empty; a header line with column names and one line per pose are expected")
    delimiter = max(",;\t", key=lines[0][1].count)
    check_lines(lines, path)
    rows = [[field.strip() for field in row] for row in csv.reader((line for _, line in lines), delimiter=delimiter)]
    header, body = rows[0], rows[1:]
    numbers = np.array([number for number, _ in lines], dtype=np.int64)
    if not body:
        raise FileError(path, "has a header but no rows", line=lines[0][0])
    if len(rows) != len(lines):
        raise FileError(path, "has a quoted field that runs over the end of its line; remove the quotation marks")
    count = np.array([len(row) for row in body])
    ragged = np.flatnonzero(count != len(header))
    if len(ragged):
        first = int(ragged[0])
        commas = delimiter == "," and count[first] >= 2 * len(header) - 2 and len(header) > 1
        hint = "; decimal commas? Write decimal points, or put ; between the fields" if commas else ""
        message = f"has {count[first]} fields, the header has {len(header)}{hint}"
        raise FileError(path, message, line=int(numbers[1 + first]))
    return TextTable(path, delimiter, header, lines[0][0], text_array(body, path, numbers[1:]), numbers[1:])


def check_lines(lines: Sequence[tuple[int, str]], path: str | Path) -> None:
    """Refuse lines, with their numbers, that are longer than those of any table.

    Raises
    ------
    FileError
        With the line.
    """
    for number, line in lines:
        if len(line) > LONGEST_LINE:
            what = f"has {len(line)} characters, at most {LONGEST_LINE} are read; is it a table of poses or readings?"
            raise FileError(path, what, line=number)


def text_array(rows: Sequence[Sequence[str]], path: str | Path, numbers: IntArray) -> NDArray[np.str_]:
    """Return fields of alike rows as an array (n, k) of str; `numbers` are the rows' lines, for messages.

    Raises
    ------
    FileError
        If there are too many columns, or the array, each field of which takes the room of the longest, would be too
        large.
    """
    if len(rows[0]) > MOST_COLUMNS:
        what = f"has {len(rows[0])} columns, at most {MOST_COLUMNS} are read"
        raise FileError(path, f"{what}; is it a table of poses or readings?", line=int(numbers[0]))
    width = [max(map(len, row)) for row in rows]
    if 4 * max(width) * len(rows) * len(rows[0]) > _LARGEST_TABLE:
        at = width.index(max(width))
        what = f"has a field of {width[at]} characters, too long for a table of {len(rows)} rows; shorten it"
        raise FileError(path, what, line=int(numbers[at]))
    return np.array(rows, dtype=np.str_)


def is_number(field: str) -> bool:
    """Return whether a field is a number, with a decimal point or a decimal comma."""
    try:
        to_float(field)
    except ValueError:
        return _DECIMAL_COMMA.fullmatch(field) is not None
    return True


def _shown(field: str) -> str:
    return repr(field[:40]) if field else "empty"


def escaped(name: str) -> str:
    """Return a name as a cell that no spreadsheet takes for a formula: ``'`` before ``=``, ``+``, ``-``, ``@``.

    Examples
    --------
    >>> escaped("=1+2"), escaped("P1"), unescaped(escaped("'=1"))
    ("'=1+2", 'P1', "'=1")
    """
    return f"'{name}" if _FORMULA.match(name) else name


def unescaped(cell: str) -> str:
    """Return the name that `escaped` wrote."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell
