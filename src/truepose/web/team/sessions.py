"""Sessions of users who have logged in: kept by the server, ended by time, log-out, or what changes of the user."""

from __future__ import annotations

import hashlib
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from truepose.store.access import Identity

IDLE_S: Final = 30 * 60.0
"""A session ends after this time without a request."""
LONGEST_S: Final = 12 * 3600.0
"""A session ends after this time in any case."""
_MOST: Final = 20  # sessions of one user


@dataclass
class Session:
    """A session.

    Attributes
    ----------
    identity : Identity
        Who logged in.
    password : str
        The fingerprint of the stored password at the log-in; the session ends when it changes.
    began, seen : float
        The times of the log-in and of the last request [s].
    csrf : str
        The value of the header that changes need.
    """

    identity: Identity
    password: str
    began: float
    seen: float
    csrf: str = field(default_factory=lambda: secrets.token_hex(32))


class Sessions:
    """The open sessions, found by random ids of 256 bits; only their hashes are kept.

    Parameters
    ----------
    clock : callable
        A function that returns the time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._open: dict[str, Session] = {}

    def begin(self, identity: Identity, password: str) -> tuple[str, Session]:
        """Open a session and return its id; the oldest sessions of a user who has many are ended."""
        id_, now = secrets.token_urlsafe(32), self._clock()
        session = Session(identity, password, now, now)
        with self._lock:
            self._open = {key: one for key, one in self._open.items() if self._alive(one)}
            own = [key for key, one in self._open.items() if one.identity.user_id == identity.user_id]
            for key in own[: max(0, len(own) + 1 - _MOST)]:
                del self._open[key]
            self._open[_hash(id_)] = session
        return id_, session

    def find(self, id_: str) -> Session | None:
        """Return a session that is open, and note that it is in use."""
        with self._lock:
            session = self._open.get(_hash(id_))
            if session is not None and self._alive(session):
                session.seen = self._clock()
                return session
            self._open.pop(_hash(id_), None)
        return None

    def is_open(self, session: Session) -> bool:
        """Return whether a session is open; it does not count as in use."""
        with self._lock:
            return self._alive(session) and any(one is session for one in self._open.values())

    def end(self, session: Session) -> None:
        """End a session."""
        with self._lock:
            self._open = {key: one for key, one in self._open.items() if one is not session}

    def _alive(self, session: Session) -> bool:
        now = self._clock()
        return now - session.seen < IDLE_S and now - session.began < LONGEST_S


def _hash(id_: str) -> str:
    return hashlib.sha256(id_.encode()).hexdigest()
