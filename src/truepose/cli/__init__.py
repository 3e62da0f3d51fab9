"""The command line: from readings to a corrected program.

The modules of commands import the numerical modules inside each command, so that ``truepose --help`` is fast.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NoReturn, TextIO

import typer

from truepose.cli import (
    browser,
    demo,
    events,
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
    store,
    store_release,
    store_users,
    update,
    verify,
    watch,
)
from truepose.cli.options import Command
from truepose.errors import TrueposeError, one_line
from truepose.problem import document, problem

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

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
        "mask": importing.mask,
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
_STORE: Final[dict[str, Callable[..., None]]] = {
    "init": store.init,
    "import": store_release.import_folder,
    "list": store_release.list_objects,
    "release": store_release.release,
    "withdraw": store_release.withdraw,
    "recall": store_release.recall,
    "verify": store.verify,
    "head": store.head,
    "backup": store.backup,
    "restore": store.restore,
    "migrate": store.migrate,
}
for _panel, _commands in _COMMANDS.items():
    for _name, _command in _commands.items():
        app.command(_name, cls=Command, rich_help_panel=_panel)(_command)
_store = typer.Typer(help="Keep cells, maps, programs and their history for a team.", no_args_is_help=True)
for _name, _command in _STORE.items():
    _store.command(_name, cls=Command)(_command)
_store.add_typer(store_users.user_commands, name="user")
_store.add_typer(store_users.token_commands, name="token")
app.add_typer(_store, name="store", rich_help_panel="Store")


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

    If the reader of the output is gone (``truepose robots | head -1``), exit silently with 141. For other programs,
    steps, warnings and errors can be JSON (`truepose.cli.events`).
    """
    for stream in (sys.stdout, sys.stderr):  # file names may hold undecodable bytes
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        if events.wanted():
            events.end_with_parent()
        with warnings.catch_warnings(), _no_interrupt_lost():
            warnings.showwarning = _warn
            try:
                _run()
            finally:
                sys.stdout.flush()
    except BrokenPipeError:
        _end_at_broken_pipe()
    except (KeyboardInterrupt, SystemExit) as end:
        if isinstance(end.__context__, BrokenPipeError):  # typer and rich turn it into an exit
            _end_at_broken_pipe()
        if isinstance(end, SystemExit) and end.code != _INTERRUPTED:  # the code that typer uses for Ctrl-C
            raise
        _fail(document("Interrupted", _interrupted()), code=_INTERRUPTED)
    except Exception as error:
        if os.environ.get("TRUEPOSE_TRACEBACK") and not isinstance(error, TrueposeError):
            raise
        if isinstance(error, OSError) and error.filename is None:
            _forget_stdout()
        _fail(problem(error))


def _run() -> None:
    """Run the command; typer shows wrong usage with its help, unless events are wanted."""
    if not events.wanted():
        app()
        return
    try:
        code = app(standalone_mode=False)
    except Exception as error:
        if not hasattr(error, "format_message"):  # an exception of typer, in any version of it
            raise
        _fail(document("UsageError", error.format_message()), code=getattr(error, "exit_code", 2))
    sys.exit(code or 0)


@contextlib.contextmanager
def _no_interrupt_lost() -> Iterator[None]:
    """End the process at an interrupt that compiled code ignores, as some of scipy's does: its results are void."""
    before = sys.unraisablehook

    def end(ignored: UnraisableHookArgs) -> None:
        if not isinstance(ignored.exc_value, KeyboardInterrupt):
            before(ignored)
            return
        _tell(document("Interrupted", _interrupted()))
        os._exit(_INTERRUPTED)

    sys.unraisablehook = end
    try:
        yield
    finally:
        sys.unraisablehook = before


def _end_at_broken_pipe() -> None:
    _forget_stdout()
    sys.exit(_BROKEN_PIPE)


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
    if events.wanted():
        events.emit("warning", message=one_line(str(message)))
    else:
        sys.stderr.write(f"truepose: warning: {one_line(str(message))}\n")


def _fail(found: Mapping[str, Any], code: int = 1) -> NoReturn:
    _tell(found)
    sys.exit(code)


def _tell(found: Mapping[str, Any]) -> None:
    """Write the problem that ends the command to stderr."""
    if events.wanted():
        events.emit("problem", **found)
    else:
        sys.stderr.write(f"truepose: {found['detail']}\n")
        sys.stderr.flush()
