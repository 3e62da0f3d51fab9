"""Pieces of a program that control passes without jumps: inside one, a motion starts where the motion before ended."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import cached_property
from typing import Final, NamedTuple


class Piece:
    """A piece of program that control passes from its beginning to its end, without jumps.

    Parameters
    ----------
    before : Piece, optional
        The piece that calls routines at its end, and always goes on with this one behind them.
    calls : collection of str
        These routines.
    moves : callable
        A function of a routine's name: whether the robot may move in it.
    """

    def __init__(
        self, before: Piece | None = None, calls: Collection[str] = (), moves: Callable[[str], bool] = bool
    ) -> None:
        self._before, self._calls, self._moves = before, calls, moves

    @cached_property
    def start(self) -> Piece:
        """The first of the pieces before this one that it goes on from without a motion in between."""
        piece, between = self, list[Piece]()
        while "start" not in vars(piece) and piece._before is not None and not any(map(piece._moves, piece._calls)):
            between.append(piece)
            piece = piece._before
        found: Piece = vars(piece).get("start", piece)
        for one in between:  # a long program has many, one behind the other
            vars(one)["start"] = found
        return found


class Section(NamedTuple):
    """Where in a program a motion stands: the number of its section, see `Flow.motion`, and its piece."""

    number: int
    piece: Piece


WHOLE: Final = Section(0, Piece())
"""Of all motions of a program without control flow."""
