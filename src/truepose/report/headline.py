"""The decision on the first page: the worst of all that the report contains, and a row for each program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from truepose.programs import ProgramVerification
from truepose.report.conformity import decision
from truepose.report.document import Block, Section, Table, Text
from truepose.report.evidence import Evidence
from truepose.report.locale import MISSING, Locale
from truepose.report.records import Record
from truepose.verification.conformity import Assessment, overall


@dataclass(frozen=True)
class Headline:
    """The decision of a report.

    Attributes
    ----------
    decision : {"pass", "not assessed", "undecided", "fail"}
        The worst of `held_out` and of the decisions on programs; ``not assessed`` where there is none.
    held_out : {"pass", "not assessed", "undecided", "fail"} or None
        The decision on the held-out poses; None where nothing can be decided on them.
    programs : tuple of (str, str)
        The verified programs, each with its decision.
    tolerances_mm : tuple of float [mm]
        The tolerances of these decisions, each once.
    """

    decision: Assessment
    held_out: Assessment | None
    programs: tuple[tuple[str, Assessment], ...]
    tolerances_mm: tuple[float, ...]


def headline(evidence: Evidence) -> Headline:
    """Return the decision of a report."""
    held_out, verified = decision(evidence), evidence.verifications
    found = [] if held_out is None else [held_out]
    if held_out is None and evidence.held_out is not None:
        found.append("not assessed")
    tolerances = [one.tolerance_mm for one in verified]
    if evidence.cell.tolerance_mm is not None and (held_out is not None or not verified):
        tolerances.insert(0, evidence.cell.tolerance_mm)
    return Headline(
        overall([*found, *(one.decision for one in verified)]),
        held_out,
        tuple((_name(one.program), one.decision) for one in verified),
        tuple(sorted(set(tolerances))),
    )


def tile(found: Headline, say: Locale) -> tuple[str, str]:
    """Return the decision and the tolerances, for the head of the report."""
    stated = say("finding.list").join(say("conformity.mm", value=t) for t in found.tolerances_mm)
    caption = say("conformity.tile", tolerances=stated) if stated else say("conformity.tile_none")
    return say(f"conformity.{found.decision}"), caption


def section(evidence: Evidence, found: Headline, say: Locale) -> Section:
    """Return the section on what the decision is made of: the held-out poses, and a row for each program."""
    poses = say(f"conformity.{found.held_out or 'none'}")
    blocks: list[Block] = [Text(say("headline.held_out", decision=poses), warns=found.held_out == "fail")]
    if len(found.tolerances_mm) > 1:
        stated = say("finding.list").join(say("conformity.mm", value=t) for t in found.tolerances_mm)
        blocks.append(Text(say("headline.tolerances", tolerances=stated), warns=True))
    rows = list(_rows(evidence.records, evidence.verifications, say))
    columns = ("program", "targets", "corrected", "uncorrected", "largest", "measured", "tolerance", "decision")
    if rows:
        blocks.append(Table([say(f"headline.column_{key}") for key in columns], rows, last_left=1))
    return Section(say("headline.title"), blocks)


def _rows(records: Sequence[Record], verifications: Sequence[ProgramVerification], say: Locale) -> list[list[str]]:
    """Return a row for each corrected program, and for each verification of a program without a record here."""
    waiting = list(verifications)
    rows = []
    for record in records:
        own = [one for one in waiting if _is_of(one, record)]
        waiting = [one for one in waiting if one not in own]
        counts = record.summary
        rest = counts.targets - counts.corrected
        numbers = [str(counts.targets), str(counts.corrected), str(rest)]
        numbers.append(say.number(counts.largest_correction_mm, ".3f"))
        rows += [[record.name, *numbers, *_verified(one, say)] for one in own]
        if not own:
            rows.append([record.name, *numbers, MISSING, MISSING, say("headline.not_verified")])
    for one in waiting:
        n = len(one.targets) + len(one.unmeasured)
        rows.append([_name(one.program), str(n), MISSING, MISSING, MISSING, *_verified(one, say)])
    return rows


def _is_of(one: ProgramVerification, record: Record) -> bool:
    return _name(one.record) == record.file and _name(one.program) == record.name


def _verified(one: ProgramVerification, say: Locale) -> list[str]:
    """Return how many targets were measured, the tolerance, and the decision."""
    return [str(len(one.targets)), say.number(one.tolerance_mm, ".3f"), say(f"conformity.{one.decision}")]


def _name(path: str) -> str:
    return Path(path.replace("\\", "/")).name
