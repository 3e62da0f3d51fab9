"""The session of a page, and the health of the server."""

from __future__ import annotations

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field

from truepose import _version
from truepose.store.roles import Role
from truepose.web.team.team import Visitor
from truepose.web.workspace import InWorkspace

router = APIRouter(tags=["session"])
health = APIRouter(tags=["session"])


class LoggedIn(BaseModel):
    """The user of a session."""

    name: str
    roles: list[Role]


class Session(BaseModel):
    """The values that a page needs for its requests."""

    csrf: str
    version: str
    workspace: str
    user: LoggedIn | None = Field(None, description="null on a server without users")


class Version(BaseModel):
    """The version of the product, and what a page has to know before it asks for anything."""

    version: str
    users: bool = Field(description="whether users log in by name and password")
    entered: bool = Field(description="whether the browser has a session")


@router.get("/session")
def session(request: Request, workspace: InWorkspace) -> Session:
    """Return the value of the header that requests with effect need."""
    visitor: Visitor | None = getattr(request.state, "visitor", None)
    user = visitor and LoggedIn(name=visitor.identity.name, roles=list(visitor.roles))
    csrf = request.app.state.guard.csrf_of(request)
    return Session(csrf=csrf, version=_version.version(), workspace=workspace.root.name, user=user)


@health.get("/healthz")
def healthz() -> dict[str, str]:
    """Say that the server answers."""
    return {"status": "ok"}


@health.get("/version")
def version(request: Request) -> Version:
    """Return the version of the product, and whether the browser may ask for more."""
    guard = request.app.state.guard
    return Version(version=_version.version(), users=guard.has_users, entered=guard.entered(request))
