"""Every page in every language, width and theme: no complaint, nothing wider than the window, nothing inaccessible."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.browser.opening import PAGES, Browser, Opened, Server

WIDE, NARROW = 1400, 390


def show_correction(app: Opened, *, from_page: str = "") -> None:
    """Show the correction of the virtual cell, from the page of programs."""
    if from_page:
        app.go(from_page)
    app.page.locator("main a", has_text="panel").first.click()
    app.page.locator("main [role=grid] [role=row]").nth(1).wait_for()
    app.ready()


# each width with each language, and the two themes of the pictures in the documentation
@pytest.mark.parametrize(
    ("width", "theme", "language"),
    [
        (WIDE, "light", "en"),
        (WIDE, "dark", "en"),
        (WIDE, "light", "de"),
        (WIDE, "dark", "zh"),
        (NARROW, "dark", "en"),
        (NARROW, "light", "de"),
        (NARROW, "dark", "zh"),
    ],
)
@pytest.mark.sampled(1)
def test_every_page_fits_its_window(
    browser: Browser, server: Server, pictures: Path, width: int, theme: str, language: str
) -> None:
    found = []
    with browser.opened(
        server, width=width, height=900 if width == WIDE else 844, language=language, theme=theme
    ) as app:
        for page in PAGES:
            app.go(page)
            if page == "programs":
                show_correction(app)
            found += [f"{page}: {one}" for one in app.overflow()]
            shown_in_docs = width == WIDE and language == "en"
            name = f"{page}-{theme}" if shown_in_docs else f"{page}-{theme}-{width}-{language}"
            app.page.screenshot(path=pictures / f"{name}.png")
    assert not found, "\n".join(found)


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [WIDE, NARROW])
@pytest.mark.exhaustive
def test_every_page_is_accessible(browser: Browser, server: Server, axe: str, width: int, theme: str) -> None:
    found = []
    with browser.opened(server, width=width, theme=theme) as app:
        for page in PAGES:
            app.go(page)
            found += [f"{page}: {one}" for one in app.axe(axe)]
        show_correction(app, from_page="programs")
        found += [f"correction: {one}" for one in app.axe(axe)]
    assert not found, "\n".join(found)
