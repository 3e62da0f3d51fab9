"""The section on conformity: tolerance, decision rule, expanded uncertainty (k = 2) and noise floor in one place."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map.repeatability import Repeatability
from truepose.report.document import Block, Section, Table, Text
from truepose.report.evidence import Evidence
from truepose.report.identity import facts
from truepose.report.locale import MISSING, Locale
from truepose.verification import RP_PER_STD
from truepose.verification.conformity import CONFORMITIES, COVERAGE_FACTOR, Assessment, Conformity, conformity, overall

_STATES: Final = ("before", "after")


def decision(evidence: Evidence) -> Assessment | None:
    """Return the decision on the evaluated poses after correction.

    None means that nothing can be decided: there is no tolerance, the uncertainty of a reading is not known, or the
    poses took part in the fit.
    """
    held_out = evidence.held_out is not None and not evidence.accuracy["seen"]
    return overall(_decisions(evidence, evidence.after)) if held_out and _decidable(evidence) else None


def section(evidence: Evidence, say: Locale) -> Section:
    """Return the section on conformity with the tolerance."""
    tolerance, found = evidence.cell.tolerance_mm, evidence.accuracy
    floor = found.get("noise_floor")
    robot = evidence.error_map.robot
    rp = Repeatability.of(evidence.cell, robot).known or Repeatability.of(evidence.error_map.cell, robot).known
    rows = {
        "tolerance": None if tolerance is None else say("conformity.mm", value=tolerance),
        "repeatability": None if rp is None else say("conformity.mm", value=rp),
        "noise_floor": _floor(floor, say) if floor else None,
    }
    blocks: list[Block] = [facts("conformity", rows, say), Text(say("conformity.rule"))]
    if _decidable(evidence):
        blocks.append(_counts(evidence, say))
    if (reason := _undecidable(evidence, say)) is not None:
        blocks.append(Text(reason, warns=True))
    blocks += [Text(say("conformity.uncertainty")), _uncertainty(evidence, rp, say)]
    return Section(say("conformity.title"), blocks)


def _decidable(evidence: Evidence) -> bool:
    return evidence.cell.tolerance_mm is not None and evidence.reading_std is not None


def _undecidable(evidence: Evidence, say: Locale) -> str | None:
    if evidence.cell.tolerance_mm is None:
        return say("conformity.no_tolerance")
    if evidence.reading_std is None:
        return say("conformity.no_uncertainty")
    if evidence.held_out is None or evidence.accuracy["seen"]:
        return say("conformity.no_held_out")
    return None


def _decisions(evidence: Evidence, e: FloatArray) -> list[Conformity]:
    tolerance, std = evidence.cell.tolerance_mm, evidence.reading_std
    assert tolerance is not None
    assert std is not None
    return conformity(np.linalg.norm(e, axis=1), COVERAGE_FACTOR * std, tolerance)


def _counts(evidence: Evidence, say: Locale) -> Table:
    columns = ["", *(say(f"conformity.{key}") for key in CONFORMITIES)]
    rows = []
    for state in _STATES:
        count = Counter(_decisions(evidence, getattr(evidence, state)))
        rows.append([say(f"report.{state}"), *(str(count[key]) for key in CONFORMITIES)])
    return Table(columns, rows)


def _uncertainty(evidence: Evidence, rp: float | None, say: Locale) -> Table:
    """Return the table of standard and expanded uncertainties."""
    reading = evidence.reading_std
    predicted = float(np.sqrt((evidence.std**2).sum(axis=1).mean()))
    values = {
        "reading": None if reading is None else float(reading.max()),
        "scatter": None if rp is None else rp / RP_PER_STD,
        "prediction": predicted,
    }
    sources = {"reading": f"reading_{evidence.reading_source}"}
    rows = [
        [
            say(f"conformity.{key}"),
            MISSING if u is None else say.number(u, ".4f"),
            MISSING if u is None else say.number(COVERAGE_FACTOR * u, ".4f"),
            say("report.missing") if u is None else say(f"conformity.{sources.get(key, key)}_source"),
        ]
        for key, u in values.items()
    ]
    return Table([say(f"conformity.column_{key}") for key in ("source", "u", "expanded", "from")], rows, last_left=1)


def _floor(floor: Mapping[str, Any], say: Locale) -> str:
    low, high = floor["ratio_interval_95"]
    return say("accuracy.noise_floor", mean=floor["mean_mm"], ratio=floor["ratio"], low=low, high=high)
