"""The session of a page, and the health of the server."""

from __future__ import annotations

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field

from truepose import __version__
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
    """The version of the product."""

    version: str


@router.get("/session")
def session(request: Request, workspace: InWorkspace) -> Session:
    """Return the value of the header that requests with effect need."""
    visitor: Visitor | None = getattr(request.state, "visitor", None)
    user = visitor and LoggedIn(name=visitor.identity.name, roles=list(visitor.roles))
    csrf = request.app.state.guard.csrf_of(request)
    return Session(csrf=csrf, version=__version__, workspace=workspace.root.name, user=user)


@health.get("/healthz")
def healthz() -> dict[str, str]:
    """Say that the server answers."""
    return {"status": "ok"}


@health.get("/version")
def version() -> Version:
    """Return the version of the product."""
    return Version(version=__version__)
