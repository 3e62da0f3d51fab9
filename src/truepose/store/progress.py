"""How work on many rows says how far it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, Protocol, TypeVar

_EVERY: Final = 20_000
_Row = TypeVar("_Row")


class Progress(Protocol):
    """What is told of the work; a line on the terminal, or nothing."""

    def __call__(self, step: str) -> object:
        """Take the step that begins."""

    def count(self, done: int, total: int) -> object:
        """Take how much of the step is done."""


class Silent:
    """Progress that nobody sees."""

    def __call__(self, step: str) -> None:
        """Leave the step."""

    def count(self, done: int, total: int) -> None:
        """Leave the count."""


SILENT: Final[Progress] = Silent()


def counted(rows: Iterable[_Row], total: int, progress: Progress) -> Iterator[_Row]:
    """Yield rows, and tell every some thousand rows how many have passed."""
    for number, row in enumerate(rows, 1):
        if number % _EVERY == 0:
            progress.count(number, max(number, total))
        yield row
