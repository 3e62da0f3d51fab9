"""ABB RAPID: modules with robtargets and the motions to them; the modules of a task are judged together.

Tool and workobject stand in each motion. Their values come from the frame table, or from tooldata and wobjdata of the
modules. A displacement (PDispSet, EOffsSet …) is followed through the task, interrupt programs and error handlers
included. What a module declares without LOCAL may be used by every module of its task, so it is corrected only where
the whole task was read.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import numpy as np

from truepose._io.files import read_bytes
from truepose.errors import FileError
from truepose.programs.core.copies import loaded_of
from truepose.programs.core.flow import BlockError
from truepose.programs.core.forms import Run
from truepose.programs.core.judge import Judge
from truepose.programs.core.order import Sweep
from truepose.programs.core.points import Place, Problem, Use
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.shifts import problem_of as shifted_by
from truepose.programs.core.source import PLAIN_LEXER, NotAProgramError, Source
from truepose.programs.core.state import UNSET, State
from truepose.programs.rapid import sharing
from truepose.programs.rapid.columns import at_line
from truepose.programs.rapid.derived import Reach
from truepose.programs.rapid.module import RapidModule
from truepose.programs.rapid.names import RapidMotion, RapidTask, Scope
from truepose.programs.rapid.runs import OF_NAMED, run_of
from truepose.programs.rapid.unreadable import LeftOut, assume_all_of, declared_in, left_out, module_of, statements_of

_ALONE: Final = Problem(
    "refuse",
    "global to the task: other modules may move to it under other workobjects; give the files of the whole task, state "
    "that these are all (--whole-task), or declare it LOCAL",
)


_HOMES: Final = ("progmod", "sysmod")
"""The folders in which a controller keeps the modules of a task."""
_Name = TypeVar("_Name", str, tuple[str, str])


class TaskFiles(NamedTuple):
    """A task as it is given to `read_tasks`.

    Attributes
    ----------
    path : Path
        The path that names it.
    files : sequence of Path
        The modules.
    kept : mapping of Path to str
        Modules that are read for what they declare and do, and never corrected, each with the reason.
    unread : str
        The modules that belong to the task and cannot be read, in words: data without LOCAL are refused.
    hidden : str
        The modules that came with options of the controller and cannot be read, in words: PERS and VAR are left.
    problem : str
        The reason why no target of the task is corrected, such as another robot; empty if there is none.
    frames : KnownFrames, optional
        The tools and bases, where they are not those of the other tasks.
    aside : mapping of Path to FileError
        Modules among the files that are left out, each with the reason: what they name is not trusted.
    """

    path: Path
    files: Sequence[Path]
    kept: Mapping[Path, str] = {}
    unread: str = ""
    hidden: str = ""
    problem: str = ""
    frames: KnownFrames | None = None
    aside: Mapping[Path, FileError] = {}


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read a RAPID module alone; it is the whole task only if `options.whole_task` is set."""
    (program,) = read_tasks([TaskFiles(path, [path])], frames, options, whole=options.whole_task)
    return program


def read_tasks(
    tasks: Sequence[TaskFiles | tuple[Path, Sequence[Path]]],
    frames: KnownFrames,
    options: ReadOptions,
    *,
    whole: bool = True,
    every: bool = False,
    broken: list[FileError] | None = None,
) -> list[Program]:
    """Read the tasks of one controller.

    A tool or workobject that one task changes counts as changed in all that share it, because PERS data of one name
    are one variable. A module that cannot be read, or that has the name or data of another one, is left out; what it
    names is not trusted. `Program.unreadable` has the reasons.

    Parameters
    ----------
    tasks : sequence of TaskFiles
        The tasks; a path that names it and the paths of its modules are enough.
    frames : KnownFrames
        The tools and bases.
    options : ReadOptions
        The options of reading.
    whole : bool
        Whether each has all modules of its task.
    every : bool
        Whether these are all tasks of the controller, so that no other one writes their data.
    broken : list of FileError, optional
        The list to which the errors of tasks that cannot be read are added. Without it the first one is raised.

    Raises
    ------
    FileError
        If all modules of a task are broken, or contradict each other.
    """
    given = [TaskFiles(*task) for task in tasks]
    opened: list[_Task] = []
    unread: list[TaskFiles] = []
    failed: list[FileError] = []
    for k, files in enumerate(given):
        try:
            opened.append(_Task(files, options, whole=whole))
        except FileError as error:
            if fewer := without_broken(files, options):
                again = [*given[:k], fewer, *given[k + 1 :]]
                return read_tasks(again, frames, options, whole=whole, every=every, broken=broken)
            if broken is None:
                raise
            failed.append(error)
            unread.append(files)
    sharing.reconcile([(task.files.path.name, task.data) for task in opened])
    read: list[_Task] = []
    for task in opened:
        try:
            task.read()
            read.append(task)
        except FileError as error:
            if fewer := without_broken(task.files, options):
                again = [fewer if files is task.files else files for files in given]
                return read_tasks(again, frames, options, whole=whole, every=every, broken=broken)
            if broken is None:
                raise
            failed.append(error)
            unread.append(task.files)
    if broken is not None:
        broken += failed
    aside = [source.path for task in read for source in task.left]
    elsewhere = sharing.Unread([path for files in unread for path in files.files], [f.path.name for f in unread], aside)
    all_data = [task.data for task in read]
    programs = []
    for task in read:
        others = [data for data in all_data if data is not task.data]
        task.data.changed.update(sharing.changed_elsewhere(task.data, others, elsewhere))
        sharing.leave_variables(task.data, others, elsewhere, every=every)
        programs.append(task.program(task.files.frames or frames))
    return programs


def without_broken(files: TaskFiles, options: ReadOptions) -> TaskFiles | None:
    """Return a task without the modules that keep the others from being read; None where there are none, or no others.

    They are those that cannot be read alone. Where all can, they are those that declare what another one declares, but
    for the one of several with one name that the controller loads.
    """
    more = _broken_alone(files, options) or _contradicting(files)
    rest = [path for path in files.files if path not in files.aside and path not in more]
    return files._replace(aside={**files.aside, **more}) if more and rest else None


def _broken_alone(files: TaskFiles, options: ReadOptions) -> dict[Path, FileError]:
    found: dict[Path, FileError] = {}
    for path in files.files:
        try:
            if path not in files.aside:
                _Task(TaskFiles(path, [path]), options, whole=False).read()
        except FileError as error:
            found[path] = error
    return found


def _contradicting(files: TaskFiles) -> dict[Path, FileError]:
    """Return the modules of one name but for the loaded one; where there are none, all that declare the same."""
    texts = {path: read_bytes(path) for path in files.files if path not in files.aside}  # not as a proof has them
    found: dict[Path, FileError] = {}
    for name, paths in _having({path: {module_of(text)} for path, text in texts.items()}):
        chosen = loaded_of(
            paths, _HOMES, lambda a, b: statements_of(texts[a]) == statements_of(texts[b]), root=_root(files)
        )
        for path in paths:
            other = chosen or next(one for one in paths if one != path)
            if chosen is None:
                why = f"module {name} is in {other}, too, and is another one; keep the one that the controller loads"
                found[path] = FileError(path, why)
            elif path != chosen:
                found[path] = NotAProgramError(path, f"is a copy of module {name}, which is in {chosen}")
    for (_, name), paths in _having({path: declared_in(text) for path, text in texts.items() if path not in found}):
        why = f"{name} is declared in {paths[1]}, too; give the files of one task at a time"
        error = FileError(paths[0], why)
        for path in paths:
            found.setdefault(path, error)
    return found


def _having(names: Mapping[Path, set[_Name]]) -> Iterator[tuple[_Name, list[Path]]]:
    """Yield the names that several files have, each with these."""
    owners: dict[_Name, list[Path]] = {}
    for path, some in names.items():
        for name in some:
            owners.setdefault(name, []).append(path)
    yield from sorted((name, paths) for name, paths in owners.items() if len(paths) > 1)


def _root(files: TaskFiles) -> Path:
    return Path(os.path.commonpath([path.parent for path in files.files]))


class _Task:
    """A task on its way from files to a program.

    Attributes
    ----------
    files : TaskFiles
        The files.
    data : RapidTask
        What its modules share.
    left : list of Source
        The modules that are left out, whose names are not trusted.
    """

    def __init__(self, files: TaskFiles, options: ReadOptions, *, whole: bool) -> None:
        self.files = files
        with self._named():
            self._sources = tuple([Source.read(file) for file in files.files if file not in files.aside])
            left = left_out(files.files, files.aside)
            self.left = left.sources
            self._open(options, left, whole=whole)

    def _open(self, options: ReadOptions, left: LeftOut, *, whole: bool) -> None:
        """Let all modules declare; without columns, if two robtargets have one name, which the error then says."""
        files = self.files
        names = frozenset(source.path.name.lower() for source in self._sources)
        unread = "" if options.whole_task else files.unread or left.unknown
        hidden = files.hidden or left.spare
        for columns in (True, False):
            self.data = RapidTask(
                options, whole and not unread, unread, hidden, named=len(files.files) > 1, files=names
            )
            self._modules = [RapidModule(source, self.data, columns=columns) for source in self._sources]
            first: dict[str, RapidModule] = {}
            for module in self._modules:
                if (other := first.setdefault(module.name, module)) is not module:
                    raise FileError(
                        module.source.path,
                        f"module {module.name} is in {other.source.path}, too; give the files of one task at a time",
                    )
            try:
                for module in self._modules:
                    module.declare()
            except FileError:
                if not columns:
                    raise
                continue  # read once more, one by one, so that the error names the first place
            if _unique([self.data.scope, *(module.own for module in self._modules)]):
                break

    def read(self) -> None:
        """Read the statements of all modules, and follow the displacements."""
        with self._named():
            for source in self.left:
                assume_all_of(source, self.data)
            for module in self._modules:
                module.read()
            self.data.change_handed()
            try:
                self.data.flow.solve()
            except BlockError as error:
                raise FileError(self._sources[0].path, f"{error}; correct the file") from None
        _settle(self.data, {source.path.name: k for k, source in enumerate(self._sources)})
        _attach(self.data)
        _leave(self.data, self.files)

    def program(self, frames: KnownFrames) -> Program:
        """Return the program with its verdicts."""
        path, data = self.files.path, self.data
        judge = Judge(frames, data.options, "abb", changed=data.changed)
        runs: list[tuple[Sweep | None, Run]] = [
            (Sweep.of(first.uses[0].visit(0), lines.items), run_of(first.source, lines, judge.target(first)))
            for first, lines in data.runs
        ]
        for point, lines, group, prefix in data.groups:
            run = run_of(point.source, lines, judge.target(point), OF_NAMED, prefix)
            sweep = Sweep.of(point.uses[0].visit(0), lines.items)._replace(line=group.lines) if point.uses else None
            runs.append((sweep, run))
        targets, circles = judge.program_targets(data.points, data.circles, runs, self._sources)
        root = None if path in self.files.files else path
        aside = tuple(dict.fromkeys(self.files.aside.values()))
        return Program(path, self._sources, targets, circles, PLAIN_LEXER, root=root, unreadable=aside)

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Let an error say that it refuses the whole task."""
        try:
            yield
        except FileError as error:
            if len(self.files.files) == 1:
                raise
            raise FileError(
                self.files.path, f"{error}; all {len(self.files.files)} modules of the task are refused"
            ) from None


def _leave(task: RapidTask, files: TaskFiles) -> None:
    """Leave the targets of modules that are never corrected, and of a task that does not move the map's robot."""
    for point in [*task.points, *(first for first, _ in task.runs), *(group.point for group in task.groups)]:
        reason = files.problem or files.kept.get(point.source.path)
        if reason and (point.problem is None or point.problem.verdict == "refuse"):
            point.problem = Problem("skip", reason)


def _attach(task: RapidTask) -> None:
    """Give each point its motions and reads, now that displacements and offsets are known."""
    _follow(task)
    owner = {id(point): variable for variable in task.variables for point in variable.elements.values()}
    for point, use, node in task.moves:
        variable = owner.get(id(point))
        problem = _hindered(task, use, node, joints=point.joints is not None)
        point.uses.append(use._replace(problem=problem or (_unseen(task, variable.reach) if variable else None)))
    # jointtargets that no motion goes to are no targets: other data have this form, too
    task.points[:] = [p for p in task.points if p.uses or not (id(p) in owner and owner[id(p)].joints)]
    for variable, place, how in task.reads:
        for point in variable.elements.values():
            point.reads.append((place, how))
    for name, place in task.read_by_name:
        for variable in task.of_name(name):
            for point in variable.elements.values():
                point.reads.append((place, "read by its name"))


def _hindered(task: RapidTask, use: Use, node: int, *, joints: bool = False) -> Problem | None:
    """Return why a motion hinders a correction, displacements and shifts at run time included."""
    shift = "" if joints else min(_shifts(task.flow.states[node]), default="")
    hindered = shifted_by(task.flow.states[node].shifts)
    if shift:
        hindered = Problem("refuse", f"a displacement may be active: {shift}; corrections do not know it")
    return hindered if hindered and (use.problem is None or use.problem.verdict == "skip") else use.problem


def _unique(scopes: Sequence[Scope]) -> bool:
    """Return whether no robtarget of a run has the name of another one of its scope."""
    for scope in scopes:
        if not all(columns.ready() for columns in scope.columns):
            return False
        if any(columns.row(name) >= 0 for columns in scope.columns for name in scope.points):
            return False
        for prefix in {prefix for columns in scope.columns for prefix in columns.prefixes}:
            codes = np.concatenate([one.numbers(prefix) for one in scope.columns if prefix in one.prefixes])
            if len(np.unique(codes)) < len(codes):
                return False
    return True


def _settle(task: RapidTask, rank: Mapping[str, int]) -> None:
    """Keep the runs of robtargets that motions of one kind go to, and declare the others on their own.

    `rank` gives the order of the files.
    """
    for name, _ in task.read_by_name:
        list(task.of_name(name))
    kinds = list(task.kinds)
    problems = [_hindered(task, use, node) for use, node in kinds]
    for columns, scope in task.columns:
        unseen = _unseen(task, "module" if columns.local else "task")
        uses = [use._replace(problem=why or unseen) for (use, _), why in zip(kinds, problems, strict=True)]
        task.groups += columns.settle(uses)
        for name, line, kind in columns.left():
            use, node = kinds[kind]
            task.derivations.distrust(scope.points[name])
            task.moves.append(RapidMotion(scope.points[name].elements[()], at_line(use, line), node))
    if kinds:  # as if they had been read one by one
        task.moves.sort(key=lambda move: _order(move.use.line, rank))


def _order(place: Place, rank: Mapping[str, int]) -> tuple[int, int]:
    return (0, place) if isinstance(place, int) else (rank[place.file], place.line)


def _follow(task: RapidTask) -> None:
    """Let the targets that are derived from points follow these."""
    known, allowed = task.derivations, task.options.derived or task.options.offsets
    found = known.solve()
    for point, use, node, *_ in known.followed:
        point.uses = [use._replace(problem=_hindered(task, use, node))]
    known.spoil(found)
    if task.loads or task.sets_by_name:
        known.spoil_assigned(task.loads or "data are set by name")
    for variable, place in known.read_itself:
        for point in variable.elements.values():
            point.reads.append((place, "read by arithmetic"))
    for k, one in enumerate(known.followed):
        if (goal := found.goals.get(k)) is None:
            continue
        direct = known.derive(goal, one, allowed=allowed)
        if one.instead and one.point.follows and allowed:
            gone = {id(point) for point in one.instead}
            task.moves[:] = [move for move in task.moves if id(move.point) not in gone or move.use != one.use]
            task.points.append(one.point)
        task.moves += [RapidMotion(point, one.use, one.node) for point in direct]
        for source, _ in goal.shifts:
            for variable, point in known.sources_of(source):
                point.shared = point.shared or _unseen(task, variable.reach)


def _shifts(state: State) -> Iterator[str]:
    """Yield the displacements that may be active."""
    yield from (text for text in state.ipo if text != "BASE")
    yield from (value.text for value in state.tool if value != UNSET)


def _unseen(task: RapidTask, reach: Reach) -> Problem | None:
    """Return why a point cannot be corrected although all that is here allows it: others may see it."""
    if reach in ("routine", "module"):
        return None
    if task.unread:
        reason = f"global to the task: {task.unread}, and may move to it under another workobject"
        return Problem("refuse", f"{reason}; state that it does not (--whole-task), or declare it LOCAL")
    if not task.whole:
        return _ALONE
    if task.loads:
        reason = f"global to the task, which loads a module that is not here: {task.loads}; give that file, too"
        return Problem("refuse", reason)
    return None
