"""Workbooks (.xlsx) as tables of text: a sheet becomes lines with semicolons, and rows keep their numbers.

A workbook is a zip of XML from anywhere, so its sizes are limited before it is unpacked, and document types (which
define entities) are refused. ``file.xlsx#Sheet`` names a sheet; a workbook with one filled sheet needs no name.
"""

from __future__ import annotations

import csv
import datetime
import io
import re
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from truepose._io.strict import to_float
from truepose.errors import FileError

if TYPE_CHECKING:
    from openpyxl import Workbook

ENDINGS: Final = (".xlsx", ".xlsm")
DELIMITER: Final = ";"
_LARGEST: Final = 2**28  # bytes, unpacked
_SMALL: Final = 2**22  # bytes that may be unpacked at any ratio
_LARGEST_RATIO: Final = 100
_MOST_MEMBERS: Final = 1000
_MOST_ROWS: Final = 2**20
_MOST_COLUMNS: Final = 500
_ILLEGAL: Final = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f]")
_TEXTS: Final = frozenset(("name", "point", "file", "motion", "frame", "tool", "verdict", "reason", "decision"))
_REMEDY: Final = "open it in a spreadsheet program and save it again as .xlsx, or export the sheet as CSV"


class SheetPath(str):
    """The name of a sheet in messages, ``file.xlsx#Sheet``; the columns of its messages have letters."""

    __slots__ = ()


def split_sheet(path: str | Path) -> tuple[Path, str]:
    """Return the file and the sheet of ``file.xlsx#Sheet``; the sheet is empty if none is named.

    Examples
    --------
    >>> split_sheet("day1.xlsx#Points")[1], split_sheet("a#b.csv")[1]
    ('Points', '')
    """
    name, mark, sheet = str(path).rpartition("#")
    return (Path(name), sheet) if mark and name.lower().endswith(ENDINGS) else (Path(path), "")


def read_sheet(data: bytes, path: Path, sheet: str = "") -> tuple[str, SheetPath]:
    """Return the text of a sheet, one line for each row from 1, and its name for messages.

    Parameters
    ----------
    data : bytes
        The content of the file.
    path : Path
        The file, for messages.
    sheet : str
        The name of the sheet; by default the only one with content.

    Raises
    ------
    FileError
        If it is not a workbook, is too large unpacked, has no such sheet or several filled ones, or a formula has no
        stored value.
    """
    try:
        formulas = _check_zip(data, path)
        from openpyxl import load_workbook

        book = load_workbook(io.BytesIO(data), read_only=True, data_only=True, keep_links=False)
        texts = {name: _text(book, name, path) for name in _wanted(book, path, sheet)}
        filled = {name: text for name, text in texts.items() if text} or texts
        if len(filled) > 1:
            names = ", ".join(filled)
            raise FileError(path, f"has several sheets ({names}); name one, such as {path.name}#{next(iter(filled))}")
        ((name, text),) = filled.items()
        if formulas:
            _check_formulas(data, name, path)
    except FileError:
        raise
    except Exception as error:  # damaged zips and XML raise errors of many modules
        raise FileError(path, f"is not a workbook, or is damaged ({error}); {_REMEDY}") from None
    return text, SheetPath(f"{path}#{name}")


def _check_zip(data: bytes, path: Path) -> bool:
    """Refuse a zip that would unpack to too much or defines entities; return whether a sheet has formulas."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        infos = archive.infolist()
        unpacked = sum(info.file_size for info in infos)
        if len(infos) > _MOST_MEMBERS or unpacked > min(_LARGEST, max(_SMALL, _LARGEST_RATIO * len(data))):
            what = f"would unpack from {len(data)} to {unpacked} bytes in {len(infos)} parts"
            raise FileError(path, f"{what}, too much for a table; export the sheet as CSV")
        if "xl/workbook.xml" not in archive.namelist():
            raise FileError(path, f"is a zip, but no workbook; {_REMEDY}")
        formulas = False
        for info in infos:
            if info.filename.endswith((".xml", ".rels")):
                content = archive.read(info)
                if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
                    raise FileError(path, f"{info.filename} defines entities, which no workbook needs; {_REMEDY}")
                formulas |= info.filename.startswith("xl/worksheets/") and (b"<f>" in content or b"<f " in content)
        return formulas


def _wanted(book: Workbook, path: Path, sheet: str) -> list[str]:
    names = [one.title for one in book.worksheets if one.sheet_state == "visible" or sheet]
    if not sheet:
        return names
    found = [name for name in names if name.casefold() == sheet.casefold()]
    if not found:
        raise FileError(path, f"has no sheet {sheet!r}; its sheets are {', '.join(names)}")
    return found


def _rows(book: Workbook, name: str, *, values_only: bool) -> Iterator[tuple[Any, ...]]:
    sheet = book[name]
    sheet.reset_dimensions()  # the stated extent may be wrong
    return iter(sheet.iter_rows(max_col=_MOST_COLUMNS + 1, max_row=_MOST_ROWS + 1, values_only=values_only))


def _text(book: Workbook, name: str, path: Path) -> str:
    rows: list[list[str]] = []
    size = 0
    for number, row in enumerate(_rows(book, name, values_only=True), start=1):
        cells = [_field(value) for value in row]
        while cells and not cells[-1]:
            cells.pop()
        size += sum(map(len, cells)) + len(cells) + 1
        if number > _MOST_ROWS or len(cells) > _MOST_COLUMNS or size > _LARGEST:
            what = f"has more than {_MOST_COLUMNS} columns or {_MOST_ROWS} rows"
            raise FileError(f"{path}#{name}", f"{what}; is it a table of poses or readings?", line=number)
        rows.append(cells)
    width = max(map(len, rows), default=0)
    lines = (DELIMITER.join(cells + [""] * (width - len(cells))) if cells else "" for cells in rows)
    return "\n".join(lines).rstrip("\n")


def _field(value: Any) -> str:
    """Return a cell as text: numbers in full, dates as year-month-day, one line, without delimiters."""
    if value is None:
        return ""
    if isinstance(value, datetime.datetime):
        return value.isoformat(sep=" ")
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    text = " ".join(str(value).split()).replace(DELIMITER, ",").lstrip('"')
    return f"error {text}" if text.startswith("#") and text.endswith(("!", "?", "/A")) else text


def _check_formulas(data: bytes, name: str, path: Path) -> None:
    """Refuse formulas whose value no program has computed."""
    from openpyxl import load_workbook

    values, formulas = (
        load_workbook(io.BytesIO(data), read_only=True, data_only=data_only, keep_links=False)
        for data_only in (True, False)
    )
    pairs = zip(_rows(values, name, values_only=True), _rows(formulas, name, values_only=False), strict=True)
    for number, (row, cells) in enumerate(pairs, start=1):
        for value, cell in zip(row, cells, strict=True):
            if value is None and cell.data_type == "f":
                what = f"cell {cell.coordinate} has a formula without a stored value"
                raise FileError(SheetPath(f"{path}#{name}"), f"{what}; {_REMEDY}", line=number)


def column_letter(column: int) -> str:
    """Return the letters of a column of a sheet by its index from 0.

    Examples
    --------
    >>> column_letter(0), column_letter(25), column_letter(26)
    ('A', 'Z', 'AA')
    """
    letters = ""
    column += 1
    while column:
        column, rest = divmod(column - 1, 26)
        letters = chr(ord("A") + rest) + letters
    return letters


def is_workbook(path: str | Path) -> bool:
    """Return whether a file to write is a workbook, by its ending."""
    return str(path).lower().endswith(ENDINGS[0])


def in_format(path: str | Path, text: str) -> str | bytes:
    """Return a table of comma-separated text as the content of a file: a workbook if its name ends in ``.xlsx``."""
    return to_workbook(csv.reader(io.StringIO(text))) if is_workbook(path) else text


def to_workbook(rows: Iterable[Iterable[str]], title: str = "truepose") -> bytes:
    """Return a workbook of a table, the first row of which names the columns.

    Fields that are numbers become numbers, except in columns of names; the others must be escaped already
    (`truepose._io.delimited.escaped`).
    """
    from openpyxl import Workbook
    from openpyxl.cell import WriteOnlyCell
    from openpyxl.styles import Font

    book = Workbook(write_only=True)
    sheet = book.create_sheet(title)
    sheet.freeze_panes = "A2"
    texts: list[bool] = []
    for number, row in enumerate(rows):
        fields = [_ILLEGAL.sub(" ", field) for field in row]
        if number == 0:
            texts = [field.lower() in _TEXTS for field in fields]
            heads = [WriteOnlyCell(sheet, value=field) for field in fields]
            for head in heads:
                head.font = Font(bold=True)
            sheet.append(heads)
            continue
        sheet.append([field if text else _value(field) for field, text in zip(fields, texts, strict=True)])
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


def _value(field: str) -> float | int | str | None:
    try:
        number = to_float(field)
    except ValueError:
        return field or None
    if number != number or abs(number) == float("inf"):
        return field
    return int(number) if number.is_integer() and abs(number) < 1e15 else number
