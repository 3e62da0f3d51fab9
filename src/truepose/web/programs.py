"""Programs: uploads, their verdicts and their corrections."""

from __future__ import annotations

from typing import Any, Final

from anyio import to_thread
from fastapi import APIRouter, Request
from pydantic import BaseModel

from truepose.web import stored_programs
from truepose.web.multipart import received
from truepose.web.stored_programs import StoredProgram
from truepose.web.workspace import CellFolder, InCell

router = APIRouter(tags=["programs"])
_SHOWN: Final = 200
FORM: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["files"],
                    "properties": {
                        "files": {
                            "type": "array",
                            "items": {"type": "string", "format": "binary"},
                            "description": "Files; the relative path of a dropped folder is the file name.",
                        }
                    },
                }
            }
        },
    }
}


class ProgramEntry(BaseModel):
    """An upload: one file, one backup, or files that belong together."""

    id: str
    name: str
    files: list[str]
    count: int
    size: int
    modified: float
    languages: list[str]

    @classmethod
    def of(cls, one: StoredProgram) -> ProgramEntry:
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
        )


@router.get("/cells/{cell}/programs")
def programs(cell: InCell) -> list[ProgramEntry]:
    """Return the uploaded programs of a cell, newest first."""
    return [ProgramEntry.of(one) for one in stored_programs.stored_programs(cell)]


@router.post("/cells/{cell}/programs", status_code=201, openapi_extra=FORM)
async def upload_programs(request: Request, cell: InCell) -> ProgramEntry:
    """Keep files, a folder or a backup (.zip) as one upload; nothing is seen before all of it has arrived."""
    async with received(request, cell.folder / stored_programs.FOLDER) as upload:
        return await to_thread.run_sync(_kept, cell, upload)


def _kept(cell: CellFolder, upload: Any) -> ProgramEntry:
    return ProgramEntry.of(stored_programs.keep(cell, upload))
