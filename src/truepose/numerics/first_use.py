"""The kernels of the package, and a message before the first that is compiled; numba is imported with the kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

KERNELS: Final[list[Any]] = []
"""numba's dispatchers of all kernels whose modules have been imported."""

_announcements: Final[list[Callable[[], None]]] = []


def register(kernel: Any) -> Any:
    """Add a kernel to `KERNELS`, and return it."""
    if not KERNELS:
        _watch_compiler()
    KERNELS.append(kernel)
    return kernel


def compiled_now() -> list[str]:
    """Return the names of the kernels that this process has compiled; kernels from the cache are not among them."""
    return [f"{kernel.__module__}.{kernel.__name__}" for kernel in KERNELS if kernel.stats.cache_misses]


@contextmanager
def announced(announce: Callable[[], None]) -> Iterator[None]:
    """Call `announce` at most once within this context: before the first kernel that has to be compiled."""
    _announcements.append(announce)
    try:
        yield
    finally:
        if announce in _announcements:
            _announcements.remove(announce)


def _watch_compiler() -> None:
    """Announce the event that numba sends when a function is compiled, but not when it is loaded from the cache."""
    from numba.core import event

    class Watcher(event.Listener):
        def on_start(self, event: Any) -> None:
            while _announcements:
                _announcements.pop()()

        def on_end(self, event: Any) -> None:
            pass

    add: Any = event.register
    add("numba:compile", Watcher())
