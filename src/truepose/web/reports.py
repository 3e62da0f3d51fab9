"""Reports about maps, with accuracy, corrected programs and verifications."""

from __future__ import annotations

import importlib.util
from typing import Final, Literal

from fastapi import APIRouter
from pydantic import BaseModel, Field
from starlette.responses import FileResponse

from truepose.jobs import Job
from truepose.web.problems import WebError
from truepose.web.workspace import CellFolder, InCell, InJobs, Kind, StoredFile, identity

router = APIRouter(tags=["reports"])
_KINDS: Final = {".html": "text/html; charset=utf-8", ".pdf": "application/pdf"}
_PREVIEW: Final = {
    "Content-Security-Policy": (
        "sandbox allow-scripts; default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
        "font-src data:; img-src data:; form-action 'none'; base-uri 'none'; frame-ancestors 'self'"
    ),
    "X-Frame-Options": "SAMEORIGIN",
}
"""The headers of a preview: the report may show what it holds, has no origin, and can ask no server."""


class ReportEntry(BaseModel):
    """A report of the cell."""

    id: str
    name: str
    format: Literal["html", "pdf"]
    modified: float
    size: int


class Reports(BaseModel):
    """The reports of the cell, newest first, and whether this installation can write PDF."""

    pdf: bool
    reports: list[ReportEntry]


class ReportOrder(BaseModel):
    """The contents of a report; files by their ids."""

    map: str = Field(description="the file of the map")
    language: Literal["en", "de", "zh"] = "en"
    format: Literal["html", "pdf"] = "html"
    interactive: bool = Field(False, description="whether errors and arm can be turned; HTML only")
    test: str | None = Field(None, description="held-out samples, for the accuracy before and after")
    records: list[str] = Field([], description="the records of corrected programs", max_length=1000)
    verifications: list[str] = Field([], max_length=1000)


@router.get("/cells/{cell}/reports")
def reports(cell: InCell) -> Reports:
    """Return the reports of the cell."""
    return Reports(
        pdf=importlib.util.find_spec("typst") is not None, reports=[_entry(file) for file in cell.files("report")]
    )


@router.post("/cells/{cell}/reports", status_code=202)
def write(order: ReportOrder, cell: InCell, jobs: InJobs) -> Job:
    """Write a report about a map, as ``truepose report`` does."""
    used = cell.get(order.map, "map")
    if order.interactive and order.format == "pdf":
        raise WebError(422, "Not possible", "a PDF cannot be interactive; choose HTML")
    command = ["report", cell.relative(used.path), "--cell", cell.file.name, "--locale", order.language]
    kinds: list[tuple[str, list[str], Kind]] = [
        ("--test", [] if order.test is None else [order.test], "samples"),
        ("--program", order.records, "record"),
        ("--verification", order.verifications, "verification"),
    ]
    for option, ids, kind in kinds:
        for path in _paths(cell, ids, kind):
            command += [option, path]
    command += ["--interactive"] if order.interactive else []
    # two orders at once have one name only if they are the same order
    stem = f"{used.path.stem}-{order.language}-{identity(order.model_dump_json())[:4]}"
    out = cell.new("reports", f"{stem}.{order.format}")
    return jobs.submit(
        [*command, "--out", cell.relative(out), "--force"], folder=cell.folder, cell=cell.id, title=out.name
    )


@router.get("/cells/{cell}/reports/{report}/file", response_class=FileResponse)
def download(cell: InCell, report: str) -> FileResponse:
    """Send a report as a file."""
    file = cell.get(report, "report")
    return FileResponse(file.path, media_type=_KINDS[file.path.suffix.lower()], filename=file.path.name)


@router.get("/cells/{cell}/reports/{report}/preview", response_class=FileResponse)
def preview(cell: InCell, report: str) -> FileResponse:
    """Send an HTML report for a frame of the page; its own policy keeps it from everything else."""
    file = cell.get(report, "report")
    if file.path.suffix.lower() != ".html":
        raise WebError(404, "No preview", "only HTML reports have a preview; download the file")
    return FileResponse(file.path, media_type=_KINDS[".html"], headers=_PREVIEW)


def _paths(cell: CellFolder, ids: list[str], kind: Kind) -> list[str]:
    """Return the paths of files as the command line names them."""
    files = {file.id: file for file in cell.files(kind)} if ids else {}
    return [cell.relative(files[one].path if one in files else cell.get(one, kind).path) for one in ids]


def _entry(file: StoredFile) -> ReportEntry:
    kind: Literal["html", "pdf"] = "pdf" if file.path.suffix.lower() == ".pdf" else "html"
    return ReportEntry(id=file.id, name=file.name, format=kind, modified=file.modified, size=file.size)
