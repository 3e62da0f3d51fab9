"""The guard: token, session, origin, host and the size of bodies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

import truepose
from truepose.web import Workspace, create_app
from truepose.web.security import CSRF_HEADER, HEADERS, Guard

BASE = "http://127.0.0.1:8765"


@pytest.fixture
def guard() -> Guard:
    return Guard(port=8765)


@pytest.fixture
def client(tmp_path: Path, guard: Guard) -> TestClient:
    return TestClient(create_app(Workspace(tmp_path / "work"), guard), base_url=BASE, follow_redirects=False)


@pytest.fixture
def inside(client: TestClient, guard: Guard) -> TestClient:
    """Return a client that opened the start URL."""
    assert client.get(f"/?token={guard.token}").status_code == 303
    return client


def test_the_start_url_gives_a_session_that_other_sites_cannot_send(client: TestClient, guard: Guard) -> None:
    answer = client.get(guard.start_url.removeprefix(BASE))
    assert answer.status_code == 303
    assert answer.headers["location"] == "/"
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert guard.token not in answer.headers["set-cookie"]
    assert client.get("/api/v1/session").json()["csrf"] == guard.csrf


def test_without_a_session_nothing_is_told(client: TestClient) -> None:
    answer = client.get("/api/v1/session")
    assert answer.status_code == 401
    assert answer.headers["content-type"] == "application/problem+json"
    assert "truepose app" in answer.json()["detail"]


def test_everybody_may_ask_for_the_version(client: TestClient) -> None:
    assert client.get("/version").json()["version"] == truepose.__version__


def test_wrong_tries_are_refused_and_then_stopped(client: TestClient, guard: Guard) -> None:
    statuses = [client.get("/?token=wrong").status_code for _ in range(12)]
    assert statuses == [403] * 10 + [429] * 2
    client.cookies.set(guard.cookie, "wrong")
    assert client.get("/api/v1/session").status_code == 429


def test_wrong_cookies_count_and_the_lock_ends_after_its_time(tmp_path: Path) -> None:
    now = [1000.0]
    guard = Guard(port=8765, clock=lambda: now[0])
    client = TestClient(create_app(Workspace(tmp_path / "work"), guard), base_url=BASE, follow_redirects=False)

    def tried(cookie: str) -> Any:
        client.cookies.set(guard.cookie, cookie)
        return client.get("/api/v1/session")

    for second in range(10):
        now[0] = 1000.0 + second
        assert tried(f"wrong{second}").status_code == 403
    locked = tried("wrong")
    assert (locked.status_code, locked.headers["Retry-After"]) == (429, "51")
    assert "51 s" in locked.json()["detail"]
    assert client.get("/?token=wrong").status_code == 429
    assert tried(guard.session).status_code == 200
    now[0] = 1059.5
    assert tried("wrong").headers["Retry-After"] == "1"
    now[0] = 1060.0
    assert [tried("wrong").status_code for _ in range(2)] == [403, 429]
    now[0] = 1200.0
    assert tried("wrong").status_code == 403


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1:1", "localhost", "127.0.0.1:8765.evil.example", ""])
def test_a_foreign_host_gets_no_answer(inside: TestClient, host: str) -> None:
    answer = inside.get("/api/v1/session", headers={"Host": host})
    assert answer.status_code == 400
    assert "csrf" not in answer.text


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:8765", "http://127.0.0.1:9999"])
def test_a_foreign_origin_changes_nothing(inside: TestClient, guard: Guard, origin: str) -> None:
    headers = {"Origin": origin, CSRF_HEADER: guard.csrf}
    assert inside.post("/api/v1/session", headers=headers).status_code == 403
    assert inside.post("/api/v1/session", headers={**headers, "Origin": BASE}).status_code == 405


def test_a_change_needs_the_header_of_the_pages(inside: TestClient, guard: Guard) -> None:
    assert inside.post("/api/v1/session").status_code == 403
    assert inside.post("/api/v1/session", headers={CSRF_HEADER: guard.token}).status_code == 403
    assert inside.post("/api/v1/session", headers={CSRF_HEADER: guard.csrf}).status_code == 405


@pytest.mark.parametrize("path", ["/", "/api/v1/session", "/healthz", "/assets/none.js", "/api/v1/none"])
def test_every_answer_forbids_what_is_foreign(client: TestClient, path: str) -> None:
    answer = client.get(path)
    assert {name: answer.headers[name] for name in HEADERS} == HEADERS


@pytest.mark.parametrize("stated", [True, False])
def test_a_body_beyond_the_limit_is_refused_by_its_stated_and_by_its_true_size(
    guard: Guard, tmp_path: Path, stated: bool
) -> None:
    app = create_app(Workspace(tmp_path), guard)
    read: list[int] = []

    @app.post("/api/v1/echo")
    def echo(body: dict[str, str]) -> int:
        read.append(len(body))
        return len(body)

    client = TestClient(app, base_url=BASE)
    client.get(f"/?token={guard.token}", follow_redirects=False)
    content = b'{"a": "' + b"x" * (5 << 20) + b'"}'
    answer = client.post(
        "/api/v1/echo",
        headers={CSRF_HEADER: guard.csrf, "Content-Type": "application/json"},
        content=content if stated else (content[i : i + 65536] for i in range(0, len(content), 65536)),
    )
    assert answer.status_code == 413
    assert "MB" in answer.json()["detail"]
    assert read == []


def test_a_wrong_length_is_refused(inside: TestClient, guard: Guard) -> None:
    headers = {CSRF_HEADER: guard.csrf, "Content-Length": "-5"}
    assert inside.post("/api/v1/session", headers=headers).status_code == 400
