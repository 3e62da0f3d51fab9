"""The users of a server: their log-ins and sessions, checked against the store at every request."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from truepose.errors import DataError, RefusedError, StoreError, one_line
from truepose.web.problems import WebError
from truepose.web.team.sessions import Session, Sessions
from truepose.web.throttle import WaitError, Waits, Window

if TYPE_CHECKING:
    from truepose.jobs import Job
    from truepose.store.access import Identity
    from truepose.store.roles import Role
    from truepose.store.store import Store
    from truepose.web.team.oidc import Provider

STORE_VARIABLE: Final = "TRUEPOSE_STORE"
"""The variable with the store's address in the environment of a job."""
TOKEN_VARIABLE: Final = "TRUEPOSE_STORE_TOKEN"
"""The variable with the token in the environment of a job."""
_WRONG_TRIES, _WINDOW_S = 60, 60.0
_AT_ONCE: Final = 2  # each check of a password takes 64 MB
_REFUSED: Final = (
    "the user name or the password is wrong, or the user is disabled; after wrong tries, wait some minutes"
)

_NO_PASSWORD: Final = (
    "you log in by OpenID Connect and have no password here, but a signature needs one; ask an administrator to set it"
)


@dataclass(frozen=True)
class Visitor:
    """The user of a request.

    Attributes
    ----------
    session : Session
        The session.
    roles : tuple of str
        The roles that are in force now.
    """

    session: Session
    roles: tuple[Role, ...]

    @property
    def identity(self) -> Identity:
        """Who it is."""
        return self.session.identity


class Team:
    """The users of a server.

    Parameters
    ----------
    store : Store
        The store.
    address : str
        The address of the store, for jobs.
    sessions : Sessions, optional
        The sessions.
    clock : callable, optional
        A function that returns the time in seconds, for waits after wrong tries.
    provider : Provider, optional
        The provider of log-ins by OpenID Connect.
    """

    def __init__(
        self,
        store: Store,
        address: str,
        sessions: Sessions | None = None,
        clock: Callable[[], float] | None = None,
        provider: Provider | None = None,
    ) -> None:
        given = {} if clock is None else {"clock": clock}
        self.store, self.address, self.provider = store, address, provider
        self.sessions = sessions or Sessions()
        self._waits, self._window = Waits(**given), Window(_WRONG_TRIES, _WINDOW_S, **given)
        self._checks = threading.Semaphore(_AT_ONCE)

    def log_in(self, name: str, password: str) -> tuple[str, Session]:
        """Open a session of a user who knows the password, and return its id.

        Raises
        ------
        WebError
            If name and password do not belong together (401, the same for all reasons), or there were too many wrong
            tries (429).
        """
        identity = self.confirmed(name, password)
        return self.sessions.begin(identity, self._standing(identity)[1])

    def log_in_by(self, subject: str) -> str:
        """Open a session of the user with a subject that the provider has proven, and return its id.

        Raises
        ------
        RefusedError
            If no user has this subject, or the user is disabled.
        """
        from truepose.store.access import by_subject

        identity = by_subject(self.store, subject)
        return self.sessions.begin(identity, self._standing(identity)[1])[0]

    def note_refused(self, reason: str) -> None:
        """Note a log-in by OpenID Connect that was refused."""
        with suppress(StoreError), self.store.transaction("truepose") as change:
            change.note("login.refused", {"oidc": one_line(reason)[:500]})

    def confirmed(self, name: str, password: str) -> Identity:
        """Return the identity of a user who knows the password; see `log_in`."""
        from truepose.store.access import log_in
        from truepose.store.names import name_key

        key = name_key(name.strip())[:200]
        if wait := self._window.wait() or self._waits.begin(key):
            raise WaitError(wait)
        try:
            with self._checks:
                identity = log_in(self.store, name, password)
        except (RefusedError, DataError):
            self._window.add()
            raise WebError(401, "Not logged in", _REFUSED) from None
        self._waits.clear(key)
        return identity

    def confirm_again(self, identity: Identity, password: str) -> None:
        """Check the password of a user who has logged in, within the same limits of wrong tries.

        Raises
        ------
        WebError
            If it is wrong (403), or there were too many wrong tries (429).
        """
        if not self.has_password(identity):
            raise WebError(403, "No password", _NO_PASSWORD)
        try:
            self.confirmed(identity.name, password)
        except WebError as error:
            if error.status != 401:
                raise
            raise WebError(403, "Wrong password", "the password is wrong; nothing was changed or signed") from None

    def has_password(self, identity: Identity) -> bool:
        """Return whether a user has a password here; who logs in by OpenID Connect only cannot sign."""
        return self._kept(identity)[0] is not None

    def visitor(self, id_: str) -> Visitor | None:
        """Return the user of a session; None if it has ended, or the user was disabled or got another password.

        Raises
        ------
        StoreError
            If the store cannot be reached.
        """
        session = self.sessions.find(id_)
        return None if session is None else self._visitor_of(session)

    def still_in(self, visitor: Visitor) -> bool:
        """Return whether the session of an answer that is still being sent goes on; it does not count as in use.

        Raises
        ------
        StoreError
            If the store cannot be reached.
        """
        return self.sessions.is_open(visitor.session) and self._visitor_of(visitor.session) is not None

    def _visitor_of(self, session: Session) -> Visitor | None:
        try:
            roles, password = self._standing(session.identity)
        except RefusedError:
            roles, password = (), ""
        if not roles or password != session.password:
            self.sessions.end(session)
            return None
        return Visitor(session, roles)

    def renew(self, session: Session) -> None:
        """Keep a session whose own user has changed the password; all others of the user end."""
        session.password = self._standing(session.identity)[1]

    @contextmanager
    def job_environment(self, job: Job) -> Iterator[Mapping[str, str]]:
        """Give the variables by which a job acts as its user: a token that ends with the job.

        Raises
        ------
        RefusedError
            If the user was disabled meanwhile.
        """
        from truepose.store.access import Identity, roles_of
        from truepose.store.tokens import create_token, revoke_token
        from truepose.store.users import find_user

        with self.store.reading() as connection:
            row = find_user(connection, job.user)
            identity = Identity(row["id"], row["name"])
            roles = roles_of(connection, identity)
        text, token = create_token(self.store, identity, f"job {job.id}", roles, days=1)
        try:
            yield {STORE_VARIABLE: self.address, TOKEN_VARIABLE: text}
        finally:
            with suppress(StoreError, RefusedError):  # without the store, the token ends with the day
                revoke_token(self.store, identity, token.identity)

    def _standing(self, identity: Identity) -> tuple[tuple[Role, ...], str]:
        """Return the roles in force, and a fingerprint of the stored password and subject."""
        from truepose.store.access import roles_of

        with self.store.reading() as connection:
            roles = roles_of(connection, identity)
        password, subject = self._kept(identity)
        return roles, hashlib.sha256(f"{password or ''}\0{subject or ''}".encode()).hexdigest()

    def _kept(self, identity: Identity) -> tuple[str | None, str | None]:
        """Return the hash of the password and the subject of a user; either may be missing."""
        import sqlalchemy as sa

        from truepose.store import schema

        user = schema.user
        with self.store.reading() as connection:
            row = connection.execute(sa.select(user.c.password, user.c.subject).where(user.c.id == identity.user_id))
            password, subject = row.one_or_none() or (None, None)
        return password, subject
