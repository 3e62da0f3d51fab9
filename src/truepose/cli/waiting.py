"""A process that waits for a command of truepose on its stdin, and then runs it: ``python -m truepose.cli.waiting``.

The command is one line of JSON: ``arguments`` (without ``truepose``), ``folder`` (where to run), ``output`` (the file
for stdout) and ``environment`` (more variables). With the argument ``ready`` the process first imports what most
commands need, so that the command starts at once. It ends when stdin is closed.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from typing import Final

from truepose import cli
from truepose.errors import MissingPackageError

_WRITE: Final = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0)


def main() -> None:
    """Wait for a command and run it."""
    if "ready" in sys.argv[1:]:
        _import()
    if not (line := _line()):
        return
    order = json.loads(line)
    os.environ.update(order.get("environment", {}))
    os.chdir(order["folder"])
    output = os.open(order["output"], _WRITE, 0o644)
    os.dup2(output, 1)
    os.close(output)
    sys.argv = ["truepose", *order["arguments"]]
    cli.main()


def _import() -> None:
    """Import the modules that the long commands use."""
    import truepose.error_map.fit
    import truepose.predictors.registry
    import truepose.programs.batch

    with suppress(MissingPackageError):  # the command that needs it says so
        import truepose.report.page  # noqa: F401


def _line() -> bytes:
    """Read one line and nothing behind it: what follows is the end of the parent (`truepose.cli.events`)."""
    line = b""
    while not line.endswith(b"\n"):
        if not (more := os.read(0, 1)):
            return b""
        line += more
    return line


if __name__ == "__main__":
    main()
