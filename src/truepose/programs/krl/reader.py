"""KUKA KRL: a .src with its .dat, or a whole project of modules, as targets."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from truepose.errors import FileError
from truepose.programs.core.points import Visit, in_order
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.source import Source
from truepose.programs.core.target import Target
from truepose.programs.krl.lexer import LEXER
from truepose.programs.krl.module import Module, Shared
from truepose.programs.krl.motions import Goal
from truepose.programs.krl.names import element
from truepose.programs.krl.points import Judge, Variable, at
from truepose.programs.krl.runs import Run

_HOME: Final = re.compile(r"X?HOME\d*", re.I)


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read a KRL program.

    Parameters
    ----------
    path : Path
        The .src, or the .dat beside it. A .src with inline targets alone needs no .dat.
    frames : KnownFrames
    options : ReadOptions

    Raises
    ------
    FileError
        If one of the pair is missing, or a file is broken; with its line.
    """
    src_path = path if path.suffix.lower() == ".src" else _partner(path, ".src")
    if src_path is None:
        raise FileError(path, f"is the data list of {path.stem}.src, which is not beside it; both are needed")
    dat_path = _partner(src_path, ".dat") if src_path == path else path
    shared = Shared(options)
    module = Module(Source.read(src_path), None if dat_path is None else Source.read(dat_path), shared)
    module.read_dat()
    module.read_src()
    _check_pair(module)
    return _program(path, [module], shared, frames)


def read_project(folder: Path, files: Iterable[Path], frames: KnownFrames, options: ReadOptions) -> Program:
    """Read the modules of a folder as one program, whose GLOBAL points and routines all of them may use.

    Parameters
    ----------
    folder : Path
    files : iterable of Path
        Every .src and .dat.
    frames : KnownFrames
    options : ReadOptions

    Raises
    ------
    FileError
        If a file is broken, or two modules have one name.
    """
    found: dict[str, dict[str, Path]] = {}
    for file in files:
        kind = found.setdefault(file.stem.upper(), {})
        ending = file.suffix.lower()
        if ending in kind:
            shown = f"{kind[ending].relative_to(folder)} is another module of this name"
            raise FileError(file, f"{shown}; give the folder of one controller at a time")
        kind[ending] = file
    shared = Shared(options, project=True)

    def source(kind: dict[str, Path], ending: str) -> Source | None:
        return Source.read(kind[ending]) if ending in kind else None

    modules = [Module(source(kind, ".src"), source(kind, ".dat"), shared) for kind in found.values()]
    for module in modules:
        module.read_dat()
    for module in modules:
        module.names.take_imports({m.name: m.names for m in modules})
    for module in modules:
        if module.src is not None:
            module.read_src()
    return _program(folder, modules, shared, frames)


def _partner(path: Path, suffix: str) -> Path | None:
    """Return the other file of a pair, whatever the case of its name."""
    exact = path.with_suffix(suffix)
    if exact.is_file():
        return exact
    try:
        beside = sorted(path.parent.iterdir())
    except OSError:
        return None
    return next((p for p in beside if p.name.lower() == exact.name.lower() and p.is_file()), None)


def _check_pair(module: Module) -> None:
    """Require the .dat if the program moves to points that only it can declare."""
    if module.dat is not None or module.src is None:
        return
    for variable in module.names.elsewhere.values():
        if variable.moves and not _HOME.fullmatch(variable.name):
            dat = module.src.path.with_suffix(".dat").name
            raise module.src.error(
                variable.line, f"moves to {variable.name}, which no file at hand declares; put {dat} beside it"
            )


def _program(path: Path, modules: Sequence[Module], shared: Shared, frames: KnownFrames) -> Program:
    """Judge what was read, and put it in order."""
    ambient = shared.flow.solve()
    whole = shared.project or shared.options.whole_task
    states, changed = shared.flow.states, shared.changed
    judge = Judge(frames, shared.options, states, ambient, changed, whole=whole, moved=shared.moved)
    targets: list[Target | Run] = []
    place: dict[int, int] = {}
    visits: list[Visit] = []
    for i, numbers in enumerate(shared.numbers):
        target = judge.target(numbers)
        if target is not None:
            place[i] = len(targets)
            visits += [numbers.use.visit(place[i])] if numbers.use else []
            targets.append(target)
    circles: list[list[int]] = []
    unknown: dict[int, int] = {}
    for module in modules:
        circles += _of_module(module, judge, targets, visits, place, unknown)
    sources = [source for module in modules for source in (module.src, module.dat) if source is not None]
    visits += _to_points(modules, place, unknown)
    ordered = in_order(targets, circles, sources, visits)
    return Program(path, tuple(sources), *ordered, LEXER, root=path if shared.project else None)


def _to_points(modules: Sequence[Module], place: Mapping[int, int], unknown: Mapping[int, int]) -> Iterator[Visit]:
    """Yield the motions to named points; to a whole array where the run time names the element."""
    variables = {id(variable): variable for module in modules for variable in _variables(module)}
    for key, variable in variables.items():
        for index, uses in variable.moves.items():
            items = [place[i] for i in at(variable.literals, index) if i in place]
            items = items or ([unknown[key]] if key in unknown else [])
            for use in uses:
                yield from (use.visit(item, order) for order, item in enumerate(items))


def _variables(module: Module) -> list[Variable]:
    return [*module.names.module.values(), *module.variables, *module.names.elsewhere.values()]


def _of_module(
    module: Module,
    judge: Judge,
    targets: list[Target | Run],
    visits: list[Visit],
    place: dict[int, int],
    unknown: dict[int, int],
) -> list[list[int]]:
    """Add a module's runs and the motions whose target has no numbers; return its circles by places in `targets`.

    `place` holds those of numbers, `unknown` those of points without.
    """
    if module.src is None:
        return []
    for first, lines in module.runs:
        like = judge.target(first)
        assert like is not None  # it is moved to
        assert first.use is not None
        visits.append(first.use.visit(len(targets)))
        targets.append(Run(module.src, lines.start, lines.end, lines.line, lines.lines, like))
    first_other = len(targets)
    targets += module.motions.others
    visits += module.motions.visits(first_other)
    for variable in _variables(module):
        if variable.moves and not variable.literals and id(variable) not in unknown:
            unknown[id(variable)] = len(targets)
            targets.append(_without_numbers(variable, module.src))

    def places(goal: Goal) -> list[int]:
        if goal.numbers is not None:
            return [place[goal.numbers]]
        if goal.other is not None:
            return [first_other + goal.other]
        assert goal.variable is not None
        if id(goal.variable) in unknown:
            return [unknown[id(goal.variable)]]
        literals = at(goal.variable.literals, element(goal.variable, goal.brackets))
        return [place[i] for i in literals if i in place]

    return [[i for goal in goals for i in places(goal)] for goals in module.motions.circles]


def _without_numbers(variable: Variable, src: Source) -> Target:
    moves = [use for uses in variable.moves.values() for use in uses]
    if _HOME.fullmatch(variable.name) and variable.origin == "nowhere":
        reason = "joint target of $config.dat"
    elif variable.origin in ("nowhere", "import"):
        reason = "declared in another module"
    else:
        reason = "its value is known at run time only"
    return Target(variable.name, src.path, moves[0].line, tuple(use.word for use in moves), "skip", reason)
