"""The table ``[report]`` of a cell file: the facts that an auditor expects in a report."""

from __future__ import annotations

from datetime import date, datetime
from typing import Annotated

from pydantic import BeforeValidator, Field

from truepose.cell.poses import CellSection, Positive, Temperature


def _day(value: object) -> object:
    """Return a date of a cell file or of a map; a number is no date."""
    if isinstance(value, str):
        try:
            return date.fromisoformat(value)
        except ValueError:
            pass
    if isinstance(value, date) and not isinstance(value, datetime):
        return value
    raise ValueError(f"expected a date such as 2026-03-31, got {value!s}")


Day = Annotated[date, BeforeValidator(_day)]
Line = Annotated[str, Field(strict=True, min_length=1, max_length=200)]


class ReportSection(CellSection):
    """``[report]``: company, place, people, serial numbers, calibrations and the tolerance of the report.

    ``logo`` is a .png, .jpg or .svg file relative to the cell file. ``measured`` is the date of the measurement.
    ``tolerance_mm`` is the largest permitted length of a positional error; by default that of ``[correction]``.
    """

    company: Line | None = None
    logo: Line | None = None
    site: Line | None = None
    operator: Line | None = None
    job: Line | None = None
    part: Line | None = None
    measured: Day | None = None
    robot_serial: Line | None = None
    tracker: Line | None = None
    tracker_serial: Line | None = None
    tracker_calibration_due: Day | None = None
    reflector: Line | None = None
    reflector_calibration_due: Day | None = None
    temperature_C: Temperature | None = None  # noqa: N815 - °C, as in the cell file
    tolerance_mm: Positive | None = None
