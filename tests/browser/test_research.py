"""The researcher's part of the day: ranking, variogram by hand, curves of joints, held-out samples."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from tests.browser.opening import Browser, Opened, Server

from truepose.cell import load_cell
from truepose.error_map import ErrorMap, fit_cell, load_map
from truepose.report.knowledge import knowledge
from truepose.report.study import refit, similarity_study
from truepose.samples import read_samples


def picture(app: Opened, path: Path) -> None:
    """Take a picture for the light and for the dark pages of the documentation."""
    for theme in ("dark", "light"):
        app.page.emulate_media(color_scheme=theme)  # type: ignore[arg-type]
        app.page.wait_for_timeout(100)  # charts are drawn again
        app.page.screenshot(path=path.with_name(f"{path.name}-{theme}.png"))


def shown_map(app: Opened, server: Server) -> ErrorMap:
    """Return the map that the page shows."""
    sha = app.page.locator("main header select").input_value()
    files = (server.workspace / "virtual-cell").rglob("*.truepose")
    return next(found for path in files if (found := load_map(path)).hash == sha)


def open_tab(app: Opened, name: str) -> None:
    app.page.get_by_role("tab", name=name).click()
    app.ready()


def drag(app: Opened, handle: str, dx: float, dy: float) -> None:
    """Drag a handle of the variogram with the mouse, and wait for the fit of the others."""
    box = app.page.get_by_role("slider", name=handle).bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    with app.page.expect_response(lambda answer: answer.request.method == "POST" and "variogram" in answer.url):
        app.page.mouse.move(x, y)
        app.page.mouse.down()
        app.page.mouse.move(x + dx, y + dy)
        app.page.mouse.up()


def shown_model(app: Opened, held: dict[str, float]) -> dict[str, float]:
    """Return the model's parameters when the command of the page holds as many as were dragged."""
    for name in held:
        app.page.locator("main code", has_text=f"--{name} ").wait_for()
    fields = {"nugget": "Nugget", "sill": "Partial sill", "range": "Range"}
    return {name: float(app.page.get_by_label(label).last.input_value()) for name, label in fields.items()}


@pytest.mark.exhaustive
def test_dragged_parameters_are_held_and_the_others_fitted_again(
    browser: Browser, server: Server, pictures: Path
) -> None:
    with browser.opened(server) as app:
        app.go("map")
        error_map = shown_map(app, server)
        (part,) = similarity_study(error_map, space="cartesian").parts
        open_tab(app, "Variogram")
        app.page.get_by_role("slider", name="Nugget").wait_for()
        before = shown_model(app, {})
        held: dict[str, float] = {}
        for name, label, dx, dy in (("range", "Range", -40, 0), ("nugget", "Nugget", 0, -15), ("sill", "sill", 0, 20)):
            drag(app, label, dx, dy)
            app.page.locator("main code", has_text=f"--{name} ").wait_for()
            command = app.page.locator("main code", has_text="truepose similarity").inner_text()
            held = {key: float(value) for key, value in re.findall(r"--(nugget|sill|range) (\S+)", command)}
            assert name in held
            fitted = refit(part, fixed=held).model
            wanted = {"nugget": fitted.nugget, "sill": fitted.sill, "range": float(np.max(fitted.range))}
            assert shown_model(app, held) == pytest.approx(wanted, rel=1e-3, abs=1e-6)
            if name == "range":
                assert held["range"] < before["range"]
                picture(app, pictures / "variogram")
        assert sorted(held) == ["nugget", "range", "sill"]
        app.page.get_by_role("button", name="Fit all again").click()
        app.page.get_by_role("button", name="Fit all again").wait_for(state="detached")
        app.page.locator("main code", has_text="--range ").wait_for(state="detached")
        assert shown_model(app, {}) == before


@pytest.mark.exhaustive
def test_handles_of_the_variogram_move_by_keys(browser: Browser, server: Server) -> None:
    moves = {"range": ("Range", "ArrowLeft"), "nugget": ("Nugget", "ArrowUp"), "sill": ("sill", "ArrowDown")}
    with browser.opened(server) as app:
        page = app.page
        app.go("map")
        page.get_by_role("tab", name="Variogram").focus()
        page.keyboard.press("Enter")
        for name, (label, key) in moves.items():
            handle = page.get_by_role("slider", name=label)
            handle.wait_for()
            before = handle.get_attribute("aria-valuetext")
            handle.focus()
            page.keyboard.press(f"Shift+{key}")
            page.locator("main code", has_text=f"--{name} ").wait_for()
            assert handle.get_attribute("aria-valuetext") != before
        again = page.get_by_role("button", name="Fit all again")
        again.focus()
        page.keyboard.press("Enter")
        again.wait_for(state="detached")


def test_candidates_are_ranked_and_the_chosen_one_is_validated(
    browser: Browser, own_server: Server, pictures: Path
) -> None:
    with browser.opened(own_server) as app:
        page = app.page
        app.go("map")
        page.get_by_role("button", name="Fit a map").click()
        dialog = page.get_by_role("dialog")
        dialog.get_by_label("Samples").select_option("fit_samples.csv")
        dialog.get_by_label("Name of the map").fill("chosen")
        dialog.get_by_role("checkbox", name="blocks").uncheck()
        dialog.get_by_role("button", name="Fit", exact=True).click()
        dialog.wait_for(state="detached", timeout=300_000)
        page.wait_for_function("() => document.querySelector('main header select').innerText.includes('chosen')")
        error_map = shown_map(app, own_server)
        open_tab(app, "Candidates")
        rows = page.get_by_role("grid", name="Candidates").get_by_role("row")
        rows.nth(2).wait_for()
        assert error_map.predictor_name in rows.nth(1).inner_text()
        assert not app.cut_headers()
        picture(app, pictures / "candidates")

        open_tab(app, "Held-out")
        page.get_by_label("Table of held-out samples").select_option("held_out_samples.csv")
        page.get_by_role("button", name="Validate").click()
        mean = page.get_by_role("row", name=re.compile("^Mean ")).first
        mean.wait_for(timeout=300_000)
        figures = error_map.validate(
            read_samples(own_server.workspace / "virtual-cell" / "held_out_samples.csv"), rivals=False
        ).to_dict()
        shown = [float(text) for text in re.findall(r"\d+\.\d+", mean.inner_text())]
        assert shown[:2] == [round(figures[when]["mean_mm"], 3) for when in ("before", "after")]
        picture(app, pictures / "held-out")


def test_curves_of_joints_have_bands(browser: Browser, own_server: Server, pictures: Path) -> None:
    folder = own_server.workspace / "virtual-cell"
    samples = read_samples(folder / "fit_samples.csv")
    error_map = fit_cell(load_cell(folder / "cell.toml"), samples, "kinematic-kriging")
    error_map.save(folder / "map.truepose")
    known = knowledge(error_map)
    with browser.opened(own_server) as app:
        app.go("map")
        assert shown_map(app, own_server).hash == error_map.hash
        open_tab(app, "Joints")
        charts = app.page.get_by_role("figure", name=re.compile("Error of joint"))
        charts.first.locator("canvas").wait_for()
        assert charts.count() == len(known.curves) > 0
        picture(app, pictures / "joints")
        with app.page.expect_download() as saved:
            app.page.get_by_role("link", name="Export as CSV").click()
        head, *lines = csv.reader(Path(saved.value.path()).read_text("utf-8").splitlines())
        column = next(k for k, name in enumerate(head) if "std" in name)
        wanted = np.concatenate([1e3 * curve.std for curve in known.curves])
        assert np.allclose([float(line[column]) for line in lines], wanted, rtol=1e-5)
