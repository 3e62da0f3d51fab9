"""Corrections: their counts, targets, paths and differences, and their files."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal
from urllib.parse import quote

from fastapi import APIRouter, Depends, Query, Request
from pydantic import BaseModel
from starlette.responses import FileResponse, HTMLResponse, Response, StreamingResponse

from truepose.programs.coverage import Coverage
from truepose.report.coverage import page
from truepose.web.corrections import stored
from truepose.web.corrections.answers import (
    MOST_ROWS,
    IndexState,
    Kind,
    MostPoints,
    TargetPage,
    TargetQuery,
    json_answer,
    path_answer,
)
from truepose.web.corrections.index import CorrectionIndexes
from truepose.web.corrections.stored import CorrectionFinder, StoredCorrection
from truepose.web.corrections.table import TargetTable
from truepose.web.problems import missing
from truepose.web.workspace import InCell, InWorkspace

router = APIRouter(tags=["corrections"])
_NO_SCRIPTS: Final = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; frame-ancestors 'self'"
)
_WORKBOOK: Final = "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"


class CorrectionEntry(BaseModel):
    """A correction in a list."""

    id: str
    cell: str
    record: str
    """The id of the record among the files of the cell."""
    name: str
    folder: str
    program: str
    modified: float
    size: int
    map_sha256: str | None
    on_guard: str
    summary: dict[str, Any]
    warnings: list[str]

    @classmethod
    def of(cls, one: StoredCorrection) -> CorrectionEntry:
        """Return the entry of a correction."""
        return cls(
            id=one.id,
            cell=one.cell.id,
            record=one.file.id,
            name=one.stem,
            folder=one.file.name.rpartition("/")[0],
            program=str(one.head.get("program", "")),
            modified=one.file.modified,
            size=one.file.size,
            map_sha256=one.head.get("map_sha256"),
            on_guard=str(one.head.get("on_guard", "")),
            summary=dict(one.head.get("summary", {})),
            warnings=[str(text) for text in one.head.get("warnings", [])],
        )


class CorrectedFile(BaseModel):
    """A file of a correction, and the size of its difference."""

    file: str
    changed: int
    lines: int
    rows: int
    found: bool
    """Whether both versions are in the cell's folder, unchanged."""


class CorrectionDetail(CorrectionEntry):
    """A correction with its limits, reasons and coverage."""

    limits: dict[str, Any]
    continuity: dict[str, Any]
    blended: dict[str, int]
    refused: dict[str, str]
    index: IndexState
    kinds: list[Kind]
    verdicts: dict[str, int]
    coverage: dict[str, Any] | None
    files: list[CorrectedFile]
    box: list[list[float]] | None


class DifferenceRow(BaseModel):
    """A row of a difference; every second part of the text, from the second, is changed."""

    kind: Literal["header", "context", "old", "new"]
    line: int
    parts: list[str]


class DifferencePage(BaseModel):
    """Some rows of a difference."""

    file: str
    total: int
    offset: int
    changed: int
    lines: int
    rows: list[DifferenceRow]


def _correction(request: Request, id: str) -> StoredCorrection:  # noqa: A002 - the name in the address
    state = request.app.state
    if not hasattr(state, "corrections"):
        state.corrections = CorrectionFinder(state.workspace)
    finder: CorrectionFinder = state.corrections
    return finder.find(id)


def _indexes(request: Request) -> CorrectionIndexes:
    return CorrectionIndexes.of(request.app)


Indexes = Annotated[CorrectionIndexes, Depends(_indexes)]
Correction = Annotated[StoredCorrection, Depends(_correction)]


def _table(correction: Correction, indexes: Indexes) -> TargetTable:
    return indexes.table(correction.record, correction.cell.folder)


Table = Annotated[TargetTable, Depends(_table)]


@router.get("/cells/{cell}/corrections")
def corrections(cell: InCell, workspace: InWorkspace) -> list[CorrectionEntry]:
    """Return the corrections of a cell, newest first; also those that the command line wrote."""
    return [CorrectionEntry.of(one) for one in stored.corrections(workspace, cell)]


@router.get("/corrections/{id}")
def correction_detail(correction: Correction, indexes: Indexes) -> CorrectionDetail:
    """Return a correction; begins to index its targets, and says how far that is."""
    state = indexes.state(correction.record, correction.cell.folder)
    entry, head = CorrectionEntry.of(correction), correction.head
    known = indexes.table(correction.record, correction.cell.folder).summary if state.ready else {}
    files = [{**one, "found": bool(one["before"] and one["after"])} for one in known.get("files", [])]
    return CorrectionDetail.model_validate(
        {
            **entry.model_dump(),
            **{name: head.get(name, {}) for name in ("limits", "continuity", "blended", "refused")},
            "index": {"ready": state.ready, "done": state.done, "total": state.total},
            "kinds": known.get("kinds", []),
            "verdicts": known.get("verdicts", {}),
            "coverage": known.get("coverage"),
            "files": files,
            "box": known.get("box"),
        }
    )


@router.get("/corrections/{id}/targets", response_model=TargetPage)
def targets(table: Table, asked: Annotated[TargetQuery, Depends()]) -> Response:
    """Return some targets of a correction, sorted and filtered; with `row` also where that target stands."""
    return asked.answer(table)


@router.get("/corrections/{id}/path.bin", response_class=Response)
def correction_path(table: Table, most: MostPoints = 20_000) -> Response:
    """Return the path in the base frame: positions before, corrections, rows and verdicts; see `TargetTable.path`."""
    return path_answer(table, most)


@router.get("/corrections/{id}/diff", response_model=DifferencePage)
def correction_diff(
    correction: Correction,
    indexes: Indexes,
    file: Annotated[int, Query(ge=0)] = 0,
    offset: Annotated[int, Query(ge=0)] = 0,
    limit: Annotated[int, Query(ge=1, le=MOST_ROWS)] = 200,
    line: Annotated[int | None, Query(ge=1)] = None,
) -> Response:
    """Return some rows of the difference of a file; with `line` from the rows that show that line."""
    difference = indexes.difference(correction.record, correction.cell.folder, file)
    entry = indexes.table(correction.record, correction.cell.folder).summary["files"][file]
    first = offset if line is None else max(0, difference.row_of(line) - 4)
    known = {"file": entry["file"], "total": entry["rows"], "changed": entry["changed"], "lines": entry["lines"]}
    return json_answer({**known, "offset": first, "rows": difference.page(first, limit)})


@router.get("/corrections/{id}/files.zip", response_class=StreamingResponse)
def correction_files(correction: Correction, table: Table) -> StreamingResponse:
    """Return the corrected files and the record as a .zip."""
    files = stored.files_to_send(correction, table.summary["files"])
    headers = _attached(f"{correction.stem}.zip")
    return StreamingResponse(stored.zipped(files), media_type="application/zip", headers=headers)


@router.get("/corrections/{id}/record", response_class=Response)
def correction_record(correction: Correction, format: Literal["json", "csv", "xlsx"] = "json") -> Response:  # noqa: A002
    """Return the record as JSON, CSV or a workbook."""
    if format == "xlsx":
        headers = _attached(f"{correction.stem}.corrections.xlsx")
        return Response(stored.workbook(correction), media_type=_WORKBOOK, headers=headers)
    path = correction.record if format == "json" else correction.beside(".corrections.csv")
    if not path.is_file():
        raise missing("the CSV of this record")
    kind = "application/json" if format == "json" else "text/csv; charset=utf-8"
    return FileResponse(path, media_type=kind, filename=path.name)


@router.get("/corrections/{id}/coverage", response_class=HTMLResponse)
def correction_coverage(
    correction: Correction,
    table: Table,
    format: Literal["html", "csv"] = "html",  # noqa: A002
    download: bool = False,
) -> Response:
    """Return how much is corrected and what would allow more, as a page or a table."""
    refused = correction.head.get("refused", {}).values()
    coverage = Coverage.from_dict(table.summary["coverage"], refused)
    name = f"{correction.stem}.coverage.{format}"
    headers = _attached(name) if download or format == "csv" else {}
    if format == "csv":
        return Response(coverage.to_csv(), media_type="text/csv; charset=utf-8", headers=headers)
    headers |= {"Content-Security-Policy": _NO_SCRIPTS, "X-Frame-Options": "SAMEORIGIN"}
    return HTMLResponse(page(coverage), headers=headers)


def _attached(name: str) -> dict[str, str]:
    """Return the header that makes a browser save an answer under a name."""
    return {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name, safe='', errors='replace')}"}
