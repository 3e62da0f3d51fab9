"""The preview of an import: by the functions of ``truepose import``, with nothing written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field

from truepose.cell import Cell
from truepose.error_map.importing import ImportedSamples, import_samples
from truepose.errors import TrueposeError
from truepose.trackers import preview as preview_file
from truepose.trackers import read_plan
from truepose.trackers.by_name import BY_NAME
from truepose.web.measure.form import ReadingForm


class FileRow(BaseModel):
    """A row of a measurement file as it stands there."""

    line: int
    fields: list[str]


class Understood(BaseModel):
    """What is understood of a measurement file."""

    layout: str
    unit: str
    unit_stated: bool
    frame: str
    notes: list[str]
    count: int
    missing: int
    extent_mm: list[float]
    named: bool
    timed: bool
    oriented: bool


class Matched(BaseModel):
    """How readings belong to the plan."""

    by_name: bool
    readings: int
    plan: int
    samples: int
    averaged: int
    missing: list[str]
    reordered: list[str]
    outliers: list[str]
    sentences: list[str]


class Residual(BaseModel):
    """The error of a sample after registration."""

    row: int
    point: str | None
    line: int | None
    error_mm: list[float] = Field(description="measured − commanded position, base frame")
    residual_mm: float
    outlier: bool
    masked: str


class Registered(BaseModel):
    """The registration of the samples that count."""

    mean_mm: float
    max_mm: float
    faults: list[str] = Field(description="faults of the campaign")
    tool: str | None = Field(description="what the samples say about the stated tool")
    rows: list[Residual]


class ReadingsPreview(BaseModel):
    """What an import would give."""

    rows: list[FileRow]
    skip: int = Field(description="lines before the first row with numbers")
    columns: dict[str, list[int]] = Field(description="columns of the quantities, from 1")
    readings: Understood | None
    matched: Matched | None = None
    registered: Registered | None = None
    problem: str | None = Field(None, description="why the import would be refused, with the remedy")
    warnings: list[str] = []
    stored: str | None = Field(None, description="id of the kept measurement file, instead of sending it again")
    stored_plan: str | None = Field(None, description="id of the kept plan")


def preview_readings(cell: Cell, path: Path, plan: Path | None, form: ReadingForm, *, folder: Path) -> ReadingsPreview:
    """Return what the import of a file would give.

    Parameters
    ----------
    cell : Cell
        The cell that was measured.
    path, plan : Path
        The measurement file, and the plan; without a plan, only the file is read.
    form : ReadingForm
        The statements about it.
    folder : Path
        The folder whose path is left out of messages.
    """
    found = ReadingsPreview.model_validate(preview_file(path, **form.reading()).to_dict())
    if found.readings is not None and plan is not None:
        _match(found, cell, path, plan, form)
    return ReadingsPreview.model_validate(_without(found.model_dump(), f"{folder}/"))


def _match(found: ReadingsPreview, cell: Cell, path: Path, plan: Path, form: ReadingForm) -> None:
    """Add matching and registration; where the import would be refused, those with all permissions, if there are."""
    every: dict[str, Any] = dict.fromkeys(form.permissions(), True)
    for permissions in (form.permissions(), every):
        try:
            imported = import_samples(cell, path, read_plan(plan), mask=form.points(), **permissions, **form.reading())
        except TrueposeError as error:
            found.problem = found.problem or str(error)
            continue
        found.matched, found.registered = _matched(imported), _registered(imported)
        if imported.tool is not None and imported.tool.suspect:
            found.warnings.append(imported.tool.suspicion)
        return


def _matched(imported: ImportedSamples) -> Matched:
    summary = imported.understood
    return Matched(
        by_name=BY_NAME in summary.notes,
        readings=summary.readings,
        plan=summary.plan,
        samples=summary.samples,
        averaged=summary.averaged,
        missing=list(summary.missing_points),
        reordered=list(summary.reordered_points),
        outliers=list(summary.outlier_points),
        sentences=summary.sentences(),
    )


def _registered(imported: ImportedSamples) -> Registered:
    return Registered.model_validate(
        {
            **imported.figures,
            "faults": imported.campaign.words,
            "tool": None if imported.tool is None else imported.tool.words,
            "rows": imported.rows(),
        }
    )


def _without(value: Any, prefix: str) -> Any:
    """Return plain values without a prefix of paths in their texts."""
    if isinstance(value, str):
        return value.replace(prefix, "")
    if isinstance(value, list):
        return [_without(one, prefix) for one in value]
    return {key: _without(one, prefix) for key, one in value.items()} if isinstance(value, dict) else value
