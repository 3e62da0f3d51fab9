"""Users, log-ins, roles in an open session, and tokens, on both engines."""

from __future__ import annotations

import json
import unicodedata
from datetime import UTC, datetime, timedelta

import pytest
import sqlalchemy as sa
from tests.store.people import PASSWORD

from truepose.errors import DataError, RefusedError
from truepose.store import access, schema, tokens, users
from truepose.store.access import Identity, by_subject, by_token, changing, log_in, viewing
from truepose.store.store import Store

pytestmark = pytest.mark.usefixtures("quick_hashes")


@pytest.fixture
def chief(store: Store) -> Identity:
    users.add_user(store, access.open_identity("test"), "chief", ["admin"], password=PASSWORD)
    return log_in(store, "chief", PASSWORD)


@pytest.fixture
def anna(store: Store, chief: Identity) -> Identity:
    users.add_user(store, chief, "Anna", ["measure", "program"], password=PASSWORD)
    return log_in(store, "anna", PASSWORD)


def actions(store: Store) -> list[tuple[str, str, str]]:
    with store.reading() as connection:
        audit = schema.audit
        query = sa.select(audit.c.action, audit.c.user, audit.c.payload).order_by(audit.c.sequence)
        return [tuple(row) for row in connection.execute(query)]


def test_the_first_user_must_be_an_administrator_and_is_added_without_a_log_in(store):
    somebody = access.open_identity("account")
    with changing(store, somebody, "fit"):
        pass
    with pytest.raises(RefusedError, match="needs the role release"), changing(store, somebody, "release"):
        pytest.fail("nobody can release without users")
    with pytest.raises(DataError, match="first user of a store must have the role admin"):
        users.add_user(store, somebody, "eva", ["release"], password=PASSWORD)
    users.add_user(store, somebody, "chief", ["admin"], password=PASSWORD)
    with pytest.raises(RefusedError, match="the store has users; log in as one of them"):
        users.add_user(store, somebody, "eva", ["admin"], password=PASSWORD)
    with pytest.raises(RefusedError, match="the store has users; log in"), changing(store, somebody, "fit"):
        pytest.fail("the store is no longer open")


def test_only_administrators_manage_users(store, anna, chief):
    for attempt in (
        lambda: users.add_user(store, anna, "eva", ["read"], password=PASSWORD),
        lambda: users.set_roles(store, anna, "anna", ["admin"]),
        lambda: users.set_disabled(store, anna, "chief", True),
        lambda: users.set_password(store, anna, "chief", "another pass phrase"),
    ):
        with pytest.raises(RefusedError, match="needs the role admin"):
            attempt()
    assert [(user.name, user.roles) for user in users.list_users(store, anna)] == [
        ("Anna", ("measure", "program")),
        ("chief", ("admin",)),
    ]


@pytest.mark.parametrize("name", ["ANNA", "anna", "Ａｎｎａ", " Anna "])
def test_names_that_differ_in_case_or_unicode_form_are_one_user(store, anna, chief, name):
    with pytest.raises(DataError, match=r"the user '.*' exists already as 'Anna'"):
        users.add_user(store, chief, name, ["read"], password=PASSWORD)
    assert log_in(store, name, PASSWORD) == anna


def test_composed_and_decomposed_names_are_one_user(store, chief):
    users.add_user(store, chief, "Jürgen", ["read"], password=PASSWORD)
    other = unicodedata.normalize("NFD", "JÜRGEN")
    with pytest.raises(DataError, match="differ only in case or Unicode form are one user"):
        users.add_user(store, chief, other, ["read"], password=PASSWORD)
    assert log_in(store, other, PASSWORD).name == "Jürgen"


def test_a_wrong_password_an_unknown_and_a_disabled_user_look_alike(store, anna, chief):
    users.add_user(store, chief, "ben", ["read"], password=PASSWORD)
    users.set_disabled(store, chief, "ben", True)
    told = set()
    for name, password in (("anna", "not her password"), ("nobody", PASSWORD), ("ben", PASSWORD)):
        with pytest.raises(RefusedError) as refused:
            log_in(store, name, password)
        told.add(str(refused.value))
    assert told == {"the user name or the password is wrong, or the user is disabled"}
    assert [a for a, *_ in actions(store)].count("login.refused") == 3


def test_failed_log_ins_are_slowed_and_a_success_forgets_them(store, anna, monkeypatch):
    for _ in range(access.FREE_FAILURES):
        with pytest.raises(RefusedError, match="is wrong"):
            log_in(store, "anna", "not her password")
    with pytest.raises(RefusedError, match=r"3 log-ins of this user failed in a row; wait \d s"):
        log_in(store, "ANNA", PASSWORD)
    _last_failure(store, timedelta(minutes=1))
    assert log_in(store, "anna", PASSWORD) == anna
    for _ in range(access.FREE_FAILURES - 1):  # counted from the beginning again
        with pytest.raises(RefusedError, match="is wrong"):
            log_in(store, "anna", "not her password")
    assert log_in(store, "anna", PASSWORD) == anna


def test_an_attempt_during_the_wait_is_not_even_looked_at(store, anna):
    for _ in range(access.FREE_FAILURES):
        with pytest.raises(RefusedError, match="is wrong"):
            log_in(store, "anna", "not her password")
    before = actions(store)
    with pytest.raises(RefusedError, match="wait"):
        log_in(store, "anna", PASSWORD)
    assert actions(store) == before


def _last_failure(store: Store, ago: timedelta) -> None:
    when = (datetime.now(UTC) - ago).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    with store.transaction("test") as change:
        change.connection.execute(sa.update(schema.user).values(last_failure=when))


def test_a_user_disabled_in_a_session_has_no_rights_at_the_next_check(store, anna, chief):
    with changing(store, anna, "measure"):
        pass
    users.set_disabled(store, chief, "ANNA", True)
    for action in ("view", "measure"):
        with pytest.raises(RefusedError, match="the user Anna is disabled"), changing(store, anna, action):
            pytest.fail("a disabled user came in")
    with pytest.raises(RefusedError, match="disabled"), viewing(store, anna):
        pytest.fail("a disabled user came in")
    users.set_disabled(store, chief, "anna", False)
    with viewing(store, anna):
        pass


def test_a_role_taken_in_a_session_is_gone_at_the_next_check(store, anna, chief):
    assert users.set_roles(store, chief, "anna", ["program"]) == ("program",)
    with (
        pytest.raises(RefusedError, match=r"Anna may not do this .*needs the role measure.*the user has read, program"),
        changing(store, anna, "measure"),
    ):
        pytest.fail("a right that was taken away")
    with changing(store, anna, "correct"):
        pass


def test_a_change_whose_right_is_refused_leaves_no_entry(store, anna):
    before = store.head()
    with pytest.raises(RefusedError), changing(store, anna, "release"):
        pytest.fail("not a releaser")
    assert store.head() == before


def test_the_last_administrator_stays(store, chief, anna):
    for attempt in (
        lambda: users.set_disabled(store, chief, "chief", True),
        lambda: users.set_roles(store, chief, "chief", ["read"]),
    ):
        with pytest.raises(RefusedError, match="last administrator"):
            attempt()
    users.set_roles(store, chief, "anna", ["admin"])
    users.set_roles(store, chief, "chief", ["read"])
    with pytest.raises(RefusedError, match="needs the role admin"):
        users.set_disabled(store, chief, "anna", True)


def test_passwords_change_and_are_in_no_entry(store, chief, anna):
    users.set_password(store, anna, "anna", "another pass phrase")
    with pytest.raises(RefusedError):
        log_in(store, "anna", PASSWORD)
    users.set_password(store, chief, "anna", "a third pass phrase")
    assert log_in(store, "anna", "a third pass phrase") == anna
    with pytest.raises(DataError, match="12 to 1024 characters"):
        users.set_password(store, anna, "anna", "short")
    text = json.dumps(actions(store))
    assert "user.password" in text
    assert "argon2" not in text
    assert "pass phrase" not in text


def test_a_user_without_a_password_cannot_log_in_by_one(store, chief):
    users.add_user(store, chief, "olga", ["read"], subject="https://id.example olga")
    with pytest.raises(RefusedError, match="wrong"):
        log_in(store, "olga", "")
    assert by_subject(store, "https://id.example olga").name == "olga"
    with pytest.raises(DataError, match="'olga' has this OpenID Connect subject already"):
        users.add_user(store, chief, "other", ["read"], subject="https://id.example olga")
    users.set_subject(store, chief, "olga", None)
    with pytest.raises(RefusedError, match="no user of the store has this log-in"):
        by_subject(store, "https://id.example olga")
    users.set_subject(store, chief, "olga", "https://id.example o2")
    users.set_disabled(store, chief, "olga", True)
    with pytest.raises(RefusedError, match="disabled"):
        by_subject(store, "https://id.example o2")


def test_weak_hashes_are_replaced_at_the_next_log_in(store, anna, monkeypatch):
    from argon2 import PasswordHasher

    from truepose.store import passwords

    stronger = PasswordHasher(time_cost=2, memory_cost=16, parallelism=1)
    monkeypatch.setattr(passwords, "_hasher", lambda: stronger)
    log_in(store, "anna", PASSWORD)
    with store.reading() as connection:
        kept = connection.execute(sa.select(schema.user.c.password).where(schema.user.c.key == "anna")).scalar_one()
    assert "m=16,t=2" in kept
    assert log_in(store, "anna", PASSWORD) == anna


def test_a_token_has_its_scope_and_no_more(store, anna, chief):
    text, kept = tokens.create_token(store, anna, "press line", ["measure"], days=30)
    found = by_token(store, text)
    assert found.name == "Anna"
    with changing(store, found, "measure"):
        pass
    refusal = r"Anna may not do this \(correct programs\).* but the token has"
    with pytest.raises(RefusedError, match=refusal), changing(store, found, "correct"):
        pytest.fail("outside of the scope")
    with pytest.raises(RefusedError, match="Anna does not have the role release"):
        tokens.create_token(store, anna, "x", ["release"])
    with pytest.raises(RefusedError, match="a token cannot create tokens"):
        tokens.create_token(store, found, "x", ["measure"])
    users.set_roles(store, chief, "anna", ["program"])
    with pytest.raises(RefusedError, match="needs the role"), changing(store, found, "measure"):
        pytest.fail("the user has lost the role")
    assert kept.scope == ("measure",)


def test_an_expired_or_revoked_token_is_refused_also_in_a_session(store, anna):
    text, kept = tokens.create_token(store, anna, "night shift", ["program"], days=1)
    found = by_token(store, text)
    past = "2020-01-01T00:00:00.000000Z"
    with store.transaction("test") as change:
        change.update(schema.token, found.token_id, {"expires": past})
    for attempt in (lambda: by_token(store, text), lambda: viewing(store, found).__enter__()):
        with pytest.raises(RefusedError, match="the token 'night shift' of Anna expired on 2020-01-01"):
            attempt()
    text, kept = tokens.create_token(store, anna, "day shift", ["program"])
    found = by_token(store, text)
    tokens.revoke_token(store, anna, kept.identity)
    for attempt in (lambda: by_token(store, text), lambda: viewing(store, found).__enter__()):
        with pytest.raises(RefusedError, match="not known or was revoked"):
            attempt()


def test_tokens_are_kept_as_hashes_and_found_by_nothing_else(store, anna):
    text, kept = tokens.create_token(store, anna, "x", ["program"])
    with store.reading() as connection:
        row = connection.execute(sa.select(schema.token)).mappings().one()
    assert text.rsplit("_", 1)[1] not in json.dumps([dict(row), actions(store)])
    for wrong in ("", "tp_", text[:-1], text.replace(kept.identity, "00000000"), kept.identity, row["hash"]):
        with pytest.raises(RefusedError, match="not known"):
            by_token(store, wrong)


def test_tokens_are_listed_and_revoked_by_their_users_and_administrators(store, anna, chief):
    users.add_user(store, chief, "ben", ["program"], password=PASSWORD)
    ben = log_in(store, "ben", PASSWORD)
    _, of_anna = tokens.create_token(store, anna, "a", ["program"])
    _, of_ben = tokens.create_token(store, ben, "b", ["read"])
    assert [one.identity for one in tokens.list_tokens(store, ben)] == [of_ben.identity]
    assert [one.user for one in tokens.list_tokens(store, chief)] == ["Anna", "ben"]
    with pytest.raises(RefusedError, match="another user"):
        tokens.revoke_token(store, ben, of_anna.identity)
    tokens.revoke_token(store, chief, of_ben.identity)
    assert [one.revoked for one in tokens.list_tokens(store, chief)] == [False, True]
    with pytest.raises(DataError, match="no token"):
        tokens.revoke_token(store, chief, "none")


@pytest.mark.parametrize("days", [0, -1, 731])
def test_tokens_have_an_end(store, anna, days):
    with pytest.raises(DataError, match="1 to 730 days"):
        tokens.create_token(store, anna, "x", ["program"], days=days)
