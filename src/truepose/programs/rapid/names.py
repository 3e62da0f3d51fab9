"""RAPID's names: robtargets, tools, workobjects and routines, and the statements that may see them.

Data that a module declares without LOCAL belong to the task: every other module may use them. A LOCAL name hides one of
the task, a name of a routine hides both.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from truepose.programs.core.flow import Flow
from truepose.programs.core.forms import Lines
from truepose.programs.core.points import FileLine, Frame, Place, Point, Problem, Use
from truepose.programs.core.program import Key, ReadOptions, frame_key
from truepose.programs.core.source import Source, shown
from truepose.programs.rapid import syntax
from truepose.programs.rapid.columns import FoundGroup, NamedTargets, prefix_of
from truepose.programs.rapid.derived import NumberVariable, RapidDerivations, Reach
from truepose.programs.rapid.syntax import Argument, RoutineParameter, Token
from truepose.programs.rapid.words import NO_FUNCTIONS, READING_FUNCTIONS


@dataclass(slots=True, eq=False)
class RobtargetVariable:
    """A robtarget or a jointtarget, or an array of them.

    Attributes
    ----------
    name : str
        The name.
    place : Place
        The place of the declaration.
    kind : {"CONST", "PERS", "VAR"}
        The kind of data.
    reach : {"routine", "module", "task", "controller"}
        The code that sees it: PERS without TASK or LOCAL is one variable in all tasks.
    elements : dict of tuple of int to Point
        The elements by index, in the order of the text; the index is empty where it is no array.
    joints : bool
        Whether it is a jointtarget.
    array : bool
        Whether it is an array.
    """

    name: str
    place: Place
    kind: str
    reach: Reach = "task"
    elements: dict[tuple[int, ...], Point] = field(default_factory=dict)
    joints: bool = False
    array: bool = False


class Datum(NamedTuple):
    """A tool or a workobject that a module declares.

    Attributes
    ----------
    kind : {"tooldata", "wobjdata"}
        The type.
    frame : Frame
        The name and the value.
    problem : Problem, optional
        The reason why it cannot be used.
    place : Place
        The place of the declaration.
    shared : bool
        Whether it is one variable in all tasks: PERS without TASK or LOCAL.
    """

    kind: str
    frame: Frame
    problem: Problem | None
    place: Place
    shared: bool = False


class Routine(NamedTuple):
    """A routine; `key` distinguishes LOCAL routines of one name."""

    key: str
    kind: str
    parameters: tuple[RoutineParameter, ...]
    place: Place


class RapidMotion(NamedTuple):
    """A motion to a point, with its place in the program's flow."""

    point: Point
    use: Use
    node: int


class Handed(NamedTuple):
    """A tool or workobject that a call hands over as PERS, which motions need; the routine may change it.

    Attributes
    ----------
    name, caller : str
        Its name, and the calling routine where it is a parameter of that.
    parameter, called : str
        The name of the parameter and the called routine.
    place : Place
        The place of the call.
    """

    name: str
    caller: str
    parameter: str
    called: str
    place: Place


class Read(NamedTuple):
    """A statement that reads a point without moving to it."""

    variable: RobtargetVariable
    place: Place
    how: str


@dataclass(eq=False)
class Scope:
    """The names that are declared in one place: in the task, in a module with LOCAL, or in a routine.

    `others` are names that hide those of outer scopes: a routine's parameters and data, LOCAL data of a module.
    `numbers` are the num among them that may shift points.
    """

    points: dict[str, RobtargetVariable] = field(default_factory=dict)
    columns: list[NamedTargets] = field(default_factory=list)
    frames: dict[str, Datum] = field(default_factory=dict)
    routines: dict[str, Routine] = field(default_factory=dict)
    others: set[str] = field(default_factory=set)
    numbers: dict[str, NumberVariable] = field(default_factory=dict)
    _seen: tuple[int, set[str]] = (0, set())

    def point(self, name: str) -> RobtargetVariable | None:
        """Return the robtarget of a name in upper case."""
        found = self.points.get(name)
        for columns in self.columns if found is None else ():
            if (row := columns.row(name)) >= 0:
                columns.take(row)
                return self.points[name]
        return found

    def hides(self, prefix: str) -> bool:
        """Return whether it declares a name that consists of a prefix and a number."""
        if self._seen[0] != (size := len(self.points) + len(self.others)):
            self._seen = size, {prefix_of(name) for name in (*self.points, *self.others)}
        return prefix in self._seen[1] or any(prefix in columns.prefixes for columns in self.columns)


@dataclass(eq=False)
class RapidTask:
    """Data that the modules of a task share.

    Attributes
    ----------
    options : ReadOptions
        The options of reading.
    whole : bool
        Whether all modules of the task are read.
    unread : str
        The modules of the task that cannot be read, in words; with them it is not whole.
    hidden : str
        Modules that came with options of the controller and cannot be read, in words. They do not name data of users.
    named : bool
        Whether there are several files, so that places name them.
    files : frozenset of str
        The names of the files, in lower case.
    scope : Scope
        The names that every module sees.
    routines : list of Routine
        All routines, LOCAL ones included.
    points : list of Point
        The points in the order of reading.
    runs : list of (Point, Lines)
        The runs of motions of one form, each with its first point, which is not among `points`.
    columns : list of (NamedTargets, Scope)
        The robtargets of each module that are not among `points`, because motions of runs alone name them.
    groups : list of FoundGroup
        The same, once all is read.
    kinds : dict of (Use, int) to int
        The number of each kind of motion to these, by one of them in line 0 and its node in the flow.
    changed : dict of ("tool" or "base", key or None) to place
        The places where a tool or a workobject may be changed; None: some of them.
    loads : str
        The statement that may load modules that are not at hand; empty if there is none.
    sets_by_name : Place, optional
        A statement that may write any data, because it names them at run time.
    run_by_motions : set of (str, bool)
        The procedures that motions run (``MoveLSync``), by the known beginning of their names and whether that is all.
    handed : list of Handed
        The tools and workobjects that calls hand over as PERS.
    changed_parameters : set of (str, str)
        The parameters that their routines change: routine and name.
    aliases : dict of str
        The types that have other names, by these.
    """

    options: ReadOptions
    whole: bool
    unread: str = ""
    hidden: str = ""
    named: bool = False
    files: frozenset[str] = frozenset()
    flow: Flow = field(default_factory=Flow)
    scope: Scope = field(default_factory=Scope)
    routines: list[Routine] = field(default_factory=list)
    variables: list[RobtargetVariable] = field(default_factory=list)
    points: list[Point] = field(default_factory=list)
    runs: list[tuple[Point, Lines]] = field(default_factory=list)
    columns: list[tuple[NamedTargets, Scope]] = field(default_factory=list)
    groups: list[FoundGroup] = field(default_factory=list)
    circles: list[list[Point]] = field(default_factory=list)
    moves: list[RapidMotion] = field(default_factory=list)
    reads: list[Read] = field(default_factory=list)
    read_by_name: list[tuple[str, Place]] = field(default_factory=list)
    changed: dict[tuple[str, Key | None], Place] = field(default_factory=dict)
    loads: str = ""
    sets_by_name: Place | None = None
    run_by_motions: set[tuple[str, bool]] = field(default_factory=set)
    handed: list[Handed] = field(default_factory=list)
    changed_parameters: set[tuple[str, str]] = field(default_factory=set)
    aliases: dict[str, str] = field(default_factory=dict)
    kinds: dict[tuple[Use, int], int] = field(default_factory=dict)

    _parameters: dict[tuple[str, str], RobtargetVariable] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.derivations = RapidDerivations(self.flow)

    def change_handed(self) -> None:
        """Note the tools and workobjects that routines change through a parameter, once all is read."""
        size = -1
        while size != len(self.changed_parameters):
            size = len(self.changed_parameters)
            for one in self.handed:
                if (one.called, one.parameter) in self.changed_parameters and one.caller:
                    self.changed_parameters.add((one.caller, one.name))
        for one in self.handed:
            if (one.called, one.parameter) in self.changed_parameters and not one.caller:
                self.change_frame(one.name, one.place)

    def change_frame(self, name: str, place: Place) -> None:
        """Note that a tool or workobject may change."""
        for kind in ("tool", "base"):
            self.changed.setdefault((kind, frame_key(name)), place)

    def type_of(self, name: str) -> str:
        """Return the type that a name stands for."""
        for _ in range(len(self.aliases)):
            name = self.aliases.get(name, name)
        return name

    def parameter(self, routine: str, name: str) -> RobtargetVariable:
        """Return the robtarget of a routine's parameter, which is a copy of the argument."""
        if (routine, name) not in self._parameters:
            self._parameters[routine, name] = RobtargetVariable(name, 0, "VAR", "routine")
        return self._parameters[routine, name]

    def of_name(self, name: str) -> Iterator[RobtargetVariable]:
        """Yield the robtargets of a name, whichever module or routine declares them; all where it is empty."""
        for points, _ in self.columns:
            if not name:
                points.take_all()
            elif (row := points.row(name)) >= 0:
                points.take(row)
        yield from [variable for variable in self.variables if name in ("", variable.name.upper())]

    def marks(self) -> tuple[int, ...]:
        """Return how much has been read, to see what a statement adds; points and motions first."""
        others = len(self.circles), len(self.reads), len(self.read_by_name), len(self.changed), len(self.loads)
        return len(self.points), len(self.moves), self.flow.node, *others

    def procedures(self, name: str, *, exact: bool) -> list[str]:
        """Return the keys of the procedures that a late-bound call may mean."""
        return [one.key for one in self.routines if one.kind == "PROC" and may_mean(name, one.key, exact=exact)]


def may_mean(name: str, key: str, *, exact: bool) -> bool:
    """Return whether a late-bound call of a name may mean the routine of a key."""
    bare, known = name.rpartition(":")[2], key.rpartition(":")[2]
    return known == bare if exact else known.startswith(bare)


def late_bound(expression: list[Token]) -> tuple[str, bool]:
    """Return the known beginning of the name in a late-bound call, and whether that is the whole name."""
    if expression and expression[0].kind == "text":
        return expression[0].text[1:-1].upper(), len(expression) == 1
    return "", False


class ModuleNames:
    """The names that one module sees, and the uses that its statements make of them.

    Parameters
    ----------
    source : Source
        The file of the module.
    task : RapidTask
        The task that it belongs to.

    Attributes
    ----------
    own : Scope
        The names that the module declares with LOCAL.
    inner : Scope
        The names of the routine that is being read.
    counters : list of NumberVariable
        The counters of the open loops.
    routine : str
        The key of the routine that is being read.
    taken : set of int
        The places of the words of the current statement that a rule has understood.
    """

    def __init__(self, source: Source, task: RapidTask) -> None:
        self.source, self.task = source, task
        self.own, self.inner = Scope(), Scope()
        self.counters: list[NumberVariable] = []
        self.routine = ""
        self.taken: set[int] = set()

    def take(self, items: Iterable[Token]) -> None:
        """Note that a rule has understood code."""
        self.taken.update([token.start for token in items])

    def take_rest(self, items: list[Token], line: int) -> None:
        """Distrust all that code names and that no rule has understood: it is read, and may be written or called."""
        for i, token in enumerate(items):
            if token.kind != "word" or token.start in self.taken or (i > 0 and items[i - 1].text in (".", "\\")):
                continue
            self.read_by([token], line, "named in code that is not understood")
            self.write(token.text, line, "named in code that is not understood")
            self.change(token.text, line)
            if (routine := self.find_routine(token.text)) is not None:
                self.task.flow.call_one_of([routine.key])

    def place(self, line: int) -> Place:
        """Return a line, with the file's name if the task has several."""
        return FileLine(self.source.path.name, line) if self.task.named else line

    def find(self, name: str) -> RobtargetVariable | None:
        """Return the robtarget of a name."""
        for scope in (self.inner, self.own, self.task.scope):
            if (variable := scope.point(name)) is not None:
                return variable
            if name in scope.others:
                return None
        return None

    def find_number(self, name: str) -> NumberVariable | None:
        """Return the num of a name."""
        counters = [counter for counter in self.counters if counter.name.upper() == name]
        if counters:
            return counters[-1]
        for scope in (self.inner, self.own, self.task.scope):
            if (number := scope.numbers.get(name)) is not None:
                # other modules that are not at hand may change it
                unseen = scope is self.task.scope and not self.task.whole and number.kind != "CONST"
                return None if unseen else number
            if name in scope.others:
                return None
        return None

    def hand_numbers(self, items: list[Token]) -> None:
        """Note that code may change the num that it names."""
        for token in items:
            number = self.find_number(token.text) if token.kind == "word" else None
            if number is not None and number.kind != "CONST":
                number.handed = True
                self.task.derivations.escape_number(number)

    def find_frame(self, name: str) -> Datum | None:
        """Return the tool or workobject of a name, as a module declares it."""
        return self.own.frames.get(name) or self.task.scope.frames.get(name)

    def is_data(self, name: str) -> bool:
        """Return whether a name is that of a robtarget, num, tool or workobject."""
        return any(find(name) is not None for find in (self.find, self.find_number, self.find_frame))

    def is_hidden(self, name: str) -> bool:
        """Return whether the name of a tool or workobject is one of the routine, or of other LOCAL data."""
        return name in self.inner.others or (name in self.own.others and name not in self.own.frames)

    def find_routine(self, name: str) -> Routine | None:
        """Return the routine of a name."""
        return self.own.routines.get(name) or self.task.scope.routines.get(name)

    def is_inner(self, name: str) -> bool:
        """Return whether a name is of the routine that is being read, and no robtarget."""
        return name in self.inner.others

    def read_by(self, items: list[Token], line: int, how: str = "read by arithmetic") -> None:
        """Note the points that code reads; `call_in` notes the functions."""
        self.take(items)
        for i, token in enumerate(items):
            if token.kind != "word" or (i > 0 and items[i - 1].text in (".", "\\")):
                continue
            if i > 1 and items[i - 2].text == "DIM":
                continue  # the size of an array, not its values
            if (variable := self.find(token.text)) is not None:
                self.task.reads.append(Read(variable, self.place(line), how))
                self.task.derivations.escape(variable, self.place(line), how)

    def call_in(self, items: list[Token], line: int) -> None:
        """Note the functions that code calls, in their order, and what they may write."""
        i = 0
        while i + 1 < len(items):
            name = items[i]
            i += 1
            if name.kind != "word" or items[i].text != "(" or name.text in NO_FUNCTIONS:
                continue
            inside = _in_brackets(items[i:])
            self.call_in(inside, line)
            routine = self.find_routine(name.text)
            if routine is not None:
                self.task.flow.step()
                self.task.flow.call(routine.key, "")
                self.take([name])
            if routine is not None or name.text not in READING_FUNCTIONS:
                self.hand_over(routine, syntax.arguments(inside), line)
            i += len(inside) + 1

    def hand_over(self, routine: Routine | None, arguments: list[Argument], line: int) -> None:
        """Note the names that a routine is given and may change: tools and workobjects among them."""
        required = [p for p in routine.parameters if not p.optional] if routine else []
        named = {p.name: p for p in routine.parameters} if routine else {}
        in_order = not any(argument.required for argument in arguments)
        place = 0
        for argument in arguments:
            parameter = named.get(argument.name)
            if not argument.name:
                parameter = required[place] if in_order and place < len(required) else None
                place += 1
            writable = routine is None or parameter is None or parameter.writable
            tokens = argument.tokens[argument.tokens[:1] != [] and argument.tokens[0].text == "?" :]
            if not (writable and syntax.is_variable(tokens)):
                continue
            name = tokens[0].text
            if routine is not None and parameter is not None and parameter.stored and self.find_number(name) is None:
                caller = self.routine if self.is_inner(name) else ""
                handed = Handed(name, caller, parameter.name, routine.key, self.place(line))
                self.task.handed.append(handed)
            else:
                self.change(name, line)

    def change(self, name: str, line: int) -> None:
        """Note that a tool or workobject of this name may change here."""
        if (number := self.find_number(name)) is not None:
            number.handed = True
            self.task.derivations.escape_number(number)
        elif self.is_inner(name):
            self.task.changed_parameters.add((self.routine, name))
        else:
            self.task.change_frame(name, self.place(line))

    def write(
        self, name: str, line: int, how: str, index: tuple[int, ...] | None = None, *, followed: bool = False
    ) -> None:
        """Note that the points of a name, or the elements of an index, are written here; `followed`: with what."""
        variable = self.find(name)
        if variable is not None and not followed:
            self.task.derivations.escape(variable, self.place(line), how)
        for key, point in variable.elements.items() if variable is not None else ():
            if not index or key == index:
                point.writes.append((self.place(line), how))

    def shown(self, items: list[Token]) -> str:
        """Return code for a message."""
        return shown(self.source.data, items[0].start, items[-1].end) if items else ""

    def cased(self, token: Token) -> str:
        """Return a word as the file has it."""
        return self.source.data[token.start : token.end].decode("latin-1")


def _in_brackets(items: list[Token]) -> list[Token]:
    """Return the tokens between the first bracket and the one that closes it."""
    depth = 0
    for k, token in enumerate(items):
        depth += (token.text == "(") - (token.text == ")")
        if depth == 0:
            return items[1:k]
    return items[1:]
