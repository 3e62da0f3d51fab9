"""Programs: uploads, their verdicts and their corrections."""

from __future__ import annotations

from typing import Any, Final

from anyio import to_thread
from fastapi import APIRouter, Request
from pydantic import BaseModel

from truepose.jobs import Job
from truepose.web.multipart import FORM, received
from truepose.web.programs import commands, stored
from truepose.web.programs.commands import CorrectionOptions, ReadingOptions
from truepose.web.programs.previews import preview_words
from truepose.web.programs.stored import StoredProgram
from truepose.web.workspace import CellFolder, InCell, InJobs, InWorkspace

router = APIRouter(tags=["programs"])
_SHOWN: Final = 200


class ProgramEntry(BaseModel):
    """An upload: one file, one backup, or files that belong together."""

    id: str
    name: str
    files: list[str]
    count: int
    size: int
    modified: float
    languages: list[str]
    given: list[str]
    """The paths that a command in the cell's folder is given."""

    @classmethod
    def of(cls, cell: CellFolder, one: StoredProgram) -> ProgramEntry:
        """Return the entry of an upload; of very many files the first ones."""
        base = one.path if one.path.is_dir() else one.path.parent
        shown = [file.relative_to(base).as_posix() for file in one.files[:_SHOWN]]
        return cls(
            id=one.id,
            name=one.name,
            files=shown,
            count=len(one.files),
            size=one.size,
            modified=one.modified,
            languages=one.languages,
            given=[cell.relative(path) for path in one.given()],
        )


@router.get("/cells/{cell}/programs")
def programs(cell: InCell) -> list[ProgramEntry]:
    """Return the uploaded programs of a cell, newest first."""
    return [ProgramEntry.of(cell, one) for one in stored.stored_programs(cell)]


@router.post("/cells/{cell}/programs", status_code=201, openapi_extra=FORM)
async def upload_programs(request: Request, cell: InCell) -> ProgramEntry:
    """Keep files, a folder or a backup (.zip) as one upload; nothing is seen before all of it has arrived."""
    async with received(request, cell.folder / stored.FOLDER) as upload:
        return await to_thread.run_sync(_kept, cell, upload)


def _kept(cell: CellFolder, upload: Any) -> ProgramEntry:
    return ProgramEntry.of(cell, stored.keep(cell, upload))


class CheckRequest(BaseModel):
    """The options of a check."""

    options: ReadingOptions = ReadingOptions()


class CorrectionRequest(BaseModel):
    """What to correct with which map, and how."""

    map: str
    """The SHA-256 of the map."""
    program: str
    """The id of the upload."""
    name: str = ""
    """The name of the folder of the results; by default that of the upload."""
    options: CorrectionOptions = CorrectionOptions()


@router.post("/cells/{cell}/programs/{id}/check", status_code=202)
def check_program(cell: InCell, workspace: InWorkspace, jobs: InJobs, id: str, wanted: CheckRequest) -> Job:  # noqa: A002 - as in the address
    """Begin to list which targets of an upload can be corrected; needs no map."""
    program = stored.stored_program(cell, id)
    command = [*commands.check_command(cell, program, wanted.options), *preview_words(workspace, cell)]
    return jobs.submit(command, folder=cell.folder, cell=cell.id, title=f"Check {program.name}")


@router.post("/cells/{cell}/corrections", status_code=202)
def correct_program(cell: InCell, workspace: InWorkspace, jobs: InJobs, wanted: CorrectionRequest) -> Job:
    """Begin to correct an upload with a map, into a new folder below ``corrected/``; or show what would change."""
    program = stored.stored_program(cell, wanted.program)
    _, file, _ = workspace.map(wanted.map)
    command = commands.correct_command(cell, program, file.path, wanted.name, wanted.options)
    if wanted.options.dry_run:
        command += preview_words(workspace, cell)
    return jobs.submit(command, folder=cell.folder, cell=cell.id, title=f"Correct {program.name}")
