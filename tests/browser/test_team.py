"""A server with users in the browser: log-in, and the page of the administrator."""

# ruff: noqa: E402 - what the imports need is looked for first

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.browser.opening import Browser, Opened, Server
from tests.needs import needed

needed("alembic", "'truepose[store]'")

from tests.web.people import PASSWORD, add_people

from truepose.store.access import log_in
from truepose.store.importing import import_folder
from truepose.store.store import Store

REFUSED = re.compile("console error: Failed to load resource: the server responded with a status of 40[139]")


@pytest.fixture
def team_server(browser: Browser, virtual_cell: Path, tmp_path: Path) -> Iterator[Server]:
    """A server with a store that has the files of the virtual cell; the engineer took them in."""
    workspace, folder = tmp_path / "workspace", tmp_path / "store"
    shutil.copytree(virtual_cell, workspace / "virtual-cell")
    with Store.open(folder, create=True) as store:
        add_people(store)
        import_folder(store, log_in(store, "Jürgen", PASSWORD), workspace / "virtual-cell")
    with Server.started(workspace, "--store", str(folder)) as running:
        yield running


@contextmanager
def entered(browser: Browser, server: Server, name: str, **how: Any) -> Iterator[Opened]:
    """Log in; the browser's own words about answers that refuse are no complaint."""
    with browser.opened(server, **how) as app:
        page = app.page
        page.locator("input[autocomplete=username]").fill(name)
        page.locator("input[autocomplete=current-password]").fill(PASSWORD)
        page.keyboard.press("Enter")
        page.locator("header").get_by_role("button", name=name).wait_for()
        app.ready()
        yield app
        app.complaints[:] = [text for text in app.complaints if not REFUSED.match(text)]


def test_an_administrator_adds_and_disables_a_user(browser: Browser, team_server: Server) -> None:
    with entered(browser, team_server, "root") as app:
        page = app.page
        app.go("users")
        page.get_by_label("Name", exact=True).fill("Anna")
        page.get_by_label("First password").fill(PASSWORD)
        page.get_by_role("button", name="Add a user").click()
        page.get_by_text("Anna is added.").wait_for()
        row = page.get_by_role("row", name="Anna")
        row.get_by_role("button", name="Disable").click()
        row.get_by_text("disabled").wait_for()
        page.get_by_label("What for").fill("night shift")
        page.get_by_role("button", name="Make a token").click()
        page.get_by_text("tp_").wait_for()
