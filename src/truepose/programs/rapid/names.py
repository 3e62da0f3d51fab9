"""RAPID's names: robtargets, tools, workobjects and routines, each seen by those that may see it.

What a module declares without LOCAL belongs to the task: every other module may use it. A LOCAL name hides one of the
task, a name of a routine hides both.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from truepose.programs.core.flow import Flow
from truepose.programs.core.points import Frame, Place, Point, Problem, Use
from truepose.programs.core.targets import Key, ReadOptions
from truepose.programs.rapid.syntax import Parameter, Token


@dataclass(slots=True, eq=False)
class Variable:
    """A robtarget or an array of them; `elements` by index in the text's order."""

    name: str
    place: Place
    kind: str
    is_global: bool = False
    elements: dict[tuple[int, ...], Point] = field(default_factory=dict)
    offset: float = 0.0
    offset_place: Place = 0
    offset_known: bool = True


class Datum(NamedTuple):
    """A tool or a workobject that a module declares, and why it cannot be used."""

    kind: str
    frame: Frame
    problem: Problem | None
    place: Place


class Routine(NamedTuple):
    """A routine; `key` tells LOCAL ones of one name apart."""

    key: str
    kind: str
    parameters: tuple[Parameter, ...]
    place: Place


class Move(NamedTuple):
    """A motion to a point, and where in the program's flow."""

    point: Point
    use: Use
    node: int


class Read(NamedTuple):
    """Something that reads a point without moving to it."""

    variable: Variable
    place: Place
    how: str


@dataclass(eq=False)
class Scope:
    """Names that are declared in one place: in the task, in a module with LOCAL, or in a routine.

    `others` are names of a routine whose value only the run time knows: parameters, tools, workobjects.
    """

    points: dict[str, Variable] = field(default_factory=dict)
    frames: dict[str, Datum] = field(default_factory=dict)
    routines: dict[str, Routine] = field(default_factory=dict)
    others: set[str] = field(default_factory=set)


@dataclass(eq=False)
class Task:
    """What the modules of a task have in common.

    Attributes
    ----------
    options : ReadOptions
    whole : bool
        The modules are all that there are.
    named : bool
        There are several files, so that places name them.
    files : frozenset of str
        Names of the files, in lower case.
    scope : Scope
        What every module sees.
    routines : list of Routine
        All of them, LOCAL ones included.
    points : list of Point
        In the order of reading.
    changed : dict of ("tool" or "base", key or None) to place
        Where a tool or a workobject may be changed; None: some of them.
    loads : str
        How the task may take up modules that are not here; empty if it does not.
    """

    options: ReadOptions
    whole: bool
    named: bool = False
    files: frozenset[str] = frozenset()
    flow: Flow = field(default_factory=Flow)
    scope: Scope = field(default_factory=Scope)
    routines: list[Routine] = field(default_factory=list)
    variables: list[Variable] = field(default_factory=list)
    points: list[Point] = field(default_factory=list)
    circles: list[list[Point]] = field(default_factory=list)
    moves: list[Move] = field(default_factory=list)
    reads: list[Read] = field(default_factory=list)
    read_by_name: list[tuple[str, Place]] = field(default_factory=list)
    changed: dict[tuple[str, Key | None], Place] = field(default_factory=dict)
    loads: str = ""

    def procedures(self, name: str, *, exact: bool) -> list[str]:
        """Return the keys of the procedures that a late-bound call may mean."""
        bare = name.rpartition(":")[2]
        return [
            routine.key
            for routine in self.routines
            if routine.kind == "PROC" and (_bare(routine.key) == bare if exact else _bare(routine.key).startswith(bare))
        ]


def _bare(key: str) -> str:
    return key.rpartition(":")[2]


def late_bound(expression: list[Token]) -> tuple[str, bool]:
    """Return what is known of the name in a late-bound call: its beginning, and whether that is all of it."""
    if expression and expression[0].kind == "text":
        return expression[0].text[1:-1].upper(), len(expression) == 1
    return "", False
