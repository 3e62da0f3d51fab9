"""Results that take long, kept in the workspace by what they are of; the folder may be deleted at any time."""

from __future__ import annotations

import contextlib
import hashlib
import json
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Annotated, Any, Final

from fastapi import Depends, Request

from truepose._io.files import write_atomic
from truepose._io.plain import plain
from truepose.jobs.executor.identity import code_hash
from truepose.web.kept import remove_old
from truepose.web.workspace import Workspace

_LARGEST: Final = 512 << 20
_OBJECTS: Final = 4


class ResultCache:
    """Results in the folder ``.truepose/cache`` of a workspace, and some objects in memory.

    A result is computed once: a second request for it waits for the first.

    Parameters
    ----------
    workspace : Workspace
        The workspace.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._folder = workspace.own / "cache"
        self._locks: dict[str, threading.Lock] = {}
        self._guard = threading.Lock()
        self._objects: OrderedDict[str, Any] = OrderedDict()

    def bytes(self, key: tuple[object, ...], make: Callable[[], bytes]) -> bytes:
        """Return a result by its key; made anew when the code changes."""
        name = hashlib.sha256(repr((code_hash(), *key)).encode()).hexdigest()[:40]
        path = self._folder / name
        with self._lock(name):
            try:
                return path.read_bytes()
            except OSError:
                made = make()
            with contextlib.suppress(OSError, ValueError):  # a full disk keeps nobody from the result
                self._folder.mkdir(parents=True, exist_ok=True)
                write_atomic(path, made)
                remove_old(self._folder, largest=_LARGEST)
            return made

    def json(self, key: tuple[object, ...], make: Callable[[], Any]) -> Any:
        """Return a result of JSON values by its key."""
        return json.loads(self.bytes(key, lambda: json.dumps(plain(make()), allow_nan=False).encode()))

    def object(self, key: tuple[object, ...], make: Callable[[], Any]) -> Any:
        """Return an object by its key; the last few are kept in memory only."""
        name = repr(key)
        with self._lock(name):
            if name not in self._objects:
                made = make()
                with self._guard:
                    self._objects[name] = made
                    while len(self._objects) > _OBJECTS:
                        self._objects.popitem(last=False)
                return made
            return self._objects[name]

    def _lock(self, name: str) -> threading.Lock:
        with self._guard:
            return self._locks.setdefault(name, threading.Lock())


def _cache(request: Request) -> ResultCache:
    state = request.app.state
    if not hasattr(state, "results"):
        state.results = ResultCache(state.workspace)
    cache: ResultCache = state.results
    return cache


InCache = Annotated[ResultCache, Depends(_cache)]
"""The kept results of the workspace, as a parameter of a route."""
