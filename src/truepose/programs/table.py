"""Targets in CSV: one row for each target, with units in the names of the columns.

Columns: ``name``; ``x_mm, y_mm, z_mm`` (or ``x_m`` …); the orientation as ``a_deg, b_deg, c_deg`` (KUKA), ``q1 … q4``
(ABB), ``w_deg, p_deg, r_deg`` (FANUC) or ``rx_rad, ry_rad, rz_rad`` (Universal Robots); ``rx_deg, ry_deg, rz_deg`` with
the convention of `ReadOptions.angles`. ``frame``, ``tool`` and ``motion`` are optional. Other columns are kept.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from truepose.errors import DataError
from truepose.geometry import ANGLES, euler
from truepose.programs.core.points import AS_MEASURED, Frame, Point, Problem, numbers_at
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.reader import Reader
from truepose.programs.core.source import Source

_ORIENTATIONS: Final = {
    ("a_deg", "b_deg", "c_deg"): "kuka",
    ("q1", "q2", "q3", "q4"): "abb",
    ("w_deg", "p_deg", "r_deg"): "fanuc",
    ("rx_rad", "ry_rad", "rz_rad"): "ur",
    ("rx_deg", "ry_deg", "rz_deg"): "",
}
_UNITS: Final = {"mm": 1.0, "m": 1000.0}
_TEXT: Final = ("name", "frame", "tool", "motion")


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read a CSV file of targets; a FileError names the line if it is broken."""
    source = Source.read(path)
    rows = [(line, start, end) for line, start, end in source.lines() if source.data[start:end].strip()]
    rows = [row for row in rows if not source.data[row[1] : row[2]].lstrip().startswith(b"#")]
    if not rows:
        raise source.error(1, "has no row of column names (name, x_mm, y_mm, z_mm, a_deg, …)")
    first, start, end = rows[0]
    start += 3 if source.data.startswith(b"\xef\xbb\xbf") and start == 0 else 0
    delimiter = max((b",", b";", b"\t"), key=source.data[start:end].count)
    columns = [text.decode("latin-1").lower() for text, _ in _cells(source, first, start, end, delimiter)]
    twice = [name for name in columns if name and columns.count(name) > 1]
    if twice:
        raise source.error(first, f"names the column {twice[0]} twice; keep one")
    keys, unit, controller = _meaning(source, first, columns, options)
    places = [columns.index(key) for key in keys]
    reader = Reader(source, frames, options)
    for line, start, end in rows[1:]:
        cells = _cells(source, line, start, end, delimiter)
        if len(cells) != len(columns):
            raise source.error(line, f"has {len(cells)} columns, the first row has {len(columns)}; correct the file")
        text = {key: cells[columns.index(key)][0].decode("latin-1") for key in _TEXT if key in columns}
        point = Point(text.get("name") or f"row {line}", source, line)
        tokens, starts = zip(*(cells[k] for k in places), strict=True)
        if not any(tokens):
            point.problem = Problem("skip", "an empty row")
        else:
            point.values, point.spans = numbers_at(source, line, keys, tokens, starts)
            try:
                euler(controller, point.values[3:])
            except DataError as error:
                raise source.error(line, f"{point.name}: {error}") from None
        tool, frame = (Frame(text[key], text[key]) if text.get(key) else None for key in ("tool", "frame"))
        point.uses.append(reader.use(text.get("motion") or "target", line, tool, frame))
        reader.points.append(point)
    tool = None if "tool" in columns else Frame(AS_MEASURED)  # an empty cell leaves out what others state
    return reader.program(controller, unit=unit, tool=tool, frame=Frame("base", 0))


def _meaning(source: Source, line: int, columns: list[str], options: ReadOptions) -> tuple[list[str], float, str]:
    """Return the columns of a pose, the unit of its position [mm], and the convention of its angles."""
    units = [unit for unit in _UNITS if all(f"{axis}_{unit}" in columns for axis in "xyz")]
    if len(units) != 1:
        raise source.error(line, "expected columns x_mm, y_mm, z_mm (or x_m, y_m, z_m); name them so, once")
    found = [names for names in _ORIENTATIONS if set(names) <= set(columns)]
    if len(found) != 1:
        known = "; ".join(", ".join(names) for names in _ORIENTATIONS)
        raise source.error(line, f"expected the columns of one orientation: {known}")
    controller = _ORIENTATIONS[found[0]] or options.angles
    if len(ANGLES[controller].names if controller in ANGLES else ()) != len(found[0]) or (
        not _ORIENTATIONS[found[0]] and controller not in ("yaskawa", "staubli")
    ):
        raise source.error(line, "rx_deg, ry_deg, rz_deg: name their convention (--angles yaskawa or staubli)")
    return [*(f"{axis}_{units[0]}" for axis in "xyz"), *found[0]], _UNITS[units[0]], controller


def _cells(source: Source, line: int, start: int, end: int, delimiter: bytes) -> list[tuple[bytes, int]]:
    """Return a row's cells without blanks and quotes, each with its first byte."""
    data, cells, position = source.data, [], start
    cell = re.compile(
        rb"[ \t]*\"((?:[^\"]|\"\")*)\"[ \t]*(?=" + delimiter + rb"|\Z)|([^" + delimiter + rb"]*)"
        if delimiter != b"\t"
        else rb" *\"((?:[^\"]|\"\")*)\" *(?=\t|\Z)|([^\t]*)"
    )
    row = data[start:end]
    while True:
        m = cell.match(row, position - start)
        assert m is not None  # the second alternative matches nothing, too
        k = 1 if m[1] is not None else 2
        text = m[k]
        if k == 2 and text.strip().startswith(b'"'):
            raise source.error(line, f"a cell's quotes do not pair: {text[:20].decode('latin-1')}; correct the file")
        cells.append((text.strip(), start + m.start(k) + len(text) - len(text.lstrip())))
        position = start + m.end() + 1
        if position > end:
            return cells
