"""What the tasks of a controller share: PERS of one name and type, declared without TASK or LOCAL, is one variable.

PERS and VAR that nothing writes are constants. That is known only where every statement that may write them is at hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from truepose.programs.core.points import Place, Problem, at
from truepose.programs.core.program import Key, frame_key
from truepose.programs.core.source import Source
from truepose.programs.rapid.names import Datum, RapidTask, RobtargetVariable

_WORD: Final = re.compile(rb"[A-Za-z_\x80-\xff][\w\x80-\xff]*")
_DECLARED: Final = re.compile(rb"\bPERS[ \t]+\w+[ \t]+([A-Za-z_\x80-\xff][\w\x80-\xff]*)", re.I)


class Unread:
    """The tasks that cannot be read, and the names that their statements may write.

    Parameters
    ----------
    paths : sequence of Path
        Their modules.
    tasks : sequence of str
        Their names.
    aside : sequence of Path
        The modules that are left out of tasks that can be read.
    """

    def __init__(self, paths: Sequence[Path], tasks: Sequence[str], aside: Sequence[Path] = ()) -> None:
        self.tasks = tasks
        self._names, self._aside = (_named_in(some) for some in (paths, aside))

    def names(self, name: str) -> bool:
        """Return whether the tasks name something other than in a declaration."""
        return name.upper() in self._names

    def names_aside(self, name: str) -> bool:
        """Return whether modules that are left out do."""
        return name.upper() in self._aside


def _named_in(paths: Sequence[Path]) -> set[str]:
    found: set[str] = set()
    for path in paths:
        text = Source.read(path).data
        declared = [m.start(1) for m in _DECLARED.finditer(text)]
        places = {m.start(): m[0] for m in _WORD.finditer(text)}
        found |= {word.decode("latin-1").upper() for place, word in places.items() if place not in declared}
    return found


def reconcile(tasks: Sequence[tuple[str, RapidTask]]) -> None:
    """Give shared tools and workobjects one value in all tasks; refuse those with two."""
    found: dict[str, list[tuple[str, RapidTask, Datum]]] = {}
    for name, task in tasks:
        for key, datum in task.scope.frames.items():
            if datum.shared:
                found.setdefault(key, []).append((name, task, datum))
    for key, several in found.items():
        values = {datum.frame.tf: (name, datum) for name, _, datum in several if datum.frame.tf is not None}
        problem = next((datum.problem for _, _, datum in several if datum.problem), None)
        if len(values) > 1 and problem is None:
            (a, one), (b, other) = list(values.values())[:2]
            reason = f"{one.frame.text} has one value in {a} ({at(one.place)}) and another in {b} ({at(other.place)})"
            problem = Problem("refuse", f"{reason}: PERS of one name is one variable; make them agree")
        tf = next(iter(values), None)
        for _, task, datum in several:
            frame = datum.frame._replace(tf=tf) if datum.frame.tf is None else datum.frame
            task.scope.frames[key] = datum._replace(frame=frame, problem=problem)


def changed_elsewhere(
    task: RapidTask, others: Sequence[RapidTask], unread: Unread
) -> dict[tuple[str, Key | None], Place]:
    """Return the tools and workobjects of a task that others change, without those that it has for itself."""
    own = {frame_key(datum.frame.text) for datum in task.scope.frames.values() if not datum.shared}
    found = {
        key: place
        for other in others
        for key, place in other.changed.items()
        if key not in task.changed and key[1] not in own and key[1] not in _own_frames(other)
    }
    for datum in task.scope.frames.values():
        if datum.shared and unread.names(datum.frame.text):
            which = "tool" if datum.kind == "tooldata" else "base"
            found.setdefault((which, frame_key(datum.frame.text)), datum.place)
    return found


def _own_frames(task: RapidTask) -> set[Key]:
    return {frame_key(datum.frame.text) for datum in task.scope.frames.values() if not datum.shared}


def leave_variables(task: RapidTask, others: Sequence[RapidTask], unread: Unread, *, every: bool) -> None:
    """Leave the PERS and VAR that something may write which is not at hand, or at a place that is not known."""
    elsewhere = {
        variable.name.upper(): other
        for other in others
        for variable in other.variables
        if variable.kind == "PERS" and variable.reach == "controller"
    }
    for variable in task.variables:
        if variable.kind == "CONST":
            continue
        why = _why_left(task, variable, elsewhere, others, unread, every=every)
        for point in variable.elements.values():
            if why:
                point.objection = point.objection or Problem("skip", f"{variable.kind}: {why}; make it CONST")
            if seen := [*point.writes, *point.reads]:  # what reads it may also write it, such as a procedure
                place, how = seen[0]
                point.problem = point.problem or Problem("skip", f"{variable.kind}, {how} ({at(place)})")


def _why_left(
    task: RapidTask,
    variable: RobtargetVariable,
    elsewhere: Mapping[str, RapidTask],
    others: Sequence[RapidTask],
    unread: Unread,
    *,
    every: bool,
) -> str:
    """Return why a variable may be written by something that is not known; empty if nothing can."""
    if variable.reach == "routine":
        return ""
    tasks = [task, *others] if variable.reach == "controller" else [task]
    if why := next(_hidden_writes(tasks), ""):
        return why
    if variable.reach != "controller":
        return ""
    if unread.tasks:
        return f"{', '.join(unread.tasks)} cannot be read and may write it"
    if unread.names_aside(variable.name):
        return "a module that is left out names it and may write it"
    if not every:
        return "another task of the controller may write it (give its whole backup, or declare it TASK PERS)"
    if (other := elsewhere.get(variable.name.upper())) is not None:
        place = next(v.place for v in other.variables if v.name.upper() == variable.name.upper())
        return f"it is one variable with that of another task ({at(place)})"
    return ""


def _hidden_writes(tasks: Sequence[RapidTask]) -> Iterator[str]:
    """Yield what may write any data of some tasks."""
    for task in tasks:
        if task.hidden:
            yield f"{task.hidden} and may write it"
        if not task.whole:
            yield "a module that is not read may write it"
        if task.loads:
            yield f"a module that is loaded at run time may write it ({task.loads})"
        if task.sets_by_name is not None:
            yield f"data are set by a name that only the run time knows ({at(task.sets_by_name)})"
