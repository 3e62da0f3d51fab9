"""Previews: the targets of an upload as a check or a dry run lists them, before anything is written to the cell.

The command of the job writes them with ``--targets`` to a file of the server's own folder; the table is indexed as that
of a correction.
"""

from __future__ import annotations

import os
import secrets
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, Request
from pydantic import BaseModel
from starlette.responses import Response

from truepose.web.corrections.answers import IndexState, Kind, MostPoints, TargetPage, TargetQuery, path_answer
from truepose.web.corrections.index import CorrectionIndexes
from truepose.web.corrections.table import TargetTable
from truepose.web.kept import remove_old
from truepose.web.problems import missing
from truepose.web.workspace import CellFolder, InJobs, InWorkspace, Workspace

router = APIRouter(tags=["programs"])
_FOLDER: Final = "previews"
_OPTION: Final = "--targets="
_LARGEST, _DAYS = 2 << 30, 7.0


def preview_words(workspace: Workspace, cell: CellFolder) -> list[str]:
    """Return the options that make a command list its targets for the page; remove old lists."""
    folder = workspace.own / _FOLDER
    remove_old(folder, largest=_LARGEST, days=_DAYS)
    path = folder / f"{secrets.token_hex(8)}.json"
    return [f"{_OPTION}{cell.word(path)}", "--force"]


class PreviewState(BaseModel):
    """A preview, and how far its targets are indexed."""

    index: IndexState
    corrected: bool
    """Whether the corrections are known; otherwise the targets were only read."""
    kinds: list[Kind]
    verdicts: dict[str, int]
    positions: bool
    """Whether any target has a known position in the base frame."""


class _Preview:
    """The list of the targets of a job, and the folder of its cell."""

    def __init__(self, request: Request, workspace: InWorkspace, jobs: InJobs, id: str) -> None:  # noqa: A002
        known = jobs.get(id)
        self.folder = workspace.root / known.folder
        word = next((word for word in known.command if word.startswith(_OPTION)), None)
        if word is None:
            raise missing("the list of targets of this job")
        self.path = Path(os.path.normpath(self.folder / word.removeprefix(_OPTION)))
        if self.path.parent != workspace.own / _FOLDER or not self.path.is_file():
            raise missing("the list of targets of this job")
        self.indexes = CorrectionIndexes.of(request.app)

    def table(self) -> TargetTable:
        return self.indexes.table(self.path, self.folder)


_InPreview = Annotated[_Preview, Depends()]


@router.get("/previews/{id}")
def preview_state(found: _InPreview) -> PreviewState:
    """Return the preview of a job that checks or shows a correction; begins to index its targets."""
    state = found.indexes.state(found.path, found.folder)
    known: dict[str, Any] = dict(found.table().summary) if state.ready else {}
    return PreviewState.model_validate(
        {
            "index": {"ready": state.ready, "done": state.done, "total": state.total},
            "corrected": known.get("corrected", False),
            "kinds": known.get("kinds", []),
            "verdicts": known.get("verdicts", {}),
            "positions": known.get("box") is not None,
        }
    )


@router.get("/previews/{id}/targets", response_model=TargetPage)
def preview_targets(found: _InPreview, asked: Annotated[TargetQuery, Depends()]) -> Response:
    """Return some targets of a preview, sorted and filtered; with `row` also where that target stands."""
    return asked.answer(found.table())


@router.get("/previews/{id}/path.bin", response_class=Response)
def preview_path(found: _InPreview, most: MostPoints = 20_000) -> Response:
    """Return the path of a preview in the base frame; see `TargetTable.path`."""
    return path_answer(found.table(), most)
