"""Who somebody is, and what he may do now: log-ins by password, token or OpenID Connect, and the check of each action.

An `Identity` keeps no rights. Each check reads user, roles and token again, in the transaction of the change, so a user
who is disabled, loses a role or whose token is revoked has lost the right at the next action of an open session.
"""

from __future__ import annotations

import hmac
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Final, cast

import sqlalchemy as sa

from truepose.errors import RefusedError
from truepose.store import schema
from truepose.store.audit import now
from truepose.store.passwords import hashed, is_outdated, matches, token_hash, token_identity, user_key
from truepose.store.roles import ROLES, Action, Role, check_permitted

if TYPE_CHECKING:
    from truepose.store.change import Change
    from truepose.store.store import Store

FREE_FAILURES: Final = 3
"""The number of failed log-ins in a row without a delay."""
LONGEST_DELAY: Final = timedelta(minutes=5)
"""The longest wait after a failed log-in; the first is one second, and each further one is twice as long."""
_WRONG: Final = "the user name or the password is wrong, or the user is disabled"
_NO_TOKEN: Final = "the token is not known or was revoked; create a new one with 'truepose store token create'"


OPEN_ROLES: Final[tuple[Role, ...]] = ("read", "measure", "program")
"""The roles of everybody in a store without users, where nobody can release."""
_NOBODY: Final = 0


@dataclass(frozen=True)
class Identity:
    """Somebody who has logged in, or uses a store without users; see `open_identity`.

    Attributes
    ----------
    user_id : int
        The user; 0 in a store without users.
    name : str
        The name of the user.
    token_id : int or None
        The token that was shown; its scope limits the roles.
    """

    user_id: int
    name: str
    token_id: int | None = None


def open_identity(account: str) -> Identity:
    """Return the identity of an account of the machine, which has rights as long as the store has no users."""
    return Identity(_NOBODY, account)


def any_user(connection: sa.Connection) -> bool:
    """Return whether the store has a user; the first one is added without a log-in."""
    return connection.execute(sa.select(schema.user.c.id).limit(1)).first() is not None


def delay_after(failures: int) -> timedelta:
    """Return the wait after a number of failed log-ins in a row.

    Examples
    --------
    >>> [delay_after(n).seconds for n in (0, 2, 3, 4, 6, 50)]
    [0, 0, 1, 2, 8, 300]
    """
    if failures < FREE_FAILURES:
        return timedelta(0)
    return min(timedelta(seconds=2.0 ** min(failures - FREE_FAILURES, 30)), LONGEST_DELAY)


def log_in(store: Store, name: str, password: str) -> Identity:
    """Return the identity of a user who knows the password.

    The attempt is counted before the password is looked at, so parallel attempts are slowed like others.

    Raises
    ------
    RefusedError
        If name and password do not belong together, the user is disabled or has no password, or the wait after failed
        log-ins is not over.
    """
    key = user_key(name)
    with store.transaction(key) as change:
        row = change.connection.execute(sa.select(schema.user).where(schema.user.c.key == key)).mappings().first()
        if row is not None:
            _check_delay(row)
            _set(change, row["id"], failures=row["failures"] + 1, last_failure=now())
    if not matches(password, None if row is None else row["password"]) or row is None or row["disabled"]:
        with store.transaction(key) as change:
            change.note("login.refused", {"user": key})
        raise RefusedError(_WRONG)
    with store.transaction(row["name"]) as change:
        _set(change, row["id"], failures=0)
        if is_outdated(row["password"]):
            change.update(schema.user, row["id"], {"password": hashed(password)}, "user.rehash")
        change.note("login", {"user": key})
    return Identity(row["id"], row["name"])


def confirm(store: Store, identity: Identity, password: str) -> None:
    """Refuse unless the password is that of somebody who has logged in; for signatures, which ask for it again."""
    log_in(store, identity.name, password)


def by_token(store: Store, text: str) -> Identity:
    """Return the identity that a token stands for.

    Raises
    ------
    RefusedError
        If the token is not known, was revoked or has expired, or its user is disabled.
    """
    token, kept = schema.token, token_hash(text)
    with store.reading() as connection:
        row = _first(connection, sa.select(token).where(token.c.identity == (token_identity(text) or "")))
        if row is None or not hmac.compare_digest(row["hash"], kept):
            raise RefusedError(_NO_TOKEN)
        user = _row(connection, schema.user, row["user_id"])
        found = Identity(user["id"], user["name"], row["id"])
        roles_of(connection, found)
    return found


def by_subject(store: Store, subject: str) -> Identity:
    """Return the identity of the user whose OpenID Connect subject was proven by the provider.

    Raises
    ------
    RefusedError
        If no user has this subject, or the user is disabled.
    """
    with store.transaction("truepose") as change:
        row = _first(change.connection, sa.select(schema.user).where(schema.user.c.subject == subject))
        if row is None or row["disabled"]:
            change.note("login.refused", {"subject": subject})
        else:
            change.note("login", {"user": row["key"], "subject": subject})
    if row is None or row["disabled"]:
        raise RefusedError("no user of the store has this log-in, or the user is disabled; ask an administrator")
    return Identity(row["id"], row["name"])


def roles_of(connection: sa.Connection, identity: Identity) -> tuple[Role, ...]:
    """Return the roles that are in force now, those of a token within its scope.

    Raises
    ------
    RefusedError
        If the user is disabled, or the token was revoked or has expired.
    """
    if identity.user_id == _NOBODY:
        if any_user(connection):
            raise RefusedError("the store has users; log in as one of them")
        return OPEN_ROLES
    user = _row(connection, schema.user, identity.user_id)
    if user is None or user["disabled"]:
        raise RefusedError(f"the user {identity.name} is disabled; ask an administrator")
    held: set[str] = set(
        connection.execute(sa.select(schema.role.c.role).where(schema.role.c.user_id == user["id"])).scalars()
    )
    held |= {"read"} if held else set()  # every role permits it, so every token may be limited to it
    if identity.token_id is not None:
        token = _row(connection, schema.token, identity.token_id)
        if token is None or token["revoked"]:
            raise RefusedError(_NO_TOKEN)
        if token["expires"] is not None and token["expires"] <= now():
            what = f"the token {token['name']!r} of {identity.name} expired on {token['expires'][:10]}"
            raise RefusedError(f"{what}; create a new one with 'truepose store token create'")
        held &= set(token["scope"].split())
    return tuple(role for role in ROLES if role in held)


def check(connection: sa.Connection, identity: Identity, action: Action) -> None:
    """Refuse an action that somebody may not do now.

    Raises
    ------
    RefusedError
        If no role in force permits it; see also `roles_of`.
    """
    limit = "" if identity.token_id is None else "the token"
    check_permitted(identity.name, roles_of(connection, identity), action, limit=limit)


@contextmanager
def changing(store: Store, identity: Identity, action: Action) -> Iterator[Change]:
    """Open a transaction in the name of somebody, after a check of the right in this transaction."""
    with store.transaction(identity.name) as change:
        check(change.connection, identity, action)
        yield change


@contextmanager
def viewing(store: Store, identity: Identity) -> Iterator[sa.Connection]:
    """Read the store in the name of somebody, after a check of the right to."""
    with store.reading() as connection:
        check(connection, identity, "view")
        yield connection


def _check_delay(row: Any) -> None:
    """Refuse a log-in before the wait after failed ones is over."""
    if row["last_failure"] is None:
        return
    passed = datetime.now(UTC) - datetime.fromisoformat(row["last_failure"])
    left = (delay_after(row["failures"]) - passed).total_seconds()
    if left > 0:
        raise RefusedError(f"{row['failures']} log-ins of this user failed in a row; wait {left:.0f} s and try again")


def _set(change: Change, user_id: int, **values: Any) -> None:
    """Set columns of a user that are not audited."""
    change.connection.execute(sa.update(schema.user).where(schema.user.c.id == user_id).values(**values))


def _row(connection: sa.Connection, table: sa.Table, row_id: int) -> dict[str, Any]:
    return cast("dict[str, Any]", _first(connection, sa.select(table).where(table.c.id == row_id)))


def _first(connection: sa.Connection, query: sa.Select[Any]) -> dict[str, Any] | None:
    row = connection.execute(query).mappings().first()
    return None if row is None else dict(row)
