"""How work on many rows says how far it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, Protocol, TypeVar

_EVERY: Final = 20_000
_Row = TypeVar("_Row")


class Progress(Protocol):
    """Shows how far the work is: in a line on the terminal, or nowhere."""

    def __call__(self, step: str) -> object:
        """Show the name of the step that begins."""

    def count(self, done: int, total: int) -> object:
        """Show how many rows of the step are done, of how many."""


class Silent:
    """Progress that is not shown."""

    def __call__(self, step: str) -> None:
        """Show nothing."""

    def count(self, done: int, total: int) -> None:
        """Show nothing."""


SILENT: Final[Progress] = Silent()


def counted(rows: Iterable[_Row], total: int, progress: Progress) -> Iterator[_Row]:
    """Yield rows, and report their number after each 20,000."""
    for number, row in enumerate(rows, 1):
        if number % _EVERY == 0:
            progress.count(number, max(number, total))
        yield row
