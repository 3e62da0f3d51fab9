"""The guard of a server with users: the address, the session, the origin, the header of changes, and the role."""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from anyio import to_thread
from starlette.datastructures import Headers
from starlette.requests import Request, cookie_parser
from starlette.responses import Response
from starlette.types import ASGIApp, Scope

from truepose.errors import StoreError
from truepose.jobs.job import acting_user
from truepose.web.problems import problem_of, problem_response
from truepose.web.security import CSRF_HEADER, SAFE, Guarded
from truepose.web.team.address import Address
from truepose.web.team.oidc import OIDC_CALLBACK
from truepose.web.team.permissions import OPEN, check
from truepose.web.team.team import Team, Visitor

_OPEN_PATHS: Final = frozenset({"/api/v1/login", "/api/v1/login/oidc"})
_HEALTH: Final = "/healthz"


class TeamGuard:
    """The guard of a server with users; it takes the place of `truepose.web.security.Guard`.

    Parameters
    ----------
    address : Address
        The address by which people reach the server.
    team : Team
        The users.
    """

    has_users: ClassVar[bool] = True
    """Whether users log in by name and password."""

    def __init__(self, address: Address, team: Team) -> None:
        self.address, self.team = address, team

    @property
    def secure(self) -> bool:
        """Whether browsers reach the server by TLS only."""
        return self.address.scheme == "https"

    @property
    def cookie(self) -> str:
        """The name of the session cookie; with TLS one that no other host can set."""
        return "__Host-truepose" if self.secure else f"truepose-{self.address.port}"

    @property
    def start_url(self) -> str:
        """The address to open first."""
        return self.address.url

    def middleware(self, app: ASGIApp) -> ASGIApp:
        """Return the application behind this guard."""
        return Guarded(app, self)

    async def answer(self, scope: Scope) -> Response | None:
        """Return the answer to a request that is refused; None if it may pass."""
        headers, path = Headers(scope=scope), scope["path"]
        acting_user.set("")
        if path == _HEALTH:
            return None
        if headers.get("host") not in self.address.hosts:
            return problem_response(400, "Unknown host", f"open {self.address.url}")
        if not path.startswith("/api/"):
            return None
        safe = scope["method"] in SAFE
        if not safe and (origin := headers.get("origin")) is not None and origin not in self.address.origins:
            return problem_response(403, "Foreign origin", f"pages of {origin} cannot change anything here")
        if path == OIDC_CALLBACK and safe:
            return None  # the browser comes from the provider; the endpoint checks the state and its cookie
        if path in _OPEN_PATHS:
            return None if CSRF_HEADER in headers else _no_header()
        id_ = cookie_parser(headers.get("cookie", "")).get(self.cookie)
        try:
            visitor = None if id_ is None else await to_thread.run_sync(self.team.visitor, id_)
        except StoreError as error:
            return problem_of(error)
        if visitor is None:
            return problem_response(401, "Log-in needed", "log in with your name and password", users=True)
        if not safe and not hmac.compare_digest(headers.get(CSRF_HEADER, "").encode(), visitor.session.csrf.encode()):
            return _no_header()
        scope.setdefault("state", {})["visitor"] = visitor
        acting_user.set(visitor.identity.name)
        return None

    def entered(self, request: Request) -> bool:
        """Return whether a browser has the session of a user."""
        id_ = request.cookies.get(self.cookie)
        return id_ is not None and self.team.visitor(id_) is not None

    def permit(self, request: Request) -> None:
        """Refuse an endpoint that the user's roles do not permit.

        Raises
        ------
        WebError
            With status 403 and the missing role.
        """
        endpoint = str(getattr(request.scope.get("route"), "name", ""))
        if endpoint not in OPEN:
            visitor: Visitor = request.state.visitor
            check(visitor.identity.name, visitor.roles, endpoint)

    def set_cookie(self, answer: Response, id_: str) -> None:
        """Give a session to a browser."""
        answer.set_cookie(self.cookie, id_, **self._attributes())

    def delete_cookie(self, answer: Response) -> None:
        """Take the session away."""
        answer.delete_cookie(self.cookie, **self._attributes())

    def csrf_of(self, request: Request) -> str:
        """Return the value of the header that changes of this session need."""
        visitor: Visitor = request.state.visitor
        return visitor.session.csrf

    def _attributes(self) -> Mapping[str, Any]:
        return {"httponly": True, "samesite": "strict", "secure": self.secure, "path": "/"}


def _no_header() -> Response:
    return problem_response(403, "Missing token", f"the header {CSRF_HEADER} is missing or wrong; reload the page")
