"""The preview of a measurement file says the same as its import, also where the file cannot be read as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from truepose import VirtualCell
from truepose.errors import FileError
from truepose.trackers import LAYOUTS, Columns, preview, read_readings, write_readings

SAMPLES = VirtualCell("paper").measure(VirtualCell("paper").design(20))


@pytest.mark.parametrize("layout", [layout.key for layout in LAYOUTS])
def test_every_layout_is_shown_as_it_is_read(tmp_path: Path, layout: str) -> None:
    path = tmp_path / "readings.txt"
    write_readings(path, SAMPLES, layout)
    readings = read_readings(path)
    shown = preview(path).to_dict()
    assert shown["problem"] is None
    assert (shown["readings"]["layout"], shown["readings"]["unit"]) == (readings.layout, readings.unit)
    assert shown["readings"]["count"] == len(readings)
    np.testing.assert_allclose(shown["readings"]["extent_mm"], np.ptp(readings.p, axis=0))
    if shown["columns"]:
        line = {row["line"]: row["fields"] for row in shown["rows"]}.get(int(readings.line[0]))
        assert line is not None
        places = [shown["columns"][axis][0] - 1 for axis in "xyz"]
        stated = np.array([float(line[place].replace(",", ".")) for place in places])
        factor = 1000.0 if readings.unit == "m" else 1.0
        np.testing.assert_allclose(stated * factor, readings.p[0])


def test_a_file_of_unknown_layout_shows_its_rows_and_the_remedy(tmp_path: Path) -> None:
    path = tmp_path / "odd.txt"
    path.write_text("run of today\na|b|c|d\n" + "".join(f"P{i};x;{i};{i * i};7.5;-1\n" for i in range(1, 9)), "utf-8")
    shown = preview(path)
    assert shown.readings is None
    assert "--columns" in str(shown.problem)
    assert shown.rows[2] == (3, ["P1", "x", "1", "1", "7.5", "-1"])
    chosen = preview(path, columns=Columns(x=3, y=4, z=5, name=1, skip=shown.skip))
    assert chosen.problem is None
    assert chosen.columns == {"x": [3], "y": [4], "z": [5], "name": [1]}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_line_ends_and_encodings_make_no_difference(tmp_path: Path, encoding: str, ends: str) -> None:
    rows = ["Name;X [mm];Y [mm];Z [mm];Größe", *(f"P{i};{i},5;{i * i},25;7,5;ß" for i in range(1, 9))]
    path = tmp_path / "spreadsheet.csv"
    path.write_bytes((ends.join(rows) + ends).encode(encoding))
    shown = preview(path)
    assert shown.problem is None
    assert shown.rows[1][1][:4] == ["P1", "1,5", "1,25", "7,5"]


def test_what_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + bytes(range(256)))
    with pytest.raises(FileError):
        preview(path)
