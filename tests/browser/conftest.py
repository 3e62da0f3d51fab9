"""The application as people have it: the server in a process of its own, and pages in a real browser.

A page fails its test on any console message, any error and any request to another host. Each test worker has its own
server and browser; the virtual cell that the workspaces are copied from is made once for all of them.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from tests.browser.opening import Browser, Server, chromium_path

from truepose.web.pages import STATIC

AXE = Path(__file__).parents[2] / "frontend" / "node_modules" / "axe-core" / "axe.min.js"
PICTURES = Path(__file__).parents[2] / "build" / "screens"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave to the second tier what has a server of its own: it goes through a day, or a part of one, with fits."""
    for item in items:
        if {"own_server", "own_team"} & set(getattr(item, "fixturenames", ())):
            item.add_marker("exhaustive")


def pytest_runtest_setup() -> None:
    """Skip a test where there is no browser, with one line for all; fail where they are required, as in CI."""
    if not (reason := _obstacle()):
        return
    text = f"no browser tests: {reason}; get them with 'apt-get install chromium' and 'make frontend'"
    if os.environ.get("TRUEPOSE_BROWSER_TESTS") == "require":
        pytest.fail(text, pytrace=False)
    pytest.skip(text)


@cache
def _obstacle() -> str:
    if chromium_path() is None:
        return "chromium is not installed"
    if not (STATIC / "index.html").is_file():
        return "the pages are not built"
    return "" if find_spec("playwright") else "playwright is not installed"


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """The browser of this test worker."""
    with Browser.launched(chromium_path() or "") as opened:
        yield opened


@pytest.fixture(scope="session")
def server(
    browser: Browser, virtual_cell: Path, tmp_path_factory: pytest.TempPathFactory, run: Callable[..., Any]
) -> Iterator[Server]:
    """A server of a workspace with the virtual cell and a verification in it, for tests that only look."""
    workspace = tmp_path_factory.mktemp("shown")
    cell = shutil.copytree(virtual_cell, workspace / "virtual-cell")
    (cell / "verifications").mkdir()
    readings = [cell / "panel_corrected_readings.txt", "--before", cell / "panel_original_readings.txt"]
    out = cell / "verifications" / "panel.json"
    assert run("verify", cell / "map.truepose", cell / "corrected" / "panel.src", *readings, "--out", out).code == 0
    with Server.started(workspace) as running:
        yield running


@pytest.fixture
def own_server(browser: Browser, virtual_cell: Path, tmp_path: Path) -> Iterator[Server]:
    """A server of a workspace of its own, for a test that changes it: the virtual cell and nothing else."""
    workspace = tmp_path / "workspace"
    shutil.copytree(virtual_cell, workspace / "virtual-cell")
    with Server.started(workspace) as running:
        yield running


@pytest.fixture(scope="session")
def pictures() -> Path:
    """The ignored folder of the pictures that the documentation shows."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    return PICTURES


@pytest.fixture(scope="session")
def axe() -> str:
    """The source of axe-core."""
    assert AXE.is_file(), "axe-core is missing; run 'npm ci' in frontend"
    return AXE.read_text("utf-8")
