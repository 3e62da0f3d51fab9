"""Names of files and cells as people give them: long, in Chinese, or written like markup."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.browser.opening import PAGES, Browser, Opened, Server

LONG = "Bohrzelle-Flügelkasten-links-Station-17-Kampagne-2026-03-Wiederholung"
CHINESE = "机翼钻孔单元第十七工位二零二六年三月重复测量数据第一批次左侧外翼"
MARKUP = "<img src=x onerror=document.title='run'>"


@pytest.fixture(scope="module")
def named(browser: Browser, virtual_cell: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server whose cell, samples, plans, maps and corrections have such names."""
    workspace = tmp_path_factory.mktemp("named")
    cell = shutil.copytree(virtual_cell, workspace / LONG)
    for name in (LONG, CHINESE, MARKUP):
        shutil.copy(cell / "map.truepose", cell / f"{name}.truepose")
        shutil.copy(cell / "fit_plan.csv", cell / f"{name}-plan.csv")
        samples = (cell / "fit_samples.csv").read_text("utf-8").replace("P001", name, 1)
        (cell / f"{name}.csv").write_text(samples, "utf-8")
        shutil.copytree(cell / "corrected", cell / f"{name}-corrected")
    with Server.started(workspace) as running:
        yield running


def complaints(app: Opened, page: str) -> list[str]:
    """Return what such names break on a page."""
    found = [*app.overflow(), *app.cut_headers()]
    if app.page.evaluate("() => document.querySelector('main img, main script') !== null"):
        found.append("a name became markup")
    return [f"{page}: {one}" for one in found]


@pytest.mark.parametrize(("width", "language"), [(1400, "de"), (390, "en")])
@pytest.mark.exhaustive
def test_names_break_no_page(browser: Browser, named: Server, pictures: Path, width: int, language: str) -> None:
    found = []
    with browser.opened(named, width=width, language=language) as app:
        for place in (*PAGES, "measure/samples", "measure/plans", "measure/import"):
            app.go(place)
            found += complaints(app, place)
            app.page.screenshot(path=pictures / f"names-{place.replace('/', '-')}-{width}.png")
        assert "run" not in app.page.title()
    assert not found, "\n".join(found)
