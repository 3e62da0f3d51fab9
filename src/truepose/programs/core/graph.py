"""The ways through a program as a graph of nodes, within its routines and between them."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from truepose.programs.core.arithmetic import Expression


class Counter(NamedTuple):
    """The variable of a loop that counts, with its first and last value and its step (1 or −1 if that follows)."""

    name: Hashable
    first: Expression
    last: Expression
    step: Expression


class Graph(NamedTuple):
    """The ways through a program before its calls are connected.

    Attributes
    ----------
    followers : list of list of int
        The nodes behind each node; calls lead nowhere.
    calls : list of (str, int, int)
        The name of the called routine, and the nodes before and behind each call.
    routines : dict of str to (int, int, list of int)
        The first and last node of each routine, and the nodes at which it ends.
    starts : set of str
        The routines that may be called from outside.
    parts : list of (int, int, bool)
        The first and last nodes of parts that control may enter from anywhere, and whether it goes back from there.
    handlers : set of str
        The routines that may run at any time.
    loops : dict of int to (Counter, int, int)
        The counting loops by the nodes at which they begin, with their bodies and the nodes behind them.
    aborted : list of (list of str, int)
        The routines that a handler may abort, and the nodes at which control goes on then.
    """

    followers: list[list[int]]
    calls: list[tuple[str, int, int]]
    routines: dict[str, tuple[int, int, list[int]]]
    starts: set[str]
    parts: list[tuple[int, int, bool]]
    handlers: set[str]
    loops: dict[int, tuple[Counter, int, int]]
    aborted: list[tuple[list[str], int]]


@dataclass(slots=True)
class Part:
    """Nodes that control may enter from anywhere, and those in `returns` where it goes back.

    `handles`: whether it is the handler of the errors of `routine`; `raises`: whether it hands them on to the caller.
    """

    first: int
    last: int = -1
    returns: list[int] = field(default_factory=list)
    routine: str = ""
    handles: bool = False
    raises: bool = False


class Ways:
    """The ways through a program on which some variables may change: calls of routines that leave them are passed by.

    Parameters
    ----------
    graph : Graph
        The graph of the program.
    """

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._hub = len(graph.followers)
        self._next: list[list[int]] = [list(nodes) for nodes in graph.followers]
        for _, before, behind in graph.calls:
            self._next[before].append(behind)
        self._before: list[list[int]] = [[] for _ in range(self._hub + 1)]
        for node, followers in enumerate(self._next):
            for follower in followers:
                self._before[follower].append(node)
        self._next.append([])
        owners = sorted((first, last, name) for name, (first, last, _) in graph.routines.items())
        self._owner: dict[int, str] = {n: name for first, last, name in owners for n in range(first, last + 1)}
        self._callers: dict[str, set[str]] = {}
        for name, before, _ in graph.calls:
            self._callers.setdefault(name, set()).add(self._owner.get(before, ""))
        self._anytime = self._reached(graph.handlers)
        self._link_errors()
        self._later: dict[int, list[int]] = {}
        self._earlier: dict[int, list[int]] = {}

    def _link_errors(self) -> None:
        """Link the places where an error may happen with the handlers, and with the calls behind which these go on.

        An error leaves routines, from wherever they are, up to a caller that handles it.
        """
        graph = self._graph
        if not graph.parts:
            return

        def link(node: int, follower: int) -> None:
            self._next[node].append(follower)
            self._before[follower].append(node)

        failed = {name: self._hub + 1 + k for k, name in enumerate(graph.routines)}
        self._next += [[] for _ in failed]
        self._before += [[] for _ in failed]
        for name, (first, last, _) in graph.routines.items():
            for node in range(first, last + 1):
                link(node, failed[name])
        parts = [(self._owner.get(first, ""), first, goes_back) for first, _, goes_back in graph.parts]
        going_back = {name for name, _, goes_back in parts if goes_back}
        for name, before, behind in graph.calls:
            caller = self._owner.get(before, "")
            if name in failed and caller in failed:
                link(failed[name], failed[caller])
            if name in failed and caller in going_back:
                link(failed[name], before)
                link(failed[name], behind)
        for name, first, _ in parts:
            if name in failed:
                link(failed[name], first)

    def _reached(self, names: Iterable[str]) -> set[str]:
        """Return routines with all that they call."""
        calls: dict[str, set[str]] = {}
        for name, before, _ in self._graph.calls:
            calls.setdefault(self._owner.get(before, ""), set()).add(name)
        found, waiting = set(names), list(names)
        while waiting:
            new = calls.get(waiting.pop(), set()) - found
            found |= new
            waiting += new
        return found

    def touch(self, nodes: Collection[int]) -> bool:
        """Take the variables that some nodes use or change; False where control may enter these at any time."""
        graph = self._graph
        self._later, self._earlier = {}, {}
        own = {self._owner.get(node, "") for node in nodes}
        within = any(first <= node <= last for first, last, _ in graph.parts for node in nodes)
        touched, waiting = set(own), list(own)
        while waiting:
            new = self._callers.get(waiting.pop(), set()) - touched
            touched |= new
            waiting += new
        if within or own & self._anytime:
            return False
        for name, before, behind in graph.calls:
            if name in touched and name in graph.routines:
                first, _, exits = graph.routines[name]
                self._unlink(before, behind)
                self._link(before, first)
                for node in exits:
                    self._link(node, behind)
        for names, behind in graph.aborted:
            for name in touched.intersection(names):
                first, last, _ = graph.routines[name]
                for node in range(first, last + 1):
                    self._link(node, behind)
        ends = [(graph.routines[name], name) for name in sorted(touched) if name in graph.routines]
        for (first, _, exits), name in ends:  # what is left from one start is there at the next
            if name in graph.starts or name not in self._callers:
                self._link(self._hub, first)
                for node in exits:
                    self._link(node, self._hub)
        return True

    def _link(self, node: int, follower: int) -> None:
        self._later.setdefault(node, list(self._next[node])).append(follower)
        self._earlier.setdefault(follower, list(self._before[follower])).append(node)

    def _unlink(self, node: int, follower: int) -> None:
        self._later.setdefault(node, list(self._next[node])).remove(follower)
        self._earlier.setdefault(follower, list(self._before[follower])).remove(node)

    def behind(self, node: int) -> list[int]:
        """Return the nodes to which control may go from one."""
        return self._later.get(node, self._next[node])

    def before(self, node: int) -> list[int]:
        """Return the nodes from which control may come to one."""
        return self._earlier.get(node, self._before[node])

    def is_start(self, node: int) -> bool:
        """Return whether control may come to a node from outside of the program."""
        return node in (0, self._hub)

    def counter(self, node: int) -> tuple[Counter, int, int] | None:
        """Return the counting loop that begins at a node, with its body and the node behind it."""
        return self._graph.loops.get(node)

    def heads(self) -> list[tuple[Counter, int]]:
        """Return the counting loops, each with the node at which it begins."""
        return [(counter, head) for head, (counter, _, _) in self._graph.loops.items()]
