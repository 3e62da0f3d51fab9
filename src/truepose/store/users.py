"""Users, their roles and their tokens: each change is made by an administrator and has its entry in the audit trail.

A user is found by the compared form of the name (`truepose.store.passwords.user_key`), so names that differ in case or
Unicode form are one user. Users are disabled, never deleted: their signatures stay.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from truepose.errors import DataError, RefusedError
from truepose.store import schema
from truepose.store.access import Identity, any_user, changing, check, open_identity, viewing
from truepose.store.passwords import check_password, hashed, user_key
from truepose.store.roles import ROLES, Role, checked_roles

if TYPE_CHECKING:
    from truepose.store.store import Store


@dataclass(frozen=True)
class User:
    """A user of a store.

    Attributes
    ----------
    id : int
        The identity in the store.
    name : str
        The name as it was given.
    roles : tuple of str
        The roles.
    disabled : bool
        Whether the user may not log in, and has no rights in a session that is open.
    subject : str or None
        The subject of the OpenID Connect provider by which the user may log in.
    """

    id: int
    name: str
    roles: tuple[Role, ...]
    disabled: bool
    subject: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the user as plain values, without a password."""
        return {"name": self.name, "roles": list(self.roles), "disabled": self.disabled, "subject": self.subject}


def has_users(store: Store) -> bool:
    """Return whether the store has a user; the first one is added without a log-in."""
    with store.reading() as connection:
        return any_user(connection)


def list_users(store: Store, by: Identity) -> list[User]:
    """Return all users by name."""
    with viewing(store, by) as connection:
        roles: dict[int, set[str]] = {}
        for user_id, role in connection.execute(sa.select(schema.role.c.user_id, schema.role.c.role)):
            roles.setdefault(user_id, set()).add(role)
        rows = connection.execute(sa.select(schema.user).order_by(schema.user.c.key)).mappings()
        return [_user(row, roles.get(row["id"], set())) for row in rows]


def add_user(
    store: Store,
    by: Identity | None,
    name: str,
    roles: Iterable[str],
    *,
    password: str | None = None,
    subject: str | None = None,
) -> User:
    """Add a user.

    Parameters
    ----------
    store : Store
        The store.
    by : Identity or None
        The administrator; None for the first user of a store, who must be one.
    name : str
        The name, which must differ from all others in more than case and Unicode form.
    roles : iterable of str
        The roles.
    password : str, optional
        The password; without one the user logs in by OpenID Connect only, and cannot sign.
    subject : str, optional
        The subject of the OpenID Connect provider.

    Raises
    ------
    DataError
        If the name, a role or the password is refused, or another user has the name or the subject.
    RefusedError
        If `by` is no administrator, unless the store has no users.
    """
    key, held, shown = user_key(name), checked_roles(roles), name.strip()
    if password is not None:
        check_password(password, name)
    secret = None if password is None else hashed(password)
    by = by or open_identity(shown)
    with store.transaction(by.name) as change:
        if any_user(change.connection):
            check(change.connection, by, "manage")
        elif "admin" not in held:
            raise DataError("the first user of a store must have the role admin, to add the others")
        _check_free(change.connection, shown, key, subject)
        values = {"name": shown, "key": key, "password": secret, "subject": subject, "disabled": False}
        user_id = change.insert(schema.user, {**values, "failures": 0})
        change.insert_many(schema.role, [{"user_id": user_id, "role": role} for role in held])
    return User(user_id, shown, held, False, subject)


def set_disabled(store: Store, by: Identity, name: str, disabled: bool) -> None:
    """Disable or enable a user; sessions and tokens of a disabled user have no rights from the next action on."""
    with changing(store, by, "manage") as change:
        row = find_user(change.connection, name)
        if row["disabled"] == disabled:
            return
        action = "user.disable" if disabled else "user.enable"
        change.update(schema.user, row["id"], {"disabled": disabled}, action)
        _check_administrator(change.connection)


def set_roles(store: Store, by: Identity, name: str, roles: Iterable[str]) -> tuple[Role, ...]:
    """Give a user these roles and no others; return them."""
    wanted, table = checked_roles(roles), schema.role
    with changing(store, by, "manage") as change:
        user_id = find_user(change.connection, name)["id"]
        held = {
            role: id_
            for id_, role in change.connection.execute(
                sa.select(table.c.id, table.c.role).where(table.c.user_id == user_id)
            )
        }
        for role in sorted(set(held) - set(wanted)):
            change.delete(table, held[role])
        if new := [role for role in wanted if role not in held]:
            change.insert_many(table, [{"user_id": user_id, "role": role} for role in new])
        _check_administrator(change.connection)
    return wanted


def set_password(store: Store, by: Identity, name: str, password: str) -> None:
    """Set the password of a user: one's own, or as an administrator that of another."""
    check_password(password, name)
    secret = hashed(password)
    own = user_key(name) == user_key(by.name)
    with changing(store, by, "view" if own and by.token_id is None else "manage") as change:
        row = find_user(change.connection, name)
        change.update(schema.user, row["id"], {"password": secret}, "user.password")


def set_subject(store: Store, by: Identity, name: str, subject: str | None) -> None:
    """Set the OpenID Connect subject by which a user may log in; None takes it away."""
    with changing(store, by, "manage") as change:
        row = find_user(change.connection, name)
        if row["subject"] != subject:
            _check_free(change.connection, None, None, subject)
            change.update(schema.user, row["id"], {"subject": subject}, "user.subject")


def find_user(connection: sa.Connection, name: str) -> dict[str, Any]:
    """Return the row of a user by a name in any case and Unicode form.

    Raises
    ------
    DataError
        If there is no such user.
    """
    row = connection.execute(sa.select(schema.user).where(schema.user.c.key == user_key(name))).mappings().first()
    if row is None:
        raise DataError(f"the store has no user {name!r}; 'truepose store user list' lists them")
    return dict(row)


def _user(row: Any, roles: set[str]) -> User:
    held = tuple(role for role in ROLES if role in roles)
    return User(row["id"], row["name"], held, row["disabled"], row["subject"])


def _check_free(connection: sa.Connection, name: str | None, key: str | None, subject: str | None) -> None:
    """Refuse a name or a subject that another user has."""
    user = schema.user
    taken = connection.execute(sa.select(user.c.name).where(user.c.key == key)).scalar() if key else None
    if taken is not None:
        different = "" if taken == name else "; names that differ only in case or Unicode form are one user"
        raise DataError(f"the user {name!r} exists already as {taken!r}{different}")
    if subject and (other := connection.execute(sa.select(user.c.name).where(user.c.subject == subject)).scalar()):
        raise DataError(f"the user {other!r} has this OpenID Connect subject already")


def _check_administrator(connection: sa.Connection) -> None:
    """Refuse a change after which nobody could manage the store."""
    user, role = schema.user, schema.role
    left = (
        sa.select(user.c.id)
        .join(role, role.c.user_id == user.c.id)
        .where(role.c.role == "admin", user.c.disabled.is_(False))
    )
    if connection.execute(left.limit(1)).first() is None:
        raise RefusedError("this is the last administrator of the store; make another user one first")
