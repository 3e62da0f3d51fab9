"""Everything without a mouse: the pages are reached and used by keys alone, and one always sees where one is."""

from __future__ import annotations

from pathlib import Path

from tests.browser.opening import PAGES, Browser, Opened, Server

_FOCUSED = """() => {
  const one = document.activeElement
  const outline = getComputedStyle(one)
  const seen = outline.outlineStyle !== 'none' && parseFloat(outline.outlineWidth) > 0
  const name = (one.getAttribute('aria-label') ?? one.textContent ?? '').trim().slice(0, 60)
  return { tag: one.tagName.toLowerCase(), role: one.getAttribute('role'), name, seen }
}"""


def tab_to(app: Opened, name: str, *, most: int = 80) -> None:
    """Press Tab until the focused element has a name."""
    found = []
    for _ in range(most):
        app.page.keyboard.press("Tab")
        focused = app.page.evaluate(_FOCUSED)
        assert focused["tag"] == "body" or focused["seen"], f"the focus is not seen at {focused}"
        found.append(focused["name"])
        if focused["name"].startswith(name):
            return
    raise AssertionError(f"no way to {name!r} by Tab; only to {found}")


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


def test_the_keys_are_listed_and_the_list_gives_the_focus_back(browser: Browser, server: Server) -> None:
    with browser.opened(server) as app:
        app.go("history")
        tab_to(app, "Export as CSV", most=200)
        app.page.keyboard.press("?")
        app.page.get_by_role("dialog").wait_for()
        app.page.keyboard.press("Escape")
        app.page.get_by_role("dialog").wait_for(state="detached")
        assert app.page.evaluate(_FOCUSED)["name"].startswith("Export as CSV")
