"""One line per program, and the reasons why targets are not corrected, grouped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from truepose.cli.output import say

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from truepose._typing import IntArray
    from truepose.programs import Backup, CorrectedProgram, Coverage, Program
    from truepose.programs.core.reasons import Judged
    from truepose.programs.used_frames import UsedFrame

_TARGETS: Final = 3  # targets of a group that are named
_GROUPS: Final = 20
_WARNINGS: Final = 40
_FOLLOWS: Final = 3  # code of targets that follow corrected ones, after those of the verdicts
_OF_ONE: Final = "max_bend_mm"
"""The limit whose default is found for each program."""


def show_backups(backups: Sequence[Backup]) -> None:
    """Show the controllers of backups, the files that are left as they are, and what the user must know."""
    from rich.markup import escape

    for backup in backups:
        for one in backup.controllers:
            where = backup.path if one.name == "." else f"{backup.path}, {one.name}"
            left = ", ".join(f"{kind}: {n}" for kind, n in one.left.items())
            more = f"; left as they are: {sum(one.left.values())} files ({left})" if left else ""
            say(f"[bold]{escape(str(where))}[/]: {escape(f'{one}{more}')}")
            for warning in one.contents.warnings:
                say(escape(f"  {warning}"))
        if len(backup.makers) > 1:
            say(escape(f"{backup.path}: holds controllers of {len(backup.makers)} makers: {', '.join(backup.makers)}"))
        for warning in backup.warnings[:_WARNINGS]:
            say(escape(warning))


def show_left_out(texts: Sequence[str]) -> None:
    """Name what is no program, although its ending is that of one."""
    from rich.markup import escape

    for text in texts[:_WARNINGS]:
        say(escape(text))
    if len(texts) > _WARNINGS:
        say(f"{len(texts) - _WARNINGS} more files are left out")


def show_checked(program: Program) -> None:
    """Show the counts of a program, or of each module of a project, and why targets are not corrected."""
    import numpy as np
    from rich.markup import escape

    from truepose.programs.unnamed_tools import unnamed_words, with_measured_tool

    codes = _codes(program)
    say(f"[bold]{escape(str(program.path))}[/]: {_verdicts(codes)}")
    modules = program.modules
    for module, rows in modules.items() if len(modules) > 1 else ():
        say(f"  {escape(str(module))}: {_verdicts(codes[rows])}")
    for text in unnamed_words(with_measured_tool(program)):
        say(escape(f"  {text}"))
    _say_blended(program)
    _say_reasons(program.targets, np.flatnonzero((codes != 0) & (codes != _FOLLOWS)))


def show_corrected(program: CorrectedProgram) -> None:
    """Show the counts of a corrected program, and why targets are left nominal."""
    import numpy as np
    from rich.markup import escape

    summary = program.summary()
    following = f"{summary['following']} derived from these, " if summary["following"] else ""
    say(
        f"[bold]{escape(str(program.program.path))}[/]: {summary['corrected']} corrected, {following}"
        f"{summary['below_uncertainty']} below uncertainty, {summary['skipped']} skipped, "
        f"{summary['refused']} refused; largest correction "
        f"{summary['largest_correction_mm']:.3f} mm, largest standard deviation {summary['largest_std_mm']:.3f} mm"
    )
    if joint_targets := summary.get("joint_targets"):
        remaining = summary["largest_remaining_mm"]
        say(f"  {joint_targets} of the corrected are joint targets; their digits leave {remaining:.4f} mm at most")
    modules, corrected = program.program.modules, program.targets.corrected
    for module, rows in modules.items() if len(modules) > 1 else ():
        note = "; refused, not written" if module in program.refused else ""
        say(f"  {escape(str(module))}: {int(np.count_nonzero(corrected[rows]))} of {len(rows)} corrected{note}")
    _say_blended(program.program)
    _say_reasons(program.targets, np.flatnonzero((program.targets.code != 1) & (corrected | ~program.targets.moved)))


def show_limits(programs: Sequence[CorrectedProgram]) -> None:
    """Show the limits in force and the warnings of corrected programs, equal ones once."""
    from rich.markup import escape

    limits: dict[str, list[CorrectedProgram]] = {}
    for program in programs:
        stated = program.limits
        if len(programs) > 1 and stated.origin[_OF_ONE].startswith("default"):
            stated = replace(stated, values={**stated.values, _OF_ONE: "as in each record"})
        limits.setdefault(stated.sentence(), []).append(program)
    for sentence, some in limits.items():
        where = f" for {some[0].program.path}" if len(limits) > 1 else ""
        others = f" and {len(some) - 1} more" if where and len(some) > 1 else ""
        say(escape(f"Limits in force{where}{others}: {sentence}"))
    for warning in list(dict.fromkeys(text for program in programs for text in program.warnings))[:_WARNINGS]:
        say(escape(warning))
    for state in {program.map_state for program in programs}:
        show_draft(state)


def show_draft(state: str | None) -> None:
    """Say that a map is not released, if that is its state in the store."""
    from truepose.programs.record import DRAFT

    if state == DRAFT:
        say("[yellow]DRAFT[/]: the map is not released; the records say so")


def show_missing(rows: Sequence[UsedFrame]) -> None:
    """Show the lines of a cell file for the frames that targets need and that are not known."""
    import typer

    from truepose.programs.used_frames import missing_lines

    if not (lines := missing_lines(rows)):
        return
    states = [one.state for one in rows if one.targets]
    n, zeros = sum(state in ("unknown", "zero") for state in states), states.count("zero")
    what = "1 tool or base is" if n == 1 else f"{n} tools and bases are"
    say(f"{what} not known. Give the cell file (--cell) these lines, with the values that the controller shows:")
    if zeros:
        say(f"{zeros} of them: stored as zeros and without a name; give the two lines only if zero is meant")
    typer.echo("\n".join(["", *lines, ""]))


def show_options(coverage: Coverage) -> None:
    """Show how many targets each option would allow, and what it assumes."""
    from rich.markup import escape

    total = coverage.total
    assumed = {one.remedy.option: one.remedy.assumption for one in total.reasons if one.remedy is not None}
    for option, n in total.by_option().items():
        if option:
            say(escape(f"{option} may allow {n} more; it assumes: {assumed[option]}"))


def say_total(programs: Sequence[Program], unreadable: int) -> None:
    """Show the sum of the counts of several programs, each module of a project as one, and how many were not read."""
    count = sum(max(1, len(program.modules)) for program in programs)
    if count > 1:
        more = f"; {unreadable} more cannot be read" if unreadable else ""
        say(f"{count} programs: {_verdicts(*map(_codes, programs))}{more}")


def _codes(program: Program) -> NDArray[np.int8]:
    """Return the verdict of each target by its place in `VERDICTS`, or that it follows a corrected one, (n,)."""
    codes = program.targets.verdicts().astype("int8")
    codes[program.allowed() & (codes != 0)] = _FOLLOWS
    return codes


def _verdicts(*codes: NDArray[np.int8]) -> str:
    import numpy as np

    correct, skip, refuse, follow = np.sum([np.bincount(one, minlength=4) for one in codes], axis=0).tolist()
    who = "follows a corrected point" if follow == 1 else "follow a corrected point"
    return f"{correct} to correct, {f'{follow} {who}, ' if follow else ''}{skip} to skip, {refuse} refused"


def _say_blended(program: Program) -> None:
    """Show how many motions of a program are blended."""
    from truepose.programs.core.blending import in_words

    if told := in_words(program.blended):
        say(f"  {told}")


def _say_reasons(targets: Sequence[Any], rows: IntArray) -> None:
    """Show why the targets of some rows are not corrected, each reason once, with files, lines and names."""
    from rich.markup import escape

    from truepose.programs.core.reasons import group_reasons

    groups = group_reasons(_judged(targets, rows))
    for group in groups[:_GROUPS]:
        n = len(group.targets)
        more = f" and {n - _TARGETS} more" if n > _TARGETS else ""
        such = "" if group.alike else "such as: "
        say(escape(f"  {n} × {group.verdict}: {such}{group.reason} ({', '.join(group.targets[:_TARGETS])}{more})"))
    if len(groups) > _GROUPS:
        say(f"  … and {len(groups) - _GROUPS} more reasons (--json lists all)")


def _judged(targets: Sequence[Any], rows: IntArray) -> list[Judged]:
    return [targets[i] for i in rows.tolist()]
