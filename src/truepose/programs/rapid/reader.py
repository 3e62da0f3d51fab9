"""ABB RAPID: modules with robtargets and the motions to them; the modules of a task are judged together.

Tool and workobject stand in each motion. Their values come from the frame table, or from tooldata and wobjdata of the
modules. A displacement (PDispSet, EOffsSet …) is followed through the task, interrupt programs and error handlers
included. What a module declares without LOCAL may be used by every module of its task, so it is corrected only where
the whole task was read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from truepose.errors import FileError
from truepose.programs.core.flow import UNSET, BlockError, State
from truepose.programs.core.points import Judge, Problem, Sweep, at
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.shifts import problem_of as shifted_by
from truepose.programs.core.source import PLAIN_LEXER, Source
from truepose.programs.rapid.module import RapidModule
from truepose.programs.rapid.names import RapidTask, RobtargetVariable
from truepose.programs.rapid.runs import run_of

_ALONE: Final = Problem(
    "refuse",
    "global to the task: other modules may move to it under other workobjects; give the files of the whole task, state "
    "that these are all (--whole-task), or declare it LOCAL",
)


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read a RAPID module alone; it is the whole task only if `options.whole_task` is set."""
    (program,) = read_tasks([(path, [path])], frames, options, whole=options.whole_task)
    return program


def read_tasks(
    tasks: Sequence[tuple[Path, Sequence[Path]]], frames: KnownFrames, options: ReadOptions, *, whole: bool = True
) -> list[Program]:
    """Read the tasks of one controller, each from a path that names it and the paths of its modules.

    `whole`: these are all modules of the task. A tool or workobject that one task changes counts as changed in all of
    them, because PERS data of one name are shared.

    Raises
    ------
    FileError
        If a module is broken, or two modules declare one name.
    """
    found = [_read_task(path, paths, options, whole=whole) for path, paths in tasks]
    changed = {key: place for task, _ in reversed(found) for key, place in task.changed.items()}
    programs = []
    for (path, _), (task, sources) in zip(tasks, found, strict=True):
        judge = Judge(frames, options, "abb", changed=changed)
        runs = [
            (Sweep.of(first.uses[0], lines.items), run_of(first.source, lines, judge.target(first)))
            for first, lines in task.runs
        ]
        targets, circles = judge.program_targets(task.points, task.circles, runs, sources)
        root = path if path.is_dir() else None
        programs.append(Program(path, sources, targets, circles, PLAIN_LEXER, root=root))
    return programs


def _read_task(
    path: Path, paths: Sequence[Path], options: ReadOptions, *, whole: bool
) -> tuple[RapidTask, tuple[Source, ...]]:
    try:
        return _read_modules([Source.read(file) for file in paths], options, whole=whole)
    except FileError as error:
        if len(paths) == 1:
            raise
        raise FileError(path, f"{error}; all {len(paths)} modules of the task are refused") from None


def _read_modules(
    sources: Sequence[Source], options: ReadOptions, *, whole: bool
) -> tuple[RapidTask, tuple[Source, ...]]:
    files = frozenset(source.path.name.lower() for source in sources)
    task = RapidTask(options, whole, named=len(sources) > 1, files=files)
    modules = [RapidModule(source, task) for source in sources]
    first: dict[str, RapidModule] = {}
    for module in modules:
        if (other := first.setdefault(module.name, module)) is not module:
            raise FileError(
                module.source.path,
                f"module {module.name} is in {other.source.path}, too; give the files of one task at a time",
            )
    for module in modules:
        module.declare()
    for module in modules:
        module.read()
    try:
        task.flow.solve()
    except BlockError as error:
        raise FileError(sources[0].path, f"{error}; correct the file") from None
    _attach(task)
    return task, tuple(sources)


def _attach(task: RapidTask) -> None:
    """Give each point its motions and reads, now that displacements and offsets are known."""
    owner = {id(point): variable for variable in task.variables for point in variable.elements.values()}
    for point, use, node in task.moves:
        problem, variable = use.problem, owner.get(id(point))
        shift = "" if point.joints else min(_shifts(task.flow.states[node]), default="")
        hindered = shifted_by(task.flow.states[node].shifts)
        if shift:
            hindered = Problem("refuse", f"a displacement may be active: {shift}; corrections do not know it")
        if hindered and (problem is None or problem.verdict == "skip"):
            problem = hindered
        if problem == Problem("skip", "") and variable is not None:
            size = f"{variable.offset:g} mm" if variable.offset_known else "known at run time only"
            reason = f"moved to with an offset (largest {size}, {at(variable.offset_place)}); allow offsets"
            problem = Problem("skip", f"{reason} to give both one correction")
            # with an offset anywhere it is skipped everywhere
            point.problem = point.problem or problem
        point.uses.append(use._replace(problem=problem or _unseen(task, variable)))
    # jointtargets that no motion goes to are no targets: other data have this form, too
    task.points[:] = [p for p in task.points if p.uses or not (id(p) in owner and owner[id(p)].joints)]
    for variable, place, how in task.reads:
        for point in variable.elements.values():
            point.reads.append((place, how))
    for name, place in task.read_by_name:
        for variable in task.variables:
            if name in ("", variable.name.upper()):
                for point in variable.elements.values():
                    point.reads.append((place, "read by its name"))


def _shifts(state: State) -> Iterator[str]:
    """Yield the displacements that may be active."""
    yield from (text for text in state.ipo if text != "BASE")
    yield from (value.text for value in state.tool if value != UNSET)


def _unseen(task: RapidTask, variable: RobtargetVariable | None) -> Problem | None:
    """Return why a point cannot be corrected although all that is here allows it: others may see it."""
    if variable is None or not variable.is_global:
        return None
    if not task.whole:
        return _ALONE
    if task.loads:
        reason = f"global to the task, which loads a module that is not here: {task.loads}; give that file, too"
        return Problem("refuse", reason)
    return None
