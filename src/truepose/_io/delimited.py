"""Tables of text: encodings, delimiters, decimal commas, and messages that name the line; one reader for all tables."""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose._io.files import read_bytes
from truepose._io.strict import LARGEST, to_float
from truepose._io.units import KNOWN_UNITS
from truepose._io.workbook import SheetPath, column_letter, read_sheet, split_sheet
from truepose._typing import FloatArray, IntArray
from truepose.errors import FileError

LONGEST_LINE: Final = 20_000
"""The largest number of characters in a line of a table."""
MOST_COLUMNS: Final = 500
TITLES: Final = 20
"""The number of lines in which a header is searched."""
COMMENTS: Final = ("#", "//", "%")
_LARGEST_TABLE: Final = 2**31  # bytes of a table's fields
_FORMULA: Final = re.compile("'*[=+@\\t\\r-]")

_DECIMAL_COMMA: Final = re.compile(r"[+-]?[0-9]+,[0-9]*([eE][+-]?[0-9]+)?")
_DECIMAL_POINT: Final = re.compile(r"[+-]?[0-9]+\.[0-9]*([eE][+-]?[0-9]+)?")


@dataclass(frozen=True)
class TextTable:
    """The fields of a table as text.

    Attributes
    ----------
    path : str or Path
        The file, for messages.
    delimiter : str
        The delimiter of the fields.
    header : list of str
        The names of the k columns.
    header_line : int
        The line of the header in the file, from 1.
    fields : (n, k) array of str
        The fields without surrounding blanks.
    line : (n,) array of int
        The line of each row in the file, from 1.
    """

    path: str | Path
    delimiter: str
    header: list[str]
    header_line: int
    fields: NDArray[np.str_]
    line: IntArray

    def numbers(self, columns: Sequence[int]) -> FloatArray:
        """Return columns as numbers, (n, len(columns)); decimal commas are read unless commas separate the fields.

        Raises
        ------
        FileError
            If a field is not a number, or is larger than `LARGEST`; with its line and column.
        """
        text = self.fields[:, list(columns)]
        self._check_plain(text, columns)
        values = self._converted(text, columns)
        if (beyond := np.isfinite(values) & (np.abs(values) > LARGEST)).any():
            row, k = np.argwhere(beyond)[0]
            message = (
                f"{self.column_name(columns[k])} is {values[row, k]:g}, beyond {LARGEST:g}; correct or remove the row"
            )
            raise FileError(self.path, message, line=int(self.line[row]))
        return values

    def column_name(self, column: int) -> str:
        """Return the name of a column for messages; in a sheet also its letters: "X (column D)"."""
        name = self.header[column]
        return f"{name} (column {column_letter(column)})" if isinstance(self.path, SheetPath) else name

    def _check_plain(self, text: NDArray[np.str_], columns: Sequence[int]) -> None:
        """Refuse numbers that only Python accepts: ``1_000`` and digits of other scripts."""
        letters = np.ascontiguousarray(text).view(np.uint32).reshape(*text.shape, -1)
        odd = ((letters > 0x7F) | (letters == ord("_"))).any(axis=2)
        if odd.any():
            row, k = np.argwhere(odd)[0]
            message = f"{self.column_name(columns[k])} is {_shown(str(text[row, k]))}, which is not a number"
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
                        self.path, f"has decimal points and decimal commas ({comma}); write decimal points only"
                    )
            try:
                return np.strings.replace(text, ",", ".").astype(np.float64)
            except ValueError:
                pass
        for row, fields in enumerate(text.tolist()):
            for column, field in zip(columns, fields, strict=True):
                if not is_number(field):
                    message = f"{self.column_name(column)} is {_shown(field)}, which is not a number"
                    raise FileError(self.path, message, line=int(self.line[row]))
        raise FileError(self.path, "has a number in a form that cannot be read; write plain decimal numbers")


def read_tabular(path: str | Path) -> tuple[str, str | Path]:
    """Return the text of a table (a text file, or a sheet of a workbook) and its name for messages.

    A line of units below the header, such as ``;[mm];[mm];[mm]``, becomes a part of the header.

    Parameters
    ----------
    path : str or Path
        The file; ``file.xlsx#Sheet`` names a sheet of a workbook.

    Raises
    ------
    FileError
        If the file cannot be read, or is neither text nor a workbook.
    """
    file, sheet = split_sheet(path)
    data = read_bytes(file)
    if data.startswith(b"PK\x03\x04"):
        text, source = read_sheet(data, file, sheet)
        return _with_units(text), source
    if data.startswith(b"\xd0\xcf\x11\xe0"):
        raise FileError(path, "is a workbook of an old format (.xls); save it as .xlsx or CSV")
    return _with_units(decode(data, path)), path


def _with_units(text: str) -> str:
    """Add the units of a line that holds nothing else to the names above it; the numbers of lines stay."""
    ends = [match.start() for match in itertools.islice(re.finditer("\n", text), TITLES)]
    head = text[: ends[-1]].split("\n") if ends else []
    for k in range(1, len(head)):
        mark = find_delimiter(head[k])
        units, names = ([field.strip() for field in head[j].split(mark)] for j in (k, k - 1))
        words = [unit.strip("[]() ") for unit in units]
        if mark == " " or len(units) != len(names) or not any(words) or any(map(is_number, filter(None, names))):
            continue
        if all(word in KNOWN_UNITS for word in filter(None, words)):
            head[k - 1] = mark.join(
                f"{name} [{word}]" if word else name for name, word in zip(names, words, strict=True)
            )
            head[k] = ""
            return "\n".join(head) + text[ends[-1] :]
    return text


def decode(data: bytes, path: str | Path) -> str:
    """Return the text of a table: UTF-8, UTF-16 with a byte-order mark, else Latin-1 (which accepts every byte).

    Raises
    ------
    FileError
        If the file is empty, is not text, or has a line longer than `LONGEST_LINE`.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", errors="replace")
    elif not data.strip():
        raise FileError(path, "is empty; expected a header line with column names and one line per pose")
    elif b"\0" in data[:4096] or data.startswith(b"PK\x03\x04"):
        raise FileError(path, "is not a text file; export the table as ASCII or CSV")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    for number, line in enumerate(text.splitlines(), start=1):
        if len(line) > LONGEST_LINE:
            what = f"has {len(line)} characters, expected at most {LONGEST_LINE}; is it a table of poses or readings?"
            raise FileError(path, what, line=number)
    return text


def parse(
    text: str, path: str | Path, *, skip: int | None = None, delimiter: str = "", lenient: bool = False
) -> TextTable:
    """Split a table into fields; blank lines and comments (``#``, ``//``, ``%``) are left out.

    Parameters
    ----------
    text : str
        The content of the file.
    path : str or Path
        The file, for messages.
    skip : int, optional
        The number of lines before the data, the last of which is the header; with 0 the columns are called
        "column 1" …. By default the first line is the header.
    delimiter : str
        The delimiter; by default that of the first line that is not skipped, see `find_delimiter`.
    lenient : bool
        Whether short rows are filled with empty fields and a leading apostrophe, a spreadsheet's mark of text, is
        removed.

    Raises
    ------
    FileError
        If there are no rows, a quoted field does not end on its line, or (unless `lenient`) a row has more or fewer
        fields than the header.
    """
    lines = list(enumerate(text.splitlines(), start=1))
    kept = [
        (number, line)
        for number, line in lines[skip or 0 :]
        if (bare := line.lstrip()) and not bare.startswith(COMMENTS)
    ]
    if not kept:
        raise FileError(path, "is empty; expected a header line with column names and one line per pose")
    delimiter = delimiter or find_delimiter(kept[0][1])
    head = kept[:1] if skip is None else lines[:skip][-1:]
    body = kept[1:] if skip is None else kept
    if not body:
        raise FileError(path, "has a header but no rows", line=head[0][0])
    rows = _fields(body, delimiter, path)
    header = _fields(head, delimiter, path)[0] if head else []
    numbers = np.array([number for number, _ in body], dtype=np.int64)
    if lenient:
        width = max(len(header), *map(len, rows))
        rows = [[field.lstrip("'") for field in row] + [""] * (width - len(row)) for row in rows]
        header += [f"column {k + 1}" for k in range(len(header), width)]
    else:
        _check_widths(rows, header, delimiter, path, numbers)
    fields = text_array(rows, path, numbers)
    return TextTable(path, delimiter, header, head[0][0] if head else int(numbers[0]), fields, numbers)


def first_row(text: str) -> str:
    """Return the first line that is neither blank nor a comment."""
    rows = (line.strip() for line in text.splitlines())
    return next((row for row in rows if row and not row.startswith(COMMENTS)), "")


def find_delimiter(line: str) -> str:
    """Return the delimiter of a line: a semicolon or tab, else a comma (which may be a decimal comma), else a blank."""
    return next((mark for mark in (";", "\t", ",") if mark in line), " ")


def _fields(lines: Sequence[tuple[int, str]], delimiter: str, path: str | Path) -> list[list[str]]:
    if delimiter == " ":
        return [line.split() for _, line in lines]
    reader = csv.reader((line for _, line in lines), delimiter=delimiter, skipinitialspace=True)
    rows = [list(map(str.strip, row)) for row in reader]
    if len(rows) != len(lines):
        raise FileError(path, "has a quoted field without an end on its line; remove the quotation marks")
    return rows


def _check_widths(
    rows: list[list[str]], header: list[str], delimiter: str, path: str | Path, numbers: IntArray
) -> None:
    first = next((k for k, row in enumerate(rows) if len(row) != len(header)), None)
    if first is not None:
        count = len(rows[first])
        commas = delimiter == "," and count >= 2 * len(header) - 2 and len(header) > 1
        hint = "; decimal commas? Write decimal points, or put ; between the fields" if commas else ""
        raise FileError(path, f"has {count} fields, the header has {len(header)}{hint}", line=int(numbers[first]))


def text_array(rows: Sequence[Sequence[str]], path: str | Path, numbers: IntArray) -> NDArray[np.str_]:
    """Return the fields of rows of equal length as an array (n, k) of str; `numbers` are their lines, for messages.

    Raises
    ------
    FileError
        If there are too many columns, or the array is too large: every field takes the memory of the longest one.
    """
    if len(rows[0]) > MOST_COLUMNS:
        what = f"has {len(rows[0])} columns, expected at most {MOST_COLUMNS}"
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
    """Return a name as a cell that no spreadsheet reads as a formula: ``'`` before ``=``, ``+``, ``-``, ``@``.

    Examples
    --------
    >>> escaped("=1+2"), escaped("P1"), unescaped(escaped("'=1"))
    ("'=1+2", 'P1', "'=1")
    """
    return f"'{name}" if _FORMULA.match(name) else name


def csv_cell(text: str) -> str:
    """Return a cell of CSV, in quotes where it needs them, that no spreadsheet takes for a formula."""
    text = escaped(text)
    if any(mark in text for mark in ',"\r\n'):
        return '"' + text.replace('"', '""') + '"'
    return text


def unescaped(cell: str) -> str:
    """Return the name in a cell that `escaped` wrote."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell
