"""What all jobs of a controller tell together: which P variables they use, and which shifts reach which job."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from truepose.errors import FileError
from truepose.programs.core.points import FileLine
from truepose.programs.core.program import Key, KnownFrames
from truepose.programs.core.source import NotAProgramError, Source
from truepose.programs.inform.controller import ELSEWHERE, Controller, Displacement, Mention, Survey
from truepose.programs.inform.reader import survey
from truepose.programs.inform.words import changed_frames

_NONE: frozenset[Displacement] = frozenset()


def survey_jobs(jobs: Sequence[Path], frames: KnownFrames, controller: Controller) -> Controller:
    """Return the knowledge of all jobs of a controller.

    Parameters
    ----------
    jobs : sequence of Path
        The files of the jobs.
    frames : KnownFrames
        The controller's tools and bases.
    controller : Controller
        The knowledge that other files of the backup give.
    """
    found: dict[Path, Survey] = {}
    again = list(jobs)
    while again:
        for path in again:
            try:
                found[path] = survey(path, frames, controller)
            except NotAProgramError:
                jobs = [job for job in jobs if job != path]
            except FileError:
                found.pop(path, None)  # reading it will give the reason
        left = _left(list(found.values()), set(jobs) - set(found))
        changed = {name for name in left if left[name] != controller.left.get(name, _NONE)}
        controller = replace(controller, left=left)
        again = [path for path, one in found.items() if changed & {name for name, _, _ in one.calls}]
    mentions: dict[int, list[Mention]] = {}
    reframed: dict[str, str] = {}
    reset: dict[tuple[str, Key | None], FileLine] = {}
    for one in found.values():
        for mention in one.mentions:
            mentions.setdefault(mention.number, []).append(mention)
        reframed = {**one.reframed, **reframed}
        reset = {**one.changed, **reset}
    for path in set(jobs) - set(found):
        reset = {**_changed_unread(path), **reset}
    unread = tuple([path.name for path in jobs if path not in found])
    entered = _entered(list(found.values()))
    return replace(controller, mentions=mentions, reframed=reframed, entered=entered, unread=unread, changed=reset)


def _changed_unread(path: Path) -> dict[tuple[str, Key | None], FileLine]:
    """Return the tools and user frames that the lines of a job change which cannot be read; all if nothing can."""
    found: dict[tuple[str, Key | None], FileLine] = {}
    try:
        source = Source.read(path)
    except FileError:
        return {("tool", None): FileLine(path.name, 1), ("base", None): FileLine(path.name, 1)}
    for line, start, end in source.lines():
        for key in changed_frames(source.data[start:end]):
            found.setdefault(key, FileLine(path.name, line))
    return found


def _left(jobs: Sequence[Survey], unread: Iterable[Path]) -> dict[str, frozenset[Displacement]]:
    """Return the shifts that each job may leave active; those of any job for one that is known at run time only.

    A job that cannot be read may leave any.
    """
    left: dict[str, frozenset[Displacement]] = {}
    for one in jobs:
        left[one.name] = left.get(one.name, _NONE) | one.left
    for path in unread:
        name = path.stem.upper()
        shift = Displacement(f"{path.name}, which cannot be read,")
        left[name] = left.get(name, _NONE) | {shift}
    return {**left, ELSEWHERE: _NONE.union(*left.values())}


def _entered(jobs: Sequence[Survey]) -> dict[str, frozenset[Displacement]]:
    """Return the shifts that may be active when each job begins, those of its callers' callers included."""
    names = {one.name for one in jobs}
    entered: dict[str, frozenset[Displacement]] = dict.fromkeys(names, _NONE)
    changed = True
    while changed:
        changed = False
        for one in jobs:
            for name, shifts, passes in one.calls:
                here = shifts | entered[one.name] if passes else shifts
                for called in names if name == ELSEWHERE else names & {name}:
                    if not here <= entered[called]:
                        entered[called] |= here
                        changed = True
    return entered
