"""The command line: from readings to a corrected program.

The modules of commands import the numerical modules inside each command, so that ``truepose --help`` is fast.
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
    browser,
    demo,
    explain,
    fit,
    frames,
    importing,
    iso9283,
    maps,
    plan,
    programs,
    report,
    setup,
    similarity,
    update,
    verify,
    watch,
)
from truepose.cli.options import Command
from truepose.errors import TrueposeError, one_line

app = typer.Typer(
    name="truepose",
    help="Improve the positional accuracy of industrial robots: measure, model the errors, correct robot programs.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_COMMANDS: Final[dict[str, dict[str, Callable[..., None]]]] = {
    "Start": {
        "demo": demo.demo,
        "warm-up": setup.warm_up,
        "robots": setup.robots,
        "init": setup.init,
        "check-point": setup.check_point,
    },
    "Measure": {
        "plan": plan.plan,
        "import": importing.import_readings,
        "similarity": similarity.similarity,
        "iso9283": iso9283.iso9283,
    },
    "Model": {
        "fit": fit.fit,
        "validate": maps.validate,
        "explain": explain.explain,
        "predict": maps.predict,
        "update": update.update,
        "study": demo.study,
    },
    "Correct": {
        "check": programs.check,
        "frames": frames.frames,
        "correct": programs.correct,
        "watch": watch.watch,
        "verify": verify.verify,
    },
    "Report": {"report": report.report},
    "Browser": {"app": browser.app},
}
for _panel, _commands in _COMMANDS.items():
    for _name, _command in _commands.items():
        app.command(_name, cls=Command, rich_help_panel=_panel)(_command)


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
_BROKEN_PIPE = 141  # the code of a process ended by SIGPIPE


def main() -> None:
    """Run the command line: exit with 0 when done, 1 when refused or failed (one line on stderr), 2 for wrong usage.

    If the reader of the output is gone (``truepose robots | head -1``), exit silently with 141.
    """
    for stream in (sys.stdout, sys.stderr):  # file names may hold undecodable bytes
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
        _fail("; ".join([str(error), *getattr(error, "__notes__", [])]))
    except BrokenPipeError:
        _end_at_broken_pipe()
    except (KeyboardInterrupt, SystemExit) as end:
        if isinstance(end.__context__, BrokenPipeError):  # typer and rich turn it into an exit
            _end_at_broken_pipe()
        if isinstance(end, SystemExit) and end.code != _INTERRUPTED:  # the code that typer uses for Ctrl-C
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
    """Return the message of an unexpected error."""
    if isinstance(error, OSError):
        if error.filename is None:  # stdout has no name
            _forget_stdout()
        where = "the output" if error.filename is None else os.fsdecode(error.filename)
        return f"{where}: cannot be read or written: {error.strerror or error}"
    if isinstance(error, MemoryError):
        return "not enough memory; use fewer samples, another predictor or fewer workers"
    if isinstance(error, RecursionError):
        return "the input is nested too deeply; is it the right file?"
    return f"internal error ({type(error).__name__}: {error}); set TRUEPOSE_TRACEBACK=1 for details and report it"


def _forget_stdout() -> None:
    """Discard further output: the flush at the end of Python would fail again, with a traceback."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _interrupted() -> str:
    """Return the message of an interrupt, with the files that had been written."""
    commits = sys.modules.get("truepose._io.commits")
    written = [] if commits is None else commits.written
    if not written:
        return "interrupted; no file was written"
    more = f" and {len(written) - 1} more" if len(written) > 1 else ""
    return f"interrupted; these files were written before and are complete: {written[0]}{more}"


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
