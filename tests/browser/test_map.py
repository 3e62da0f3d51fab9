"""The page of maps: a fit and a validation as jobs, the figures as the command line gives them, exports."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from tests.browser.opening import Browser, Server

from truepose import load_map
from truepose.samples import read_samples


def samples_of(workspace: Path) -> list[Path]:
    """Return the tables of samples of the virtual cell."""
    found = []
    for path in sorted((workspace / "virtual-cell").rglob("*.csv")):
        if "x_meas_mm" in path.open(encoding="utf-8-sig").readline():
            found.append(path)
    return found


def shown_name(table: Path, server: Server) -> str:
    """Return the name of a table as the page lists it."""
    return table.relative_to(server.workspace / "virtual-cell").as_posix()


def test_a_fit_makes_a_map_and_shows_it(browser: Browser, own_server: Server) -> None:
    table = samples_of(own_server.workspace)[0]
    with browser.opened(own_server) as app:
        app.go("map")
        app.page.get_by_role("button", name="Fit a map").click()
        dialog = app.page.get_by_role("dialog")
        dialog.get_by_label("Samples").select_option(shown_name(table, own_server))
        dialog.get_by_label("Predictor", exact=True).select_option("idw")
        dialog.get_by_label("Name of the map").fill("of the test")
        assert "--predictor=idw" in dialog.locator("code").inner_text()
        dialog.get_by_role("button", name="Fit", exact=True).click()
        dialog.wait_for(state="detached", timeout=120_000)
        app.page.wait_for_function(
            "() => document.querySelector('main header select').innerText.includes('of the test')"
        )
        chosen = app.page.locator("main header select option:checked").inner_text()
        assert chosen.startswith("maps/of the test.truepose · idw")
    error_map = load_map(own_server.workspace / "virtual-cell" / "maps" / "of the test.truepose")
    assert error_map.predictor_name == "idw"


def test_held_out_figures_are_those_of_the_library(browser: Browser, own_server: Server) -> None:
    table = samples_of(own_server.workspace)[-1]
    with browser.opened(own_server) as app:
        app.go("map")
        sha = app.page.locator("main header select").input_value()
        app.page.get_by_role("tab", name="Held-out").click()
        app.page.get_by_label("Table of held-out samples").select_option(shown_name(table, own_server))
        app.page.get_by_role("button", name="Validate").click()
        row = app.page.get_by_role("row", name=re.compile("^Mean "))
        row.first.wait_for(timeout=120_000)
        shown = [float(text) for text in re.findall(r"\d+\.\d+", row.first.inner_text())]
    files = (own_server.workspace / "virtual-cell").rglob("*.truepose")
    error_map = next(found for path in files if (found := load_map(path)).hash == sha)
    figures = error_map.validate(read_samples(table), rivals=False).to_dict()
    assert shown[0] == round(figures["before"]["mean_mm"], 3)
    assert shown[1] == round(figures["after"]["mean_mm"], 3)


@pytest.mark.exhaustive
def test_the_samples_of_the_table_are_marked_in_the_view_and_exported(browser: Browser, server: Server) -> None:
    with browser.opened(server) as app:
        app.go("map")
        app.page.wait_for_selector(".scene-host canvas")
        sha = app.page.locator("main header select").input_value()
        app.page.get_by_role("tab", name="Samples").click()
        app.ready()
        before = app.page.evaluate("() => document.querySelector('.scene-host').scene.counters().points")
        app.page.get_by_role("row").nth(3).click()
        app.page.wait_for_function(
            "points => document.querySelector('.scene-host').scene.counters().points > points", arg=before
        )
        with app.page.expect_download() as saved:
            app.page.get_by_role("link", name="Export as CSV").click()
        head, *lines = csv.reader(Path(saved.value.path()).read_text("utf-8").splitlines())
    files = (server.workspace / "virtual-cell").rglob("*.truepose")
    error_map = next(found for path in files if (found := load_map(path)).hash == sha)
    assert saved.value.suggested_filename.endswith("-samples.csv")
    column = head.index("x_error_measured_mm")
    assert np.allclose([float(line[column]) for line in lines], error_map.e[:, 0], rtol=1e-6)
