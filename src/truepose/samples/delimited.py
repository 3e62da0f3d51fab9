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

from truepose.errors import FileError

FloatArray = NDArray[np.float64]

_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d+,\d*([eE][+-]?\d+)?")
_DECIMAL_POINT: Final = re.compile(r"[+-]?\d+\.\d*([eE][+-]?\d+)?")


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
    line: NDArray[np.int64]

    def numbers(self, columns: Sequence[int]) -> FloatArray:
        """Return some columns as numbers, (n, len(columns)); decimal commas are taken where they are not the delimiter.

        Raises
        ------
        FileError
            If a field is no number: its line, its column and what stands there.
        """
        text = self.fields[:, list(columns)]
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
                if not _is_number(field):
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
    return TextTable(path, delimiter, header, lines[0][0], np.array(body, dtype=np.str_), numbers[1:])


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return _DECIMAL_COMMA.fullmatch(field) is not None
    return True


def _shown(field: str) -> str:
    return repr(field[:40]) if field else "empty"
