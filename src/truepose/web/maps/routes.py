"""Maps: their fit, their facts, and what they predict."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import PurePosixPath
from typing import Annotated, Any, Final, Literal
from urllib.parse import quote

import numpy as np
from fastapi import APIRouter, Depends, Query, Response
from pydantic import BaseModel, Field

from truepose._io.strict import LARGEST
from truepose.error_map import ErrorMap
from truepose.errors import DataError
from truepose.jobs import Job
from truepose.predictors.registry import PREDICTORS, predictor_spec
from truepose.predictors.selection.choice import QUICK
from truepose.report.knowledge import knowledge
from truepose.samples import Poses
from truepose.web.cache import InCache
from truepose.web.maps import arrays, tables
from truepose.web.maps.facts import MapEntry, MapFacts, entry, facts, of_cell
from truepose.web.maps.variograms import Language, Refit, Space, Variogram, variogram
from truepose.web.workspace import CellFolder, InCell, InJobs, InWorkspace

router = APIRouter(tags=["maps"])
_LARGEST_GRID: Final = 100_000
_LARGEST_QUERY: Final = 10_000
_BINARY: Final[dict[int | str, dict[str, Any]]] = {
    200: {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}
}
Number = Annotated[float, Field(allow_inf_nan=False)]


class PredictorEntry(BaseModel):
    """A predictor that can be fitted."""

    name: str
    space: Literal["cartesian", "joint"] = Field(description="what it predicts from: positions or joints")
    quick: bool = Field(description="whether it is one of the quick candidates of auto")


class FitOrder(BaseModel):
    """A fit to be run."""

    samples: str = Field(description="id of the table of samples")
    predictor: str = Field("auto", max_length=300, description="auto, or a name with options as in the command line")
    candidates: str = Field("quick", max_length=1000, description="of auto: quick, all, or names with commas")
    splits: list[Literal["points", "blocks", "branches"]] = Field(["points", "blocks"], min_length=1)
    accept_campaign: bool = False
    name: str = Field("", max_length=100, description="name of the map file; by default that of the table")


class HeldOut(BaseModel):
    """A table of samples that were not in the fit."""

    samples: str = Field(description="id of the table")


class Candidates(BaseModel):
    """The choice among predictors; empty when a predictor was named."""

    of: Literal["cross-validation"] = "cross-validation"
    ranking: list[dict[str, Any]] = Field(description="the chosen one first, mm")
    expected: dict[str, Any] = Field(description="errors of samples outside both the fit and the choice, mm")


class Wanted(BaseModel):
    """Poses to predict: joints, or positions for a map in Cartesian space with a stated tool."""

    q_deg: list[list[Number]] | None = Field(None, max_length=_LARGEST_QUERY)
    p_mm: list[tuple[Number, Number, Number]] | None = Field(None, max_length=_LARGEST_QUERY)


class Predicted(BaseModel):
    """Predictions of single poses: errors and standard deviations in mm, base frame, per axis."""

    of: Literal["prediction"] = "prediction"
    p_mm: list[list[float]] = Field(description="commanded positions, base frame")
    e_mm: list[list[float]] = Field(description="predicted errors, measured − commanded")
    std_mm: list[list[float]] = Field(description="standard deviation of the difference to the true error")
    p_measured_mm: list[list[float]] = Field(description="where the tracker will see the point, tracker frame")


class OfMap:
    """The map of the path parameter ``sha``, and the cache."""

    def __init__(self, workspace: InWorkspace, cache: InCache, sha: str) -> None:
        self.workspace, self.cache, self.sha = workspace, cache, sha

    @property
    def cell(self) -> CellFolder:
        """The cell that holds it."""
        return self.workspace.map(self.sha)[0]

    @property
    def map(self) -> ErrorMap:
        """The map."""
        return self.workspace.map(self.sha)[2]

    def binary(self, key: tuple[object, ...], make: Callable[[ErrorMap], bytes]) -> Response:
        """Return bytes that depend on the map and the key only; the browser may keep them."""
        error_map = self.map
        made = self.cache.bytes((self.sha, *key), lambda: make(error_map))
        return Response(made, media_type="application/octet-stream", headers={"Cache-Control": "private, max-age=3600"})


InMap = Annotated[OfMap, Depends()]


@router.get("/predictors")
def predictors() -> list[PredictorEntry]:
    """Return the predictors, the candidates of auto."""
    return [PredictorEntry(name=name, space=spec.space, quick=name in QUICK) for name, spec in PREDICTORS.items()]


@router.get("/cells/{cell}/maps")
def list_maps(cell: InCell, workspace: InWorkspace, cache: InCache) -> list[MapEntry]:
    """Return the maps of a cell, newest first; those of another robot than the cell's come last."""
    return of_cell(cell, [entry(workspace, cache, file) for file in cell.files("map")])


@router.post("/cells/{cell}/maps", status_code=202)
def fit_map(cell: InCell, jobs: InJobs, order: FitOrder) -> Job:
    """Start a fit: registration, tool and predictor from samples to a map."""
    if order.predictor != "auto":
        predictor_spec(order.predictor)
    samples = cell.get(order.samples, "samples")
    stem = (order.name or samples.path.stem).removesuffix(".truepose")
    out = cell.new("maps", f"{stem}.truepose")
    command = ["fit", "cell.toml", _argument(samples.name), f"--predictor={order.predictor}"]
    if order.predictor == "auto":
        command += [f"--candidates={order.candidates}", f"--splits={','.join(order.splits)}"]
    command += ["--accept-campaign"] * order.accept_campaign
    out.parent.mkdir(exist_ok=True)
    command.append(f"--out={cell.relative(out)}")
    return jobs.submit(command, folder=cell.folder, cell=cell.id, title=f"Fit {order.predictor}: {samples.name}")


def _argument(name: str) -> str:
    """Return a name that no command line takes for an option."""
    return f"./{name}" if name.startswith("-") else name


@router.get("/maps/{sha}")
def map_facts(of: InMap) -> MapFacts:
    """Return the facts of a map; every figure says what it is of."""
    return facts(of.workspace, of.cache, of.sha)


@router.get("/maps/{sha}/candidates")
def candidates(of: InMap) -> Candidates:
    """Return the ranking of the candidates by cross-validation."""
    return Candidates(ranking=of.map.ranking, expected=of.map.expected)


@router.get("/maps/{sha}/arrays.bin", response_class=Response, responses=_BINARY)
def map_arrays(
    of: InMap,
    which: Annotated[arrays.ArrowSet, Query(alias="set")] = "samples",
    n: Annotated[int, Query(ge=1, le=_LARGEST_GRID)] = 2000,
) -> Response:
    """Return rows of p, e and the length of the standard deviation: float32, m × 7, mm, base frame."""
    return of.binary(
        ("arrows", which, n if which == "grid" else 0), lambda error_map: arrays.arrows(error_map, which, n)
    )


@router.get("/maps/{sha}/slices.bin", response_class=Response, responses=_BINARY)
def map_slices(
    of: InMap,
    plane: arrays.PlaneName = "xy",
    at: Annotated[
        float | None,
        Query(ge=-LARGEST, le=LARGEST, allow_inf_nan=False, description="mm, base frame; the middle by default"),
    ] = None,
    n: Annotated[int, Query(ge=2, le=201)] = 33,
) -> Response:
    """Return lengths of predicted error and std on a plane: float32, 2 × n × n, mm; NaN out of reach.

    Columns go along the first axis of the plane's name, rows along the second, both from the lowest to the highest
    corner of the samples' bounding box.
    """

    def make(error_map: ErrorMap) -> bytes:
        low, high = arrays.box(error_map)
        across = ({0, 1, 2} - {"xyz".index(letter) for letter in plane}).pop()
        return arrays.slices(error_map, plane, float((low + high)[across] / 2) if at is None else at, n)

    return of.binary(("slice", plane, at, n), make)


@router.get("/maps/{sha}/volume.bin", response_class=Response, responses=_BINARY)
def map_volume(of: InMap, n: Annotated[int, Query(ge=2, le=64)] = 24) -> Response:
    """Return lengths of the std on a grid over the samples' box: float32, n × n × n in the order z, y, x, mm."""
    return of.binary(("volume", n), lambda error_map: arrays.volume(error_map, n))


@router.get(
    "/maps/{sha}/table.csv", response_class=Response, responses={200: {"content": {"text/csv": {"schema": {}}}}}
)
def map_table(of: InMap, table: tables.TableName, space: Space = "cartesian") -> Response:
    """Return a table of the map as CSV, for a spreadsheet; columns state units and what the numbers are of."""
    if table in tables.OF_MAP:
        text = tables.OF_MAP[table](of.map)
    elif table == "curves":
        text = tables.curves(map_curves(of))
    else:
        found = variogram(of.cache, of.map, Refit(space=space), "en")
        unit = f"lag_{found.unit}"
        columns = [unit, "pairs", "semivariance_samples_mm2", "chance_low_mm2", "chance_high_mm2"]
        text = tables.written(columns, [list(point.model_dump().values()) for point in found.points])
    name = f"{PurePosixPath(of.workspace.map(of.sha)[1].name).stem}-{table}.csv"
    headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}"}
    return Response(text, media_type="text/csv; charset=utf-8", headers=headers)


@router.get("/maps/{sha}/curves")
def map_curves(of: InMap) -> dict[str, Any]:
    """Return what 'truepose explain' knows: joint curves and their std, shares, parameters, what to measure next."""
    error_map = of.map
    known: dict[str, Any] = of.cache.json(("knowledge", of.sha), lambda: knowledge(error_map).to_dict())
    return known


@router.get("/maps/{sha}/variogram")
def map_variogram(of: InMap, space: Space = "cartesian", language: Language = "en") -> Variogram:
    """Return the variogram of the samples' errors: points with the band of chance, and the fitted model."""
    return variogram(of.cache, of.map, Refit(space=space), language)


@router.post("/maps/{sha}/variogram")
def refit_variogram(of: InMap, wanted: Refit, language: Language = "en") -> Variogram:
    """Return the variogram with held parameters and the others fitted, as 'truepose similarity --hold' does."""
    return variogram(of.cache, of.map, wanted, language)


@router.post("/maps/{sha}/predict")
def predict(of: InMap, wanted: Wanted) -> Predicted:
    """Predict errors and readings at commanded poses."""
    poses = _poses(wanted)
    error_map = of.map
    found = error_map.predict(poses)
    return Predicted(
        p_mm=error_map.commanded_positions(poses).tolist(),
        e_mm=found.e.tolist(),
        std_mm=found.std.tolist(),
        p_measured_mm=found.p_measured.tolist(),
    )


def _poses(wanted: Wanted) -> Poses:
    if (wanted.q_deg is None) == (wanted.p_mm is None):
        raise DataError("send either joints (q_deg) or positions (p_mm)")
    if wanted.p_mm is not None:
        return Poses(p_cmd=np.array(wanted.p_mm, float).reshape(-1, 3), source="request")
    assert wanted.q_deg is not None
    if len({len(row) for row in wanted.q_deg}) != 1:
        raise DataError("q_deg must be rows of joints of the same length, at least one")
    return Poses(q=np.deg2rad(wanted.q_deg), source="request")


@router.post("/maps/{sha}/validation", status_code=202)
def validate_map(of: InMap, jobs: InJobs, held_out: HeldOut) -> Job:
    """Start the comparison of errors before and after correction on samples that were not in the fit."""
    cell, file, _ = of.workspace.map(of.sha)
    samples = cell.get(held_out.samples, "samples")
    command = ["validate", _argument(file.name), _argument(samples.name)]
    return jobs.submit(command, folder=cell.folder, cell=cell.id, title=f"Validate {file.name}: {samples.name}")
