"""Targets that get the correction of the positions that they are derived from."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from truepose.programs.core.arithmetic import Element
from truepose.programs.core.derived import Derived as Found
from truepose.programs.core.points import Derived, Frame, Place, Point, Problem, Use, derive
from truepose.programs.core.state import State
from truepose.programs.core.target import Along
from truepose.programs.tp.frames import in_force
from truepose.programs.tp.positions import Positions

_OTHER_FRAME: Final = (
    "copied to a register that is moved to, where it is not certain that its frame and tool are in force"
)


class Follower(NamedTuple):
    """A motion whose target may follow positions of the program.

    Attributes
    ----------
    target : Point
        The target, without numbers of its own.
    own : Point, optional
        The position that the motion itself names, which it shifts.
    line, node : int
        The line, and the node of the flow.
    indirect : bool
        Whether it goes to one of the positions as they are, by a number in a register.
    how : str
        The code, for messages.
    use : callable
        The motion as one to a position, given that position.
    """

    target: Point
    own: Point | None
    line: int
    node: int
    indirect: bool
    how: str
    use: Callable[[Point], Use]

    @property
    def of_register(self) -> bool:
        """Whether it goes to a register, and not to a position of the program itself."""
        return self.own is None and not self.indirect


class Followers:
    """The followers of one program.

    Parameters
    ----------
    positions : Positions
        The positions.
    group : int
        The motion group of the robot.
    allowed : bool
        Whether the options allow to correct positions from which others are derived.
    """

    def __init__(self, positions: Positions, group: int, *, allowed: bool) -> None:
        self._positions, self._group, self._allowed = positions, group, allowed
        self._all: list[Follower] = []
        self.resolved: set[int] = set()
        """The identities of targets whose positions are all known."""

    def add(self, follower: Follower) -> None:
        """Add a motion."""
        self._all.append(follower)

    def settle(self, found: Found, states: list[State]) -> None:
        """Connect the motions with the positions that they are derived from."""
        for one in self._all:
            goal, problem = found.goals.get(one.target), one.target.problem
            if goal is None or not goal.shifts or not (goal.complete or one.of_register):
                continue
            sources = [(self._source(name), axes, shifts) for (name, axes), shifts in goal.shifts.items()]
            if one.of_register and not all(self._in_frame(point, states[one.node]) for point, _, _ in sources):
                for point, _, _ in sources:
                    point.reads.append((one.line, _OTHER_FRAME))
                continue
            self._follow(one, sources)
            if not goal.complete:  # on some way it goes elsewhere
                one.target.follows, one.target.shift, one.target.problem = [], None, problem
                self.resolved.discard(id(one.target))
        for name, (place, how) in found.spoiled.items():
            if not isinstance(name, Element) or name.array != "P":
                continue
            if name.place is None:
                for point in self._positions.all():
                    point.reads.append((place, how))
            elif not self._is_own(name, place):
                self._source(name).reads.append((place, how))

    def _follow(self, one: Follower, sources: list[tuple[Point, Along, list[tuple[float, ...]]]]) -> None:
        self.resolved.add(id(one.target))
        if (one.own is not None or one.indirect) and not self._allowed:
            return  # the motion stays one to the positions themselves
        names = ", ".join(dict.fromkeys(point.name for point, _, _ in sources))
        one.target.uses = [one.use(sources[0][0])]
        one.target.problem = Problem("skip", f"derived from {names} by constant shifts; --derived corrects both alike")
        derive(one.target, [(p, Derived(one.line, one.how, tuple(shifts), axes)) for p, axes, shifts in sources])

    def _source(self, name: object) -> Point:
        assert isinstance(name, Element)
        assert name.place is not None  # of one position
        point = self._positions.get(name.place[0])
        assert point is not None  # it has numbers
        return point

    def _in_frame(self, point: Point, state: State) -> bool:
        """Return whether the frames in which a position was taught are certainly those of a motion to a register."""
        taught = self._positions.taught(point)
        pairs: tuple[tuple[Frame | None, Frame | None], ...] = (
            (taught.tool, in_force(state.tool, "tool", self._group)),
            (taught.base, in_force(state.base, "base", self._group)),
        )
        return all(own is not None and own == other for own, other in pairs)

    def _is_own(self, name: Element, place: Place) -> bool:
        """Return whether a place is a shifted motion to the position itself, which has its own reason."""
        return any(one.line == place and one.own is self._source(name) for one in self._all)
