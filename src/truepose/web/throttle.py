"""Limits of wrong tries: in a window of time, and a growing wait for each name."""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Final

from truepose.web.problems import WebError

_MOST_NAMES: Final = 10_000
_FREE: Final = 3
_LONGEST_WAIT: Final = 300.0


class WaitError(WebError):
    """Too many wrong tries.

    Parameters
    ----------
    seconds : float
        The seconds to wait.
    """

    def __init__(self, seconds: float) -> None:
        wait = max(1, math.ceil(seconds))
        super().__init__(
            429, "Too many wrong tries", f"wait {wait} s, then try again", headers={"Retry-After": str(wait)}
        )


class Window:
    """At most so many wrong tries in the last seconds.

    Parameters
    ----------
    most : int
        The largest number of wrong tries.
    seconds : float
        The length of the window.
    clock : callable
        A function that returns the time in seconds.
    """

    def __init__(self, most: int, seconds: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.seconds = seconds
        self._most, self._clock = most, clock
        self._lock = threading.Lock()
        self._wrong: deque[float] = deque(maxlen=most)

    def wait(self) -> float:
        """Return the seconds until a further try is allowed; 0 if it is allowed now."""
        now = self._clock()
        with self._lock:
            while self._wrong and self._wrong[0] + self.seconds <= now:
                self._wrong.popleft()
            return 0.0 if len(self._wrong) < self._most else self._wrong[0] + self.seconds - now

    def add(self) -> None:
        """Count a wrong try; of more than are allowed, the last ones count."""
        with self._lock:
            self._wrong.append(self._clock())


class Waits:
    """A wait after wrong tries in a row of one name: none for the first, then one second, doubled by each further one.

    Names count whether a user has them or not, so that the answers do not tell which users exist.

    Parameters
    ----------
    clock : callable
        A function that returns the time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._tries: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def begin(self, name: str) -> float:
        """Count a try of a name, and return 0; return the seconds to wait if it is too early for one."""
        now = self._clock()
        with self._lock:
            count, last = self._tries.get(name, (0, now))
            wait = min(2.0 ** (count - _FREE), _LONGEST_WAIT) if count >= _FREE else 0.0
            if (left := last + wait - now) > 0:
                return left
            self._tries[name] = (min(count + 1, 64), now)
            self._tries.move_to_end(name)
            while len(self._tries) > _MOST_NAMES:
                self._tries.popitem(last=False)
            return 0.0

    def clear(self, name: str) -> None:
        """Forget the tries of a name, after a right one."""
        with self._lock:
            self._tries.pop(name, None)
