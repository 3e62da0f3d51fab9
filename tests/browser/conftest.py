"""The application as people have it: the server in a process of its own, and pages in a real browser.

A page fails its test on any console message, any error and any request to another host. Each test worker has its own
server and browser; the virtual cell that the workspaces are copied from is made once for all of them.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest
from tests.browser.opening import Browser, Server, chromium_path

from truepose.web.pages import STATIC

PICTURES = Path(__file__).parents[2] / "build" / "screens"
_HOW = "'apt-get install chromium' and 'make setup', which builds the pages"


def _cannot(reason: str) -> NoReturn:
    """Skip the browser tests; fail where they are required, as in CI."""
    text = f"no browser tests: {reason}; get them with {_HOW}"
    if os.environ.get("TRUEPOSE_BROWSER_TESTS") == "require":
        pytest.fail(text, pytrace=False)
    pytest.skip(text)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """The browser of this test worker."""
    if (found := chromium_path()) is None:
        _cannot("chromium is not installed")
    if not (STATIC / "index.html").is_file():
        _cannot("the pages are not built")
    try:
        import playwright  # noqa: F401
    except ModuleNotFoundError:
        _cannot("playwright is not installed")
    with Browser.launched(found) as opened:
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
