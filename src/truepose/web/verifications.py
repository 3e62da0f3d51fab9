"""Verifications: targets of a program measured again, and the decision about each."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Form, UploadFile
from pydantic import BaseModel, Field

from truepose._io.files import writing
from truepose.errors import FileError
from truepose.jobs import Job
from truepose.programs import ProgramVerification
from truepose.programs.record import head_of
from truepose.report.verification import read_verification
from truepose.verification.conformity import Assessment
from truepose.web.problems import WebError, missing
from truepose.web.uploads import MB
from truepose.web.workspace import CellFolder, InCell, InJobs, InWorkspace, StoredFile, Workspace

router = APIRouter(tags=["verifications"])
Assumption = Literal[
    "derived", "offsets", "joint-targets", "calls-keep-frames", "whole-task", "external-axes", "absolute-accuracy"
]
"""An option of reading programs, as in their correction; see ``truepose correct --help``."""


class Verifiable(BaseModel):
    """A corrected program whose targets can be measured again."""

    record: str = Field(description="the id of its record")
    program: str = Field(description="its path in the cell's folder")
    map: str | None = Field(description="the SHA-256 of the map that corrected it")
    known: bool = Field(description="whether the cell holds that map")
    modified: float


class VerificationEntry(BaseModel):
    """A verification in the list; `problem` says why its file cannot be read."""

    id: str
    name: str
    modified: float
    program: str = ""
    readings: str = ""
    map: str | None = None
    decision: Assessment | None = None
    passed: int = 0
    undecided: int = 0
    failed: int = 0
    tolerance_mm: float | None = None
    mean_mm: float | None = None
    max_mm: float | None = None
    before_mean_mm: float | None = None
    before_max_mm: float | None = None
    problem: str | None = None


class Verification(BaseModel):
    """A verification with its targets: what ``truepose verify --json`` prints, and its sentences."""

    id: str
    name: str
    modified: float
    sentences: list[str]
    found: dict[str, Any]


@router.get("/cells/{cell}/verifiable")
def verifiable(cell: InCell, workspace: InWorkspace) -> list[Verifiable]:
    """Return the corrected programs of the cell, newest first."""
    maps = {workspace.hash_of(file) for file in cell.files("map")}
    found = []
    for record in cell.files("record"):
        try:
            head = head_of(record.path)
        except FileError:
            continue
        if (program := _program(record, head)) is None:
            continue
        sha = head.get("map_sha256")
        sha = sha if isinstance(sha, str) else None
        found.append(
            Verifiable(
                record=record.id,
                program=cell.relative(program),
                map=sha,
                known=sha in maps,
                modified=record.modified,
            )
        )
    return found


@router.get("/cells/{cell}/verifications")
def verifications(cell: InCell) -> list[VerificationEntry]:
    """Return the verifications of the cell, newest first."""
    return [_entry(file) for file in cell.files("verification")]


@router.get("/cells/{cell}/verifications/{verification}")
def verification(cell: InCell, verification: str) -> Verification:
    """Return one verification with its targets."""
    file = cell.get(verification, "verification")
    found = read_verification(file.path)
    return Verification(
        id=file.id, name=file.name, modified=file.modified, sentences=found.sentences(), found=found.to_dict()
    )


@router.post("/cells/{cell}/verifications", status_code=202)
def verify(
    cell: InCell,
    workspace: InWorkspace,
    jobs: InJobs,
    readings: UploadFile,
    record: Annotated[str, Form(description="the id of the record of the corrected program")],
    before: UploadFile | None = None,
    map_file: Annotated[
        str | None, Form(description="the file of a map; by default the one that the record names")
    ] = None,
    tolerance_mm: Annotated[float | None, Form(gt=0, allow_inf_nan=False)] = None,
    uncertainty_mm: Annotated[float | None, Form(gt=0, allow_inf_nan=False)] = None,
    match: Annotated[Literal["auto", "name", "position"], Form()] = "auto",
    moved: Annotated[bool, Form(description="whether the tracker was moved: register the readings")] = False,
    columns: Annotated[str | None, Form(max_length=500)] = None,
    unit: Annotated[Literal["mm", "m", "cm", "in"] | None, Form()] = None,
    assume: Annotated[list[Assumption], Form()] = [],  # noqa: B006
) -> Job:
    """Compare readings of a corrected program's targets with the nominal ones, as ``truepose verify`` does."""
    stored_record = cell.get(record, "record")
    head = head_of(stored_record.path)
    if (program := _program(stored_record, head)) is None:
        raise missing("the corrected program of this record")
    used = _map_of(head, cell, workspace) if map_file is None else cell.get(map_file, "map").path
    measured = _stored(readings, cell)
    stem = program.name.partition(".")[0]
    out = cell.new("verifications", f"{stem}-{measured.name.partition('.')[0]}.json")
    command = ["verify", cell.relative(used), cell.relative(program), cell.relative(measured), "--cell", cell.file.name]
    if before is not None:
        command += ["--before", cell.relative(_stored(before, cell))]
    for option, value in (
        ("--tolerance", tolerance_mm),
        ("--uncertainty", uncertainty_mm),
        ("--columns", columns),
        ("--unit", unit),
    ):
        if value is not None:
            command += [f"{option}={value}"]
    command += ["--match", match, *(["--register"] if moved else []), *(f"--{one}" for one in assume)]
    command += ["--out", cell.relative(out), "--force"]
    return jobs.submit(command, folder=cell.folder, cell=cell.id, title=f"{program.name}: {measured.name}")


def _stored(upload: UploadFile, cell: CellFolder) -> Path:
    """Write an upload to a new file of the readings."""
    path = cell.new("readings", upload.filename or "")
    with writing(path, force=False) as [file]:
        shutil.copyfileobj(upload.file, file, MB)
    return path


def _program(record: StoredFile, head: dict[str, Any]) -> Path | None:
    """Return the corrected program of a record: the file beside it with the program's name, or the record's folder."""
    name = head.get("program")
    if not isinstance(name, str):
        return None
    beside = record.path.with_name(Path(name).name or record.path.name)
    return beside if beside.exists() else record.path.parent


def _map_of(head: dict[str, Any], cell: CellFolder, workspace: Workspace) -> Path:
    for file in cell.files("map"):
        if workspace.hash_of(file) == head.get("map_sha256"):
            return file.path
    raise WebError(404, "No map", "the map that corrected this program is not in this cell; copy its file to the cell")


def _entry(file: StoredFile) -> VerificationEntry:
    try:
        found = read_verification(file.path)
    except FileError as error:
        return VerificationEntry(id=file.id, name=file.name, modified=file.modified, problem=str(error))
    return _summary(file, found)


def _summary(file: StoredFile, found: ProgramVerification) -> VerificationEntry:
    after, before = found.figures["after"], found.figures.get("before", {})
    return VerificationEntry(
        id=file.id,
        name=file.name,
        modified=file.modified,
        program=found.program,
        readings=found.readings,
        map=found.map_sha256,
        decision=found.decision,
        passed=found.counts["pass"],
        undecided=found.counts["undecided"],
        failed=found.counts["fail"],
        tolerance_mm=found.tolerance_mm,
        mean_mm=after["mean_mm"],
        max_mm=after["max_mm"],
        before_mean_mm=before.get("mean_mm"),
        before_max_mm=before.get("max_mm"),
    )
