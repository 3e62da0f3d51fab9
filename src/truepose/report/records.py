"""The records of corrected programs that ``truepose correct`` writes, and their section of the report."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError

from truepose._io import files
from truepose._io.delimited import escaped
from truepose.errors import FileError
from truepose.programs.core.reasons import kind_of
from truepose.programs.record import DRAFT
from truepose.report.document import Attachment, Block, Section, Table, Text
from truepose.report.locale import MISSING, Locale

_NAMED: Final = 6
"""The number of programs that a sentence names."""
HASHES: Final = "hashes.csv"
"""The name of the attached table of SHA-256."""
TABLE: Final = "targets.csv"
"""The name of the attached table."""
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
    file: str = ""
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
    map_state: str | None = None
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
    def provenance(self) -> list[tuple[str, str]]:
        """The name and the SHA-256 of the record, and of each changed file after the correction."""
        return [(self.file, self.sha256), *self.hashes]

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
    if len(records) > 1:
        rows.append(_total(records, say))
    blocks: list[Block] = _warnings(records, map_hash, say)
    n = sum(len(record.targets) for record in records)
    attached = Text(say("programs.all_targets", n=n, table=TABLE))
    blocks += [Table(columns, rows), attached, *_reasons(records, say), *_limits(records, say)]
    return Section(title, blocks)


def attachment(records: Sequence[Record], say: Locale) -> list[Attachment]:
    """Return the tables of all targets and of all SHA-256 as CSV, to attach; none without records."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    places = [f"{axis}_{kind}_mm" for kind in ("before", "correction") for axis in "xyz"]
    writer.writerow(["program", "file", "line", "target", *places, "std_mm", "verdict", "reason"])
    for record in records:
        for t in record.targets:
            numbers = ["" if v is None else f"{v:.6f}" for v in (*t.before_mm, *t.correction_mm, t.std_mm)]
            words = [escaped(word) for word in (record.program, t.file)]
            writer.writerow([*words, t.line, escaped(t.name), *numbers, t.verdict, escaped(t.reason)])
    if not records:
        return []
    hashed = "".join(f"{escaped(name)},{digest}\n" for record in records for name, digest in record.provenance)
    return [
        Attachment(TABLE, say("programs.attached"), buffer.getvalue()),
        Attachment(HASHES, say("provenance.attached"), f"file,sha256\n{hashed}"),
    ]


def _total(records: Sequence[Record], say: Locale) -> list[str]:
    sums = [str(sum(getattr(record.summary, key) for record in records)) for key in _COUNTS]
    largest = (
        max((v for record in records if (v := getattr(record.summary, key)) is not None), default=None)
        for key in ("largest_correction_mm", "largest_std_mm")
    )
    return [say("programs.total"), *sums, *(say.number(value, ".3f") for value in largest)]


def _reasons(records: Sequence[Record], say: Locale) -> list[Block]:
    """Return the table of the reasons why targets are unchanged; reasons of one kind are one row."""
    found: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for record in records:
        for target in record.targets:
            if not target.touched:
                group = found.setdefault((target.verdict, kind_of(target.reason)), [])
                group.append((record.program, target.reason))
    if not found:
        return []
    ranked = sorted(found.items(), key=lambda item: -len(item[1]))[:_REASONS]
    columns = [say(f"programs.column_{key}") for key in ("verdict", "reason", "programs", "count")]
    rows = [
        [
            say(f"programs.{verdict.replace(' ', '_')}"),
            some[0][1] if len({reason for _, reason in some}) == 1 else common,
            str(len({program for program, _ in some})),
            str(len(some)),
        ]
        for (verdict, common), some in ranked
    ]
    return [Text(say("programs.why")), Table(columns, rows, left=2)]


def _warnings(records: Sequence[Record], map_hash: str, say: Locale) -> list[Block]:
    """Return warnings of programs that were corrected with another map, and of refused targets: one for each kind."""
    others: dict[str, list[Record]] = {}
    refused: dict[str, list[Record]] = {}
    drafts = [record for record in records if record.map_state == DRAFT]
    for record in records:
        if record.map_sha256 != map_hash:
            others.setdefault((record.map_sha256 or MISSING)[:12], []).append(record)
        if record.summary.refused:
            refused.setdefault(record.on_guard, []).append(record)
    found = [say("programs.draft", program=_names(drafts, say))] if drafts else []
    found += [say("programs.other_map", program=_names(some, say), hash=other) for other, some in others.items()]
    for policy, some in refused.items():
        n = sum(record.summary.refused for record in some)
        found.append(say("programs.refused", program=_names(some, say), n=n, policy=policy))
    return [Text(warning, warns=True) for warning in found]


def _names(some: Sequence[Record], say: Locale) -> str:
    """Return the names of programs; of many, the first and the number of the others."""
    names = [record.name for record in some[:_NAMED]]
    more = [say("cell.more", n=len(some) - _NAMED)] if len(some) > _NAMED else []
    return say("finding.list").join([*names, *more])


def _limits(records: Sequence[Record], say: Locale) -> list[Block]:
    """Return the limits with their sources, once for programs that share them; records of older versions have none."""
    shared: dict[str, list[Record]] = {}
    for record in records:
        if record.limits:
            shared.setdefault(json.dumps({k: v.model_dump() for k, v in record.limits.items()}), []).append(record)
    columns = [say(f"programs.column_{key}") for key in ("setting", "value", "origin")]
    blocks: list[Block] = []
    for some in shared.values():
        rows = [
            [key, limit.value if isinstance(limit.value, str) else say.number(limit.value, ".4g"), limit.origin]
            for key, limit in some[0].limits.items()
        ]
        blocks += [Text(say("programs.limits", program=_names(some, say))), Table(columns, rows, left=3)]
    return blocks


def _file_name(path: str) -> str:
    return path.replace("\\", "/").rsplit("/", 1)[-1] or MISSING
