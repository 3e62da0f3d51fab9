"""The guard of the server: who may ask, from where, and how much.

The start URL holds a token; it is exchanged for a cookie that no other site can send (``SameSite=Strict``). A request
that changes something also needs the header ``X-Truepose-CSRF``, and the origin of the pages themselves. The header
``Host`` must be an address that the server listens on, so that a foreign name that resolves to this machine gets no
answer.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import ClassVar, Final, Protocol
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request, cookie_parser
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from truepose.web.problems import problem_response
from truepose.web.throttle import WaitError, Window
from truepose.web.uploads import BodyTooLargeError, largest_body

CSRF_HEADER: Final = "X-Truepose-CSRF"
_TRIES, _WINDOW_S = 10, 60.0
SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})
HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""The headers of every answer: nothing from elsewhere, nothing inline, no foreign frame."""


class Gate(Protocol):
    """What the application needs of its guard: `Guard`, or that of a server with users."""

    has_users: ClassVar[bool]
    """Whether users log in by name and password."""

    def entered(self, request: Request) -> bool:
        """Return whether a browser has a session."""

    @property
    def start_url(self) -> str:
        """The address to open first."""

    def middleware(self, app: ASGIApp) -> ASGIApp:
        """Return the application behind the guard."""

    async def answer(self, scope: Scope) -> Response | None:
        """Return the answer to a request that is not passed on; None if it may pass."""

    def permit(self, request: Request) -> None:
        """Refuse an endpoint that the user of a request may not use."""

    def csrf_of(self, request: Request) -> str:
        """Return the value of the header that changes need."""


@dataclass
class Guard:
    """The start-up token, the hosts that the server answers, and the wrong tries of the last minute.

    Parameters
    ----------
    port : int
        The port of the server; part of the cookie's name, since cookies do not know ports.
    token : str
        The start-up token; random by default.
    clock : callable
        A function that returns the time in seconds, for the limit of wrong tries.
    """

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    clock: Callable[[], float] = time.monotonic
    _wrong: Window = field(init=False)

    def __post_init__(self) -> None:
        self._wrong = Window(_TRIES, _WINDOW_S, self.clock)

    @property
    def hosts(self) -> frozenset[str]:
        """The values of the header ``Host`` that are answered."""
        names = ("127.0.0.1", "localhost", "[::1]")
        bare = names if self.port == 80 else ()
        return frozenset({f"{name}:{self.port}" for name in names} | set(bare))

    @property
    def cookie(self) -> str:
        """The name of the session cookie."""
        return f"truepose-{self.port}"

    @property
    def session(self) -> str:
        """The value of the session cookie; the token itself is in the start URL only."""
        return self._derived("session")

    @property
    def csrf(self) -> str:
        """The value of the header `CSRF_HEADER`."""
        return self._derived("csrf")

    def _derived(self, purpose: str) -> str:
        return hmac.new(self.token.encode(), purpose.encode(), hashlib.sha256).hexdigest()

    @property
    def start_url(self) -> str:
        """The address to open first."""
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    def middleware(self, app: ASGIApp) -> ASGIApp:
        """Return the application behind this guard."""
        return Guarded(app, self)

    async def answer(self, scope: Scope) -> Response | None:
        """Return the answer to a request that is refused or starts a session; None if it may pass."""
        return self.refusal(scope) or self.start(scope)

    has_users: ClassVar[bool] = False
    """Whether users log in by name and password."""

    def entered(self, request: Request) -> bool:
        """Return whether a browser has the session of this server."""
        value = request.cookies.get(self.cookie, "")
        return hmac.compare_digest(value.encode(), self.session.encode())

    def permit(self, _request: Request) -> None:
        """Permit every endpoint: who has the session is the one user."""

    def csrf_of(self, _request: Request) -> str:
        """Return the value of the header that changes need."""
        return self.csrf

    def refusal(self, scope: Scope) -> Response | None:
        """Return the answer to a request that is refused; None if it may pass."""
        headers = Headers(scope=scope)
        if headers.get("host") not in self.hosts:
            return problem_response(400, "Unknown host", "open the address that 'truepose app' printed")
        if not scope["path"].startswith("/api/"):
            return None
        if (value := cookie_parser(headers.get("cookie", "")).get(self.cookie)) is None:
            return problem_response(401, "No session", "open the address with the token that 'truepose app' printed")
        if not hmac.compare_digest(value.encode(), self.session.encode()):
            return self._wrong_try("the session is not of this server")
        if scope["method"] in SAFE:
            return None
        origin = headers.get("origin")
        if origin is not None and origin.removeprefix("http://") not in self.hosts:
            return problem_response(403, "Foreign origin", f"pages of {origin} cannot change anything here")
        if not hmac.compare_digest(headers.get(CSRF_HEADER, "").encode(), self.csrf.encode()):
            return problem_response(
                403, "Missing token", f"the header {CSRF_HEADER} is missing or wrong; reload the page"
            )
        return None

    def start(self, scope: Scope) -> Response | None:
        """Return the answer to the start URL: the session cookie, and the address without the token."""
        if scope["path"] != "/" or scope["method"] != "GET":
            return None
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token")
        if given is None:
            return None
        if not hmac.compare_digest(given[0].encode(), self.token.encode()):
            return self._wrong_try("the token is wrong")
        answer = RedirectResponse("/", status_code=303)
        answer.set_cookie(self.cookie, self.session, httponly=True, samesite="strict", path="/")
        return answer

    def _wrong_try(self, what: str) -> Response:
        """Return 403, or 429 after many wrong tries in a minute."""
        if wait := self._wrong.wait():
            return WaitError(wait).response()
        self._wrong.add()
        return problem_response(403, "Refused", f"{what}; open the address that 'truepose app' printed")


class Guarded:
    """The application behind a guard: refusals, the limit of bodies, and the headers of every answer.

    Parameters
    ----------
    app : ASGIApp
        The application.
    guard : Gate
        The guard.
    """

    def __init__(self, app: ASGIApp, guard: Gate) -> None:
        self._app, self._guard = app, guard

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        path: str = scope["path"]

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                if path.startswith("/api/"):
                    headers.setdefault("Cache-Control", "no-store")
            await send(message)

        if (answer := await self._guard.answer(scope)) is not None:
            await answer(scope, receive, send_guarded)
            return
        limited = _Limited(self._app, largest_body(path))
        await limited(scope, receive, send_guarded)


class _Limited:
    """One request whose body may have so many bytes, whatever its header says."""

    def __init__(self, app: ASGIApp, limit: int) -> None:
        self._app, self._limit = app, limit
        self._seen, self._answered = 0, False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        stated = Headers(scope=scope).get("content-length", "0")
        error = BodyTooLargeError(self._limit)
        if not stated.isdecimal():
            await problem_response(400, "Wrong length", "the header Content-Length is no number")(scope, receive, send)
            return
        if int(stated) > self._limit:
            await error.response()(scope, receive, send)
            return

        async def receive_limited() -> Message:
            message = await receive()
            self._seen += len(message.get("body", b""))
            if self._seen > self._limit:
                raise error
            return message

        async def send_once(message: Message) -> None:
            if self._seen <= self._limit or self._answered:  # else what reads the body answers in its own words
                self._answered = True
                await send(message)

        with suppress(BodyTooLargeError):
            await self._app(scope, receive_limited, send_once)
        if self._seen > self._limit and not self._answered:
            await error.response()(scope, receive, send)
