"""Users, roles and tokens, for administrators; and the own tokens of each user."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Response
from pydantic import BaseModel, Field

from truepose.store.roles import Role
from truepose.web.team.visits import InTeam, InVisit

router = APIRouter(tags=["users"])


class UserEntry(BaseModel):
    """A user."""

    name: str
    roles: list[Role]
    disabled: bool
    subject: str | None = Field(None, description="of the OpenID Connect provider")


class NewUser(BaseModel):
    """A user to add."""

    name: str = Field(max_length=200)
    roles: list[Role] = Field(min_length=1)
    password: str | None = Field(None, max_length=2000, description="without one, the user logs in by OpenID Connect")
    subject: str | None = Field(None, max_length=500)


class UserChange(BaseModel):
    """What changes of a user; what is null stays."""

    name: str = Field(max_length=200)
    roles: list[Role] | None = None
    disabled: bool | None = None
    password: str | None = Field(None, max_length=2000)
    subject: str | None = Field(None, max_length=500, description="an empty text takes it away")


class TokenEntry(BaseModel):
    """A token, without its secret."""

    identity: str
    user: str
    name: str
    scope: list[Role]
    expires: str
    revoked: bool


class TokenOrder(BaseModel):
    """A token to make for oneself."""

    name: str = Field(min_length=1, max_length=200)
    scope: list[Role] = Field(min_length=1)
    days: Annotated[int, Field(ge=1, le=730)] = 90


class NewToken(TokenEntry):
    """A token and its secret, which is shown this once."""

    token: str


@router.get("/users")
def list_users(team: InTeam, visit: InVisit) -> list[UserEntry]:
    """Return all users by name."""
    from truepose.store import users

    return [UserEntry.model_validate(one.to_dict()) for one in users.list_users(team.store, visit.identity)]


@router.post("/users", status_code=201)
def new_user(given: NewUser, team: InTeam, visit: InVisit) -> UserEntry:
    """Add a user."""
    from truepose.store import users

    made = users.add_user(
        team.store,
        visit.identity,
        given.name,
        given.roles,
        password=given.password or None,
        subject=given.subject or None,
    )
    return UserEntry.model_validate(made.to_dict())


@router.patch("/users", status_code=204)
def change_user(given: UserChange, team: InTeam, visit: InVisit) -> Response:
    """Change roles, password or subject of a user, or disable the user; open sessions follow at their next request."""
    from truepose.store import users

    store, by, name = team.store, visit.identity, given.name
    if given.roles is not None:
        users.set_roles(store, by, name, given.roles)
    if given.disabled is not None:
        users.set_disabled(store, by, name, given.disabled)
    if given.password:
        users.set_password(store, by, name, given.password)
    if given.subject is not None:
        users.set_subject(store, by, name, given.subject or None)
    return Response(status_code=204)


@router.get("/tokens")
def list_tokens(team: InTeam, visit: InVisit) -> list[TokenEntry]:
    """Return the own tokens; all for an administrator."""
    from truepose.store import tokens

    return [TokenEntry.model_validate(one.to_dict()) for one in tokens.list_tokens(team.store, visit.identity)]


@router.post("/tokens", status_code=201)
def make_token(given: TokenOrder, team: InTeam, visit: InVisit) -> NewToken:
    """Make a token; its secret is in this answer only."""
    from truepose.store import tokens

    text, made = tokens.create_token(team.store, visit.identity, given.name, given.scope, given.days)
    return NewToken(token=text, **made.to_dict())


@router.delete("/tokens/{identity}", status_code=204)
def remove_token(identity: str, team: InTeam, visit: InVisit) -> Response:
    """Revoke a token."""
    from truepose.store import tokens

    tokens.revoke_token(team.store, visit.identity, identity)
    return Response(status_code=204)
