"""The command line: one way through the house, from readings to a corrected program.

Modules of commands import what they compute with inside each command, so that ``truepose --help`` is quick.
"""

from __future__ import annotations

import os
import sys
import warnings
from typing import TextIO

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
from truepose.errors import TrueposeError

app = typer.Typer(
    name="truepose",
    help="Makes industrial robots go where they were told: measure, find similarity, predict, correct.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("demo")(demo.demo)
app.command("robots")(setup.robots)
app.command("init")(setup.init)
app.command("plan")(planning.plan)
app.command("import")(setup.import_readings)
app.command("similarity")(similarity.similarity)
app.command("check-point")(points.check_point)
app.command("fit")(maps.fit)
app.command("predict")(maps.predict)
app.command("validate")(maps.validate)
app.command("explain")(explain.explain)
app.command("update")(updating.update)
app.command("iso9283")(iso9283.iso9283)
app.command("report")(report.report)
app.command("check")(programs.check)
app.command("correct")(programs.correct)
app.command("study")(study.study)


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: bool = typer.Option(False, "--version", help="Print the version and exit."),
) -> None:
    from truepose.files import watched

    context.with_resource(watched())
    if version:
        from truepose import __version__

        typer.echo(f"truepose {__version__}")
        raise typer.Exit


_INTERRUPTED = 130


def main() -> None:
    """Run the command line: exit 0 done, 1 refused or failed (one line on stderr says why), 2 usage."""
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _warn
            app()
    except TrueposeError as error:
        _fail(str(error))
    except (KeyboardInterrupt, SystemExit) as end:
        if isinstance(end, SystemExit) and end.code != _INTERRUPTED:  # which typer makes of Ctrl-C
            raise
        _fail("interrupted; files are written whole or not at all", code=_INTERRUPTED)
    except Exception as error:
        if os.environ.get("TRUEPOSE_TRACEBACK"):
            raise
        _fail(f"internal error ({type(error).__name__}: {error}); TRUEPOSE_TRACEBACK=1 shows where: please report it")


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    sys.stderr.write(f"truepose: warning: {' '.join(str(message).split())}\n")


def _fail(message: str, code: int = 1) -> None:
    sys.stderr.write(f"truepose: {' '.join(message.split())}\n")
    sys.exit(code)
