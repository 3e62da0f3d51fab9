"""Workbooks: tables in and out, sheets by name, messages with sheet, row and column, and hostile files."""

from __future__ import annotations

import datetime
import io
import subprocess
import sys
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest

import truepose as tp
from truepose._io.workbook import to_workbook
from truepose.errors import FileError
from truepose.samples import Poses, Samples, append_columns
from truepose.trackers import read_plan

Rows = Sequence[Sequence[Any]]


def book(path: Path, *sheets: tuple[str, Rows]) -> Path:
    made = openpyxl.Workbook()
    made.remove(made.active)
    for title, rows in sheets:
        sheet = made.create_sheet(title)
        for row in rows:
            sheet.append(list(row))
    made.save(path)
    return path


READINGS: Rows = (
    ("Point", "X [mm]", "Y [mm]", "Z [mm]", "Time"),
    ("P1", 1834.512, -920.077, 318.64, datetime.datetime(2025, 3, 7, 9, 15, 2)),
    ("P2", 1934.5, -910, 320.25, datetime.datetime(2025, 3, 7, 9, 15, 32)),
    ("P3", 1634.5, -700, 120.25, datetime.datetime(2025, 3, 7, 9, 16, 2)),
)


def test_readings_with_dates(tmp_path: Path) -> None:
    readings = tp.read_readings(book(tmp_path / "r.xlsx", ("Points", READINGS)))
    np.testing.assert_array_equal(readings.p[1], [1934.5, -910, 320.25])
    assert readings.name is not None
    assert readings.time is not None
    assert (readings.name.tolist(), np.diff(readings.time).tolist()) == (["P1", "P2", "P3"], [30.0, 30.0])
    assert readings.line.tolist() == [2, 3, 4]
    assert readings.source.endswith("r.xlsx#Points")


def test_the_sheet_is_named_after_the_file(tmp_path: Path) -> None:
    other = [*READINGS[:1], ["Q1", 0.5, 900.0, 10.0], ["Q2", 700.5, 100.0, 10.0]]
    path = book(tmp_path / "r.xlsx", ("Monday", READINGS), ("Empty", []), ("Tuesday", other))
    with pytest.raises(FileError, match=r"has several sheets \(Monday, Tuesday\); name one, such as r\.xlsx#Monday"):
        tp.read_readings(path)
    assert len(tp.read_readings(f"{path}#tuesday")) == 2
    with pytest.raises(FileError, match=r"has no sheet 'Friday'; its sheets are Monday, Empty, Tuesday"):
        tp.read_readings(f"{path}#Friday")


def test_plans_and_samples(tmp_path: Path) -> None:
    rows = [["name", "q1_deg", "q2_deg"], ["P1", 10, 20.5], ["P2", 11.25, 21]]
    path = book(tmp_path / "plan.xlsx", ("Plan", rows))
    for poses in (read_plan(path), tp.read_poses(path)):
        assert poses.q is not None
        np.testing.assert_allclose(np.degrees(poses.q), [[10, 20.5], [11.25, 21]])
        assert poses.rows(np.array([1])) == "point P2 (line 3)"
    joints = [["Punkt", "Achse1", "Achse2"], ["A", 10, 20.5], ["B", 11.25, 21]]
    assert read_plan(book(tmp_path / "j.xlsx", ("Plan", joints))).q is not None


def test_samples_there_and_back(tmp_path: Path) -> None:
    p = np.array([[2100.0, 5, 800], [2050, 360.123456, 800], [1.5, 2000, 3.0]])
    names = np.array(["=HYPERLINK(1)", "1.10", "+P3"])
    samples = Samples(p, q=np.radians([[10.0, 3], [20, 4], [30, 5]]), name=names)
    tp.write_samples(tmp_path / "s.xlsx", samples)
    again = tp.read_samples(tmp_path / "s.xlsx")
    np.testing.assert_array_equal(again.p_meas, p)
    assert again.name is not None
    assert again.name.tolist() == names.tolist()
    sheet = openpyxl.load_workbook(tmp_path / "s.xlsx").active
    assert [sheet["B2"].value, sheet["B4"].value] == ["'=HYPERLINK(1)", "'+P3"]
    assert {cell.data_type for cell in sheet["B"]} == {"s"}
    assert {cell.data_type for cell in sheet["E"][1:]} == {"n"}


def test_predictions_are_added_to_a_workbook(tmp_path: Path) -> None:
    tp.write_samples(tmp_path / "poses.xlsx", Poses(q=np.radians([[10.0, 3], [20, 4]])))
    append_columns(tmp_path / "poses.xlsx", tmp_path / "out.xlsx", {"std_mm": np.array([0.1, 0.25])})
    sheet = openpyxl.load_workbook(tmp_path / "out.xlsx").active
    assert [cell.value for cell in sheet["D"]] == ["std_mm", 0.1, 0.25]
    append_columns(tmp_path / "poses.xlsx", tmp_path / "out.csv", {"std_mm": np.array([0.1, 0.25])})
    assert len(tp.read_poses(tmp_path / "out.csv")) == 2


def test_a_message_names_sheet_row_and_column(tmp_path: Path) -> None:
    wrong = [list(row) for row in READINGS]
    wrong[2][2] = "abc"
    path = book(tmp_path / "r.xlsx", ("Points", wrong))
    with pytest.raises(FileError, match=r"r\.xlsx#Points:3: Y \[mm\] \(column C\) is 'abc', which is not a number"):
        tp.read_readings(path)
    wrong[2][2] = "#DIV/0!"
    with pytest.raises(FileError, match=r"r\.xlsx#Points:3: Y \[mm\] \(column C\) is 'error #DIV/0!'"):
        tp.read_readings(book(tmp_path / "r.xlsx", ("Points", wrong)))
    wrong[2][2] = "=B3+1"
    with pytest.raises(FileError, match=r"r\.xlsx#Points:3: cell C3 has a formula without a stored value; open it"):
        tp.read_readings(book(tmp_path / "r.xlsx", ("Points", wrong)))


def test_merged_header_cells(tmp_path: Path) -> None:
    rows = [["Point", "Measured [m]", None, None], [None, "X", "Y", "Z"]]
    rows += [[name, *(1e-3 * value for value in p)] for name, *p in (row[:4] for row in READINGS[1:])]
    path = book(tmp_path / "r.xlsx", ("Points", rows))
    made = openpyxl.load_workbook(path)
    made["Points"].merge_cells("B1:D1")
    made["Points"].merge_cells("A1:A2")
    made.save(path)
    readings = tp.read_readings(path)
    np.testing.assert_allclose(readings.p[0], [1834.512, -920.077, 318.64])
    assert readings.name is not None
    assert readings.name[0] == "P1"
    assert readings.line[0] == 3


def changed(path: Path, change: Callable[[str, bytes], bytes], **more: bytes) -> Path:
    out = io.BytesIO()
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            new.writestr(name, change(name, old.read(name)))
        for name, content in more.items():
            new.writestr(name, content)
    path.write_bytes(out.getvalue())
    return path


def test_hostile_workbooks(tmp_path: Path) -> None:
    path = book(tmp_path / "r.xlsx", ("Points", READINGS))
    good = path.read_bytes()
    with pytest.raises(FileError, match=r"would unpack from \d+ to 6\d{7} bytes in \d+ parts, too much"):
        tp.read_readings(changed(path, lambda _, content: content, bomb=bytes(60_000_000)))
    path.write_bytes(good)
    entities = b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]>'
    with pytest.raises(FileError, match="defines entities, which no workbook needs"):
        tp.read_readings(changed(path, lambda name, content: entities + content if "sheet1" in name else content))
    path.write_bytes(good)
    far = b'<row r="9"><c r="XFD9"><v>1</v></c></row></sheetData>'
    with pytest.raises(FileError, match=r"r\.xlsx#Points:9: has more than 500 columns"):
        tp.read_readings(changed(path, lambda _, content: content.replace(b"</sheetData>", far.replace(b"XFD", b"SG"))))
    path.write_bytes(good[: len(good) // 2])
    with pytest.raises(FileError, match="is not a workbook, or is damaged"):
        tp.read_readings(path)
    path.write_bytes(b"\xd0\xcf\x11\xe0" + bytes(600))
    with pytest.raises(FileError, match=r"of an old format \(\.xls\); save it as \.xlsx"):
        tp.read_readings(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("content.xml", "<a/>")
    with pytest.raises(FileError, match="is a zip, but no workbook"):
        tp.read_readings(path)


def test_a_wrong_extent_hides_no_rows(tmp_path: Path) -> None:
    path = book(tmp_path / "r.xlsx", ("Points", READINGS))
    changed(path, lambda _, content: content.replace(b'<dimension ref="A1:E4"', b'<dimension ref="A1:A2"'))
    assert len(tp.read_readings(path)) == 3


def test_control_characters_and_texts() -> None:
    sheet = openpyxl.load_workbook(io.BytesIO(to_workbook([["name", "x"], ["a\x01b", "1e-3"], ["7", "nan"]]))).active
    assert [[cell.value for cell in row] for row in sheet] == [["name", "x"], ["a b", 0.001], ["7", "nan"]]


def test_openpyxl_is_imported_when_needed() -> None:
    code = "import sys, truepose; truepose.read_readings; assert 'openpyxl' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
