"""The result of the verification of a program: an error and a decision for each target."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

import numpy as np

from truepose._io.delimited import escaped
from truepose._version import version
from truepose.verification.budget import BudgetLine, words
from truepose.verification.conformity import CONFORMITIES, RULE, Assessment, Conformity, overall

OtherRun = Literal["", "original", "corrected"]
FORMAT: Final = "truepose verification"
SCHEMA: Final = 1
_STATION: Final = {
    "map": "The station is that of the map: errors include a common shift of all targets.",
    "registered": (
        "The readings were registered again to the nominal targets: a common shift or turn of all targets, as by a "
        "wrong base, is not seen."
    ),
}
_RUN: Final = {
    "corrected": (
        "The readings are those of a corrected run, and the program is an original: name the corrected program, with "
        "its record beside it."
    ),
    "original": (
        "The readings are those of a run without correction, and the program is corrected: the robot ran the original, "
        "or the readings are older; measure the corrected run, and give these as those before it."
    ),
}
"""What is wrong where the readings are those of another run."""


@dataclass(frozen=True)
class VerifiedTarget:
    """A target that was measured again.

    Attributes
    ----------
    name : str
        The name of the target.
    file : str
        Its file.
    line : int
        Its line.
    correction : str
        The verdict of the correction, such as ``correct`` or ``skip``; ``original`` in an original program.
    nominal_mm, measured_mm : tuple of 3 float [mm], base frame
        The nominal position of the measured point, and the mean of its readings.
    error_mm : float [mm]
        The distance between them.
    uncertainty_mm : float [mm]
        The expanded uncertainty U of the error, see `ProgramVerification.budget`.
    before_mm : float [mm] or None
        The error without correction; see `ProgramVerification.before`.
    readings : int
        The number of readings.
    decision : {"pass", "undecided", "fail"}
        The decision on the error.
    """

    name: str
    file: str
    line: int
    correction: str
    nominal_mm: tuple[float, float, float]
    measured_mm: tuple[float, float, float]
    error_mm: float
    uncertainty_mm: float
    before_mm: float | None
    readings: int
    decision: Conformity


@dataclass(frozen=True, repr=False)
class ProgramVerification:
    """The verification of a program by re-measured targets; made by `verify_program`.

    Attributes
    ----------
    program, readings : str
        The program and the file of the readings.
    record : str
        The record of the correction; empty for an original program.
    map_sha256 : str or None
        The hash of the map.
    tolerance_mm : float [mm]
        The tolerance T of the length of an error.
    tolerance_origin : str
        Where the tolerance is stated.
    station : {"map", "registered"}
        Whether the station is that of the map, or was registered again.
    station_std_mm : float [mm]
        The standard uncertainty of the station along the errors (RMS). It shifts all of them alike.
    before : {"predicted", "measured", ""}
        Whether the errors before the correction were predicted by the map or measured; empty if there are none.
    targets : tuple of VerifiedTarget
        The measured targets.
    unmeasured : tuple of str
        The names of targets without a reading.
    unknown : int
        The number of targets whose position or frame is not known.
    notes : tuple of str
        Further sentences.
    run : {"", "original", "corrected"}
        Of which run the readings are, where they are not those of the program: of the original one, or of the corrected
        one.
    coverage_factor : float
        The factor k from a standard uncertainty to U, the largest of the targets.
    budget : tuple of BudgetLine
        The contributions to U, also those that are not stated. Files of earlier versions have none: their U is that of
        the reading alone.
    """

    program: str
    readings: str
    record: str
    map_sha256: str | None
    tolerance_mm: float
    tolerance_origin: str
    station: str
    station_std_mm: float
    before: str
    targets: tuple[VerifiedTarget, ...]
    unmeasured: tuple[str, ...]
    unknown: int
    notes: tuple[str, ...] = ()
    run: OtherRun = ""
    coverage_factor: float = 2.0
    budget: tuple[BudgetLine, ...] = ()

    @property
    def decision(self) -> Assessment:
        """The worst decision on a measured target; where these pass and others were not measured, ``not assessed``.

        So it is where the readings are those of another run (`run`).
        """
        whole: list[Assessment] = ["not assessed"] if self.unmeasured or self.run else []
        return overall([*whole, *(target.decision for target in self.targets)])

    @property
    def counts(self) -> dict[str, int]:
        """The number of measured targets with each decision."""
        count = Counter(target.decision for target in self.targets)
        return {decision: count[decision] for decision in CONFORMITIES}

    @property
    def figures(self) -> dict[str, dict[str, float | int]]:
        """The mean, the 95th percentile and the maximum of the errors after and, where known, before the correction."""
        before = [t.before_mm for t in self.targets if t.before_mm is not None]
        states = {"before": before, "after": [t.error_mm for t in self.targets]}
        return {state: _summary(errors) for state, errors in states.items() if errors}

    def sentences(self) -> list[str]:
        """Return the result in sentences."""
        count, after = self.counts, self.figures["after"]
        n = len(self.targets)
        measured = f"all {n}" if not self.unmeasured else f"{n} of {n + len(self.unmeasured)}"
        decided = f"{measured} targets were measured; {count['pass']} pass"
        size = f"mean {after['mean_mm']:.3f} mm, maximum {after['max_mm']:.3f} mm"
        said = [
            f"{self.decision.upper()}: {decided}, {count['undecided']} undecided, {count['fail']} fail.",
            f"Error: {size}; tolerance {self.tolerance_mm:g} mm ({self.tolerance_origin}).",
        ]
        if (before := self.figures.get("before")) is not None:
            said.append(
                f"Before correction ({self.before}, {before['n']} targets): mean {before['mean_mm']:.3f} mm, "
                f"maximum {before['max_mm']:.3f} mm."
            )
        if self.run:
            said.append(_RUN[self.run])
        elif not self.record:
            said.append("This is an original program: the errors are those before a correction.")
        if self.unmeasured:
            said.append(f"Not measured: {', '.join(self.unmeasured)}.")
        if self.unknown:
            said.append(f"Not verifiable, because position or frame is not known: {self.unknown} targets.")
        said += [RULE, _STATION[self.station]]
        if self.budget:
            lines = "; ".join(words(line) for line in self.budget)
            said.append(f"Standard uncertainties along the errors (RMS; k = {self.coverage_factor:.2f}): {lines}.")
        else:
            said.append(f"U is that of the reading alone; the station has {self.station_std_mm:.3f} mm beside it.")
        return [*said, *self.notes]

    def __repr__(self) -> str:
        return f"<ProgramVerification {self.program}: {' '.join(self.sentences()[:2])}>"

    def to_dict(self) -> dict[str, Any]:
        """Return the verification for JSON, as the report reads it."""
        head = {"format": FORMAT, "schema": SCHEMA, "written_by": f"truepose {version()}"}
        own = asdict(self)
        return {**head, "decision": self.decision, "counts": self.counts, "figures": self.figures, "rule": RULE, **own}

    def to_csv(self) -> str:
        """Return the measured targets as CSV, units in the names."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        places = [f"{axis}_{kind}_mm" for kind in ("nominal", "measured") for axis in "xyz"]
        words = ("file", "line", "name", "correction")
        numbers = ("before_mm", "error_mm", "uncertainty_mm", "tolerance_mm")
        writer.writerow([*words, *places, *numbers, "readings", "decision"])
        for t in self.targets:
            values = [*t.nominal_mm, *t.measured_mm, t.before_mm, t.error_mm, t.uncertainty_mm, self.tolerance_mm]
            shown = ["" if value is None else f"{value:.6f}" for value in values]
            writer.writerow([escaped(t.file), t.line, escaped(t.name), t.correction, *shown, t.readings, t.decision])
        return buffer.getvalue()


def _summary(errors: Sequence[float]) -> dict[str, float | int]:
    """Return the number, the mean, the 95th percentile and the maximum of errors."""
    p95 = float(np.percentile(errors, 95))
    return {"n": len(errors), "mean_mm": sum(errors) / len(errors), "p95_mm": p95, "max_mm": max(errors)}
