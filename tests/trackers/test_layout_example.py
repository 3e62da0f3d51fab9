"""The worked example of docs/how-to/add-a-tracker-layout.md."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import truepose as tp
from truepose.errors import FileError
from truepose.trackers import LAYOUTS, read_readings

EXAMPLE = Path(__file__).parents[2] / "docs" / "how-to" / "files" / "layout" / "probe_export.py"


@pytest.fixture(scope="module")
def layout() -> Any:
    return runpy.run_path(str(EXAMPLE))["PROBE"]


def test_a_file_of_the_page(tmp_path: Path, layout: Any) -> None:
    PROBE, path = layout, tmp_path / "probe.csv"
    path.write_text("Probe export;unit=in\nNr;Target;X;Y;Z;RMS\n1;P1;72,25;-36,5;12,0;0,001\n", "utf-8")
    # [read]
    readings = read_readings(path, layouts=(PROBE, *LAYOUTS))
    # [/read]
    assert readings.layout == "probe export"
    np.testing.assert_allclose(readings.p, [[25.4 * 72.25, 25.4 * -36.5, 25.4 * 12.0]])
    np.testing.assert_allclose(readings.p_std, np.full((1, 3), 0.0254))
    with pytest.raises(FileError, match="unknown layout"):
        read_readings(path, layouts=())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Probe export;unit=ell\nNr;Target;X;Y;Z;RMS\n1;P1;1;2;3;0", ":2: the unit 'ell' is not known"),
        ("Probe export;unit=mm\nNr;Target;X;Y;RMS\n1;P1;1;2;0", ":2: has no column 'Z'"),
        ("Probe export;unit=mm\nNr;Target;X;Y;Z;RMS\n1;P1;1;two;3;0", ":3: Y is 'two', which is not a number"),
    ],
)
def test_errors_name_the_line(tmp_path: Path, layout: Any, text: str, message: str) -> None:
    path = tmp_path / "probe.csv"
    path.write_text(text, "utf-8")
    with pytest.raises(FileError, match=message):
        read_readings(path, layouts=(layout,))


def test_there_and_back(tmp_path: Path, layout: Any) -> None:
    virtual = tp.VirtualCell("paper", seed=1)
    samples = virtual.measure(virtual.design(20, seed=1))
    path = tmp_path / "probe.csv"
    path.write_bytes(layout.write(samples))
    readings = read_readings(path, layouts=(layout,))
    np.testing.assert_allclose(readings.p, samples.p_meas, rtol=0, atol=5.01e-4)
