"""Log-in and log-out of users, and their own passwords; on a server with a store."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from truepose.web.team.visits import InTeam, InVisit

router = APIRouter(tags=["session"])


class Credentials(BaseModel):
    """Name and password."""

    name: str = Field(max_length=200)
    password: str = Field(max_length=2000)


class NewPassword(BaseModel):
    """The password of today and the next one."""

    password: str = Field(max_length=2000)
    new_password: str = Field(max_length=2000)


@router.post("/login", status_code=204)
def log_in(credentials: Credentials, team: InTeam, request: Request) -> Response:
    """Open a session; the answer to a wrong try does not tell whether the user exists."""
    id_, _ = team.log_in(credentials.name, credentials.password)
    answer = Response(status_code=204)
    request.app.state.guard.set_cookie(answer, id_)
    return answer


@router.post("/logout", status_code=204)
def log_out(team: InTeam, visit: InVisit, request: Request) -> Response:
    """End the session."""
    team.sessions.end(visit.session)
    answer = Response(status_code=204)
    request.app.state.guard.delete_cookie(answer)
    return answer


@router.put("/password", status_code=204)
def change_password(given: NewPassword, team: InTeam, visit: InVisit) -> Response:
    """Change the own password; the other sessions of the user end."""
    from truepose.store.users import set_password

    team.confirm_again(visit.identity, given.password)
    set_password(team.store, visit.identity, visit.identity.name, given.new_password)
    team.renew(visit.session)
    return Response(status_code=204)
