"""The session of a page, and the health of the server."""

from __future__ import annotations

from fastapi import APIRouter, Request
from pydantic import BaseModel

from truepose import __version__
from truepose.web.workspace import InWorkspace

router = APIRouter(tags=["session"])
health = APIRouter(tags=["session"])


class Session(BaseModel):
    """The values that a page needs for its requests."""

    csrf: str
    version: str
    workspace: str


class Version(BaseModel):
    """The version of the product."""

    version: str


@router.get("/session")
def session(request: Request, workspace: InWorkspace) -> Session:
    """Return the value of the header that requests with effect need."""
    return Session(csrf=request.app.state.guard.csrf, version=__version__, workspace=workspace.root.name)


@health.get("/healthz")
def healthz() -> dict[str, str]:
    """Say that the server answers."""
    return {"status": "ok"}


@health.get("/version")
def version() -> Version:
    """Return the version of the product."""
    return Version(version=__version__)
