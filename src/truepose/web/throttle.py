"""Limits of wrong tries: in a window of time, and a growing wait for each name."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Final

_MOST_NAMES: Final = 10_000
_FREE: Final = 3
_LONGEST_WAIT: Final = 300.0


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
        self._wrong: deque[float] = deque()

    def full(self) -> bool:
        """Return whether no further try is allowed now."""
        start = self._clock() - self.seconds
        while self._wrong and self._wrong[0] < start:
            self._wrong.popleft()
        return len(self._wrong) >= self._most

    def add(self) -> None:
        """Count a wrong try."""
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
