"""Programs in a real browser: from the dropped files to the corrected ones, by mouse and by keyboard."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path

from tests.browser.opening import Browser, Opened, Server

MARKUP = "<img src=x onerror=alert(1)>.src"
MORE = "PTP {A1 0,A2 -90,A3 90,A4 0,A5 45,A6 0}\nLIN_REL {X 5}\n"


def drop(app: Opened, files: dict[str, bytes]) -> None:
    app.go("programs")
    chosen = [{"name": name, "mimeType": "text/plain", "buffer": content} for name, content in files.items()]
    app.page.locator("input[type=file]:not([webkitdirectory])").set_input_files(chosen)  # type: ignore[arg-type]
    app.page.wait_for_url("**/upload/**")
    app.ready()


def panel(server: Server) -> dict[str, bytes]:
    folder = server.workspace / "virtual-cell" / "program"
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    files["panel.src"] = re.sub(rb"END\s*$", MORE.encode() + b"END\n", files["panel.src"])
    return files


def correct(app: Opened) -> None:
    app.page.get_by_label("Targets that a limit refuses").select_option("skip")
    app.page.get_by_role("button", name="Correct", exact=True).click()
    app.page.wait_for_url("**/correction/**", timeout=120_000)
    app.page.get_by_role("grid", name="Targets").get_by_text("XP1", exact=True).wait_for()
    app.ready()


def test_files_become_corrected_files_and_these_are_refused(
    browser: Browser, own_server: Server, pictures: Path, axe: str
) -> None:
    with browser.opened(own_server) as app:
        page = app.page
        drop(app, panel(own_server))
        page.get_by_role("button", name="Check", exact=True).click()
        page.get_by_text("of the motion targets can be corrected").wait_for(timeout=120_000)
        grid = page.get_by_role("grid", name="Targets")
        grid.get_by_text("correctable", exact=True).first.wait_for()
        grid.focus()
        page.keyboard.press("ArrowDown")
        page.get_by_role("heading", name="PTP:", exact=False).wait_for()
        page.keyboard.press("/")
        page.keyboard.type("xp1")
        page.get_by_text("11 rows").wait_for()  # XP1, XP10 to XP19
        page.get_by_label("Targets that a limit refuses").select_option("skip")
        page.get_by_role("button", name="Preview", exact=True).click()
        grid.get_by_text("corrected", exact=True).first.wait_for(timeout=120_000)
        assert not (own_server.workspace / "virtual-cell" / "corrected" / "panel").exists()
        assert not app.axe(axe)
        correct(app)
        command = "truepose correct map.truepose programs/panel --out=corrected/panel"
        page.get_by_role("tab", name="Limits").click()
        assert page.get_by_text(command).count() == 1
        page.get_by_role("tab", name="Path").click()
        page.keyboard.press("/")
        assert page.evaluate("() => document.activeElement.matches('[data-filter]')")
        page.keyboard.type("xp1")
        page.get_by_text("11 rows").wait_for()  # XP1, XP10 to XP19
        page.get_by_role("grid", name="Targets").focus()
        page.keyboard.press("ArrowDown")
        page.keyboard.press("ArrowDown")
        page.get_by_role("heading", name="XP10", exact=True).wait_for()
        page.screenshot(path=pictures / "programs-correction.png")
        page.get_by_role("button", name=re.compile(r"panel\.dat:\d+")).click()
        page.locator("mark").first.wait_for()
        assert not app.axe(axe)
        page.screenshot(path=pictures / "programs-difference.png")
        with page.expect_download() as waiting:
            page.get_by_role("link", name="Download the corrected files").click()
        with zipfile.ZipFile(io.BytesIO(Path(waiting.value.path()).read_bytes())) as sent:
            files = {name: sent.read(name) for name in ("panel.src", "panel.dat")}
        written = own_server.workspace / "virtual-cell" / "corrected" / "panel" / "panel.dat"
        assert files["panel.dat"] == written.read_bytes()
        drop(app, files)
        page.get_by_role("button", name="Correct", exact=True).click()
        refusal = page.get_by_role("alert")
        refusal.wait_for(timeout=120_000)
        assert "do not correct it twice: take the original" in refusal.inner_text()


def test_names_with_markup_are_text_and_fit_a_narrow_window(browser: Browser, own_server: Server) -> None:
    with browser.opened(own_server, width=390, height=844) as app:
        drop(app, {MARKUP: b"DEF a()\nEND\n"})
        assert app.page.get_by_text("_img src=x onerror=alert(1)_.src").count()
        assert app.page.locator("main img").count() == 0
        assert not app.overflow()
        app.go("programs")
        assert not app.overflow()
