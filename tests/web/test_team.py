"""A server with users: log-in, sessions, roles, and what ends them."""

# ruff: noqa: E402 - what the imports need is looked for first

from __future__ import annotations

import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import anyio
import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request
from tests.needs import needed

needed("alembic", "'truepose[store]'")

from tests.web.people import PASSWORD, browsers, enter

from truepose.errors import DataError, StoreError
from truepose.jobs import Job
from truepose.jobs.job import COMMANDS
from truepose.store.access import log_in
from truepose.store.store import Store
from truepose.store.users import set_disabled, set_password, set_roles
from truepose.web import Workspace
from truepose.web.jobs import _events
from truepose.web.security import CSRF_HEADER
from truepose.web.server import WithUsers, _guard
from truepose.web.team.address import Address
from truepose.web.team.permissions import NEEDED, OF_COMMANDS, OPEN
from truepose.web.team.sessions import IDLE_S, LONGEST_S, Sessions
from truepose.web.team.team import Team, Visitor
from truepose.web.team.visits import session_check

FREE_TRIES = 3


class Clock:
    """A clock that stands still until it is set."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


class Running:
    """A queue with one job that runs for ever."""

    job: Final = Job(
        id="00000001-00000000", command=("study",), folder=".", cell="", title="", state="running", created=""
    )

    def revision(self, _job: str) -> int:
        return self.job.revision

    def get(self, _job: str) -> Job:
        return self.job


def lost() -> None:
    raise StoreError("store: the connection to the store was lost; try again")


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def team(store: Store, clock: Clock, tmp_path: Path) -> Team:
    return Team(store, str(tmp_path / "store"), Sessions(clock), clock)


@pytest.fixture
def opened(team: Team, tmp_path: Path) -> Callable[..., TestClient]:
    """Return a function that returns a browser: of a user, or of nobody."""
    return browsers(Workspace(tmp_path / "work"), team)


def test_a_user_logs_in_and_out(opened: Callable[..., TestClient]) -> None:
    client = opened()
    answer = client.get("/api/v1/session")
    assert answer.status_code == 401
    assert answer.json()["users"] is True
    cookie = enter(client, "reader", PASSWORD).headers["set-cookie"].lower()
    assert all(word in cookie for word in ("__host-truepose=", "httponly", "samesite=strict", "secure", "path=/"))
    session = client.get("/api/v1/session").json()
    assert session["user"] == {"name": "reader", "roles": ["read"]}
    kept = dict(client.cookies)
    client.headers[CSRF_HEADER] = session["csrf"]
    assert client.post("/api/v1/logout").status_code == 204
    client.cookies.update(kept)
    assert client.get("/api/v1/session").status_code == 401


@pytest.mark.parametrize("name", ["JÜRGEN", "ju\u0308rgen", " Jürgen "])
def test_a_name_in_other_case_or_unicode_form_is_the_same_user(opened: Callable[..., TestClient], name: str) -> None:
    assert opened(name).get("/api/v1/session").json()["user"]["name"] == "Jürgen"


def test_unknown_user_wrong_password_and_disabled_user_get_the_same_answer(
    opened: Callable[..., TestClient], store: Store
) -> None:
    set_disabled(store, log_in(store, "root", PASSWORD), "reader", True)
    tries = [("nobody", PASSWORD), ("root", "a wrong password"), ("reader", PASSWORD), ("", ""), ("a\0b", "x")]
    answers = [enter(opened(), *one) for one in tries]
    assert {answer.status_code for answer in answers} == {401}
    assert len({answer.text for answer in answers}) == 1


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["root", "nobody"])
def test_wrong_tries_of_a_name_must_wait_whether_it_exists_or_not(
    opened: Callable[..., TestClient], clock: Clock, name: str
) -> None:
    client = opened()
    answers = [enter(client, name, "wrong") for _ in range(10)]
    assert [answer.status_code for answer in answers] == [401] * FREE_TRIES + [429] * 7
    assert int(answers[-1].headers["retry-after"]) >= 1
    assert enter(client, name.upper(), PASSWORD).status_code == 429
    clock.now += 1.1
    assert enter(client, name, "wrong").status_code == 401
    clock.now += 1.1
    assert enter(client, name, "wrong").status_code == 429
    assert enter(client, "reader", PASSWORD).status_code == 204


def test_wrong_tries_of_many_names_are_stopped_together(opened: Callable[..., TestClient], clock: Clock) -> None:
    client = opened()
    statuses = [enter(client, f"user{i} x", "wrong").status_code for i in range(61)]
    assert statuses == [401] * 60 + [429]
    assert enter(client, "reader", PASSWORD).headers["Retry-After"] == "60"
    clock.now += 60
    assert enter(client, "reader", PASSWORD).status_code == 204


@pytest.mark.parametrize(("step", "total"), [(IDLE_S, IDLE_S), (IDLE_S / 2, LONGEST_S)])
def test_a_session_ends_by_time(opened: Callable[..., TestClient], clock: Clock, step: float, total: float) -> None:
    client, end = opened("reader"), clock.now + total
    while clock.now + step < end:
        clock.now += step
        assert client.get("/api/v1/session").status_code == 200
    clock.now = end
    assert client.get("/api/v1/session").status_code == 401


def test_a_disabled_user_is_out_at_the_next_request(opened: Callable[..., TestClient], store: Store) -> None:
    client, root = opened("Jürgen"), log_in(store, "root", PASSWORD)
    assert client.get("/api/v1/cells").status_code == 200
    set_disabled(store, root, "Jürgen", True)
    assert client.get("/api/v1/cells").status_code == 401
    set_disabled(store, root, "Jürgen", False)
    assert client.get("/api/v1/cells").status_code == 401


def test_a_changed_password_ends_the_other_sessions(opened: Callable[..., TestClient], store: Store) -> None:
    one, other = opened("reader"), opened("reader")
    new = {"password": PASSWORD, "new_password": "another long password"}
    assert one.put("/api/v1/password", json={**new, "password": "wrong"}).status_code == 403
    assert one.put("/api/v1/password", json={**new, "new_password": "short"}).status_code == 422
    assert other.get("/api/v1/session").status_code == 200
    assert one.put("/api/v1/password", json=new).status_code == 204
    assert one.get("/api/v1/session").status_code == 200
    assert other.get("/api/v1/session").status_code == 401
    set_password(store, log_in(store, "root", PASSWORD), "reader", "a third long password")
    assert one.get("/api/v1/session").status_code == 401


def test_a_missing_role_is_named_and_a_lost_role_counts_at_once(
    opened: Callable[..., TestClient], store: Store
) -> None:
    client, root = opened("Jürgen"), log_in(store, "root", PASSWORD)
    answer = client.get("/api/v1/users")
    assert answer.status_code == 403
    assert "admin" in answer.json()["detail"]
    assert client.post("/api/v1/cells", json={}).status_code == 422
    set_roles(store, root, "Jürgen", ["read"])
    answer = client.post("/api/v1/cells", json={})
    assert answer.status_code == 403
    assert "measure" in answer.json()["detail"]


def test_every_route_needs_a_role(opened: Callable[..., TestClient]) -> None:
    """A new route without an entry in the table is refused; so is an entry without a route."""
    paths = opened().app.openapi()["paths"]  # type: ignore[attr-defined]
    names = {one["operationId"] for path, ways in paths.items() if path.startswith("/api/") for one in ways.values()}
    assert names == set(NEEDED) | OPEN


def test_every_job_has_an_action() -> None:
    assert set(OF_COMMANDS) == COMMANDS


def test_a_route_without_an_entry_is_refused(opened: Callable[..., TestClient], monkeypatch: Any) -> None:
    client = opened("root")
    assert client.get("/api/v1/cells").status_code == 200
    monkeypatch.delitem(NEEDED, "list_cells")
    assert client.get("/api/v1/cells").status_code == 403


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1:8765", "truepose.example:1", ""])
def test_a_foreign_host_gets_no_answer(opened: Callable[..., TestClient], host: str) -> None:
    assert opened("reader").get("/api/v1/session", headers={"Host": host}).status_code == 400
    assert opened().get("/healthz", headers={"Host": host}).status_code == 200


def test_a_foreign_origin_and_a_missing_header_change_nothing(opened: Callable[..., TestClient]) -> None:
    client = opened("root")
    for origin in ("https://evil.example", "null", "http://truepose.example"):
        assert client.post("/api/v1/logout", headers={"Origin": origin}).status_code == 403
        assert client.post("/api/v1/login", headers={"Origin": origin}).status_code == 403
    assert client.post("/api/v1/logout", headers={CSRF_HEADER: "log-in"}).status_code == 403
    del client.headers[CSRF_HEADER]
    assert enter(client, "root", PASSWORD).status_code == 403
    assert client.get("/api/v1/session").status_code == 200


def test_an_administrator_adds_changes_and_disables_users(opened: Callable[..., TestClient]) -> None:
    root = opened("root")
    new = {"name": "Anna", "roles": ["release"], "password": PASSWORD}
    assert root.post("/api/v1/users", json=new).json()["roles"] == ["release"]
    assert root.post("/api/v1/users", json={**new, "name": "ANNA"}).status_code == 422
    assert root.post("/api/v1/users", json={**new, "name": "Eve", "roles": ["king"]}).status_code == 422
    anna = opened("anna")
    assert root.patch("/api/v1/users", json={"name": "Anna", "roles": ["read", "release"]}).status_code == 204
    assert anna.get("/api/v1/session").json()["user"]["roles"] == ["read", "release"]
    assert root.patch("/api/v1/users", json={"name": "Anna", "disabled": True}).status_code == 204
    assert anna.get("/api/v1/session").status_code == 401
    shown = {one["name"]: one for one in root.get("/api/v1/users").json()}
    assert shown["Anna"] == {"name": "Anna", "roles": ["read", "release"], "disabled": True, "subject": None}
    assert root.patch("/api/v1/users", json={"name": "root", "roles": ["read"]}).status_code == 409


def test_a_token_is_shown_once(opened: Callable[..., TestClient]) -> None:
    client = opened("Jürgen")
    made = client.post("/api/v1/tokens", json={"name": "night shift", "scope": ["program"]}).json()
    listed = client.get("/api/v1/tokens")
    assert made["token"] not in listed.text
    assert [one["name"] for one in listed.json()] == ["night shift"]
    assert client.post("/api/v1/tokens", json={"name": "more", "scope": ["admin"]}).status_code == 409
    assert client.delete(f"/api/v1/tokens/{made['identity']}").status_code == 204
    assert client.get("/api/v1/tokens").json()[0]["revoked"] is True


def test_a_lost_store_is_said_and_the_server_recovers(
    opened: Callable[..., TestClient], team: Team, monkeypatch: Any
) -> None:
    client = opened("reader")

    with monkeypatch.context() as broken:
        broken.setattr(team.store, "reading", lost)
        answer = client.get("/api/v1/cells")
        assert answer.status_code == 503
        assert answer.headers["content-type"] == "application/problem+json"
    assert client.get("/api/v1/cells").status_code == 200


@pytest.mark.parametrize(
    ("url", "host", "shown"),
    [
        (None, "127.0.0.1", "http://127.0.0.1:8765/"),
        (None, "10.0.0.5", "http://10.0.0.5:8765/"),
        ("https://truepose.example/", "0.0.0.0", "https://truepose.example/"),
        ("https://[fd00::1]:8443", "::", "https://[fd00::1]:8443/"),
    ],
)
def test_the_address_is_that_of_the_url_or_the_bound_one(url: str | None, host: str, shown: str) -> None:
    assert Address.of(url, host, 8765).url == shown


@pytest.mark.parametrize(
    "url", [None, "", "truepose.example", "ftp://a.example", "https://a/b", "https://u:p@a", "https://a:x"]
)
def test_an_address_that_nobody_can_open_is_refused(url: str | None) -> None:
    with pytest.raises(DataError, match="--url"):
        Address.of(url, "0.0.0.0", 8765)


@pytest.mark.parametrize(
    ("users", "said"),
    [
        (WithUsers("", "10.0.0.5"), "http://10.0.0.5:8765/ has no TLS"),
        (WithUsers("", "0.0.0.0", "http://truepose.example"), "http://truepose.example/ has no TLS"),
        (WithUsers("", "10.0.0.5", "https://truepose.example"), ""),
        (WithUsers("", url="http://localhost:8765"), ""),
        (WithUsers(""), ""),
    ],
)
def test_passwords_that_cross_a_network_in_the_clear_are_warned_of(team: Team, users: WithUsers, said: str) -> None:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        _guard(8765, users, team)
    assert len(found) == bool(said)
    assert all(said in str(one.message) and "--url https://" in str(one.message) for one in found)


@pytest.mark.parametrize("end", ["logout", "disabled", "store"])
def test_the_events_of_a_job_end_with_the_session(
    opened: Callable[..., TestClient], team: Team, store: Store, end: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = opened("Jürgen")
    (visitor,) = (Visitor(one, ("measure",)) for one in team.sessions._open.values())
    request = Request({"type": "http", "app": client.app, "state": {"visitor": visitor}})
    goes_on = session_check(request)
    seen = visitor.session.seen
    monkeypatch.setattr("truepose.web.jobs._REPEAT", 0.0)
    monkeypatch.setattr("truepose.web.jobs._LOOK", 0.0)

    async def sent() -> int:
        count = 0
        async for _ in _events(Running(), Running.job, None, goes_on):  # type: ignore[arg-type]
            count += 1
            if count == 4 and end == "logout":
                assert client.post("/api/v1/logout").status_code == 204
            elif count == 4 and end == "disabled":
                set_disabled(store, log_in(store, "root", PASSWORD), "Jürgen", True)
            elif count == 4:
                monkeypatch.setattr(team.store, "reading", lost)
            assert count <= 4
        return count

    with ThreadPoolExecutor(1) as own:  # a browser of other tests may have left an event loop in this thread
        assert own.submit(anyio.run, sent).result() == 4
    assert visitor.session.seen == seen, "watching does not keep a session open"


def test_another_address_needs_users(run: Callable[..., Any], tmp_path: Path) -> None:
    assert "--store" in run("app", tmp_path, "--host", "0.0.0.0", "--no-browser").failed()


def test_two_servers_of_one_file_are_refused(run: Callable[..., Any], store: Store, tmp_path: Path) -> None:
    with store.serve_lock():
        answer = run("app", tmp_path / "work", "--store", tmp_path / "store", "--port", 0, "--no-browser").failed()
    assert "another server" in answer
