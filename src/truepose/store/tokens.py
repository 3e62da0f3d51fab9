"""Tokens: for scripts and other programs, which log in without a password. A token is shown once and kept as a hash."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Final

import sqlalchemy as sa

from truepose.errors import DataError, RefusedError
from truepose.store import schema
from truepose.store.access import Identity, changing, roles_of, viewing
from truepose.store.passwords import new_token, token_hash, token_identity
from truepose.store.roles import Role, checked_roles, permitted

if TYPE_CHECKING:
    from truepose.store.store import Store

DAYS: Final = 90
"""The usual life of a token in days."""
MOST_DAYS: Final = 730
"""The longest life of a token in days."""


@dataclass(frozen=True)
class Token:
    """A token without its secret.

    Attributes
    ----------
    identity : str
        The part of the token by which it is found.
    user : str
        The name of its user.
    name : str
        What it is for.
    scope : tuple of str
        The roles that it may use; those that its user has not, it has not either.
    expires : str
        The end of its life, UTC.
    revoked : bool
        Whether it was revoked.
    """

    identity: str
    user: str
    name: str
    scope: tuple[str, ...]
    expires: str
    revoked: bool

    def to_dict(self) -> dict[str, Any]:
        """Return the token as plain values."""
        return {**asdict(self), "scope": list(self.scope)}


def create_token(store: Store, by: Identity, name: str, scope: Iterable[str], days: int = DAYS) -> tuple[str, Token]:
    """Create a token of somebody's own; return it, which nobody can do again, and what the store keeps of it.

    Raises
    ------
    DataError
        If the scope is empty or holds no role, or the life is not 1 to 730 days.
    RefusedError
        If the scope holds a role that `by` has not, or `by` is itself a token.
    """
    if not 1 <= days <= MOST_DAYS:
        raise DataError(f"the life of a token must be 1 to {MOST_DAYS} days, got {days}")
    if by.token_id is not None:
        raise RefusedError("a token cannot create tokens; log in with a password")
    wanted, text = checked_roles(scope), new_token()
    expires = (datetime.now(UTC) + timedelta(days=days)).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    with changing(store, by, "view") as change:
        held: tuple[Role, ...] = roles_of(change.connection, by)
        if more := [role for role in wanted if role not in held]:
            raise RefusedError(f"{by.name} does not have the role {more[0]}, so a token cannot; narrow its --scope")
        found = Token(token_identity(text) or "", by.name, name, wanted, expires, False)
        values = {"identity": found.identity, "hash": token_hash(text), "scope": " ".join(wanted), "expires": expires}
        change.insert(schema.token, {"user_id": by.user_id, "name": name, "revoked": False, **values})
    return text, found


def list_tokens(store: Store, by: Identity) -> list[Token]:
    """Return the tokens that somebody may revoke: the own ones, and for an administrator all."""
    token, user = schema.token, schema.user
    with viewing(store, by) as connection:
        query = (
            sa.select(token, user.c.name.label("user")).join(user, token.c.user_id == user.c.id).order_by(token.c.id)
        )
        if "manage" not in permitted(roles_of(connection, by)):
            query = query.where(token.c.user_id == by.user_id)
        rows = connection.execute(query).mappings()
        return [
            Token(
                row["identity"], row["user"], row["name"], tuple(row["scope"].split()), row["expires"], row["revoked"]
            )
            for row in rows
        ]


def revoke_token(store: Store, by: Identity, identity: str) -> None:
    """Revoke a token: one's own, or as an administrator that of another.

    Raises
    ------
    DataError
        If there is no such token.
    RefusedError
        If it is that of another user, and `by` is no administrator.
    """
    table = schema.token
    with changing(store, by, "view") as change:
        query = sa.select(table).where(table.c.identity == (token_identity(identity) or identity))
        row = change.connection.execute(query).mappings().first()
        if row is None:
            raise DataError(f"the store has no token {identity!r}; 'truepose store token list' lists them")
        if row["user_id"] != by.user_id and "manage" not in permitted(roles_of(change.connection, by)):
            raise RefusedError("this token is that of another user; only an administrator may revoke it")
        if not row["revoked"]:
            change.update(table, row["id"], {"revoked": True}, "token.revoke")
