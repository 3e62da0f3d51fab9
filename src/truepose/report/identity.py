"""The section on job and equipment, and the company's logo."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Final

from truepose._io import files
from truepose.report.document import Facts, Logo, Section, Text
from truepose.report.evidence import Evidence
from truepose.report.locale import Locale

_FORMS: Final = {".png": "png", ".jpg": "jpg", ".jpeg": "jpg", ".svg": "svg"}
_SAME_C: Final = 0.1
_LARGEST_LOGO: Final = 1_000_000
_TEXTS: Final = ("company", "site", "operator", "job", "part", "measured", "robot_serial", "tracker", "tracker_serial")
_REST: Final = ("tracker_calibration_due", "reflector", "reflector_calibration_due")


def section(evidence: Evidence, say: Locale) -> Section:
    """Return the section on job and equipment; missing facts are flagged."""
    stated = evidence.cell.report
    rows = {key: None if (value := getattr(stated, key)) is None else str(value) for key in (*_TEXTS, *_REST)}
    rows["temperature"] = _temperature(evidence, say)
    return Section(say("job.title"), [facts("job", rows, say, columns=2)])


def facts(title: str, rows: dict[str, str | None], say: Locale, *, columns: int = 1) -> Facts:
    """Return named facts by their keys in one section of the texts; None is a missing fact."""
    missing = [k for k, text in enumerate(rows.values()) if text is None]

    def shown(key: str, text: str | None) -> str:
        own = f"{title}.{key}_missing"
        return say(own if own in say.texts else "report.missing") if text is None else text

    return Facts([(say(f"{title}.{key}"), shown(key, text)) for key, text in rows.items()], missing, columns)


def overdue(evidence: Evidence, say: Locale) -> list[Text]:
    """Return a warning for each calibration that was overdue on the day of the measurement."""
    stated = evidence.cell.report
    day = stated.measured or evidence.date.date()
    due: dict[str, date | None] = {
        "tracker": stated.tracker_calibration_due,
        "reflector": stated.reflector_calibration_due,
    }
    return [
        Text(say("job.overdue", what=say(f"job.{key}_name"), due=str(end), day=str(day)), warns=True)
        for key, end in due.items()
        if end is not None and end < day
    ]


def logo(evidence: Evidence, say: Locale) -> tuple[Logo | None, list[Text]]:
    """Return the logo, or a warning if its file cannot be used."""
    path = evidence.cell.logo
    if path is None:
        return None, []
    form = _FORMS.get(path.suffix.lower())
    if form is None or not path.is_file() or path.stat().st_size > _LARGEST_LOGO:
        return None, [Text(say("job.no_logo", path=Path(path).name), warns=True)]
    return Logo(form, files.read_bytes(path), evidence.cell.report.company or ""), []


def _temperature(evidence: Evidence, say: Locale) -> str | None:
    stated, read = evidence.cell.report.temperature_C, evidence.error_map.samples.temperature
    if stated is not None:
        return say("job.temperature_text", value=stated)
    if read is None:
        return None
    if read.max() - read.min() < _SAME_C:
        return say("job.temperature_samples", value=float(read.mean()))
    return say("job.temperature_range", low=float(read.min()), high=float(read.max()))
