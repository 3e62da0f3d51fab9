"""The users of a server and the user of a request, as parameters of routes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from fastapi import Depends, Request

from truepose.errors import DataError, StoreError
from truepose.jobs import Job
from truepose.web.problems import WebError
from truepose.web.team.permissions import OF_COMMANDS, check_action
from truepose.web.team.team import Team, Visitor


def _team(request: Request) -> Team:
    team: Team | None = request.app.state.team
    if team is None:
        raise WebError(404, "No store", "this server has no users; start it with: truepose app WORKSPACE --store URL")
    return team


def _visit(request: Request, _team: Annotated[Team, Depends(_team)]) -> Visitor:
    visitor: Visitor = request.state.visitor
    return visitor


def check_job(request: Request, job: Job, *, own: bool = False) -> None:
    """Refuse a job that the user of a request may not start; with `own` only if it is that of another user.

    Raises
    ------
    WebError
        With status 403 and the missing role.
    """
    visitor: Visitor | None = getattr(request.state, "visitor", None)
    if visitor is None or (own and job.user == visitor.identity.name):
        return
    if (action := OF_COMMANDS.get(job.command[0])) is None:
        raise DataError(f"{job.command[0]} cannot be run by users")
    check_action(visitor.identity.name, visitor.roles, action)


def session_check(request: Request) -> Callable[[], bool]:
    """Return a function that says whether the session of a request goes on, for answers that take their time.

    Where the store cannot be reached the answer is no; the next request says why.
    """
    team: Team | None = request.app.state.team
    visitor: Visitor | None = getattr(request.state, "visitor", None)

    def goes_on() -> bool:
        if team is None or visitor is None:
            return True
        try:
            return team.still_in(visitor)
        except StoreError:
            return False

    return goes_on


InTeam = Annotated[Team, Depends(_team)]
"""The users, as a parameter of a route."""
InVisit = Annotated[Visitor, Depends(_visit)]
"""The user of the request, as a parameter of a route."""
