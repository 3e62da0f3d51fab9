"""Cells: their list, their files, and the text of the cell file."""

from __future__ import annotations

import shutil
import threading
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import APIRouter, Form, Header, Response, UploadFile
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import FileResponse

from truepose._io.files import LARGEST_CONFIG, read_bytes, write_atomic
from truepose.cell import ANGLE_KEYS, Cell, write_template
from truepose.errors import FileError, TrueposeError, one_line
from truepose.jobs import Job
from truepose.robots import list_robots, load_robot
from truepose.robots.io.library import ROBOT_FILES
from truepose.web.cells.text import Change, KeyProblem, as_file, cell_schema, changed, etag_of, problems_in, values_of
from truepose.web.problems import WebError, problem_response
from truepose.web.uploads import safe_name
from truepose.web.workspace import CellFolder, InCell, InJobs, InWorkspace, Kind

router = APIRouter(tags=["cells"])
_SAVING: Final = threading.Lock()
_ROBOT_FILE: Final = "robot"
_VIRTUAL: Final = "virtual-cell"


class CellSummary(BaseModel):
    """A cell of the workspace."""

    id: str
    name: str
    robot: str | None = Field(description="maker and model; null if the cell file cannot be read")
    problem: str | None = Field(description="why the cell file cannot be read")
    files: dict[Kind, int] = Field(description="number of files by kind")


class FileEntry(BaseModel):
    """A file of a cell."""

    id: str
    name: str
    kind: Kind
    modified: float = Field(description="seconds since 1970")
    size: int


class RobotEntry(BaseModel):
    """A robot of the library."""

    name: str
    maker: str
    model: str
    reach_mm: float | None
    axes: int


class CellText(BaseModel):
    """The text of a cell file, what it states, and its errors."""

    text: str
    values: dict[str, Any] | None = Field(description="the values; null if the text is not TOML")
    problems: list[KeyProblem]
    controller: str | None = Field(description="the controller whose angles the file states")
    angles: list[str] = Field(description="the keys of an orientation")
    axes: int | None


class CellDocument(CellText):
    """A cell file with the schema of its form; the header ETag is its version."""

    model_config = ConfigDict(serialize_by_alias=True, populate_by_name=True)
    id: str
    name: str
    json_schema: dict[str, Any] = Field(alias="schema")
    command: str = Field(description="the command line that makes such a file")


class Edit(BaseModel):
    """A new text of a cell file, changes of single keys, or changes of a text that is not saved yet."""

    text: str | None = Field(None, max_length=LARGEST_CONFIG)
    changes: list[Change] = []


@router.get("/cells")
def list_cells(workspace: InWorkspace) -> list[CellSummary]:
    """Return the cells of the workspace."""
    return [_summary(cell) for cell in workspace.cells()]


def _summary(cell: CellFolder) -> CellSummary:
    robot, problem = None, None
    try:
        found = cell.load().load_robot()
        robot = f"{found.maker} {found.model}".strip() or found.name
    except TrueposeError as error:
        problem = str(error).replace(f"{cell.folder}/", "")
    counts: dict[Kind, int] = {}
    for file in cell.files():
        counts[file.kind] = counts.get(file.kind, 0) + 1
    return CellSummary(id=cell.id, name=one_line(cell.name), robot=robot, problem=problem, files=counts)


@router.get("/robots")
def robots() -> list[RobotEntry]:
    """Return the robots of the library."""
    return list(_library())


@cache
def _library() -> tuple[RobotEntry, ...]:
    found = []
    for name in list_robots():
        robot = load_robot(name)
        reach = None if robot.data_sheet is None else robot.data_sheet.reach_mm
        found.append(RobotEntry(name=name, maker=robot.maker, model=robot.model, reach_mm=reach, axes=robot.dof))
    return tuple(found)


@router.post("/cells", status_code=201)
def new_cell(
    workspace: InWorkspace,
    name: Annotated[str, Form(min_length=1, max_length=150)],
    robot: Annotated[str | None, Form(max_length=150)] = None,
    file: UploadFile | None = None,
) -> CellSummary:
    """Make a cell with a robot of the library, or with that of a file."""
    cell = workspace.new_cell(name)
    cell.folder.mkdir()
    try:
        model = robot if file is None else str(_robot_file(cell, file))
        if not model or (file is None and model not in list_robots()):
            raise WebError(422, "Robot", "choose a robot of the library, or a file with a robot (.toml, .urdf or .csv)")
        write_template(cell.folder, model)
    except BaseException:
        shutil.rmtree(cell.folder, ignore_errors=True)
        raise
    return _summary(cell)


@router.post("/cells/virtual", status_code=202)
def virtual_cell(workspace: InWorkspace, jobs: InJobs) -> Job:
    """Start to make a virtual cell, whose errors are known, with the whole workflow of ``truepose demo``."""
    cell = workspace.new_cell(_VIRTUAL)
    cell.folder.mkdir()  # the name is taken from now on
    from truepose.studies.demo import EVERY_VIEW

    command = ["demo", cell.name, "--predictor", EVERY_VIEW]
    return jobs.submit(command, folder=workspace.root, cell=cell.id, title="Virtual cell")


def _robot_file(cell: CellFolder, file: UploadFile) -> Path:
    """Write a robot file into the folder of a new cell; return its path."""
    name = safe_name(file.filename or "")
    if Path(name).suffix.lower() not in ROBOT_FILES:
        raise WebError(422, "Robot", f"{name} is no robot file; expected .toml, .urdf or .csv")
    path = cell.folder / (f"{_ROBOT_FILE}.toml" if name.lower() == cell.file.name else name)
    write_atomic(path, file.file.read())
    return path


@router.get("/cells/{cell}", responses={200: {"headers": {"ETag": {"schema": {"type": "string"}}}}})
def read_cell(cell: InCell, response: Response) -> CellDocument:
    """Return the cell file."""
    return _document(cell, response)


def _document(cell: CellFolder, response: Response) -> CellDocument:
    content = read_bytes(cell.file, LARGEST_CONFIG)
    response.headers["ETag"] = etag_of(content)
    shown = _shown(cell, _decoded(content, cell.file).replace("\r\n", "\n"))
    model = (shown.values or {}).get("robot", {})
    model = model.get("model") if isinstance(model, dict) else None
    command = f"truepose init {_quoted(one_line(cell.name))} --robot {_quoted(str(model or 'ROBOT'))}"
    return CellDocument(**dict(shown), id=cell.id, name=one_line(cell.name), json_schema=cell_schema(), command=command)


def _quoted(word: str) -> str:
    return f'"{word}"' if any(letter.isspace() for letter in word) else word


def _shown(cell: CellFolder, text: str) -> CellText:
    """Return a text with its values and errors; the angles are those of the maker even where other keys are wrong."""
    values, controller, axes = values_of(text), None, None
    robot = (values or {}).get("robot")
    model = robot.get("model") if isinstance(robot, dict) else None
    if isinstance(model, str):
        try:
            bare = Cell.model_validate({"robot": {"model": model}}, context={"folder": cell.folder})
            controller, axes = bare.controller, bare.load_robot().dof
        except ValueError:
            pass
    return CellText(
        text=text,
        values=values,
        problems=problems_in(text, cell.folder),
        controller=controller,
        angles=list(ANGLE_KEYS[controller or "kuka"]),
        axes=axes,
    )


@router.post("/cells/{cell}/check")
def check_cell(cell: InCell, edit: Edit) -> CellText:
    """Return a text with some keys changed, and its errors; nothing is written."""
    text = _decoded(read_bytes(cell.file, LARGEST_CONFIG), cell.file) if edit.text is None else edit.text
    return _shown(cell, changed(text, edit.changes).replace("\r\n", "\n") if edit.changes else text)


@router.put(
    "/cells/{cell}", response_model=CellDocument, responses={412: {"description": "Saved by somebody else meanwhile"}}
)
def save_cell(
    cell: InCell, edit: Edit, response: Response, if_match: Annotated[str | None, Header()] = None
) -> CellDocument | Response:
    """Save the cell file: a whole text, or changes of single keys; a text with errors is refused."""
    if if_match is None:
        raise WebError(428, "Version missing", "the header If-Match must name the version that was changed")
    with _SAVING:
        before = read_bytes(cell.file, LARGEST_CONFIG)
        text = _new_text(edit, before, cell.file)
        if if_match.strip() not in (etag_of(before), "*"):
            return _conflict(text, before)
        if problems := problems_in(text, cell.folder):
            return _refused(problems)
        content = as_file(text, before)
        if content != before:
            write_atomic(cell.file, content)
        return _document(cell, response)


def _new_text(edit: Edit, before: bytes, path: Path) -> str:
    if edit.text is None and not edit.changes:
        raise WebError(422, "Nothing to save", "send the text, or changes of it")
    if edit.text is not None:
        return changed(edit.text, edit.changes) if edit.changes else edit.text
    return changed(_decoded(before, path), edit.changes)


def _decoded(content: bytes, path: Path) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FileError(path.name, "is not UTF-8 text; save it as UTF-8") from None


def _conflict(yours: str, now: bytes) -> Response:
    words = "somebody else saved this cell file since you opened it; compare both texts, then save one of them"
    return problem_response(
        412,
        "Changed meanwhile",
        words,
        headers={"ETag": etag_of(now)},
        etag=etag_of(now),
        current=now.decode("utf-8-sig", "replace").replace("\r\n", "\n"),
        yours=yours,
    )


def _refused(problems: list[KeyProblem]) -> Response:
    first = problems[0]
    words = f"{first.message}{f' (line {first.line})' if first.line else ''}; nothing was written"
    errors = [one.model_dump() for one in problems]
    return problem_response(422, "Cell file not accepted", words, line=first.line, errors=errors)


@router.get("/cells/{cell}/files")
def list_files(cell: InCell, kind: Kind | None = None) -> list[FileEntry]:
    """Return the files of a cell, newest first."""
    return [
        FileEntry(id=one.id, name=one_line(one.name), kind=one.kind, modified=one.modified, size=one.size)
        for one in cell.files(kind)
    ]


@router.get("/cells/{cell}/files/{file}", response_class=FileResponse)
def download_file(cell: InCell, file: str) -> FileResponse:
    """Return a file of a cell, to be saved."""
    found = cell.get(file)
    return FileResponse(found.path, filename=one_line(found.path.name), media_type="application/octet-stream")
