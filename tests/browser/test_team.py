"""A server with users in the browser: log-in, and the page of the administrator."""

# ruff: noqa: E402 - what the imports need is looked for first

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from tests.browser.opening import Browser, Opened, Server, give
from tests.needs import needed

needed("alembic", "'truepose[store]'")

from tests.web.people import PASSWORD, add_people

from truepose.store import schema
from truepose.store.access import log_in
from truepose.store.importing import import_folder
from truepose.store.store import Store

REFUSED = re.compile("console error: Failed to load resource: the server responded with a status of 40[139]")


MONTHS = 10


@pytest.fixture(scope="module")
def team_server(browser: Browser, virtual_cell: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server whose engineer took the virtual cell in and verified monthly, for tests that only look."""
    with started(virtual_cell, tmp_path_factory.mktemp("team"), months=MONTHS) as running:
        yield running


@pytest.fixture
def own_team(browser: Browser, virtual_cell: Path, tmp_path: Path) -> Iterator[Server]:
    """A server of its own, for a test that changes it."""
    with started(virtual_cell, tmp_path) as running:
        yield running


@contextmanager
def started(virtual_cell: Path, root: Path, *, months: int = 0) -> Iterator[Server]:
    """Start a server with a store that has the files of the virtual cell; the engineer took them in."""
    workspace, folder = root / "workspace", root / "store"
    shutil.copytree(virtual_cell, workspace / "virtual-cell")
    with Store.open(folder, create=True) as store:
        add_people(store)
        import_folder(store, log_in(store, "Jürgen", PASSWORD), workspace / "virtual-cell")
        with store.transaction("Jürgen") as change:
            map_id = change.connection.execute(sa.select(schema.map.c.id)).scalar_one()
            for month in range(months):
                after = {"n": 40, "mean_mm": 0.06 + 0.004 * month, "p95_mm": 0.12 + 0.009 * month, "max_mm": 0.3}
                figures = json.dumps({"program": f"panel-{month:02}.src", "after": after})
                when = f"2025-{month + 1:02}-15T08:00:00.000000Z"
                verified = {"map_id": map_id, "correction_id": None, "reading_set_id": None, "record_sha256": None}
                change.insert(schema.verification, {**verified, "kind": "program", "figures": figures, "created": when})
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


@pytest.mark.exhaustive
def test_nothing_is_asked_and_nothing_else_shown_before_a_log_in(browser: Browser, team_server: Server) -> None:
    with browser.opened(team_server) as app:
        app.page.get_by_role("heading", name="Log in").wait_for()
        assert not app.page.locator("nav").count()
        assert not app.page.get_by_role("button", name="Jobs").count()
        assert not app.complaints


@pytest.mark.exhaustive
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


def cards(app: Opened, view: str) -> None:
    """Choose a view of the history by the keyboard, from the one before."""
    app.page.get_by_role("tab", selected=True).focus()
    app.page.keyboard.press("ArrowRight")
    app.page.wait_for_function("view => location.hash.endsWith(`view=${view}`)", arg=view)
    app.ready()


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("language", "width", "theme"), [("en", 1400, "light"), ("de", 390, "dark"), ("zh", 390, "light")]
)
def test_the_history_shows_drift_and_the_audit_trail(
    browser: Browser, team_server: Server, axe: str, pictures: Path, language: str, width: int, theme: Any
) -> None:
    found = []
    with entered(browser, team_server, "quality", language=language, width=width, theme=theme) as app:
        page = app.page
        app.go("history")
        cards(app, "drift")
        page.locator("figure.chart canvas").wait_for()
        assert page.get_by_role("grid").get_attribute("aria-rowcount") == str(MONTHS + 2)
        found += [f"drift: {one}" for one in [*app.overflow(), *app.axe(axe)]]
        page.screenshot(path=pictures / f"drift-{theme}-{width}-{language}.png")
        cards(app, "audit")
        grid = page.get_by_role("grid")
        grid.get_by_text("verification.add").first.wait_for()
        every = grid.get_attribute("aria-rowcount")
        page.locator("main select").select_option("map")
        page.wait_for_function("n => document.querySelector('[role=grid]').ariaRowCount !== n", arg=every)
        assert set(grid.locator("[role=row] [role=gridcell]:nth-child(4)").all_inner_texts()) == {"map.add"}
        page.keyboard.press("Escape")
        grid.focus()
        page.keyboard.press("ArrowDown")
        page.locator("main section h2", has_text="map.add").wait_for()
        found += [f"audit: {one}" for one in [*app.overflow(), *app.axe(axe)]]
        page.screenshot(path=pictures / f"audit-{theme}-{width}-{language}.png")
        page.locator("main input[type=search]").fill("nothing has this text")
        page.locator("main .none").wait_for()
    assert not found, "\n".join(found)


def sign(app: Opened, what: str, *, reason: str = "", password: str = PASSWORD) -> None:
    """Sign for the map that is shown: ``Release`` or ``Withdraw``."""
    page = app.page
    if (choice := page.get_by_role("radio", name=what)).count():
        choice.check()
    page.get_by_label("Reason" if what == "Withdraw" else "Comment").fill(reason)
    page.get_by_label("Your password, as your signature").fill(password)
    page.get_by_role("button", name=what, exact=True).click()


def choose_map(app: Opened, name: str) -> None:
    """Show a map on the page of releases."""
    app.go("release")
    app.page.get_by_role("grid").get_by_text(name, exact=True).click()
    app.page.get_by_role("heading", name=name).wait_for()


def test_two_engineers_and_a_quality_manager(
    browser: Browser, own_team: Server, virtual_cell: Path, pictures: Path
) -> None:
    with entered(browser, own_team, "both") as app:
        page = app.page
        app.go("map")
        page.get_by_text("DRAFT").wait_for()
        page.get_by_role("button", name="Fit a map").click()
        page.get_by_label("Predictor").select_option("ordinary-kriging")
        page.get_by_role("button", name="Fit", exact=True).click()
        page.get_by_text("The map is fitted.").wait_for()
        (made,) = (own_team.workspace / "virtual-cell").glob("maps/*.truepose")
        name = made.name.removesuffix(".truepose")
        page.get_by_text("DRAFT").wait_for()
        choose_map(app, name)
        page.get_by_text("You made this map, so somebody else must release it.").wait_for()
        assert page.get_by_role("button", name="Release", exact=True).count() == 0
    with entered(browser, own_team, "quality") as app:
        page = app.page
        choose_map(app, name)
        sign(app, "Release", password="another long password")
        page.get_by_text("The password is wrong").wait_for()
        page.screenshot(path=pictures / "release-light.png")
        sign(app, "Release", reason="figures reviewed")
        page.get_by_text("The map is released.").wait_for()
        page.get_by_text("Comment: figures reviewed").or_(page.get_by_text("Reason: figures reviewed")).wait_for()
    with entered(browser, own_team, "Jürgen") as app:
        page = app.page
        app.go("programs")
        program = [virtual_cell / "program" / name for name in ("panel.src", "panel.dat", "$config.dat")]
        give(app, "Drop programs", *program)
        page.get_by_role("combobox", name="Error map", exact=True).select_option(
            hashlib.sha256(made.read_bytes()).hexdigest()
        )
        page.get_by_role("button", name="Correct", exact=True).click()
        page.get_by_text("of 24 targets corrected").wait_for()
        assert page.locator("main").get_by_text("DRAFT").count() == 0
    with entered(browser, own_team, "quality") as app:
        page = app.page
        choose_map(app, name)
        sign(app, "Withdraw", reason="the tool was bent")
        page.get_by_text("The map is withdrawn.").wait_for()
        recalled = page.get_by_role("region", name="Programs to review")
        recalled.get_by_role("cell", name="panel").first.wait_for()
        recalled.get_by_role("cell", name="Jürgen").filter(has_text="202").first.wait_for()
        assert recalled.evaluate("list => list.scrollWidth <= list.clientWidth")
        page.screenshot(path=pictures / "recall-light.png")
        app.go("programs")
        page.get_by_text("withdrawn").first.wait_for()
        choose_map(app, "map")  # the draft of another
        sign(app, "Withdraw", reason="not needed")
        page.get_by_text("The map is withdrawn.").first.wait_for()


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [1400, 390])
@pytest.mark.exhaustive
def test_the_pages_of_a_team_fit_and_are_accessible(
    browser: Browser, team_server: Server, axe: str, pictures: Path, width: int, theme: Any
) -> None:
    found = []
    suffix = theme if width == 1400 else f"{theme}-{width}"

    def look(app: Opened, what: str) -> None:
        found.extend(f"{what}: {one}" for one in [*app.overflow(), *app.axe(axe)])
        app.page.screenshot(path=pictures / f"{what}-{suffix}.png")

    with browser.opened(team_server, width=width, theme=theme) as app:
        app.page.locator("input[autocomplete=username]").wait_for()
        look(app, "login")
        app.complaints[:] = [text for text in app.complaints if not REFUSED.match(text)]
    with entered(browser, team_server, "root", width=width, theme=theme) as app:
        app.go("users")
        look(app, "users")
    with entered(browser, team_server, "quality", width=width, theme=theme) as app:
        choose_map(app, "map")
        look(app, "releases")
        grid = app.page.get_by_role("grid")
        if width == 1400:  # all columns are in view
            assert grid.evaluate("one => one.scrollWidth <= one.clientWidth")
            cut = "heads => heads.filter(one => one.scrollWidth > one.clientWidth).map(one => one.textContent)"
            assert app.page.get_by_role("columnheader").evaluate_all(cut) == []
        app.page.locator("header").get_by_role("button", name="quality").click()
        app.page.get_by_label("What for").fill("night shift")
        app.page.get_by_role("button", name="Make a token").click()
        app.page.get_by_text("tp_").wait_for()
        look(app, "account")
        app.page.get_by_role("row", name="night shift").get_by_role("button", name="Revoke").click()
        app.page.get_by_role("row", name="night shift").wait_for(state="detached")
        assert app.page.get_by_label("administer").count() == 0
    assert not found, "\n".join(found)
