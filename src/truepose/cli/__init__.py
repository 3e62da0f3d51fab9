"""The command line: one way through the house, from readings to a corrected program.

Modules of commands import what they compute with inside each command, so that ``truepose --help`` is quick.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import warnings
from collections.abc import Callable
from typing import Final, TextIO

import typer

from truepose.cli import (
    demo,
    explain,
    iso9283,
    maps,
    planning,
    points,
    programs,
    report,
    setup,
    similarity,
    study,
    updating,
)
from truepose.cli.numbers import Command
from truepose.errors import TrueposeError, one_line

app = typer.Typer(
    name="truepose",
    help="Makes industrial robots go where they were told: measure, find similarity, predict, correct.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_COMMANDS: Final[dict[str, Callable[..., None]]] = {
    "demo": demo.demo,
    "robots": setup.robots,
    "init": setup.init,
    "plan": planning.plan,
    "import": setup.import_readings,
    "similarity": similarity.similarity,
    "check-point": points.check_point,
    "fit": maps.fit,
    "predict": maps.predict,
    "validate": maps.validate,
    "explain": explain.explain,
    "update": updating.update,
    "iso9283": iso9283.iso9283,
    "report": report.report,
    "check": programs.check,
    "correct": programs.correct,
    "study": study.study,
}
for _name, _command in _COMMANDS.items():
    app.command(_name, cls=Command)(_command)


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: bool = typer.Option(False, "--version", help="Print the version and exit."),
) -> None:
    from truepose._io.files import watched

    context.with_resource(watched())
    if version:
        from truepose import __version__

        typer.echo(f"truepose {__version__}")
        raise typer.Exit


_INTERRUPTED = 130
_BROKEN_PIPE = 141  # what a shell says of a process that SIGPIPE ended


def main() -> None:
    """Run the command line: exit 0 done, 1 refused or failed (one line on stderr says why), 2 usage.

    If the reader of the output is gone (``truepose robots | head -1``), it ends silently with 141.
    """
    for stream in (sys.stdout, sys.stderr):  # names of files may hold bytes that no encoding shows
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _warn
            try:
                app()
            finally:
                sys.stdout.flush()
    except TrueposeError as error:
        _fail(str(error))
    except BrokenPipeError:
        _end_at_broken_pipe()
    except (KeyboardInterrupt, SystemExit) as end:
        if isinstance(end.__context__, BrokenPipeError):  # of which typer and rich make an exit
            _end_at_broken_pipe()
        if isinstance(end, SystemExit) and end.code != _INTERRUPTED:  # which typer makes of Ctrl-C
            raise
        _fail(_interrupted(), code=_INTERRUPTED)
    except Exception as error:
        if os.environ.get("TRUEPOSE_TRACEBACK"):
            raise
        _fail(_explained(error))


def _end_at_broken_pipe() -> None:
    _forget_stdout()
    sys.exit(_BROKEN_PIPE)


def _explained(error: Exception) -> str:
    """Return what an error says to a user that no command expected."""
    if isinstance(error, OSError):
        if error.filename is None:  # the output, which has no name
            _forget_stdout()
        where = "the output" if error.filename is None else os.fsdecode(error.filename)
        return f"{where}: cannot be read or written: {error.strerror or error}"
    if isinstance(error, MemoryError):
        return "not enough memory; use fewer samples, another predictor or fewer workers"
    if isinstance(error, RecursionError):
        return "the input is nested too deeply; is it the right file?"
    return f"internal error ({type(error).__name__}: {error}); TRUEPOSE_TRACEBACK=1 shows where: please report it"


def _forget_stdout() -> None:
    """Let Python's own flush at its end go nowhere: it would fail again, with a traceback."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _interrupted() -> str:
    """Return what is said of an interrupt: which files had been written by then."""
    commits = sys.modules.get("truepose._io.commits")
    written = [] if commits is None else commits.written
    if not written:
        return "interrupted; no file was written"
    more = f" and {len(written) - 1} more" if len(written) > 1 else ""
    return f"interrupted, but these files were written before, and they are whole: {written[0]}{more}"


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    sys.stderr.write(f"truepose: warning: {one_line(str(message))}\n")


def _fail(message: str, code: int = 1) -> None:
    sys.stderr.write(f"truepose: {one_line(message)}\n")
    sys.exit(code)
