"""Log-in and log-out of users, and their own passwords; on a server with a store."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field
from starlette.responses import RedirectResponse

from truepose.errors import DataError, RefusedError
from truepose.web.problems import WebError
from truepose.web.team.oidc import OIDC_CALLBACK, PENDING_S, Provider, ProviderError
from truepose.web.team.team import Team
from truepose.web.team.visits import InTeam, InVisit

router = APIRouter(tags=["session"])
_BEGUN: Final = "truepose-oidc"


class Credentials(BaseModel):
    """Name and password."""

    name: str = Field(max_length=200)
    password: str = Field(max_length=2000)


class LogIns(BaseModel):
    """The ways to log in."""

    provider: str | None = Field(description="the host of the OpenID Connect provider; null without one")


class Destination(BaseModel):
    """The page of the provider to go to."""

    url: str


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


@router.get("/login")
def log_ins(team: InTeam) -> LogIns:
    """Return the ways to log in."""
    return LogIns(provider=None if team.provider is None else team.provider.name)


@router.post("/login/oidc")
def begin_oidc(team: InTeam, request: Request, response: Response) -> Destination:
    """Begin a log-in by OpenID Connect; the page goes to the provider then."""
    try:
        begun = _provider(team).begin()
    except (ProviderError, DataError) as error:
        raise WebError(502, "Provider not reached", f"{error}; try again, or log in with a password") from None
    # Lax, unlike that of sessions: the browser comes back from pages of the provider
    secure = request.app.state.guard.secure
    response.set_cookie(
        _BEGUN, begun.browser, max_age=int(PENDING_S), path=OIDC_CALLBACK, httponly=True, samesite="lax", secure=secure
    )
    return Destination(url=begun.url)


@router.get("/login/oidc/callback", response_class=RedirectResponse)
def finish_oidc(
    team: InTeam,
    request: Request,
    state: Annotated[str, Query(max_length=200)] = "",
    code: Annotated[str, Query(max_length=4000)] = "",
    error: Annotated[str, Query(max_length=200)] = "",
) -> Response:
    """Open the session of the user whom the provider has proven; the page says what went wrong."""
    try:
        if error:
            raise RefusedError(f"the provider answered {error}")
        id_ = team.log_in_by(_provider(team).finish(state, code, request.cookies.get(_BEGUN, "")))
    except (RefusedError, ProviderError, DataError) as problem:
        team.note_refused(str(problem))
        why = "refused" if isinstance(problem, RefusedError) else "provider"
        answer = RedirectResponse(f"/?oidc={why}", 303)
    else:
        answer = RedirectResponse("/", 303)
        request.app.state.guard.set_cookie(answer, id_)
    answer.delete_cookie(_BEGUN, path=OIDC_CALLBACK)
    return answer


def _provider(team: Team) -> Provider:
    if team.provider is None:
        raise WebError(404, "No provider", "this server has no OpenID Connect provider; log in with a password")
    return team.provider


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
