"""Answers about targets: some rows of their table, for corrections and for previews of them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

import numpy as np
from fastapi import Query
from pydantic import BaseModel
from starlette.responses import Response

from truepose.web.corrections.columns import VERDICTS
from truepose.web.corrections.table import TargetTable, View

MOST_ROWS: Final = 1000
"""The largest number of rows of an answer."""
MostPoints = Annotated[int, Query(ge=2, le=1_000_000)]
"""The largest number of points of a path, as a parameter of a route."""
Sort = Literal["", "name", "line", "verdict", "change", "std", "error", "reason"]


class Kind(BaseModel):
    """A kind of reason, with what would allow its targets."""

    kind: int
    reason: str
    example: str
    option: str
    assumption: str
    counts: dict[str, int]


class IndexState(BaseModel):
    """How far the targets are indexed."""

    ready: bool
    done: int
    total: int


class TargetRow(BaseModel):
    """A target of a correction; positions before and after in its own frame, and in the base frame."""

    row: int
    name: str
    file: str
    line: int
    motion: str
    frame: str
    tool: str
    verdict: str
    reason: str
    note: str
    remedy: str
    assumption: str
    change: float | None
    std: float | None
    error: float | None
    bend_mm: float | None
    turn_deg: float | None
    spacing_mm: float | None
    difference_mm: float | None
    remaining_mm: float | None
    before_mm: list[float | None] | None
    after_mm: list[float | None] | None
    base_mm: list[float | None] | None
    base_after_mm: list[float | None] | None


class TargetPage(BaseModel):
    """Some rows of the table of targets."""

    total: int
    offset: int
    rows: list[TargetRow]
    place: int | None = None
    """Where the row that was asked for stands in the view."""


@dataclass
class TargetQuery:
    """The rows of the table that a request asks for: sorted and filtered; with `row` also where that target stands."""

    offset: Annotated[int, Query(ge=0)] = 0
    limit: Annotated[int, Query(ge=1, le=MOST_ROWS)] = 200
    sort: Annotated[Sort, Query()] = ""
    descending: Annotated[bool, Query()] = False
    verdict: Annotated[list[str] | None, Query(max_length=len(VERDICTS))] = None
    kind: Annotated[int | None, Query(ge=0)] = None
    search: Annotated[str, Query(max_length=200)] = ""
    row: Annotated[int | None, Query(ge=0)] = None

    def answer(self, table: TargetTable) -> Response:
        """Return these rows of a table."""
        shown = tuple(sorted(one for one in self.verdict or () if one in VERDICTS))
        rows = table.rows(View(self.sort, self.descending, shown, self.kind, self.search.strip()))
        place = next(iter(np.flatnonzero(rows == self.row).tolist()), None) if self.row is not None else None
        page = table.page(rows[self.offset : self.offset + self.limit])
        return json_answer({"total": len(rows), "offset": self.offset, "rows": page, "place": place})


def json_answer(page: dict[str, Any]) -> Response:
    """Return a page of very many rows, whose values need no check."""
    text = json.dumps(page, ensure_ascii=False, allow_nan=False).encode("utf-8", "backslashreplace")
    return Response(text, media_type="application/json")


def path_answer(table: TargetTable, most: int) -> Response:
    """Return the path of a table's targets; see `TargetTable.path`."""
    return Response(table.path(most), media_type="application/octet-stream")
