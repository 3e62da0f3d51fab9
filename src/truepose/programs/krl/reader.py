"""Read KUKA KRL: a .src with its .dat, or a whole project of modules."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

from truepose._io.files import read_bytes
from truepose.errors import FileError
from truepose.programs.core.copies import loaded_of
from truepose.programs.core.derived import Goal as Positions
from truepose.programs.core.order import Sweep
from truepose.programs.core.points import FileLine, Point, Problem
from truepose.programs.core.program import KnownFrames, Program, ReadOptions
from truepose.programs.core.source import NotAProgramError, Source
from truepose.programs.krl.derived import Followed
from truepose.programs.krl.lexer import LEXER
from truepose.programs.krl.libraries import HALF_CIRCLE, NOT_WRITTEN, all_defined_in, defined_in, needed
from truepose.programs.krl.module import KrlModule, Shared
from truepose.programs.krl.motions import Goal
from truepose.programs.krl.points import KrlJudge, Numbers, PointVariable, concerning
from truepose.programs.krl.runs import Run
from truepose.programs.krl.unreadable import assume_all_of

_HOME: Final = re.compile(r"X?HOME[1-5]?", re.I)
"""The home positions that every controller has in its ``$config.dat``."""
_HOMES: Final = ("program", "system", "tp")
"""The folders from which a controller loads modules."""
_HOME_OF_USER: Final = re.compile(r"X?HOME\d*", re.I)


def read(path: Path, frames: KnownFrames, options: ReadOptions) -> Program:
    """Read a KRL program: a .src, or a .dat with the .src beside it. A .src with inline targets alone needs no .dat."""
    src_path = path if path.suffix.lower() == ".src" else _partner(path, ".src")
    if src_path is None:
        raise FileError(path, f"is the data list of {path.stem}.src, which is not beside it; both are needed")
    dat_path = _partner(src_path, ".dat") if src_path == path else path
    shared = Shared(options)
    module = KrlModule(Source.read(src_path), None if dat_path is None else Source.read(dat_path), shared)
    module.read_dat()
    module.look_ahead()
    module.forget_handed()
    module.read_src()
    _check_pair(module)
    return _program(path, [module], shared, frames)


def read_project(
    folder: Path,
    files: Iterable[Path],
    frames: KnownFrames,
    options: ReadOptions,
    libraries: Iterable[Path] = (),
) -> Program:
    """Read the .src and .dat files of a folder as one program, whose modules share GLOBAL points and routines.

    A module that cannot be read is left out, and so are those that define the same. What they may do to the others is
    assumed of what they name. Of several modules of one name, the one that the controller loads is read; where that is
    not known, none is.

    Parameters
    ----------
    folder : Path
        The folder that the user gave.
    files : iterable of Path
        The files of the programs.
    frames, options
        The tools and bases, and the options of reading.
    libraries : iterable of Path
        The system modules, submits and data lists of the controller, with ``$config.dat``. Those that the programs use
        are read for their effects. Nothing in them is corrected.

    Raises
    ------
    FileError
        If no module can be read.
    """
    programs = list(files)
    extra = needed(programs, libraries)
    found, copies, broken = _by_name(folder, [*programs, *extra])
    libraries = frozenset(extra)
    if not found:
        raise next(iter(broken.values()))
    while True:
        kept = [kind for name, kind in found.items() if name not in broken]
        shared = Shared(options, project=True, libraries=libraries)
        try:
            modules = _read_modules(kept, shared)
            break
        except FileError as error:
            more = _broken({name: kind for name, kind in found.items() if name not in broken}, options)
            more = more or _contradicting(found, broken, error)
            if not more or len(more) == len(kept):
                raise
            broken |= more
    for name, why in broken.items():
        try:
            assume_all_of(name, [*found.get(name, {}).values(), *copies.get(name, ())], modules, shared)
        except FileError:
            raise FileError(folder, f"{why}; what it does to the other modules is not known") from None
    unreadable: list[FileError] = [
        why
        for name, why in broken.items()
        if not libraries.issuperset([*found.get(name, {}).values(), *copies.get(name, ())])
    ]
    for name, paths in copies.items():
        chosen = found.get(name, {})
        if name not in broken:
            own = {path: read_bytes(path) for path in chosen.values()}
            different = [path for path in paths if read_bytes(path) not in own.values()]
            assume_all_of(name, different, modules, shared, copy=True)
            shown = next(iter(chosen.values())).relative_to(folder)
            unreadable += [NotAProgramError(path, f"is a copy of module {name}, which is in {shown}") for path in paths]
    return replace(_program(folder, modules, shared, frames), unreadable=tuple(dict.fromkeys(unreadable)))


def _by_name(
    folder: Path, files: Iterable[Path]
) -> tuple[dict[str, dict[str, Path]], dict[str, list[Path]], dict[str, FileError]]:
    """Return the files of each module by their endings; the files of its copies; and the errors where it is not known.

    A submit is a module like a .src.
    """
    places: dict[str, dict[Path, dict[str, Path]]] = {}
    for file in files:
        ending = ".src" if file.suffix.lower() == ".sub" else file.suffix.lower()
        kind = places.setdefault(file.stem.upper(), {}).setdefault(file.parent, {})
        if ending in kind:
            raise FileError(file, f"{kind[ending].name} differs from it in upper and lower case only; keep one")
        kind[ending] = file
    found: dict[str, dict[str, Path]] = {}
    copies: dict[str, list[Path]] = {}
    errors: dict[str, FileError] = {}
    for name, kinds in places.items():
        endings = [ending for kind in kinds.values() for ending in kind]
        if len(endings) == len(set(endings)):
            found[name] = {ending: file for kind in kinds.values() for ending, file in kind.items()}
            continue
        heads = {next(iter(kind.values())): kind for kind in kinds.values()}
        chosen = loaded_of(list(heads), _HOMES, partial(_same, heads), root=folder)
        rest = [kind for head, kind in heads.items() if head != chosen]
        copies[name] = [file for kind in rest for file in kind.values()]
        if chosen is not None:
            found[name] = heads[chosen]
        else:
            first, second = list(heads)[:2]
            shown = f"{first.relative_to(folder)} is another module of this name"
            errors[name] = FileError(second, f"{shown}; keep the one that the controller loads")
    return found, copies, errors


def _same(kinds: Mapping[Path, Mapping[str, Path]], first: Path, second: Path) -> bool:
    """Return whether two modules have the same files, as they are on the disk."""
    one, other = kinds[first], kinds[second]
    return one.keys() == other.keys() and all(read_bytes(one[key]) == read_bytes(other[key]) for key in one)


def _contradicting(
    found: Mapping[str, Mapping[str, Path]], known: Mapping[str, FileError], error: FileError
) -> dict[str, FileError]:
    """Return the module that an error names, and those that define a routine of it."""
    at = Path(error.path)
    texts = {name: read_bytes(kind[".src"]) for name, kind in found.items() if name not in known and ".src" in kind}
    named = [name for name, kind in found.items() if at in kind.values() and name not in known]
    defined = {name: defined_in(name, text) for name, text in texts.items()}
    own = {one for name in named for one in all_defined_in(texts.get(name, b""))}
    return dict.fromkeys([*named, *(name for name, routines in defined.items() if routines & own)], error)


def _read_modules(kinds: Sequence[Mapping[str, Path]], shared: Shared) -> list[KrlModule]:
    """Read the modules of a project, each from its files by their endings."""

    def source(kind: Mapping[str, Path], ending: str) -> Source | None:
        return Source.read(kind[ending]) if ending in kind else None

    modules = [KrlModule(source(kind, ".src"), source(kind, ".dat"), shared) for kind in kinds]
    for module in modules:
        module.read_dat()
    for module in modules:
        module.names.take_imports({m.name: m.names for m in modules})
        if module.src is not None:
            module.look_ahead()
    with_code = [module for module in modules if module.src is not None]
    for module in with_code:
        module.forget_handed()
    for module in with_code:
        module.read_src()
    return modules


def _broken(found: Mapping[str, Mapping[str, Path]], options: ReadOptions) -> dict[str, FileError]:
    """Return the modules that cannot be read alone, each with its error."""
    errors = {}
    for name, kind in found.items():
        try:
            _read_modules([kind], Shared(options, project=True))
        except FileError as error:
            errors[name] = error
    return errors


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


def _check_pair(module: KrlModule) -> None:
    """Require the .dat if the program moves to points that no file at hand declares."""
    if module.dat is not None or module.src is None:
        return
    for variable in module.names.elsewhere.values():
        if variable.moves and not _HOME_OF_USER.fullmatch(variable.name):
            dat = module.src.path.with_suffix(".dat").name
            raise module.src.error(
                variable.line, f"moves to {variable.name}, which no file at hand declares; put {dat} beside it"
            )


def _program(path: Path, modules: Sequence[KrlModule], shared: Shared, frames: KnownFrames) -> Program:
    """Judge the points of all modules, and put them in order."""
    ambient = shared.solve()
    derived = shared.derivations.solve()
    shared.derivations.spoil(derived)
    whole = shared.project or shared.options.whole_task
    states, changed = shared.flow.states, shared.changed
    judge = KrlJudge(
        frames, shared.options, states, ambient, changed, whole=whole, moved=shared.moved, set_to=shared.set_to
    )
    derived_goals = [
        (one, module.src, derived.goals[one])
        for module in modules
        if module.src is not None
        for one in module.motions.followed
        if one in derived.goals and module.src.path not in shared.libraries
    ]
    if shared.options.derived:
        for one, _, goal in derived_goals:
            if goal.complete and one.variable is not None:
                one.variable.moves[one.element].remove(one.motion)
    of_numbers = {id(numbers): point for numbers in shared.numbers if (point := _point(numbers, judge, shared))}
    of_variables: dict[int, Point] = {}
    points = list(of_numbers.values())
    runs: list[tuple[Sweep, Run]] = []
    own = [module for module in modules if module.src is not None and module.src.path not in shared.libraries]
    written = {module.src.path.name: module.src for module in own if module.src is not None}
    has_config = any(module.name == "$CONFIG" for module in modules)
    for module in own:
        assert module.src is not None
        runs += _runs(module, module.src, judge)
        points += module.motions.others
    for variable in [*(v for module in own for v in _variables(module)), *shared.points.values()]:
        given = not variable.moves or variable.literals or id(variable) in of_variables
        if not given and (point := _without_numbers(variable, written, has_config=has_config)):
            of_variables[id(variable)] = point
    points += of_variables.values()
    computed = {one: point for m in modules if m.src is not None for one, point in m.motions.computed.items()}
    followers = _followers(derived_goals, shared, judge, of_numbers, computed)
    points += [point for one, point in followers.items() if one.variable is not None]

    def points_of(goal: Goal) -> list[Point]:
        if isinstance(goal, Point):
            return [goal] if goal.source.path not in shared.libraries else []
        if isinstance(goal, Numbers):
            return [of_numbers[id(goal)]] if id(goal) in of_numbers else []
        if goal.followed in followers:
            return [followers[goal.followed]]
        if id(goal.variable) in of_variables:
            return [of_variables[id(goal.variable)]]
        literals = concerning(goal.variable.literals, goal.key)
        return [of_numbers[id(numbers)] for numbers in literals if id(numbers) in of_numbers]

    circles = []
    for module in modules:
        for goals in module.motions.circles if module.src is not None else ():
            found = [points_of(goal) for goal in goals]
            circle = [point for some in found for point in some]
            circles += [circle] if circle else []
            for point in circle if not all(found) else ():  # the other one may be in a system module
                point.problem = point.problem or HALF_CIRCLE
    sources = [source for module in modules for source in (module.src, module.dat) if source is not None]
    named = {point.source.path for point in points}
    sources = [source for source in sources if source.path not in shared.libraries or source.path in named]
    ordered = judge.program_targets(points, circles, runs, sources)
    return Program(path, tuple(sources), *ordered, LEXER, root=path if shared.project else None)


def _point(numbers: Numbers, judge: KrlJudge, shared: Shared) -> Point | None:
    """Return the point of a literal; None where it is no target, or one of a system module alone."""
    point = judge.point(numbers)
    if point is None or numbers.source.path not in shared.libraries:
        return point
    modules = {path.name for path in shared.libraries}
    if all(isinstance(use.line, FileLine) and use.line.file in modules for use in point.uses):
        return None
    point.problem = point.problem or NOT_WRITTEN
    return point


def _followers(
    goals: Iterable[tuple[Followed, Source, Positions]],
    shared: Shared,
    judge: KrlJudge,
    of_numbers: Mapping[int, Point],
    computed: Mapping[Followed, Point],
) -> dict[Followed, Point]:
    """Return the targets that are derived from points, and let them follow these."""
    known = shared.derivations
    sources = {
        known.name(numbers.variable, numbers.index): of_numbers[id(numbers)]
        for numbers in shared.numbers
        if numbers.variable is not None and id(numbers) in of_numbers
    }
    followers: dict[Followed, Point] = {}
    for one, src, goal in goals:
        variable, motion = one.variable, one.motion
        uses = judge.uses([(motion, 0)], variable)
        if variable is None:
            point = computed[one]
            point.uses = uses
        else:
            problem = Problem("skip", "its value is known at run time only")
            point = Point(known.shown(known.name(variable, one.element)), src, motion.line, problem=problem, uses=uses)
        if known.derive(goal, point, sources) and shared.options.derived:
            followers[one] = point
    return followers


def _runs(module: KrlModule, src: Source, judge: KrlJudge) -> Iterator[tuple[Sweep, Run]]:
    """Yield the runs of motions of a module, each with its motions."""
    for first, lines in module.runs:
        point = judge.point(first)
        assert point is not None  # a motion goes to it
        run = Run(src, lines.start, lines.end, lines.line, lines.lines, judge.target(point))
        yield Sweep.of(point.uses[0].visit(0), len(run)), run


def _variables(module: KrlModule) -> list[PointVariable]:
    return [*module.names.module.values(), *module.variables, *module.names.elsewhere.values()]


def _without_numbers(variable: PointVariable, written: Mapping[str, Source], *, has_config: bool) -> Point | None:
    """Return a point that no file gives numbers; None where only system modules move to it."""
    motions = [motion for motions in variable.moves.values() for motion in motions]
    if variable.origin == "nowhere" and _HOME.fullmatch(variable.name) and not has_config:
        reason = "joint target of $config.dat"
    elif variable.origin == "nowhere":
        reason = "not defined in the files at hand"
    elif variable.origin == "import":
        reason = "declared in another module"
    else:
        reason = "its value is known at run time only"
    first = next((m for m in motions if not isinstance(m.place, FileLine) or m.place.file in written), None)
    if first is None:
        return None
    src = written[first.place.file] if isinstance(first.place, FileLine) else next(iter(written.values()))
    uses = [motion.use() for motion in motions]
    return Point(variable.name, src, first.line, problem=Problem("skip", reason), uses=uses)
