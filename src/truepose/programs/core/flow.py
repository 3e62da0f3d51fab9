"""Follow the ways through a program, to find the tools and bases that may be in force at each motion.

A node is a piece of program between two changes, an edge is a way that control may take. Each node has the set of
values that may have reached it for $TOOL, $BASE, $IPO_MODE and FDAT_ACT. If the set has one value, that is in force. If
it has two, the value depends on the way through the program, and nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from truepose.programs.core.graph import Counter, Graph, Part
from truepose.programs.core.pieces import Piece, Section
from truepose.programs.core.state import NO_FDAT, NOWHERE, START, UNSET, FdatFrames, InForce, Shift, State


@dataclass(slots=True)
class _Node:
    changes: dict[str, frozenset[object]] = field(default_factory=dict)
    applies_fdat: bool = False
    begins: Shift | None = None
    ends: str = ""
    followers: list[int] = field(default_factory=list)

    @property
    def changes_state(self) -> bool:
        return bool(self.changes or self.applies_fdat or self.begins or self.ends)


@dataclass(slots=True)
class _Block:
    kind: str
    line: int
    entry: int
    exits: list[int] = field(default_factory=list)
    complete: bool = False
    branches: int = 0
    counter: Counter | None = None
    runs: bool = False


class BlockError(Exception):
    """A block that is closed without being open, or that is left open."""


class Flow:
    """The graph of one program, built statement by statement and then solved.

    The methods are called in the order of the text. `node` is the current node.
    """

    def __init__(self) -> None:
        self.node = 0
        self._nodes: list[_Node] = []
        self._blocks: list[_Block] = []
        self._routines: dict[str, tuple[int, list[int]]] = {}
        self._last: dict[str, int] = {}
        self._calls: list[tuple[str, int, int, str]] = []
        self._labels: dict[str, int] = {}
        self._gotos: list[tuple[str, int]] = []
        self._open: set[int] = set()
        self._exits: list[int] = []
        self._routine = ""
        self._parts: list[Part] = []
        self._interrupting = False
        self._interrupts: set[str] = set()
        self._errors_pass = False
        self.handlers: list[str] = []
        self.stepwise = False
        """Whether errors may leave a routine between any two statements, so that `step` separates them."""
        self.concurrent = False
        """Whether handlers run beside the program (threads), and do not only interrupt it."""
        self._started: list[tuple[str, int]] = []
        self.only_called: set[str] = set()
        """Routines at which control does not begin: those of libraries."""
        self._declared: list[tuple[str, int]] = []
        self._aborting: list[tuple[str, int | None]] = []
        self._aborts: set[str] = set()
        self._aborted: list[tuple[list[str], int]] = []
        self._callees: dict[str, set[str]] = {}
        self._left_by_handlers: frozenset[FdatFrames] = frozenset()
        self._beside: list[tuple[int, list[int]]] = []
        self.states: list[State] = []
        self.graph: Graph | None = None
        self._loops: dict[int, tuple[Counter, int, int]] = {}
        self._piece = Piece()
        self._moving: set[str] = set()
        self._called_in: dict[str, set[str]] = {}
        self._certain: list[tuple[int, int, int]] = []
        self._new()
        self._open.add(0)

    def _new(self, *before: int, piece: Piece | None = None) -> int:
        """Start a node behind some others; in a new piece where none is given."""
        self._nodes.append(_Node())
        self.node = len(self._nodes) - 1
        for node in before:
            self._nodes[node].followers.append(self.node)
        self._piece = piece or Piece()
        return self.node

    def _advance(self) -> int:
        """Start a node behind the current one, in the same piece."""
        return self._new(self.node, piece=self._piece)

    def step(self) -> None:
        """Separate the statements before and behind this, if errors are handled."""
        if self.stepwise:
            self._advance()

    def begin_routine(self, name: str, *, outside: bool) -> None:
        """Begin a routine; `outside` if other modules may call it."""
        if name in self._routines:
            raise BlockError(f"{name} is defined twice; give one another name")
        entry = self._new()
        self._routine, self._exits = name, []
        self._routines[name] = (entry, self._exits)
        self._labels, self._gotos = {}, []
        if outside:
            self._open.add(entry)
        self._advance()

    def end_routine(self) -> None:
        """End the routine."""
        if self._blocks:
            block = self._blocks[-1]
            raise BlockError(f"{block.kind} of line {block.line} is not closed")
        self._exits.append(self.node)
        for label, node in self._gotos:
            if label not in self._labels:
                raise BlockError(f"GOTO {label}: there is no such label in {self._routine or 'this program'}")
            self._nodes[node].followers.append(self._labels[label])
        self._gotos = []
        self._last[self._routine] = self.node
        self._close_part()
        self._interrupting = False
        self._new()

    def part(self, *, errors: bool = False, listed: bool = False) -> None:
        """Begin an error handler or another part that control may enter from anywhere; the body before it ends.

        `errors`: whether it handles the errors of the routine; `listed`: only some of them, which pass the handlers of
        called routines by.
        """
        self._close_part()
        self._exits.append(self.node)
        self._parts.append(Part(self._new(), routine=self._routine, handles=errors))
        self._errors_pass = self._errors_pass or listed

    def interrupt_program(self) -> None:
        """Mark the routine that begins here as one that an interrupt may call from anywhere."""
        self._interrupting = True
        self._interrupts.add(self._routine)
        self._parts.append(Part(self._new(self.node)))

    def resume(self) -> None:
        """Return to the place that control came from: RETRY and similar."""
        if self._parts and self._parts[-1].last < 0:
            self._parts[-1].returns.append(self.node)
        self._new()

    def fail(self, *, handled: bool) -> None:
        """Raise an error; `handled`: the routine has a handler, which may go on behind this statement."""
        if self._parts and self._parts[-1].last < 0 and self._parts[-1].handles:
            self._parts[-1].raises = True
        elif handled:
            return
        self._new()

    def _close_part(self) -> None:
        if self._parts and self._parts[-1].last < 0:
            self._parts[-1].last = self.node
            self._parts[-1].returns += [self.node] if self._interrupting else []

    def change(self, **values: object) -> None:
        """Set tool, base, ipo or fdat to one value from here on."""
        self._advance()
        self._nodes[self.node].changes = {name: frozenset([value]) for name, value in values.items()}

    def apply_fdat(self) -> None:
        """Take tool, base and ipo from FDAT_ACT."""
        self._advance()
        self._nodes[self.node].applies_fdat = True

    def shift(self, kind: str, text: str) -> None:
        """Begin a shift of motions at run time; see `Shift`."""
        self._advance()
        self._nodes[self.node].begins = Shift(kind, text)

    def unshift(self, kind: str) -> None:
        """End all shifts of a kind."""
        self._advance()
        self._nodes[self.node].ends = kind

    def call(self, name: str, text: str) -> None:
        """Call a subprogram; `text` is the reason why tool and base are unknown if it is not in this program."""
        before = self.node
        after = self._new(piece=self._behind([name]))
        self._calls.append((name, before, after, text))

    def start(self, name: str) -> None:
        """Let a routine of this program run at any time from here on: an interrupt handler or a thread."""
        self._started.append((name, self.node))

    def handle_if_reached(self, name: str) -> None:
        """Take a routine as a handler if control may come here."""
        self._declared.append((name, self.node))

    def may_abort(self, name: str, *, anywhere: bool) -> None:
        """Let a handler abort what this routine calls (`anywhere`: what any routine calls), if it has `abort`."""
        self._aborting.append((name, None if anywhere else self.node))

    def abort(self) -> None:
        """Leave this handler, and all routines that it interrupted up to the one that declared it: RESUME."""
        self._aborts.add(self._routine)
        self.leave()

    def call_one_of(self, names: list[str]) -> None:
        """Call one of several subprograms of this program, or none."""
        before = self.node
        after = self._new(before, piece=self._behind(names))
        self._calls += [(name, before, after, "") for name in names]

    def stop(self) -> None:
        """End the program, or leave it by an error; nothing follows."""
        self._new()

    def begin(self, kind: str, line: int, counter: Counter | None = None, *, runs: bool = False) -> None:
        """Open IF, SWITCH or a loop; one that counts has a counter, and `runs` if that lets it turn at least once."""
        before = self.node
        entry = self._advance()
        if kind not in ("IF", "SWITCH"):
            before = entry
            self._new(entry)  # the body; the loop comes back to the node before it
        self._blocks.append(_Block(kind, line, before, counter=counter, runs=runs))

    def branch(self, kind: str, *, last: bool) -> None:
        """Begin ELSE (last), CASE, or DEFAULT (last)."""
        block = self._top(kind, "IF" if kind == "ELSE" else "SWITCH")
        if block.kind == "IF" or block.branches:
            block.exits.append(self.node)
        block.branches += 1
        block.complete = block.complete or last
        self._new(block.entry)

    def decide(self) -> None:
        """Let the branches that follow begin here, where the condition of this one was evaluated."""
        block = self._blocks[-1]
        if self._nodes[block.entry].followers[-1] != self.node:  # it called functions
            block.entry = self.node
            self._advance()

    def end(self, kind: str, opener: str) -> None:
        """Close a block."""
        block = self._top(kind, opener)
        self._blocks.pop()
        last = self.node
        if opener in ("IF", "SWITCH"):
            self._new(last, *block.exits, *([] if block.complete else [block.entry]))
        else:
            self._nodes[last].followers.append(block.entry)
            # FOR and WHILE may run not at all; LOOP ends by EXIT only, yet what follows it is reached by text
            self._new(block.entry, *block.exits)
            if block.runs:
                self._certain.append((block.entry, last, self.node))
            if block.counter is not None:
                self._loops[block.entry] = (block.counter, block.entry + 1, self.node)

    def _top(self, kind: str, opener: str) -> _Block:
        if not self._blocks or self._blocks[-1].kind != opener:
            raise BlockError(f"{kind} without {opener}")
        return self._blocks[-1]

    @property
    def routines(self) -> Iterable[str]:
        """Return the names of the routines."""
        return self._routines

    def motion(self) -> Section:
        """Return where a motion here stands, and note that the robot moves in the routine.

        The number of the section changes where a routine or a part of one begins.
        """
        self._moving.add(self._routine)
        return Section(len(self._routines) + len(self._parts), self._piece)

    def may_move(self) -> None:
        """Let the robot move here as this program does not show."""
        self._moving.add(self._routine)
        self._piece = Piece()

    def _behind(self, names: list[str]) -> Piece:
        """Return the piece behind a call of routines."""
        self._called_in.setdefault(self._routine, set()).update(names)
        return Piece(self._piece, names, self._moves)

    def _moves(self, name: str) -> bool:
        """Return whether the robot may move in a routine; it may in one that is not in this program."""
        found, waiting = {name}, [name]
        while waiting:
            one = waiting.pop()
            if one in self._moving or one not in self._routines:
                return True
            new = self._called_in.get(one, set()) - found
            found |= new
            waiting += new
        return False

    @property
    def counters(self) -> tuple[Counter, ...]:
        """Return the counters of the open loops."""
        return tuple([block.counter for block in self._blocks if block.counter is not None])

    @property
    def counter(self) -> Counter | None:
        """Return the counter of the innermost block; None where it does not count."""
        return self._blocks[-1].counter if self._blocks else None

    @property
    def innermost(self) -> str:
        """Return the opening word of the innermost block; empty outside all blocks."""
        return self._blocks[-1].kind if self._blocks else ""

    def exit(self, *, maybe: bool = False) -> None:
        """Leave the innermost loop; `maybe`: or go on, depending on a condition."""
        for block in reversed(self._blocks):
            if block.kind not in ("IF", "SWITCH"):
                block.exits.append(self.node)
                if not maybe:
                    self._new()
                break

    def next_turn(self) -> None:
        """Go on with the next turn of the innermost loop."""
        for block in reversed(self._blocks):
            if block.kind not in ("IF", "SWITCH"):
                self._nodes[self.node].followers.append(block.entry)
                self._new()
                break

    def leave(self) -> None:
        """Leave the routine: RETURN or RESUME."""
        self._exits.append(self.node)
        if self._interrupting:
            self._parts[-1].returns.append(self.node)
        self._new()

    def again(self) -> None:
        """Begin the current routine again: a main program runs in cycles."""
        for node in [*self._exits, self.node]:
            self._nodes[node].followers.append(self._routines[self._routine][0])

    def label(self, name: str) -> None:
        """Note a target of GOTO."""
        self._labels[name] = self._new(self.node)

    def goto(self, name: str) -> None:
        """Jump to a label of the routine."""
        self._gotos.append((name, self.node))
        self._new()

    def may_go(self, name: str) -> None:
        """Jump to a label of the routine, or not, depending on a condition."""
        self._gotos.append((name, self.node))
        self._advance()

    def solve(self) -> State:
        """Follow all ways to the end; return the values that interrupt handlers may set, which count everywhere."""
        self.graph = self._graph()
        for entry, last, behind in self._certain:  # what is in force behind it was so at its end
            self._nodes[entry].followers.remove(behind)
            self._nodes[last].followers.append(behind)
        called, changing = set(), self._changing()
        for name, before, after, text in self._calls:
            if name in self._routines:
                entry, exits = self._routines[name]
                called.add(entry)
                self._nodes[before].followers.append(entry)
                # one that changes nothing hands back to each caller what that caller had
                for node in exits if name in changing else [before]:
                    self._nodes[node].followers.append(after)
            else:
                self._nodes[before].followers.append(after)
                if text:
                    unknown = InForce("call", text)
                    frames = FdatFrames(unknown, unknown, "BASE")
                    self._nodes[after].changes = {
                        "tool": frozenset([unknown]), "base": frozenset([unknown]), "fdat": frozenset([frames])
                    }  # fmt: skip
        self._connect_errors(changing)
        self._connect_parts(changing)
        self._connect_aborted(changing)
        self._handle_reached()
        first = self._open | {entry for entry, _ in self._routines.values()} - called
        self._follow(first)
        ambient = self._ambient()
        self._left_by_handlers = ambient.fdat
        started = self._connect_started()
        if started or ambient.fdat:
            self._follow(first - (started - self._open))
        for others, nodes in self._beside:  # what others set meanwhile may be in force anywhere in a thread
            for node in nodes:
                self.states[node] = self.states[node].join(self.states[others])
        return ambient

    def _connect_aborted(self, changing: set[str]) -> None:
        """Connect the nodes of routines that a handler may abort with what follows their calls."""
        for handler, declared in self._aborting if self._aborts else ():
            if handler not in self._routines or self._aborts.isdisjoint(self._called_by(handler)):
                continue
            inside = [range(len(self._nodes))] if declared is None else map(self._nodes_of, self._routines)
            (here,) = [nodes for nodes in inside if declared is None or declared in nodes] or [range(0)]
            hubs: dict[str, int] = {}
            for name, before, after, _ in self._calls:
                if before in here and name in self._routines:
                    names = self._called_by(name)
                    self._aborted.append((sorted(names), after))
                    if name not in hubs:
                        hubs[name] = len(self._nodes)
                        self._nodes.append(_Node())
                        for node in (node for one in names & changing for node in self._nodes_of(one)):
                            self._nodes[node].followers.append(hubs[name])
                    self._nodes[hubs[name]].followers.append(after)

    def _graph(self) -> Graph:
        """Return the ways through the program before calls are connected."""
        ends = {name: self._last.get(name, len(self._nodes) - 1) for name in self._routines}
        return Graph(
            [list(node.followers) for node in self._nodes],
            [(name, before, after) for name, before, after, _ in self._calls],
            {name: (entry, ends[name], exits) for name, (entry, exits) in self._routines.items()},
            {name for name, (entry, _) in self._routines.items() if entry in self._open},
            [(part.first, part.last, bool(part.returns)) for part in self._parts],
            {*self.handlers, *self._interrupts, *(name for name, _ in self._started)},
            dict(self._loops),
            self._aborted,
        )

    def _follow(self, first: set[int]) -> None:
        """Follow all ways from some nodes until no new value arrives."""
        self.states = [NOWHERE] * len(self._nodes)
        before_node = [NOWHERE] * len(self._nodes)
        waiting = [(node, START) for node in first]
        while waiting:
            node, state = waiting.pop()
            joined = before_node[node].join(state)
            if joined == before_node[node]:
                continue
            before_node[node] = joined
            self.states[node] = out = self._transfer(node, joined)
            waiting += [(follower, out) for follower in self._nodes[node].followers]

    def _connect_started(self) -> set[int]:
        """Connect the routines of `start` with every node that may follow; return their entries.

        The way back is not followed: the values that they set for others are in `_ambient`.
        """
        entries = {name: self._routines[name][0] for name, _ in self._started if name in self._routines}
        inner = dict(entries)
        if self.concurrent:
            for name, entry in entries.items():
                inner[name] = self._new()
                self._nodes[self.node].followers.append(entry)
                self._beside.append((self.node, self._run_by(name)))
        done: set[tuple[int, int]] = set()
        size = -1
        while size != len(done):  # one that interrupts another follows what the other follows
            size = len(done)
            for name, node in self._started:
                if name in entries:
                    new = {(other, inner[name]) for other in self._reach(node)} - done
                    for other, entry in new:
                        self._nodes[other].followers.append(entry)
                    done |= new
        return set(entries.values())

    def reached(self) -> set[int]:
        """Return the nodes that control may reach without beginning in a routine of `only_called`."""
        names = (self._routines.keys() - self.only_called) | (set(self.handlers) & self._routines.keys())
        return self._reached_from(self._open | {self._routines[name][0] for name in names})

    def _handle_reached(self) -> None:
        """Take the handlers that reached statements declare."""
        waiting = self._declared
        while waiting:
            nodes = self.reached()
            now = [name for name, node in waiting if node in nodes]
            waiting = [one for one in waiting if one[1] not in nodes]
            self.handlers += now
            if not now:
                break

    def _reached_from(self, nodes: set[int]) -> set[int]:
        found, waiting = set(nodes), list(nodes)
        while waiting:
            new = set(self._nodes[waiting.pop()].followers) - found
            found |= new
            waiting += new
        return found

    def _called_by(self, name: str) -> set[str]:
        """Return a routine and all that it calls."""
        if not self._callees:
            owner = {node: one for one in self._routines for node in self._nodes_of(one)}
            for called, before, _, _ in self._calls:
                if called in self._routines:
                    self._callees.setdefault(owner.get(before, ""), set()).add(called)
        found, waiting = {name}, [name]
        while waiting:
            new = self._callees.get(waiting.pop(), set()) - found
            found |= new
            waiting += new
        return found

    def _nodes_of(self, name: str) -> range:
        """Return the nodes of a routine."""
        return range(self._routines[name][0], self._last.get(name, len(self._nodes) - 1) + 1)

    def _run_by(self, name: str) -> list[int]:
        """Return the nodes of a routine and of all that it calls."""
        return [node for one in sorted(self._called_by(name)) for node in self._nodes_of(one)]

    def _reach(self, node: int) -> set[int]:
        """Return a node and all that control may reach from it."""
        return self._reached_from({node})

    def _changing(self) -> set[str]:
        """Return the routines of this program that may change a value in force or start others, also by a call."""
        ranges = {name: (entry, self._last.get(name, len(self._nodes))) for name, (entry, _) in self._routines.items()}
        changing = {
            name
            for name, (first, last) in ranges.items()
            if any(node.changes_state for node in self._nodes[first : last + 1])
            or any(first <= node <= last for _, node in self._started)
        }
        owners = [
            (name, called, bool(text) and called not in self._routines)
            for called, before, _, text in self._calls
            for name, (first, last) in ranges.items()
            if first <= before <= last
        ]
        changing |= {name for name, _, unknown in owners if unknown}
        size = -1
        while size != len(changing):
            size = len(changing)
            changing |= {name for name, called, _ in owners if called in changing}
        return changing

    def _connect_errors(self, changing: set[str]) -> None:
        """Connect what an error may leave, with values changed, with the calls of routines that handle it and go on."""
        handlers = {part.routine: part for part in self._parts if part.handles}
        if not any(part.returns for part in handlers.values()):
            return

        def inside(node: int, part: Part | None) -> bool:
            return part is not None and part.first <= node <= part.last

        ranges = {name: (self._routines[name][0], self._last[name]) for name in changing}
        left = {name: len(self._nodes) + k for k, name in enumerate(ranges)}
        self._nodes += [_Node() for _ in left]
        kept = {name for name, part in handlers.items() if not (part.raises or self._errors_pass)}
        for name, (first, last) in ranges.items():
            for node in range(first, last + 1):
                here = inside(node, handlers.get(name))
                if self._nodes[node].changes_state if here else name not in kept:
                    self._nodes[node].followers.append(left[name])
        owners = {
            node: name for name, (entry, _) in self._routines.items() for node in range(entry, self._last[name] + 1)
        }
        for called, before, after, _ in self._calls:
            if called not in left or (owner := owners.get(before)) is None:
                continue
            handler = handlers.get(owner)
            here = inside(before, handler)
            if owner in left and (here or owner not in kept):
                self._nodes[left[called]].followers.append(left[owner])
            if handler is not None and handler.returns and not here:
                self._nodes[left[called]].followers += [self._routines[called][0], after]

    def _connect_parts(self, changing: set[str]) -> None:
        """Connect every node with the parts, and the parts with every node if they change a value in force."""
        if not self._parts:
            return
        nodes, n = self._nodes, len(self._nodes)
        nodes += [_Node(followers=[part.first for part in self._parts]), _Node(followers=list(range(n)))]
        for node in nodes[:n]:
            node.followers.append(n)
        for part in self._parts:
            calls = any(name in changing and part.first <= before <= part.last for name, before, _, _ in self._calls)
            if calls or any(node.changes_state for node in nodes[part.first : part.last + 1]):
                for back in part.returns:
                    nodes[back].followers.append(n + 1)

    def _transfer(self, node: int, state: State) -> State:
        piece = self._nodes[node]
        if piece.begins:
            return state._replace(shifts=state.shifts | {piece.begins})
        if piece.ends:
            return state._replace(shifts=frozenset(shift for shift in state.shifts if shift.kind != piece.ends))
        if piece.applies_fdat:
            fdats = state.fdat | self._left_by_handlers
            return State(
                frozenset(f.tool for f in fdats),
                frozenset(f.base for f in fdats),
                frozenset(f.ipo for f in fdats),
                state.fdat,
                state.shifts,
            )
        return state._replace(**piece.changes) if piece.changes else state  # type: ignore[arg-type]

    def _ambient(self) -> State:
        tool: set[InForce] = set()
        base: set[InForce] = set()
        ipo: set[str] = set()
        fdat: set[FdatFrames] = set()
        shifts: set[Shift] = set()
        for name in dict.fromkeys(self.handlers):
            if name not in self._routines:
                unknown = InForce("call", f"the interrupt program {name}() is not in this file")
                tool.add(unknown)
                base.add(unknown)
                continue
            for last_node in self._routines[name][1]:
                tool |= self.states[last_node].tool - {UNSET}
                base |= self.states[last_node].base - {UNSET}
                ipo |= self.states[last_node].ipo - {"BASE"}
                fdat |= self.states[last_node].fdat - {NO_FDAT}
            nodes = [self._nodes[node] for node in self._run_by(name)]
            if self.concurrent or self._aborts:  # what it does not leave is seen by threads, and if it is aborted
                for node in nodes:
                    tool |= node.changes.get("tool", frozenset())  # type: ignore[arg-type]
                    base |= node.changes.get("base", frozenset())  # type: ignore[arg-type]
                    ipo |= node.changes.get("ipo", frozenset()) - {"BASE"}  # type: ignore[arg-type]
                    fdat |= node.changes.get("fdat", frozenset())  # type: ignore[arg-type]
            # motions elsewhere go on while a handler or a thread runs: what it ends itself counts, too
            shifts |= {node.begins for node in nodes if node.begins}
        return State(frozenset(tool), frozenset(base), frozenset(ipo), frozenset(fdat), frozenset(shifts))
