"""Measuring: plans, readings and samples."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np
from anyio import to_thread
from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field
from scipy.spatial.transform import Rotation

from truepose._io.plain import plain
from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.errors import DataError, TrueposeError, one_line
from truepose.jobs import Job, JobQueue
from truepose.planning import METHODS, expected_accuracy, measuring_program
from truepose.robots import shown_joints, to_toml
from truepose.samples import on_arm
from truepose.samples.masked import SampleTable
from truepose.samples.tidy import read_all_samples, read_samples_but
from truepose.trackers import read_plan
from truepose.web.cache import InCache
from truepose.web.measure.form import MaskRequest, ReadingForm, mask_of
from truepose.web.measure.previews import ReadingsPreview, preview_readings
from truepose.web.measure.uploads import StoredUploads
from truepose.web.multipart import Upload, received
from truepose.web.problems import WebError
from truepose.web.uploads import LARGEST_READINGS, largest_file
from truepose.web.workspace import CellFolder, InCell, InJobs, InWorkspace, StoredFile

router = APIRouter(tags=["measure"])
_MOST_ROWS: Final = 20_000
_SHA: Final = 64  # characters of the hash of a map
FORM: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "properties": {
                        "file": {
                            "type": "string",
                            "format": "binary",
                            "description": "The measurement file.",
                        },
                        "plan": {"type": "string", "format": "binary", "description": "A plan that is not stored yet."},
                        "options": {"type": "string", "description": "ReadingForm as JSON."},
                    },
                }
            }
        },
    }
}


class PlanRequest(BaseModel):
    """A plan to make."""

    n: int = Field(ge=1, le=5000)
    method: str = "posterior"
    seed: int = Field(0, ge=0, le=2**31)
    after: str = Field("", description="SHA-256 of a map of an earlier series, or id of its table of samples")
    until_mm: float | None = Field(None, gt=0, le=1000, description="expected accuracy for which fewer poses may do")
    candidates: str = Field("", description="id of a plan or table of samples whose joints are the candidates")


class PoseRow(BaseModel):
    """A pose of a plan, or of a table of samples; null stands for a field that is no number."""

    row: int
    name: str
    q_deg: list[float | None]
    p_mm: list[float | None] = Field(
        description="commanded position, base frame; of the stated tool if there are joints"
    )
    rpy_deg: list[float | None] = []
    p_meas_mm: list[float | None] = Field([], description="measured position, tracker frame")
    p_std_mm: list[float | None] = []
    masked: str = Field("", description="the reason why the sample is left out")


class TableEntry(BaseModel):
    """A plan or a table of samples."""

    id: str
    name: str
    modified: float
    count: int | None = Field(description="rows; null if the file cannot be read")
    masked: int = 0
    problem: str | None = None


class PoseTable(BaseModel):
    """The rows of a plan or of a table of samples."""

    id: str
    name: str
    total: int
    masked: int
    rows: list[PoseRow]


class ExpectedRow(BaseModel):
    """The accuracy to expect after so many poses."""

    n: int
    mean_mm: float
    low_mm: float
    high_mm: float


class ExpectedAccuracy(BaseModel):
    """The accuracy to expect of a plan: the mean length by which a reading differs from its prediction."""

    n: int
    rows: list[ExpectedRow]


@router.get("/plan-methods")
def plan_methods() -> list[str]:
    """Return the methods that choose poses."""
    return list(METHODS)


@router.post("/cells/{cell}/plans", status_code=202)
def make_plan(cell: InCell, workspace: InWorkspace, jobs: InJobs, wanted: PlanRequest) -> Job:
    """Start the choice of poses."""
    if wanted.method not in METHODS:
        raise WebError(422, "Request not accepted", f"method: expected one of {', '.join(METHODS)}")
    folder = cell.new("plans", f"{wanted.method}-{wanted.n}")
    command = ["plan", cell.file.name, "--n", str(wanted.n), "--method", wanted.method, "--seed", str(wanted.seed)]
    if wanted.after:
        is_map = len(wanted.after) == _SHA
        earlier = workspace.map(wanted.after)[1] if is_map else _poses(cell, wanted.after, "samples")
        command.append(f"--after={cell.word(earlier.path)}")
    if wanted.until_mm is not None:
        command.append(f"--until={wanted.until_mm:g}mm")
    if wanted.candidates:
        command.append(f"--candidates={cell.word(_poses(cell, wanted.candidates, 'plan', 'samples').path)}")
    command += ["--out", cell.relative(folder)]
    return jobs.submit(command, folder=cell.folder, cell=cell.id, title=f"Plan of {wanted.n} poses")


def _poses(cell: CellFolder, file: str, *kinds: str) -> StoredFile:
    """Return a file of one of some kinds: a plan, or a table of samples."""
    found = cell.get(file)
    if found.kind not in kinds:
        expected = "a plan or a table of samples" if "plan" in kinds else "a table of samples"
        raise WebError(422, "Request not accepted", f"{found.name}: expected {expected}")
    return found


@router.get("/cells/{cell}/plans")
def plans(cell: InCell) -> list[TableEntry]:
    """Return the plans of a cell, newest first."""
    return [_entry(file) for file in cell.files("plan")]


@router.get("/cells/{cell}/samples")
def sample_tables(cell: InCell) -> list[TableEntry]:
    """Return the tables of samples of a cell, newest first."""
    return [_entry(file) for file in cell.files("samples")]


def _entry(file: StoredFile) -> TableEntry:
    """Return the entry of a file; the rows of a file that has not changed are counted once."""
    entry = TableEntry(id=file.id, name=one_line(file.name), modified=file.modified, count=None)
    try:
        entry.count, entry.masked, problem = _count(file, file.path.stat().st_mtime_ns)
    except TrueposeError as error:
        problem = str(error)
    entry.problem = problem and problem.replace(f"{file.path.parent}/", "")
    return entry


@lru_cache(maxsize=1000)
def _count(file: StoredFile, _changed: int) -> tuple[int, int, str | None]:
    """Return the number of rows of a table and of masked ones, and what is wrong with a row that counts."""
    if file.kind == "plan":
        return len(read_plan(file.path)), 0, None
    table, problem = read_all_samples(file.path), None
    try:
        read_samples_but(file.path, table.reasons)
    except TrueposeError as error:
        problem = str(error)
    return len(table), int((table.reasons != "").sum()), problem


@router.get("/cells/{cell}/plans/{file}")
def plan_table(
    cell: InCell, file: str, offset: int = Query(0, ge=0), limit: int = Query(_MOST_ROWS, ge=1)
) -> PoseTable:
    """Return the poses of a plan."""
    stored = cell.get(file, "plan")
    settings = cell.load()
    poses = on_arm(read_plan(stored.path), settings.load_robot())
    values: dict[str, Any] = {"q": poses.q, "p_cmd": poses.p_cmd}
    if poses.rotation_cmd is not None:
        values["rpy_cmd"] = poses.rotation_cmd.as_euler("ZYX")[:, ::-1]
    assert poses.row is not None
    table = SampleTable(poses.row, poses.name, np.full(len(poses), ""), values, poses.source)
    return _table(stored, settings, table, slice(offset, offset + min(limit, _MOST_ROWS)))


@router.get("/cells/{cell}/samples/{file}")
def sample_table(
    cell: InCell, file: str, offset: int = Query(0, ge=0), limit: int = Query(_MOST_ROWS, ge=1)
) -> PoseTable:
    """Return the rows of a table of samples, with the masked ones."""
    stored = cell.get(file, "samples")
    rows = slice(offset, offset + min(limit, _MOST_ROWS))
    return _table(stored, cell.load(), read_all_samples(stored.path), rows)


@router.post("/cells/{cell}/samples/{file}/mask", status_code=202)
def mask_samples(cell: InCell, jobs: InJobs, file: str, wanted: MaskRequest) -> Job:
    """Start to write a table of samples anew with other rows left out; the table itself stays."""
    stored = cell.get(file, "samples")
    table = read_all_samples(stored.path)
    reasons: dict[int, str] = dict(zip(table.row.tolist(), table.reasons.tolist(), strict=True)) | wanted.reasons
    left_out = mask_of((row, reason) for row, reason in reasons.items() if reason)
    command = ["mask", cell.word(stored.path), "--out", cell.relative(cell.new("samples", stored.path.name))]
    if left_out.reasons:
        left_out.of(table)  # a row that is not in the table is refused before anything is written
        path = cell.new("samples", f"{stored.path.stem}.mask.csv")
        left_out.write(path)
        command += ["--mask", cell.relative(path)]
    return jobs.submit(command, folder=cell.folder, cell=cell.id, title=f"Masks of {one_line(stored.name)}")


def _table(stored: StoredFile, cell: Cell, table: SampleTable, rows: slice) -> PoseTable:
    """Return some rows of a table; values that are no number are null."""
    n = len(table.row[rows])
    part = {name: values[rows] for name, values in table.values.items() if values is not None}
    p, rpy, q = part.get("p_cmd"), part.get("rpy_cmd"), part.get("q")
    if q is None and (shown := part.get("q_shown")) is not None:
        q = shown_joints(cell.load_robot()).to_model(shown)
    if q is not None:
        p, rpy = _reached(cell, q)
    found = {
        "row": table.row[rows].tolist(),
        "name": [""] * n if table.name is None else table.name[rows].tolist(),
        "q_deg": _listed(q, n, np.rad2deg),
        "p_mm": _listed(p, n),
        "rpy_deg": _listed(rpy, n, np.rad2deg),
        "p_meas_mm": _listed(part.get("p_meas"), n),
        "p_std_mm": _listed(part.get("p_std"), n),
        "masked": table.reasons[rows].tolist(),
    }
    return PoseTable(
        id=stored.id,
        name=one_line(stored.name),
        total=len(table),
        masked=int((table.reasons != "").sum()),
        rows=[PoseRow.model_validate(dict(zip(found, one, strict=True))) for one in zip(*found.values(), strict=True)],
    )


def _reached(cell: Cell, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the commanded positions [mm] and roll, pitch, yaw [rad] of joints (n, dof); nan where these are."""
    known = np.isfinite(q).all(axis=1)
    p, rpy = np.full((len(q), 3), np.nan), np.full((len(q), 3), np.nan)
    if known.any():
        tf = cell.load_robot().forward(q[known], tool=cell.tf_flange_tool)
        p[known], rpy[known] = tf[:, :3, 3], Rotation.from_matrix(tf[:, :3, :3]).as_euler("ZYX")[:, ::-1]
    return p, rpy


def _listed(values: FloatArray | None, n: int, unit: Callable[[FloatArray], FloatArray] = np.asarray) -> list[Any]:
    return [[]] * n if values is None else plain(unit(values))


@router.get("/cells/{cell}/plans/{file}/expected")
def expected(cell: InCell, file: str, cache: InCache) -> ExpectedAccuracy:
    """Return the accuracy to expect after a plan, and after fewer or more poses."""
    settings = cell.load()
    q = _joints(cell.get(file, "plan"), settings)
    key = ("expected-interval", settings.to_toml(), to_toml(settings.load_robot()), q.tobytes())
    rows = cache.json(key, lambda: expected_accuracy(settings, q))
    return ExpectedAccuracy.model_validate({"n": len(q), "rows": rows})


def _joints(stored: StoredFile, cell: Cell) -> Any:
    poses = on_arm(read_plan(stored.path), cell.load_robot())
    if poses.q is None:
        raise DataError(f"{stored.name}: has no joints (q1_deg …)")
    return poses.q


@router.get("/cells/{cell}/plans/{file}/program", response_class=Response)
def program(cell: InCell, file: str) -> Response:
    """Return the measuring program of a plan, to be saved."""
    ending, text = measuring_program(cell.load(), read_plan(cell.get(file, "plan").path))
    headers = {"Content-Disposition": f'attachment; filename="measure{ending}"'}
    return Response(text.encode(), media_type="application/octet-stream", headers=headers)


@router.post(
    "/cells/{cell}/readings",
    status_code=202,
    response_model=Job,
    openapi_extra=FORM,
    responses={200: {"model": ReadingsPreview}},
)
async def send_readings(
    request: Request, cell: InCell, workspace: InWorkspace, jobs: InJobs, preview: bool = False
) -> Job | Response:
    """Keep a measurement file and start its import; as a preview, only tell what would come of it.

    A preview keeps the files for a while and returns their ids. Later requests state these instead of the files.
    """
    stored = StoredUploads(workspace)
    async with received(request, cell.folder / "readings", least=0, largest=_largest) as upload:
        form = ReadingForm.parse(upload.fields.get("options", ""))
        await to_thread.run_sync(lambda: _take_stored(stored, upload, form, own=not preview))
        if not preview:
            return await to_thread.run_sync(_import, cell, jobs, upload, form)
        found = await to_thread.run_sync(_preview, cell, stored, upload, form)
        return Response(found.model_dump_json(), media_type="application/json")


def _largest(name: PurePosixPath) -> int:
    return max(LARGEST_READINGS, largest_file(name))


def _files(cell: CellFolder, upload: Upload, form: ReadingForm) -> tuple[Path, Path | None]:
    """Return the measurement file and the plan of an upload, where they are now."""
    plan = None
    if form.plan is not None:
        plan = cell.get(form.plan, "plan").path
    elif form.plan_file is not None:
        named = [upload.folder / name for name, given in upload.files.items() if given == form.plan_file]
        if not named:
            raise WebError(422, "Request not accepted", f"the upload holds no file {form.plan_file}")
        plan = named[0]
    others = [path for path in upload.paths() if path != plan]
    if len(others) != 1:
        raise WebError(422, "Request not accepted", f"expected one measurement file, got {len(others)}")
    return others[0], plan


def _take_stored(stored: StoredUploads, upload: Upload, form: ReadingForm, *, own: bool) -> None:
    """Add the files that an earlier preview kept to an upload."""
    for id_, given in ((form.stored, None), (form.stored_plan, form.plan_file)):
        if id_ is not None:
            name = stored.place(id_, upload.folder, own=own).name
            upload.files[PurePosixPath(name)] = given or name


def _preview(cell: CellFolder, stored: StoredUploads, upload: Upload, form: ReadingForm) -> ReadingsPreview:
    readings, plan = _files(cell, upload, form)
    found = preview_readings(cell.load(), readings, plan, form, folder=upload.folder)
    found.stored = form.stored or stored.keep(readings)
    if plan is not None and upload.folder in plan.parents:
        found.stored_plan = form.stored_plan or stored.keep(plan)
    return found


def _import(cell: CellFolder, jobs: JobQueue, upload: Upload, form: ReadingForm) -> Job:
    readings, plan = _files(cell, upload, form)
    if plan is None:
        raise WebError(422, "Request not accepted", "choose the plan that was measured")
    mask = form.points()
    kept = upload.keep(cell.new("readings", readings.name), PurePosixPath(readings.relative_to(upload.folder)))
    if upload.folder in plan.parents:
        plan = upload.keep(cell.new("readings", plan.name), PurePosixPath(plan.relative_to(upload.folder)))
    name = readings.name.rpartition(".")[0] or readings.name
    command = ["import", cell.file.name, cell.relative(kept), "--plan", cell.relative(plan)]
    command += ["--out", cell.relative(cell.new("samples", f"{name}.csv")), *form.options()]
    if mask is not None:
        path = cell.new("samples", f"{name}.mask.csv")
        mask.write(path)
        command += ["--mask", cell.relative(path)]
    return jobs.submit(command, folder=cell.folder, cell=cell.id, title=f"Import of {one_line(kept.name)}")
