"""Wherever figures of a map stand, so does the number of readings that take no part in them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import truepose as tp
from truepose.report import write_report
from truepose.samples import write_samples


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tp.ErrorMap]:
    """A folder with cell, samples with a gross reading, a map and held-out samples."""
    folder = tmp_path_factory.mktemp("gross")
    virtual = tp.VirtualCell("paper", seed=5)
    samples = virtual.measure(virtual.design(30, seed=1), seed=1)
    p_meas = samples.p_meas.copy()
    p_meas[7, 0] += 590.0
    write_samples(folder / "samples.csv", replace(samples, p_meas=p_meas))
    write_samples(folder / "held_out.csv", virtual.measure(virtual.design(20, seed=2), seed=2))
    (folder / "cell.toml").write_text(virtual.cell.to_toml())
    found = tp.fit_cell(tp.load_cell(folder / "cell.toml"), tp.read_samples(folder / "samples.csv"), "calibration")
    found.save(folder / "map.truepose")
    return folder, found


def test_in_python(made) -> None:
    folder, error_map = made
    assert "  samples    29, 1 left out\n" in repr(error_map)
    assert error_map.validate(tp.read_samples(folder / "held_out.csv"))["left_out_of_map"] == 1


@pytest.mark.parametrize("command", ["validate", "explain"])
def test_on_the_command_line(made, command: str, run) -> None:
    folder, _ = made
    more = [folder / "held_out.csv"] if command == "validate" else []
    shown = run(command, folder / "map.truepose", *more).out
    assert "1 left out" in shown or "1 of the map" in shown, shown


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("locale", "own", "both"),
    [
        ("en", "left out of the fit and of these figures: 1.", "left out: 1 of the fit, 0 of the held-out table."),
        ("de", "weggelassene Messwerte: 1.", "Weggelassene Messwerte: 1 aus der Anpassung, 0 aus"),
        ("zh", "指标的读数：1。", "拟合中 1 个，留出数据中 0 个"),
    ],
)
def test_in_the_report(made, locale: str, own: str, both: str, tmp_path: Path) -> None:
    folder, error_map = made
    write_report(error_map, tmp_path / "own.html", locale=locale)
    assert own in (tmp_path / "own.html").read_text()
    write_report(error_map, tmp_path / "both.html", tp.read_samples(folder / "held_out.csv"), locale=locale)
    assert both in (tmp_path / "both.html").read_text()
