"""The records of corrected programs that ``truepose correct`` writes, and their section of the report."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError

from truepose._io import files
from truepose.errors import FileError
from truepose.report.document import Block, Section, Table, Text
from truepose.report.locale import MISSING, Locale

_SHOWN: Final = 30
"""The number of targets of a program that are listed one by one."""
_REASONS: Final = 12
_COUNTS: Final = ("targets", "corrected", "clipped", "below_uncertainty", "skipped", "refused")
_Numbers = tuple[float | None, float | None, float | None]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class Summary(_Part):
    """The counts of the targets by verdict, and the largest correction and standard deviation [mm]."""

    targets: int
    corrected: int
    clipped: int
    skipped: int
    refused: int
    below_uncertainty: int = 0
    largest_correction_mm: float | None
    largest_std_mm: float | None


class ChangedFile(_Part):
    """A file of the program, with its hashes before and after."""

    file: str
    sha256_before: str
    sha256_after: str


class Target(_Part):
    """The correction of one target; positions and corrections [mm] in its own frame."""

    name: str
    line: int
    before_mm: _Numbers
    correction_mm: _Numbers
    std_mm: float | None
    verdict: Literal["correct", "clip", "skip", "refuse", "below uncertainty"]
    reason: str

    @property
    def touched(self) -> bool:
        """Whether the target was changed."""
        return self.verdict in ("correct", "clip")


class Limit(_Part):
    """A limit of a correction, and its source."""

    value: float | str | None
    origin: str


class Record(_Part):
    """The record of one corrected program; see `read_record`."""

    program: str
    map_sha256: str | None
    on_guard: str
    summary: Summary
    files: list[ChangedFile]
    targets: list[Target]
    limits: dict[str, Limit] = Field(default_factory=dict)

    _path: Path = PrivateAttr()
    _sha256: str = PrivateAttr()

    @property
    def file(self) -> str:
        """The name of the record's file."""
        return self._path.name

    @property
    def sha256(self) -> str:
        """The SHA-256 of the record's file."""
        return self._sha256

    @property
    def name(self) -> str:
        """The name of the program's file, on any operating system."""
        return _file_name(self.program)

    @property
    def hashes(self) -> list[tuple[str, str]]:
        """The name and the SHA-256 after the correction of each changed file."""
        return [(_file_name(f.file), f.sha256_after) for f in self.files if f.sha256_after != f.sha256_before]


def read_record(path: str | Path) -> Record:
    """Read the record of a corrected program.

    Raises
    ------
    FileError
        If the file does not exist or is not a record.
    """
    data = files.read_bytes(path)
    try:
        record = Record.model_validate_json(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise FileError(
            path,
            f"is not the record of a corrected program ({where + ': ' if where else ''}{first['msg']}); "
            "name a .json file written by 'truepose correct'",
        ) from None
    record._path, record._sha256 = Path(path), hashlib.sha256(data).hexdigest()
    return record


def section(records: Sequence[Record], map_hash: str, say: Locale) -> Section:
    """Return the section on corrected programs."""
    title = say("programs.title")
    if not records:
        return Section(title, [Text(say("programs.none"))])
    columns = [say(f"programs.column_{key}") for key in ("program", *_COUNTS, "largest", "std")]
    rows = [
        [
            record.name,
            *(str(getattr(record.summary, key)) for key in _COUNTS),
            *(say.number(getattr(record.summary, key), ".3f") for key in ("largest_correction_mm", "largest_std_mm")),
        ]
        for record in records
    ]
    blocks: list[Block] = [
        Text(warning, warns=True) for record in records for warning in _warnings(record, map_hash, say)
    ]
    blocks.append(Table(columns, rows))
    reasons = Counter(
        (record.name, target.verdict, target.reason)
        for record in records
        for target in record.targets
        if not target.touched
    )
    if reasons:
        columns = [say(f"programs.column_{key}") for key in ("program", "verdict", "reason", "count")]
        rows = [
            [name, say(f"programs.{verdict.replace(' ', '_')}"), reason, str(count)]
            for (name, verdict, reason), count in reasons.most_common(_REASONS)
        ]
        blocks += [Text(say("programs.why")), Table(columns, rows, left=3)]
    for record in records:
        blocks += _limits(record, say) + _targets(record, say)
    return Section(title, blocks)


def _warnings(record: Record, map_hash: str, say: Locale) -> list[str]:
    found = []
    if record.map_sha256 != map_hash:
        found.append(say("programs.other_map", program=record.name, hash=(record.map_sha256 or MISSING)[:12]))
    if record.summary.refused:
        n, policy = record.summary.refused, record.on_guard
        found.append(say("programs.refused", program=record.name, n=n, policy=policy))
    return found


def _limits(record: Record, say: Locale) -> list[Block]:
    """Return the limits of a correction with their sources; empty for a record of an older version."""
    columns = [say(f"programs.column_{key}") for key in ("setting", "value", "origin")]
    rows = [
        [key, limit.value if isinstance(limit.value, str) else say.number(limit.value, ".4g"), limit.origin]
        for key, limit in record.limits.items()
    ]
    return [Text(say("programs.limits", program=record.name)), Table(columns, rows, left=3)] if rows else []


def _targets(record: Record, say: Locale) -> list[Block]:
    """Return the table of the first corrected targets."""
    touched = [target for target in record.targets if target.touched]
    if not touched:
        return []
    words = [say(f"programs.column_{key}") for key in ("target", "line")]
    columns = [*words, "x [mm]", "y [mm]", "z [mm]", "Δx [mm]", "Δy [mm]", "Δz [mm]", say("accuracy.column_std")]
    rows = [
        [
            target.name,
            str(target.line),
            *(say.number(v, ".3f") for v in target.before_mm),
            *(say.number(v, "+.3f") for v in target.correction_mm),
            say.number(target.std_mm, ".3f"),
        ]
        for target in touched[:_SHOWN]
    ]
    blocks: list[Block] = [Text(say("programs.targets", program=record.name)), Table(columns, rows)]
    if len(touched) > _SHOWN:
        shown = say("programs.targets_more", shown=_SHOWN, n=len(record.targets), record=record.file)
        blocks.append(Text(shown))
    return blocks


def _file_name(path: str) -> str:
    return path.replace("\\", "/").rsplit("/", 1)[-1] or MISSING
