"""The maps of a cell in the store: their states and signatures, release, withdrawal, recall, audit trail and drift."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, Annotated, Any, Literal

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, Field

from truepose._io.delimited import escaped
from truepose.errors import one_line
from truepose.web.team.visits import InTeam, InVisit
from truepose.web.workspace import InCell, InWorkspace

if TYPE_CHECKING:
    from truepose.store.releases import Recall

router = APIRouter(tags=["releases"])
_COLUMNS = ("map", "map_sha256", "robot", "program", "program_sha256", "output_sha256", "draft", "corrected_by", "time")
MapState = Literal["draft", "released", "superseded", "withdrawn"]
FileState = Literal["draft", "released", "superseded", "withdrawn", "unknown"]
AuditedKind = Literal["cell", "campaign", "reading_set", "map", "correction", "verification", "release"]


class Signature(BaseModel):
    """A release or a withdrawal."""

    user: str
    time: str
    meaning: str
    reason: str | None


class StoredMap(BaseModel):
    """A map of the cell in the store."""

    sha256: str
    name: str
    predictor: str
    state: MapState
    made_by: str
    created: str
    parent: str | None = Field(None, description="SHA-256 of the map that it updates")
    n: int | None = Field(None, description="number of samples")
    mean_mm: float | None = Field(None, description="expected mean error after correction, by cross-validation")
    p95_mm: float | None
    corrections: int
    signatures: list[Signature]


class StoredMaps(BaseModel):
    """The maps of a cell, and the head of the audit trail."""

    maps: list[StoredMap]
    sequence: int
    head: str


class States(BaseModel):
    """The states of the maps that files of a cell are, or were corrected with."""

    maps: dict[str, FileState] = Field(description="by the SHA-256 of the map")
    files: dict[str, FileState] = Field(description="of maps and records of corrections, by the id of the file")


class Signed(BaseModel):
    """A signature: the password again, and a comment or a reason."""

    password: str = Field(max_length=2000)
    reason: str = Field("", max_length=2000)


class RecalledProgram(BaseModel):
    """A program that a map corrected."""

    map: str
    map_sha256: str
    robot: str
    program: str
    program_sha256: str
    output_sha256: str
    draft: bool
    made_by: str
    created: str


class AuditEntry(BaseModel):
    """An entry of the audit trail."""

    sequence: int
    time: str
    user: str
    action: str
    object: str
    object_id: int | None
    name: str | None = Field(description="of the object, or of its map or program")
    payload: dict[str, Any]
    hash: str


class AuditPart(BaseModel):
    """A part of the audit trail, and the number of all entries that match."""

    total: int
    rows: list[AuditEntry]


class DriftPoint(BaseModel):
    """What a map or a verification says of the accuracy at a time."""

    time: str
    kind: Literal["map", "update", "verification"]
    name: str
    of: str = Field(description="what the numbers are of: cross-validation, or measured")
    n: int | None
    mean_mm: float
    p95_mm: float | None


@router.get("/cells/{cell}/releases")
def stored_maps(cell: InCell, team: InTeam, visit: InVisit) -> StoredMaps:
    """Return the maps of the cell in the store, newest first."""
    from truepose.web.team import records

    return StoredMaps.model_validate(records.maps(team.store, visit.identity, cell.file))


@router.get("/cells/{cell}/states")
def map_states(cell: InCell, workspace: InWorkspace, team: InTeam, visit: InVisit) -> States:
    """Return which maps and corrections of the cell are drafts, superseded, withdrawn or not in the store."""
    from truepose.web.team import records

    return States.model_validate(records.states(team.store, visit.identity, cell, workspace))


@router.post("/releases/{sha}", status_code=204)
def release(sha: str, signed: Signed, team: InTeam, visit: InVisit) -> Response:
    """Release a map that somebody else has made."""
    from truepose.store.releases import release_map

    team.confirm_again(visit.identity, signed.password)
    release_map(team.store, visit.identity, sha, signed.password, comment=signed.reason or None)
    return Response(status_code=204)


@router.post("/releases/{sha}/withdrawal")
def withdraw(sha: str, signed: Signed, team: InTeam, visit: InVisit) -> list[RecalledProgram]:
    """Withdraw a map for a reason; return the programs that it corrected."""
    from truepose.store.releases import withdraw_map

    team.confirm_again(visit.identity, signed.password)
    return _programs(withdraw_map(team.store, visit.identity, sha, signed.password, signed.reason))


@router.get("/releases/{sha}/recall")
def recalled(sha: str, team: InTeam, visit: InVisit) -> list[RecalledProgram]:
    """Return the programs that a map and its updates corrected."""
    from truepose.store.releases import recall_map

    return _programs(recall_map(team.store, visit.identity, sha))


@router.get("/releases/{sha}/recall.csv", response_class=Response)
def recall_table(sha: str, team: InTeam, visit: InVisit) -> Response:
    """Return the programs that a map and its updates corrected as a table."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for one in recalled(sha, team, visit):
        writer.writerow([escaped(one_line(str(value))) for value in one.model_dump().values()])
    headers = {"Content-Disposition": 'attachment; filename="recall.csv"'}
    return Response("\ufeff" + text.getvalue(), media_type="text/csv; charset=utf-8", headers=headers)


@router.get("/cells/{cell}/audit")
def audit_trail(
    cell: InCell,
    team: InTeam,
    visit: InVisit,
    text: Annotated[str, Query(max_length=200, description="a part of time, user, action, values or hash")] = "",
    kind: Annotated[AuditedKind | None, Query(description="only entries about this kind of object")] = None,
    offset: Annotated[int, Query(ge=0)] = 0,
    limit: Annotated[int, Query(ge=1, le=1000)] = 200,
) -> AuditPart:
    """Return a part of the audit trail about the cell and what belongs to it, newest first."""
    from truepose.web.team import records

    wanted = records.AuditFilter(text, kind, offset, limit)
    return AuditPart.model_validate(records.audit_of(team.store, visit.identity, cell.file, wanted))


@router.get("/cells/{cell}/drift")
def drift(cell: InCell, team: InTeam, visit: InVisit) -> list[DriftPoint]:
    """Return the figures of the cell's maps, updates and verifications by time."""
    from truepose.web.team import records

    return [DriftPoint.model_validate(one) for one in records.drift(team.store, visit.identity, cell.file)]


def _programs(found: Recall) -> list[RecalledProgram]:
    return [
        RecalledProgram(
            map=of["name"],
            map_sha256=of["sha256"],
            **{name: one[name] for name in ("robot", "program", "program_sha256", "output_sha256", "draft")},
            made_by=one["made_by"],
            created=one["created"],
        )
        for of, corrections in [(found.map, found.corrections), *found.updated]
        for one in corrections
    ]
