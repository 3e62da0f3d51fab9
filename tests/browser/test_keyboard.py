"""Everything without a mouse: the pages are reached and used by keys alone, and one always sees where one is."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import pytest
from tests.browser.opening import PAGES, Browser, Opened, Server

from truepose.error_map import load_map
from truepose.samples import read_samples

_FOCUSED = """() => {
  const one = document.activeElement
  const outline = getComputedStyle(one)
  const seen = outline.outlineStyle !== 'none' && parseFloat(outline.outlineWidth) > 0
  const name = (one.getAttribute('aria-label') ?? (one.labels?.[0] ?? one).textContent ?? '').trim().slice(0, 60)
  return { tag: one.tagName.toLowerCase(), role: one.getAttribute('role'), name, seen }
}"""
_OFFERED = "start => [...(document.activeElement.options ?? [])].some(one => one.textContent.startsWith(start))"


def tab_to(app: Opened, name: str, *, most: int = 80, whole: bool = False) -> None:
    """Press Tab until the name of the focused element starts so, or is that as a whole."""
    found = []
    for _ in range(most):
        app.page.keyboard.press("Tab")
        focused = app.page.evaluate(_FOCUSED)
        assert focused["tag"] == "body" or focused["seen"], f"the focus is not seen at {focused}"
        found.append(focused["name"])
        if focused["name"].removesuffix(" …") == name or (not whole and focused["name"].startswith(name)):
            return
    raise AssertionError(f"no way to {name!r} by Tab; only to {found}")


def give_by_keys(app: Opened, *files: Path) -> None:
    """Go to the next button that chooses files, and give it some."""
    tab_to(app, "Choose")
    with app.page.expect_file_chooser() as chooser:
        app.page.keyboard.press("Enter")
    chooser.value.set_files([str(file) for file in files])


def choose_by_keys(app: Opened, label: str, start: str) -> None:
    """Choose an entry of a list by its first letters, as browsers have it."""
    tab_to(app, label)
    app.page.wait_for_function(_OFFERED, arg=start)
    app.page.keyboard.type(start)
    chosen = app.page.evaluate("() => document.activeElement.selectedOptions[0].textContent")
    assert chosen.startswith(start), f"{label} is {chosen}"


def press(app: Opened, name: str) -> None:
    """Press a button that can be pressed: go there by Tab."""
    app.page.locator("button:enabled", has_text=re.compile(f"^{name}( …)?$")).last.wait_for()
    tab_to(app, name, whole=True)
    app.page.keyboard.press("Enter")


def download_by_keys(app: Opened, name: str) -> Path:
    """Follow a link that sends a file."""
    tab_to(app, name, most=200)
    with app.page.expect_download() as saved:
        app.page.keyboard.press("Enter")
    return Path(saved.value.path())


@pytest.mark.exhaustive
def test_every_page_is_reached_by_keys(browser: Browser, server: Server) -> None:
    with browser.opened(server) as app:
        for page in PAGES[1:]:
            tab_to(app, page.capitalize(), most=200)
            app.page.keyboard.press("Enter")
            app.shown(page)


def test_a_program_is_verified_by_keys(browser: Browser, own_server: Server, virtual_cell: Path) -> None:
    with browser.opened(own_server) as app:
        keyboard = app.page.keyboard
        app.go("verify")
        tab_to(app, "Skip to the page")
        keyboard.press("Enter")
        tab_to(app, "Choose a file")
        with app.page.expect_file_chooser() as chooser:
            keyboard.press("Enter")
        chooser.value.set_files(str(virtual_cell / "panel_corrected_readings.txt"))
        app.page.get_by_text("panel_corrected_readings.txt").wait_for()
        tab_to(app, "Verify")
        keyboard.press("Enter")
        table = app.page.get_by_role("grid", name="Measured targets")
        table.wait_for()
        app.page.locator("main").focus()
        keyboard.press("/")
        keyboard.type("XP2")
        app.page.wait_for_function("() => document.querySelector('[role=grid]').getAttribute('aria-rowcount') === '7'")
        tab_to(app, "Measured targets")
        keyboard.press("End")
        chosen = table.get_by_role("row", selected=True)
        assert "XP24" in chosen.inner_text()
        keyboard.press("ArrowUp")
        assert "XP23" in chosen.inner_text()


def test_the_whole_day_goes_by_keys(browser: Browser, own_server: Server, virtual_cell: Path) -> None:
    folder = own_server.workspace / "virtual-cell"
    with browser.opened(own_server) as app:
        page, keyboard = app.page, app.page.keyboard
        page.evaluate(
            "() => ['mousedown', 'touchstart'].forEach(one => addEventListener(one, () => window.mouse = one))"
        )

        keyboard.press("2")
        app.shown("measure")
        tab_to(app, "Plan")
        keyboard.press("ArrowRight")  # to the tab Import
        page.get_by_role("group", name="Drop the measurement file").wait_for()
        give_by_keys(app, virtual_cell / "fit_readings.txt")
        plans = page.get_by_role("region", name="Match with the plan").get_by_role("combobox", name="Plan")
        plans.locator("option", has_text="fit_plan").wait_for(state="attached")
        choose_by_keys(app, "Plan", "fit_plan")
        page.get_by_role("region", name="Errors after registration").wait_for()
        press(app, "Import")
        page.get_by_text("samples are in").wait_for()
        (samples,) = folder.glob("samples/*.csv")
        assert len(read_samples(samples)) == len(read_samples(virtual_cell / "fit_samples.csv"))

        keyboard.press("3")
        app.shown("map")
        press(app, "Fit a map")
        page.get_by_role("dialog").get_by_label("Samples").locator("option").first.wait_for(state="attached")
        choose_by_keys(app, "Samples", f"samples/{samples.name}")
        choose_by_keys(app, "Predictor", "kinematic-kriging")
        tab_to(app, "Name of the map")
        keyboard.type("by keys")
        press(app, "Fit")
        page.get_by_role("dialog").wait_for(state="detached")
        made = load_map(folder / "maps" / "by keys.truepose")
        assert made.predictor_name == "kinematic-kriging"

        keyboard.press("4")
        app.shown("programs")
        give_by_keys(app, *(virtual_cell / "program" / name for name in ("panel.src", "panel.dat", "$config.dat")))
        page.wait_for_url("**/upload/**")
        app.ready()
        choose_by_keys(app, "Error map", "maps/by keys")
        press(app, "Correct")
        page.get_by_text("23 of 24 targets corrected").wait_for()
        app.ready()
        with zipfile.ZipFile(download_by_keys(app, "Download the corrected files")) as files:
            (name,) = (name for name in files.namelist() if name.endswith("panel.dat"))
            assert files.read(name) == (folder / "corrected" / "panel" / "panel.dat").read_bytes()
        record = (folder / "corrected" / "panel" / "panel.corrections.json").read_text("utf-8")
        assert made.hash in record

        keyboard.press("5")
        app.shown("verify")
        give_by_keys(app, virtual_cell / "panel_corrected_readings.txt")
        press(app, "Verify")
        page.get_by_role("grid", name="Measured targets").wait_for()
        page.get_by_text("24 pass, 0 undecided, 0 fail").wait_for()
        saved = download_by_keys(app, "Download (JSON)")
        assert saved.read_bytes() == next(folder.glob("verifications/*.json")).read_bytes()
        assert page.evaluate("() => window.mouse === undefined")


@pytest.mark.exhaustive
def test_the_keys_are_listed_and_the_list_gives_the_focus_back(browser: Browser, server: Server) -> None:
    with browser.opened(server) as app:
        app.go("history")
        tab_to(app, "Export as CSV", most=200)
        app.page.keyboard.press("?")
        app.page.get_by_role("dialog").wait_for()
        app.page.keyboard.press("Escape")
        app.page.get_by_role("dialog").wait_for(state="detached")
        assert app.page.evaluate(_FOCUSED)["name"].startswith("Export as CSV")
