"""Log-in by OpenID Connect: who gets a session, and which answers of a provider are refused."""

# ruff: noqa: E402 - what the imports need is looked for first

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from fastapi.testclient import TestClient
from tests.needs import needed

needed("alembic", "'truepose[store]'")
needed("authlib", "'truepose[oidc]'")

from tests.web.people import PASSWORD, URL, browsers
from tests.web.provider import CLIENT, SECRET, SmallProvider

from truepose.errors import DataError, FileError, MissingPackageError
from truepose.store.access import log_in
from truepose.store.store import Store
from truepose.store.users import add_user, set_disabled, set_subject
from truepose.web import Workspace
from truepose.web.security import CSRF_HEADER
from truepose.web.team.oidc import OIDC_CALLBACK, PENDING_S, Provider, Settings
from truepose.web.team.team import Team

ANNA = "00u-anna"
ENVIRONMENT = {"TRUEPOSE_OIDC_CLIENT_ID": CLIENT, "TRUEPOSE_OIDC_CLIENT_SECRET": SECRET}


class Clock:
    """A clock that a test sets."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture(scope="module")
def provider() -> Iterator[SmallProvider]:
    with SmallProvider.started() as running:
        yield running


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def opened(
    workspace: Workspace, store: Store, provider: SmallProvider, clock: Clock, tmp_path: Path
) -> Callable[..., TestClient]:
    """Return a function that returns a browser; the user Anna logs in by the provider only."""
    root = log_in(store, "root", PASSWORD)
    add_user(store, root, "Anna", ["release"], subject=ANNA)
    team = Team(store, str(tmp_path / "store"))
    team.provider = Provider(Settings(provider.issuer, CLIENT, SECRET), URL + OIDC_CALLBACK, clock=clock)
    return browsers(workspace, team)


def begin(client: TestClient) -> str:
    answer = client.post("/api/v1/login/oidc")
    assert answer.status_code == 200, answer.text
    return str(answer.json()["url"])


def come_back(client: TestClient, url: str, code: str, **changed: str) -> Any:
    """Return the server's answer to the browser that the provider sends back, without following it."""
    state = parse_qs(urlsplit(url).query)["state"][0]
    query = {"code": code, "state": state, **changed}
    return client.get(OIDC_CALLBACK, params=query, headers={"sec-fetch-site": "cross-site"}, follow_redirects=False)


def refused(client: TestClient, answer: Any, why: str = "refused") -> bool:
    assert (answer.status_code, answer.headers["location"]) == (303, f"/?oidc={why}")
    return bool(client.get("/api/v1/session").status_code == 401)


def reason(store: Store) -> str:
    """Return why the log-in was refused last, from the audit trail."""
    import sqlalchemy as sa

    from truepose.store import schema

    query = sa.select(schema.audit.c.payload).where(schema.audit.c.action == "login.refused")
    with store.reading() as connection:
        return str(connection.execute(query.order_by(schema.audit.c.sequence.desc())).scalars().first())


def test_a_known_user_logs_in_without_a_password_but_cannot_sign(
    opened: Callable[..., TestClient], provider: SmallProvider, store: Store
) -> None:
    client = opened()
    assert client.get("/api/v1/login").json() == {"provider": "127.0.0.1"}
    url = begin(client)
    asked = parse_qs(urlsplit(url).query)
    assert asked["redirect_uri"] == [URL + OIDC_CALLBACK]
    assert asked["response_type"] == ["code"]
    cookie = next(iter(client.cookies.jar))
    assert (cookie.path, cookie.secure) == (OIDC_CALLBACK, True)
    answer = come_back(client, url, provider.grant(url, ANNA))
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    session = client.get("/api/v1/session").json()
    assert (session["user"]["name"], session["user"]["roles"]) == ("Anna", ["read", "release"])
    client.headers[CSRF_HEADER] = session["csrf"]
    signed = client.post(f"/api/v1/releases/{'0' * 64}", json={"password": PASSWORD, "reason": ""})
    assert signed.status_code == 403
    assert "ask an administrator" in signed.json()["detail"]
    assert opened("quality").get("/api/v1/session").status_code == 200  # passwords keep working
    set_subject(store, log_in(store, "root", PASSWORD), "Anna", None)
    assert client.get("/api/v1/session").status_code == 401


NOW = int(time.time())
BAD: dict[str, tuple[dict[str, Any], str]] = {
    "wrong nonce": ({"nonce": "of another log-in"}, "nonce"),
    "expired": ({"exp": NOW - 3600, "iat": NOW - 7200}, "expired"),
    "other audience": ({"aud": "another client"}, "aud"),
    "audience of several": ({"aud": [CLIENT, "another client"]}, "another client asked"),
    "other party": ({"azp": "another client"}, "another client asked"),
    "other issuer": ({"iss": "https://elsewhere.example"}, "iss"),
    "unsigned": ({"algorithm": "none"}, "not valid"),
    "signed by another": ({"foreign_key": True}, "not valid"),
    "no subject": ({"sub": None}, "sub"),
    "no end": ({"exp": None}, "exp"),
    "unknown user": ({"sub": "00u-nobody"}, "no user of the store"),
}


def test_a_token_that_is_not_right_opens_no_session(
    opened: Callable[..., TestClient], provider: SmallProvider, store: Store
) -> None:
    client = opened()
    for what, (changed, words) in BAD.items():
        url = begin(client)
        assert refused(client, come_back(client, url, provider.grant(url, ANNA, **changed))), what
        assert words in reason(store), (what, reason(store))


CLAIMS: dict[str, tuple[str, dict[str, Any], str]] = {
    "verified address": ("email", {"email": ANNA, "email_verified": True}, ""),
    "address that is not verified": ("email", {"email": ANNA, "email_verified": False}, "has not verified"),
    "address without a word of it": ("email", {"email": ANNA}, "has not verified"),
    "a word is no proof": ("email", {"email": ANNA, "email_verified": "true"}, "has not verified"),
    "another claim": ("employee", {"sub": "x", "employee": ANNA}, ""),
    "claim that is missing": ("employee", {}, "no claim 'employee'"),
    "claim that is empty": ("employee", {"employee": ""}, "no claim 'employee'"),
    "claim that is no text": ("employee", {"employee": [ANNA]}, "no claim 'employee'"),
    "the subject does not count": ("employee", {"sub": ANNA, "employee": "somebody"}, "no user of the store"),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("what", CLAIMS)
def test_the_claim_of_the_settings_names_the_user(
    opened: Callable[..., TestClient], provider: SmallProvider, store: Store, what: str
) -> None:
    claim, claims, words = CLAIMS[what]
    client = opened()
    team: Team = client.app.state.team  # type: ignore[attr-defined]
    team.provider = Provider(Settings(provider.issuer, CLIENT, SECRET, claim), URL + OIDC_CALLBACK)
    url = begin(client)
    assert parse_qs(urlsplit(url).query)["scope"] == ["openid profile email"]
    answer = come_back(client, url, provider.grant(url, ANNA, **claims))
    if words:
        assert refused(client, answer)
        assert words in reason(store)
    else:
        assert answer.headers["location"] == "/"
        assert client.get("/api/v1/session").json()["user"]["name"] == "Anna"


def test_a_log_in_is_finished_once_in_the_browser_that_began_it_and_in_time(
    opened: Callable[..., TestClient], provider: SmallProvider, clock: Clock
) -> None:
    client, other = opened(), opened()
    url = begin(client)
    begin(other)
    code = provider.grant(url, ANNA)
    assert refused(other, come_back(other, url, code))
    assert refused(other, come_back(client, url, code, state="guessed"))
    assert refused(other, come_back(client, url, "guessed"))
    assert refused(client, come_back(client, url, code))  # the state was used with the guessed code
    url = begin(client)
    assert refused(client, come_back(client, url, "", error="access_denied"))
    url = begin(client)
    clock.now += PENDING_S
    assert refused(client, come_back(client, url, provider.grant(url, ANNA)))
    url = begin(client)
    code = provider.grant(url, ANNA)
    provider.grants[code].challenge = "of another verifier"
    assert refused(client, come_back(client, url, code))


def test_a_disabled_user_gets_no_session(
    opened: Callable[..., TestClient], provider: SmallProvider, store: Store
) -> None:
    client = opened()
    set_disabled(store, log_in(store, "root", PASSWORD), "Anna", True)
    url = begin(client)
    assert refused(client, come_back(client, url, provider.grant(url, ANNA)))


def test_new_keys_of_the_provider_are_read(opened: Callable[..., TestClient], provider: SmallProvider) -> None:
    from joserfc.jwk import RSAKey

    client, old = opened(), provider.key
    url = begin(client)
    come_back(client, url, provider.grant(url, ANNA))
    provider.key = RSAKey.generate_key(2048, {"kid": "second"})
    try:
        url = begin(client)
        code = provider.grant(url, ANNA)
        provider.grants[code].kid = "second"
        assert come_back(client, url, code).headers["location"] == "/"
    finally:
        provider.key = old


def test_without_the_provider_passwords_work_and_the_page_says_why(
    workspace: Workspace, store: Store, tmp_path: Path
) -> None:
    with SmallProvider.started() as running:
        down = running.issuer
    team = Team(store, str(tmp_path / "store"))
    team.provider = Provider(Settings(down, CLIENT, SECRET), URL + OIDC_CALLBACK)
    opened = browsers(workspace, team)
    answer = opened().post("/api/v1/login/oidc")
    assert (answer.status_code, answer.json()["title"]) == (502, "Provider not reached")
    assert opened("quality").get("/api/v1/session").status_code == 200


def test_a_provider_with_another_name_is_refused(opened: Callable[..., TestClient], provider: SmallProvider) -> None:
    provider.document["issuer"] = "https://elsewhere.example"
    try:
        assert opened().post("/api/v1/login/oidc").status_code == 502
    finally:
        provider.document["issuer"] = provider.issuer


def test_settings_come_from_the_environment_or_a_file(tmp_path: Path) -> None:
    issuer = {"TRUEPOSE_OIDC_ISSUER": "https://login.example"}
    assert Settings.of({}) is None
    found = Settings.of({**issuer, **ENVIRONMENT})
    assert found == Settings("https://login.example", CLIENT, SECRET, "sub")
    by_mail = Settings.of({**issuer, **ENVIRONMENT, "TRUEPOSE_OIDC_CLAIM": "email"})
    assert by_mail == Settings("https://login.example", CLIENT, SECRET, "email")
    secret = tmp_path / "secret"
    secret.write_text(f"{SECRET}\n", "utf-8")
    by_file = {**issuer, "TRUEPOSE_OIDC_CLIENT_ID": CLIENT, "TRUEPOSE_OIDC_CLIENT_SECRET_FILE": str(secret)}
    assert Settings.of(by_file) == found
    secret.write_text("", "utf-8")
    with pytest.raises(FileError, match="empty"):
        Settings.of(by_file)
    with pytest.raises(DataError, match="CLIENT_ID is missing"):
        Settings.of(issuer)
    with pytest.raises(DataError, match="CLIENT_SECRET_FILE"):
        Settings.of({**issuer, "TRUEPOSE_OIDC_CLIENT_ID": CLIENT})
    for wrong in ("http://login.example", "login.example", "https://"):
        with pytest.raises(DataError, match="https address"):
            Settings.of({**ENVIRONMENT, "TRUEPOSE_OIDC_ISSUER": wrong})


def test_a_missing_package_is_named_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [one for one in sys.modules if one.partition(".")[0] == "authlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "authlib", None)
    with pytest.raises(MissingPackageError, match=r"truepose\[oidc\]"):
        Provider(Settings("https://login.example", CLIENT, SECRET), URL)
