"""Verified programs: the file that ``truepose verify`` writes, and its section of the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter, ValidationError

from truepose._io import files
from truepose._io.delimited import escaped
from truepose.errors import FileError
from truepose.programs import ProgramVerification
from truepose.report.document import Attachment, Block, Picture, Section, Table, Text
from truepose.report.locale import MISSING, Locale

_SHOWN: Final = 20
"""The largest number of targets that are listed one by one: those that do not pass. The attached table has all."""
TABLE: Final = "verified.csv"
"""The name of the attached table."""
_ADAPTER: Final = TypeAdapter(ProgramVerification)


def read_verification(path: str | Path) -> ProgramVerification:
    """Read a verification that ``truepose verify --out FILE.json`` wrote.

    Raises
    ------
    FileError
        If the file does not exist or is not a verification.
    """
    try:
        found = _ADAPTER.validate_json(files.read_bytes(path))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise FileError(
            path,
            f"is not the verification of a program ({where + ': ' if where else ''}{first['msg']}); "
            "name a .json file written by 'truepose verify --out'",
        ) from None
    if not found.targets:
        raise FileError(path, "is the verification of no target")
    return found


def section(found: Sequence[ProgramVerification], map_hash: str, say: Locale) -> Section | None:
    """Return the section on verified programs; None if there is none."""
    if not found:
        return None
    blocks: list[Block] = []
    for one in found:
        blocks += _program(one, map_hash, say)
    rule = Text(say("verification.rule", section=say("conformity.title")))
    return Section(say("verification.title"), [*blocks, rule])


def _program(one: ProgramVerification, map_hash: str, say: Locale) -> list[Block]:
    from truepose.report.plots.verification import target_errors

    name = Path(one.program).name
    count, after, before = one.counts, one.figures["after"], one.figures.get("before")
    blocks: list[Block] = [
        Text(
            say(
                "verification.result",
                program=name,
                decision=say(f"conformity.{one.decision}"),
                n=len(one.targets),
                passed=count["pass"],
                undecided=count["undecided"],
                failed=count["fail"],
                tolerance=one.tolerance_mm,
                mean=float(after["mean_mm"]),
                largest=float(after["max_mm"]),
            ),
            warns=one.decision != "pass",
        )
    ]
    if before is not None:
        figures = {"mean": float(before["mean_mm"]), "largest": float(before["max_mm"]), "n": before["n"]}
        blocks.append(Text(say(f"verification.before_{one.before}", **figures)))
    for condition, key in (
        (not one.record and not one.run, "original"),
        (one.map_sha256 != map_hash, "other_map"),
        (one.station == "registered", "registered"),
        (bool(one.unmeasured), "unmeasured"),
        (bool(one.unknown), "unknown"),
        (bool(one.run), f"run_{one.run}"),
    ):
        if condition:
            n = len(one.unmeasured) if key == "unmeasured" else one.unknown
            names = say("finding.list").join(one.unmeasured)
            blocks.append(Text(say(f"verification.{key}", n=n, names=names), warns=True))
    readings = Path(one.readings).name
    station = say("verification.station", std=one.station_std_mm, readings=readings)
    if one.budget:
        station = say("verification.budget", readings=readings, k=one.coverage_factor)
    picture = Picture(target_errors(one, say), say("verification.caption", program=name))
    return [*blocks, Text(station), *_budget(one, say), picture, *_table(one, say)]


def _budget(one: ProgramVerification, say: Locale) -> list[Block]:
    """Return the table of the contributions to the uncertainty; files of earlier versions have none."""
    columns = [
        say(f"budget.column_{key}") for key in ("source", "u", "share", "dof", "distribution", "targets", "origin")
    ]
    rows = [
        [
            say(f"budget.{line.source}"),
            say("budget.not_stated") if line.u_mm is None else say.number(line.u_mm, ".4f"),
            MISSING if line.share is None else say("report.percent", share=100 * line.share),
            "∞" if line.dof is None else say.number(line.dof, ".0f"),
            say(f"budget.{line.distribution}"),
            say("budget.alike" if line.common else "budget.each"),
            line.origin,
        ]
        for line in one.budget
    ]
    return [Table(columns, rows, last_left=3)] if rows else []


def attachment(found: Sequence[ProgramVerification], say: Locale) -> list[Attachment]:
    """Return the table of all measured targets as CSV, to attach; none without verifications."""
    rows = [line for one in found for line in _prefixed(one)]
    if not found:
        return []
    head = "program," + found[0].to_csv().splitlines()[0]
    return [Attachment(TABLE, say("verification.attached"), "\n".join([head, *rows]) + "\n")]


def _prefixed(one: ProgramVerification) -> list[str]:
    return [f"{escaped(one.program)},{line}" for line in one.to_csv().splitlines()[1:]]


def _table(one: ProgramVerification, say: Locale) -> list[Block]:
    """Return the table of the targets that do not pass."""
    left = sorted((t for t in one.targets if t.decision != "pass"), key=lambda t: -t.error_mm)
    more = [Text(say("verification.all_targets", shown=min(len(left), _SHOWN), n=len(left), table=TABLE))]
    if not left:
        return [*more]
    words = [say(f"verification.column_{key}") for key in ("target", "line", "before", "error", "uncertainty")]
    rows = [
        [
            target.name,
            str(target.line),
            say.number(target.before_mm, ".3f"),
            say.number(target.error_mm, ".3f"),
            say.number(target.uncertainty_mm, ".3f"),
            say(f"conformity.{target.decision}"),
        ]
        for target in left[:_SHOWN]
    ]
    return [Table([*words, say("verification.column_decision")], rows, last_left=1), *more]
