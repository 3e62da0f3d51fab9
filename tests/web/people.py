"""A server with a store and its users: an engineer, a quality manager and an administrator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fastapi.testclient import TestClient

from truepose.store.access import log_in
from truepose.store.store import Store
from truepose.store.users import add_user
from truepose.web import Workspace, create_app
from truepose.web.security import CSRF_HEADER
from truepose.web.team.address import Address
from truepose.web.team.guard import TeamGuard
from truepose.web.team.team import Team

PASSWORD = "a long enough password"
URL = "https://truepose.example"
USERS = {
    "Jürgen": ["measure", "program"],
    "quality": ["release"],
    "both": ["measure", "program", "release"],
    "reader": ["read"],
}


def add_people(store: Store) -> None:
    """Add the users; all have the same password."""
    add_user(store, None, "root", ["admin"], password=PASSWORD)
    root = log_in(store, "root", PASSWORD)
    for name, roles in USERS.items():
        add_user(store, root, name, roles, password=PASSWORD)


def enter(client: TestClient, name: str, password: str) -> Any:
    """Try to log in."""
    return client.post("/api/v1/login", json={"name": name, "password": password})


def browsers(workspace: Workspace, team: Team) -> Callable[..., TestClient]:
    """Return a function that returns a browser: of a user, or of nobody."""
    app = create_app(workspace, TeamGuard(Address.of(URL, "127.0.0.1", 8765), team), team=team)

    def browser(name: str | None = None, password: str = PASSWORD) -> TestClient:
        client = TestClient(app, base_url=URL, headers={CSRF_HEADER: "log-in"}, raise_server_exceptions=False)
        if name is not None:
            assert enter(client, name, password).status_code == 204
            client.headers[CSRF_HEADER] = client.get("/api/v1/session").json()["csrf"]
        return client

    return browser
