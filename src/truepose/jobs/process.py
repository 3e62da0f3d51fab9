"""A process for one command of truepose: its start, its events, and its end."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, cast

_LONGEST_LINE: Final = 1 << 20
_OTHER_LINES: Final = 20
_THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class CommandProcess:
    """A process that waits for a command, and then runs it.

    It leads a process group of its own, so that Ctrl-C in the terminal of the application does not reach it. It ends
    when its stdin is closed, thus also when this process is killed.

    Parameters
    ----------
    threads : int, optional
        The number of threads of its computations; by default all processors.
    ready : bool
        Whether it imports the numerical modules before it waits.

    Raises
    ------
    OSError
        If the system cannot start it.
    """

    def __init__(self, *, threads: int | None = None, ready: bool = False) -> None:
        command = [sys.executable, "-P", "-m", "truepose.cli.waiting", *(["ready"] if ready else [])]
        own_group: dict[str, Any] = {"start_new_session": True}
        if sys.platform == "win32":
            own_group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW}
        self._process = subprocess.Popen(
            command,
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env=_environment(os.environ, threads),
            **own_group,
        )
        assert self._process.stdin is not None  # both are pipes
        assert self._process.stderr is not None
        self._stdin, self._stderr = self._process.stdin, io.BufferedReader(cast(io.FileIO, self._process.stderr))
        self._other: deque[str] = deque(maxlen=_OTHER_LINES)

    def begin(
        self, command: Sequence[str], folder: Path, output: Path, variables: Mapping[str, str] | None = None
    ) -> None:
        """Let the process run a command in a folder, and write its JSON to a file.

        The variables are added to its environment; they are sent through the pipe, so no list of processes shows them.

        Raises
        ------
        OSError
            If the process has ended.
        """
        name, *rest = command
        order: dict[str, Any] = {"arguments": [name, "--json", *rest], "folder": str(folder), "output": str(output)}
        order["environment"] = dict(variables or {})
        line = memoryview(json.dumps(order).encode() + b"\n")
        while line:
            line = line[self._stdin.write(line) or 0 :]

    def events(self) -> Iterator[dict[str, Any]]:
        """Yield the events of the command until it ends; other lines that it writes are kept for `last_words`."""
        while line := self._stderr.readline(_LONGEST_LINE):
            text = line.decode("utf-8", "replace").rstrip()
            try:
                event = json.loads(text)
            except (ValueError, RecursionError):
                event = None
            if isinstance(event, dict) and "event" in event:
                yield event
            elif text:
                self._other.append(text)

    def interrupt(self) -> None:
        """Interrupt the command as Ctrl-C does."""
        with contextlib.suppress(OSError):
            self._stdin.close()

    def kill(self) -> None:
        """Kill the process and those that it has started."""
        with contextlib.suppress(OSError):
            if sys.platform == "win32":
                self._process.kill()
            elif self._process.returncode is None:  # nobody has waited for it, so its number is still its own
                os.killpg(self._process.pid, signal.SIGKILL)

    def wait(self) -> int:
        """Return the exit code of the process after its end; close its pipes."""
        code = self._process.wait()
        self.interrupt()
        self._stderr.close()
        return code

    def last_words(self, code: int) -> str:
        """Return a sentence about a process that ended without a problem of its own."""
        if code < 0:
            name = signal.Signals(-code).name if -code in {*signal.Signals} else f"signal {-code}"
            why = f"the process was ended by {name}"
            if name == "SIGKILL":
                why += "; perhaps the memory of the machine was full: close other programs, and run it again"
        elif code == 0:
            why = "the process ended without a complete result; is the disk full?"
        else:
            why = f"the process ended with exit code {code}"
        return f"{why}: {' | '.join(self._other)}" if self._other else why


def _environment(environment: Mapping[str, str], threads: int | None) -> dict[str, str]:
    """Return the environment of a command: events in UTF-8, and the same modules in every folder."""
    made = {**environment, "TRUEPOSE_EVENTS": "json", "PYTHONIOENCODING": "utf-8"}
    made.pop("PYTHONUNBUFFERED", None)  # without a buffer, Python does not see that a part of a text was not written
    if paths := environment.get("PYTHONPATH"):
        made["PYTHONPATH"] = os.pathsep.join(str(Path(path).absolute()) for path in paths.split(os.pathsep) if path)
    if threads is not None:
        made = {**dict.fromkeys(_THREADS, str(threads)), **made}
    return made
