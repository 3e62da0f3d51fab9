"""Follow the values of point variables along the ways through a program, to find what is derived from which point.

A reader notes what statements do to points: an assignment, a motion, any other use. `Derivations.solve` then goes
through the program as the controller would: loops with constant bounds turn as often as they do, and both ways of every
condition are taken. So each motion has the set of positions that it may go to, each a point of the program plus a
constant shift. A point whose digits reach anything else - a condition, an output, a sum with a measured value - is
*spoiled*: its correction would have effects that nobody can foresee.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from truepose.programs.core.arithmetic import (
    UNKNOWN,
    At,
    Depends,
    Element,
    Expression,
    Name,
    Operation,
    Value,
    Variable,
    evaluate,
    names_in,
    sources_of,
    with_coordinate,
)
from truepose.programs.core.flow import Flow
from truepose.programs.core.graph import Counter, Ways
from truepose.programs.core.points import Place
from truepose.programs.core.target import Along

_MOST_STEPS: Final = 20_000
_MOST_STEPS_IN_ALL: Final = 400_000
_MOST_POSITIONS: Final = 1_000
NOT_CONSTANT: Final = "moved to with a shift that is not constant"
"""How a point is used whose shift in a motion is not known."""
_TOO_MANY: Final = f"moved to with more than {_MOST_POSITIONS:,} shifts"


class Assign(NamedTuple):
    """The assignment of an expression to a variable, or to a coordinate (0 to 2) of a point."""

    name: Name
    expression: Expression
    axis: int | None
    place: Place


class Move(NamedTuple):
    """A motion to an expression; `motion` is the reader's own object for it.

    `itself`: whether an element of an array that is not known is left to the reader.
    """

    motion: Hashable
    expression: Expression
    place: Place
    itself: bool = False

    def left(self, sources: Iterable[Name]) -> list[Name]:
        """Return the points whose use is not left to the reader."""
        return [one for one in sources if not (self.itself and isinstance(one, Element) and one.place is None)]


class Escape(NamedTuple):
    """Any other use of variables, after which they are not known; `how` is a phrase for the reason."""

    names: tuple[Name, ...]
    place: Place
    how: str


Event = Assign | Move | Escape


class Motion(NamedTuple):
    """The name of a motion among those of variables."""

    motion: Hashable


class Goal(NamedTuple):
    """The positions that a motion goes to.

    Attributes
    ----------
    shifts : dict of (point, axes) to list of tuple of float [mm]
        The shifts from each point along "frame" or "tool" axes, or along "both" one after the other.
    complete : bool
        Whether these are all.
    """

    shifts: dict[tuple[Name, Along], list[tuple[float, ...]]]
    complete: bool


@dataclass
class Derived:
    """What is derived from the points of a program.

    Attributes
    ----------
    goals : dict
        The positions of each motion by the reader's object; without those whose positions are not known at all.
    spoiled : dict of name to (place, how)
        The points that are used otherwise, each with the first such use.
    """

    goals: dict[Hashable, Goal] = field(default_factory=dict)
    spoiled: dict[Name, tuple[Place, str]] = field(default_factory=dict)


class Derivations:
    """Collects what statements do to points, and follows it through the program.

    Parameters
    ----------
    flow : Flow
        The ways through the program, whose current node is that of the statement.
    """

    def __init__(self, flow: Flow) -> None:
        self._flow = flow
        self._events: dict[int, list[Event]] = defaultdict(list)
        self._counters: dict[int, tuple[Counter, ...]] = {}
        self._points: set[Name] = set()
        self._numbers: set[Name] = set()
        self._elements: dict[Name, set[Name]] = defaultdict(set)
        self._distrusted: set[Name] = set()
        self._places: dict[Name, set[int]] = defaultdict(set)

    def _note(self, event: Event) -> None:
        node = self._flow.node
        self._events[node].append(event)
        self._counters[node] = self._flow.counters

    def assign(
        self, name: Name, expression: Expression, place: Place, axis: int | None = None, *, point: bool = False
    ) -> None:
        """Note an assignment to a variable, or to a coordinate (0 to 2) of a point; `point`: it is one."""
        (self._points if point or axis is not None else self._numbers).add(name)
        if isinstance(name, Element):
            self._elements[name.array].add(name)
        self._note(Assign(name, expression, axis, place))

    def move(self, motion: Hashable, expression: Expression, place: Place, *, itself: bool = False) -> None:
        """Note a motion; `motion` is any object by which its positions are found again; for `itself` see `Move`."""
        self._note(Move(motion, expression, place, itself))

    def escape(self, names: Sequence[Name], place: Place, how: str) -> None:
        """Note any other use of variables."""
        self._note(Escape(tuple(names), place, how))

    def distrust(self, name: Name) -> None:
        """Note that a variable, or any element of an array, may change or be used at any time: it is never known."""
        self._distrusted.add(name)

    def is_distrusted(self, name: Name) -> bool:
        """Return whether a variable may change at any time."""
        whole = Element(name.array, None) if isinstance(name, Element) else name
        return name in self._distrusted or whole in self._distrusted

    def begin_loop(self, counter: Counter | None, kind: str, line: int, place: Place, *, runs: bool = False) -> None:
        """Open a loop; with a counter, one that counts; `runs` if it turns at least once."""
        if counter is not None:
            self.assign(counter.name, counter.first, place)
        self._flow.begin(kind, line, counter, runs=runs)

    def end_loop(self, kind: str, opener: str, place: Place) -> None:
        """Close a loop."""
        counter = self._flow.counter
        if counter is not None:
            self.assign(counter.name, Operation("+", Variable(counter.name), counter.step), place)
        self._flow.end(kind, opener)

    def solve(self, is_point: Callable[[Name], bool], number: Callable[[Name], float | None]) -> Derived:
        """Return what is derived from which point, once the flow is solved.

        Parameters
        ----------
        is_point : callable
            Whether a variable that is not assigned is a point whose numbers never change.
        number : callable
            The value of a variable that is not assigned; None where that is not known.
        """
        assert self._flow.graph is not None  # it is solved
        found, ways, steps = Derived(), Ways(self._flow.graph), 0
        for node, events in self._events.items():
            for event in events:
                for name in self.concerned(event):
                    self._places[name].add(node)
        for names, motions in self._groups():
            most = min(_MOST_STEPS, _MOST_STEPS_IN_ALL - steps)
            walk = _Walk(self, ways, names, motions, is_point, number, found)
            walk.go(most)
            steps += walk.steps
        return found

    def nodes_of(self, names: Iterable[Name]) -> set[int]:
        """Return the nodes that change variables, or use them otherwise, or have one of some motions."""
        return set[int]().union(*[self._places.get(name, set()) for name in names])

    def concerned(self, event: Event) -> Collection[Name]:
        """Return the variables that an event changes or uses otherwise, or its motion."""
        if isinstance(event, Move):
            return (Motion(event.motion),)
        return (event.name,) if isinstance(event, Assign) else self.assigned(event.names)

    def is_point(self, name: Name) -> bool:
        """Return whether a variable is assigned as a point."""
        return name in self._points

    @property
    def events(self) -> Mapping[int, Sequence[Event]]:
        """What happens at each node, in order."""
        return self._events

    def assigned(self, names: Iterable[Name]) -> set[Name]:
        """Return the variables among some that the program assigns; those of an array where any element is meant."""
        found = set[Name]()
        for name in names:
            if isinstance(name, Element) and name.place is None:
                found |= self._elements.get(name.array, set())
            elif name in self._points or name in self._numbers:
                found.add(name)
        return found

    def _groups(self) -> list[tuple[frozenset[Name], frozenset[Hashable]]]:
        """Return the variables that are followed together, each group with its motions."""
        reads: dict[Name, set[Name]] = defaultdict(set)
        motions: dict[Hashable, set[Name]] = {}
        for node, events in self._events.items():
            loops = {name for counter in self._counters[node] for name in _names_of(counter)}
            for event in events:
                if isinstance(event, Assign):
                    reads[event.name] |= self.assigned({*names_in(event.expression), *loops})
                elif isinstance(event, Move):
                    read = self.assigned(names_in(event.expression))
                    if read or not isinstance(event.expression, Variable):  # others go to a point itself
                        motions[event.motion] = read
        joined = _Joined()
        for name, read in reads.items():
            for other in read & self._points if name in self._points else ():
                joined.join(name, other)
        for motion, read in motions.items():
            for name in read & self._points:
                joined.join(Motion(motion), name)
        groups: dict[Name, tuple[set[Name], set[Hashable]]] = {}
        for name in self._points:
            groups.setdefault(joined.root(name), (set(), set()))[0].add(name)
        for motion, read in motions.items():
            root = joined.root(Motion(motion)) if read & self._points else frozenset(read)
            group = groups.setdefault(root, (set(), set()))
            group[0].update(read)
            group[1].add(motion)
        return [(_closed(names, reads), frozenset(some)) for names, some in groups.values()]


def _names_of(counter: Counter) -> set[Name]:
    """Return the variables that a counter needs."""
    return {counter.name, *names_in(counter.last), *names_in(counter.step)}


def _closed(names: set[Name], reads: Mapping[Name, set[Name]]) -> frozenset[Name]:
    """Return variables with all that their values depend on."""
    found, waiting = set(names), list(names)
    while waiting:
        more = reads.get(waiting.pop(), set()) - found
        found |= more
        waiting += more
    return frozenset(found)


class _Joined:
    """Names in groups."""

    def __init__(self) -> None:
        self._above: dict[Name, Name] = {}

    def root(self, name: Name) -> Name:
        """Return what stands for the group of a name."""
        while (above := self._above.get(name, name)) != name:
            name = above
        return name

    def join(self, a: Name, b: Name) -> None:
        """Put two names into one group."""
        self._above[self.root(a)] = self.root(b)


class _Walk:
    """Goes through the program with the values of some variables; see `Derivations`."""

    def __init__(
        self,
        derivations: Derivations,
        ways: Ways,
        names: frozenset[Name],
        motions: frozenset[Hashable],
        is_point: Callable[[Name], bool],
        number: Callable[[Name], float | None],
        found: Derived,
    ) -> None:
        self._all, self._ways, self._names, self._motions = derivations, ways, names, motions
        self._is_point, self._number, self._found = is_point, number, found
        self._events: dict[int, list[Event]] = {}
        self._live: dict[int, set[Name]] = defaultdict(set)
        self._goals: dict[Hashable, dict[tuple[Name, Along], set[tuple[float, ...]]]] = {}
        self._open: set[Hashable] = set()
        self.steps = self._most = 0

    def go(self, most: int) -> None:
        """Take all ways, in at most so many steps."""
        nodes = self._all.nodes_of([*self._names, *map(Motion, self._motions)])
        for node in sorted(nodes):
            self._events[node] = [event for event in self._all.events[node] if self._concerns(event)]
        if not self._names:  # the same, whichever way control comes
            for node in self._events:
                for event in self._events[node]:
                    self._take(event, {})
        elif not self._ways.touch(nodes):
            self._give_up("used in an interrupt program, a thread or an error handler")
            return
        elif not self._follow_all(most):
            self._give_up(_TOO_MANY)
            return
        for motion, shifts in self._goals.items():
            sets = {key: sorted(some) for key, some in sorted(shifts.items(), key=lambda item: str(item[0]))}
            self._found.goals[motion] = Goal(sets, motion not in self._open)

    def _follow_all(self, most: int) -> bool:
        """Take all ways with all values; False where there are too many."""
        self._find_live()
        return self._follow(most)

    def _concerns(self, event: Event) -> bool:
        if isinstance(event, Move):
            return event.motion in self._motions
        return not self._names.isdisjoint(self._all.concerned(event))

    def _give_up(self, how: str) -> None:
        """Spoil all points that these variables may take values of."""
        for events in self._events.values():
            for event in events:
                names = event.names if isinstance(event, Escape) else names_in(event.expression)
                points = [name for name in names if self._is_point(name)]
                self._spoil(event.left(points) if isinstance(event, Move) else points, event.place, how)

    def _spoil(self, sources: Iterable[Name], place: Place, how: str) -> None:
        spoiled = self._found.spoiled
        for source in sources:
            if source not in spoiled or _order(place) < _order(spoiled[source][0]):
                spoiled[source] = (place, how)

    def _uses(self, event: Event) -> set[Name]:
        """Return the variables whose values an event needs."""
        if isinstance(event, Escape):
            return self._all.assigned(event.names) & self._names
        used = self._all.assigned(names_in(event.expression)) & self._names
        return used | {event.name} if isinstance(event, Assign) and event.axis is not None else used

    def _find_live(self) -> None:
        """Find the variables whose values count at each node."""
        exposed: dict[Name, list[int]] = defaultdict(list)
        defined: dict[Name, set[int]] = defaultdict(set)
        for node, events in self._events.items():
            done: set[Name] = set()
            for event in events:
                for name in self._uses(event) - done:
                    exposed[name].append(node)
                if isinstance(event, Assign) and event.axis is None:
                    done.add(event.name)
                    defined[event.name].add(node)
        for counter, head in self._ways.heads():
            if counter.name in self._names:
                for name in self._names & _names_of(counter):
                    exposed[name].append(head)
        for name, nodes in exposed.items():
            waiting = list(nodes)
            while waiting:
                node = waiting.pop()
                if name not in self._live[node]:
                    self._live[node].add(name)
                    waiting += [other for other in self._ways.before(node) if other not in defined[name]]

    def _follow(self, most: int) -> bool:
        """Take all ways with all values; False where there are too many."""
        live, seen = self._live, set[tuple[int, frozenset[tuple[Name, Value]]]]()
        waiting: list[tuple[int, dict[Name, Value]]] = [(node, {}) for node in self._events if not live.get(node)]
        waiting += [(node, {}) for node, names in live.items() if names and self._ways.is_start(node)]
        while waiting:
            node, values = waiting.pop()
            key = node, frozenset(values.items())
            if key in seen:
                continue
            seen.add(key)
            self.steps += 1
            if self.steps > most:
                return False
            values = dict(values)
            for event in self._events.get(node, ()):
                self._take(event, values)
            if self._most > _MOST_POSITIONS:
                return False
            for follower in self._next(node, values):
                if needed := live.get(follower):
                    kept = {name: values[name] for name in needed if values.get(name, UNKNOWN) != UNKNOWN}
                    waiting.append((follower, kept))
        return True

    def _next(self, node: int, values: dict[Name, Value]) -> Sequence[int]:
        """Return the nodes behind one; a loop that counts turns as often as its counter says."""
        loop = self._ways.counter(node)
        if loop is None or loop[0].name not in self._names:
            return self._ways.behind(node)
        counter, body, behind = loop
        get = self._getter(values)
        now, last, step = (evaluate(one, get) for one in (Variable(counter.name), counter.last, counter.step))
        if not (isinstance(now, float) and isinstance(last, float) and isinstance(step, float) and step):
            return self._ways.behind(node)
        return (behind,) if (now - last) * step > 0.0 else (body,)

    def _getter(self, values: Mapping[Name, Value]) -> Callable[[Name], Value]:
        def get(name: Name) -> Value:
            if name in values:
                return values[name]
            if isinstance(name, Element) and name.place is None:
                some = [values.get(other, UNKNOWN) for other in self._all.assigned([name])]
                own = frozenset([name]) if self._is_point(name) else frozenset[Name]()
                return Depends(own.union(*map(sources_of, some)))
            if name in self._names:
                return UNKNOWN
            if self._is_point(name):
                return At(name)
            known = self._number(name)
            return UNKNOWN if known is None else float(known)

        return get

    def _take(self, event: Event, values: dict[Name, Value]) -> None:
        """Let an event change values, and note what it does to points."""
        get = self._getter(values)
        if isinstance(event, Escape):
            for name in self._all.assigned(event.names) & self._names:
                sources = sources_of(get(name))
                self._spoil(sources, event.place, event.how)
                values[name] = Depends(sources)
            return
        value = evaluate(event.expression, get)
        if isinstance(event, Assign):
            if event.axis is not None:
                value = with_coordinate(get(event.name), event.axis, value)
            elif not self._all.is_point(event.name) and not isinstance(value, float):
                self._spoil(sources_of(value), event.place, "read by arithmetic")
                value = UNKNOWN
            if self._all.is_distrusted(event.name):
                value = Depends(sources_of(value))
                self._spoil(value.sources, event.place, "copied into a variable that is not followed")
            values[event.name] = value
            return
        goals = self._goals.setdefault(event.motion, {})
        if isinstance(value, At):
            along, shift = _along(value)
            goals.setdefault((value.source, along), set()).add(shift)
            self._most = max(self._most, sum(map(len, goals.values())))
        else:
            self._open.add(event.motion)
            self._spoil(event.left(sources_of(value)), event.place, NOT_CONSTANT)


def _along(value: At) -> tuple[Along, tuple[float, ...]]:
    """Return the axes of a position's shift, and the shift."""
    if not any(value.along_tool):
        return "frame", value.shift
    return ("both", value.shift + value.along_tool) if any(value.shift) else ("tool", value.along_tool)


def _order(place: Place) -> tuple[str, int]:
    return ("", place) if isinstance(place, int) else (place.file, place.line)


def words(name: str, source: str, shifts: Sequence[tuple[float, ...]], along: Along) -> str:
    """Return in words how a position is derived from a point."""
    largest = max(shifts, key=lambda shift: sum(part * part for part in shift))
    numbers = ", ".join(f"{part:g}" for part in largest)
    axes = {"frame": "", "tool": " along the axes of the tool", "both": " along the axes of the frame and of the tool"}
    others = "" if len(shifts) == 1 else f", the largest of {len(shifts)} shifts"
    return f"{name} = {source} + ({numbers}) mm{axes[along]}{others}"
