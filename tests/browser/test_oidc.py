"""Log-in by a provider of OpenID Connect, in the browser: the button, the way back, and a refusal in words."""

# ruff: noqa: E402 - what the imports need is looked for first

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.browser.opening import Browser, Server
from tests.needs import needed

needed("alembic", "'truepose[store]'")
needed("authlib", "'truepose[oidc]'")

from tests.web.people import PASSWORD, add_people
from tests.web.provider import CLIENT, SECRET, SmallProvider

from truepose.store.access import log_in
from truepose.store.store import Store
from truepose.store.users import add_user


@pytest.mark.exhaustive
def test_the_button_leads_to_the_provider_and_back(
    browser: Browser, virtual_cell: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace, folder = tmp_path / "workspace", tmp_path / "store"
    shutil.copytree(virtual_cell, workspace / "virtual-cell")
    with Store.open(folder, create=True) as store:
        add_people(store)
        add_user(store, log_in(store, "root", PASSWORD), "Anna", ["release"], subject="00u-anna")
    with SmallProvider.started() as provider:
        settings = {"ISSUER": provider.issuer, "CLIENT_ID": CLIENT, "CLIENT_SECRET": SECRET}
        for name, value in settings.items():
            monkeypatch.setenv(f"TRUEPOSE_OIDC_{name}", value)
        with Server.started(workspace, "--store", str(folder)) as server, browser.opened(server) as app:
            page = app.page
            button = page.get_by_role("button", name="127.0.0.1")
            button.click()
            page.get_by_role("alert").wait_for()  # nobody is logged in at the provider
            assert "oidc" not in page.url
            provider.subject = "00u-anna"
            button.click()
            page.locator("header").get_by_role("button", name="Anna").wait_for()
            app.ready()
            provider.subject = ""
            page.reload()
            page.locator("header").get_by_role("button", name="Anna").wait_for()
            app.complaints[:] = [one for one in app.complaints if provider.issuer not in one and "40" not in one]
