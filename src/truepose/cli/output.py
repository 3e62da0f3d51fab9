"""Output of the commands: text and tables for people, JSON for programs."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import typer

from truepose.cli import events

if TYPE_CHECKING:
    from rich.console import Group
    from rich.progress import Progress, TaskID

_BRACKET: Final = re.compile(r"(?<!\\)\[(?!(?:/|bold|dim|red|green|yellow)\])")
"""A bracket that is not markup, such as one in a file name."""

COMPILING: Final = (
    "truepose: compiling the numerical kernels that this needs, which happens once; "
    "'truepose warm-up' compiles all of them"
)
"""What is said before the first kernel is compiled."""


def overwrite(force: bool, *outputs: Path) -> None:
    """Let the command overwrite existing files if `force`; refuse outputs early that it must not write."""
    from truepose._io import files

    files.overwrite(force)
    files.check_outputs(*outputs)


def emit_json(data: Mapping[str, Any]) -> None:
    """Write one JSON object to stdout; non-finite numbers become null."""
    from truepose._io.plain import plain

    text = json.dumps(plain(data), indent=2, ensure_ascii=False)
    typer.echo(text.encode("utf-8", "backslashreplace").decode())  # bytes of a name that are not UTF-8, as \udcff


def say(*items: Any) -> None:
    """Print texts with rich's markup, or renderables, to stdout."""
    from rich.console import Console

    console = Console(highlight=False)
    for item in items:
        if isinstance(item, str):
            item = _BRACKET.sub(r"\\[", item.encode("utf-8", "backslashreplace").decode())
        console.print(item, soft_wrap=isinstance(item, str), crop=False)


class Steps(Protocol):
    """What a command is doing; see `working`."""

    def __call__(self, step: str) -> None:
        """Show the step that begins."""

    def count(self, done: int, total: int) -> None:
        """Show how much of the step is done."""


class _Line:
    """The line on a terminal that shows the step."""

    def __init__(self, bar: Progress, task: TaskID) -> None:
        self._bar, self._task = bar, task

    def __call__(self, step: str) -> None:
        self._bar.update(self._task, description=step, count="")

    def count(self, done: int, total: int) -> None:
        self._bar.update(self._task, count=f"{done} of {total}")


@contextmanager
def working(step: str = "Reading", *, quiet: bool) -> Iterator[Steps]:
    """Show the current step and the time on stderr if it is a terminal and not `quiet`; the line disappears at the end.

    Every command that can take more than two seconds uses it. `quiet` is the command's --json. A line says so when
    kernels must be compiled. If events are wanted, the steps are events (`truepose.cli.events`), with --json, too.
    """
    from truepose.numerics.first_use import announced

    if events.wanted():
        steps = events.EventSteps(step)
        with announced(steps.compiling), contextlib.closing(steps):
            yield steps
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)

    def announce() -> None:
        if not quiet:
            console.print(COMPILING, highlight=False, soft_wrap=True)

    texts = (TextColumn("{task.description}", markup=False), TextColumn("{task.fields[count]}"))
    columns = (SpinnerColumn(), *texts, TimeElapsedColumn())
    hidden = quiet or not console.is_terminal
    with announced(announce), Progress(*columns, console=console, transient=True, disable=hidden) as bar:
        yield _Line(bar, bar.add_task(step, total=None, count=""))


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Group:
    """Return a titled table: first column left-aligned, the others right-aligned, numbers with three decimals.

    A field that is too wide for the terminal is folded, never cut.
    """
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    made = Table(header_style="bold")
    for k, column in enumerate(columns):
        made.add_column(Text(column), justify="left" if k == 0 else "right", overflow="fold")
    for row in rows:
        made.add_row(*(f"{cell:.3f}" if isinstance(cell, float) else str(cell) for cell in row))
    # a title inside the table would be wrapped at its width
    return Group(Text(f"\n{title}", style="bold", no_wrap=True, overflow="ignore"), made)


def accuracy_table(title: str, figures: Mapping[str, Any]) -> Group:
    """Return the before/after table of `truepose.verification.Accuracy.to_dict`."""
    names = {"mean_mm": "mean", "rms_mm": "RMS", "std_mm": "std", "p95_mm": "P95", "max_mm": "max"}
    before, after = figures["before"], figures["after"]
    rows = [
        (label, before[key], after[key], f"{100 * (1 - after[key] / before[key]):.1f} %" if before[key] else "–")
        for key, label in names.items()
    ]
    return table(f"{title} (n = {before['n']})", ["", "before [mm]", "after [mm]", "reduction"], rows)
