"""Steps, counts, warnings and the error of a command as JSON lines on stderr, for a program that runs truepose.

They replace the texts for people if the environment variable ``TRUEPOSE_EVENTS`` is ``json``. If stdin is a pipe then,
the command also ends when the other end of the pipe is closed, so that it never survives the program that started it.
"""

from __future__ import annotations

import json
import os
import signal
import stat
import sys
import threading
import time
from typing import Any, Final

VARIABLE: Final = "TRUEPOSE_EVENTS"
_PERIOD: Final = 0.1
"""Seconds between two counts of a step."""
_GRACE: Final = 2.0
"""Seconds between the interrupt and the end of a command that does not react to it."""
_writing: Final = threading.Lock()


def wanted() -> bool:
    """Return whether events are wanted instead of texts."""
    return os.environ.get(VARIABLE) == "json"


def emit(event: str, **members: Any) -> None:
    """Write one event: a JSON object in ASCII on a line of its own."""
    line = json.dumps({"event": event, **members}) + "\n"
    with _writing:
        sys.stderr.write(line)
        sys.stderr.flush()


class EventSteps:
    """The steps of a command as events; see `truepose.cli.output.working`.

    Counts of a step are at least 0.1 s apart. The last count of a step is always written.
    """

    def __init__(self, step: str) -> None:
        self._left_out: tuple[int, int] | None = None
        self(step)

    def __call__(self, step: str) -> None:
        """Tell the step that begins."""
        self.close()
        self._step, self._next_count = step, 0.0
        emit("step", step=step)

    def count(self, done: int, total: int) -> None:
        """Tell how much of the step is done."""
        now = time.monotonic()
        self._left_out = done, total
        if now >= self._next_count or done == total:
            self._next_count = now + _PERIOD
            self.close()

    def compiling(self) -> None:
        """Tell that the step waits for kernels to be compiled."""
        emit("step", step=f"{self._step} (compiling the numerical kernels, which happens once)")

    def close(self) -> None:
        """Write the last count if it was left out."""
        if self._left_out is not None:
            (done, total), self._left_out = self._left_out, None
            emit("count", done=done, total=total)


def end_with_parent() -> None:
    """Interrupt this process, as Ctrl-C does, when its stdin is a pipe that gets closed; it ends 2 s later at most.

    A thread reads a copy of stdin; nothing else in this process can read what arrives there.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a parent in the background may ignore it
    try:
        kind = os.fstat(0).st_mode
    except OSError:  # closed
        return
    if not (stat.S_ISFIFO(kind) or stat.S_ISSOCK(kind)):
        return
    pipe = os.dup(0)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    threading.Thread(target=_wait_for_end, args=(pipe,), name="truepose-parent", daemon=True).start()


def _wait_for_end(pipe: int) -> None:
    try:
        while os.read(pipe, 4096):
            pass
    except OSError:  # Windows: the other end is gone
        pass
    if sys.platform == "win32":
        signal.raise_signal(signal.SIGINT)
    else:
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    time.sleep(_GRACE)
    os._exit(130)
