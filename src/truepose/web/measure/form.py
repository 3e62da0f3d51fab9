"""The form of the import: what a page states about a measurement file, as settings and as a command line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from truepose.samples import Mask
from truepose.samples.masks import checked_reason
from truepose.trackers import Columns
from truepose.web.problems import WebError

_Column = int
_HASH: Final = "^[0-9a-f]{64}$"


class ColumnChoice(BaseModel):
    """The columns of the quantities by number from 1."""

    model_config = ConfigDict(extra="forbid")
    x: _Column = Field(ge=1)
    y: _Column = Field(ge=1)
    z: _Column = Field(ge=1)
    name: _Column | None = Field(None, ge=1)
    time: _Column | None = Field(None, ge=1)
    rotation: list[_Column] = Field([], max_length=4)
    std: list[_Column] = Field([], max_length=3)
    skip: int = Field(0, ge=0, le=1000, description="lines before the first row")
    angle_unit: Literal["deg", "rad", "mrad"] | None = None
    angles: str | None = Field(None, pattern="^([xyz]{3}|[XYZ]{3})$")

    def text(self) -> str:
        """Return the choice as ``--columns`` takes it."""
        stated = self.model_dump(exclude_defaults=True)
        return ", ".join(
            f"{key}={':'.join(map(str, value)) if isinstance(value, list) else value}" for key, value in stated.items()
        )


class MaskedPoint(BaseModel):
    """A point to leave out."""

    model_config = ConfigDict(extra="forbid")
    row: int = Field(ge=0)
    point: str | None = None
    reason: str


class MaskRequest(BaseModel):
    """The rows of a table of samples that are left out from now on, or that count again."""

    model_config = ConfigDict(extra="forbid")
    reasons: dict[int, str] = Field(
        max_length=100_000, description="the reason by row; empty where the row is to count again"
    )


class ReadingForm(BaseModel):
    """What a page states about a measurement file."""

    model_config = ConfigDict(extra="forbid")
    plan: str | None = Field(None, description="id of a plan of the cell")
    plan_file: str | None = Field(None, description="name of an uploaded file that holds the plan")
    stored: str | None = Field(None, pattern=_HASH, description="id of the measurement file that a preview kept")
    stored_plan: str | None = Field(None, pattern=_HASH, description="id of the plan_file that a preview kept")
    columns: ColumnChoice | None = None
    unit: Literal["mm", "m", "cm", "in"] | None = None
    reflectors: int | None = Field(None, ge=1, le=100)
    keep: int | None = Field(None, ge=1, le=100)
    reorder: bool = False
    missing: bool = False
    two_stations: bool = False
    accept_campaign: bool = False
    mask: list[MaskedPoint] = Field([], max_length=100_000)

    @classmethod
    def parse(cls, text: str) -> ReadingForm:
        """Return the form of a JSON text.

        Raises
        ------
        WebError
            If it is no such form.
        """
        try:
            form = cls.model_validate_json(text or "{}")
        except ValidationError as error:
            words = "; ".join(f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors())
            raise WebError(422, "Request not accepted", words) from None
        form.points()
        return form

    def reading(self) -> dict[str, Any]:
        """Return the settings of `truepose.trackers.read_measurement`."""
        columns = None if self.columns is None else Columns.parse(self.columns.text())
        return {"columns": columns, "unit": self.unit, "reflectors": self.reflectors, "keep": self.keep}

    def permissions(self) -> dict[str, Any]:
        """Return the permissions of `truepose.error_map.importing.import_samples`."""
        names = ("reorder", "missing", "two_stations", "accept_campaign")
        return {name: getattr(self, name) for name in names}

    def points(self) -> Mask | None:
        """Return the mask; by names where every masked point has one of its own, else by rows."""
        if not self.mask:
            return None
        names = [one.point for one in self.mask]
        rows: Sequence[str | int] = [one.row for one in self.mask]
        if all(names) and len(set(names)) == len(names):
            rows = [name for name in names if name]
        return mask_of(zip(rows, (one.reason for one in self.mask), strict=True))

    def options(self) -> list[str]:
        """Return the options of ``truepose import``, without the files."""
        stated = [
            ("--columns", None if self.columns is None else self.columns.text()),
            ("--unit", self.unit),
            ("--reflectors", self.reflectors),
            ("--keep", self.keep),
        ]
        options = [word for flag, value in stated if value is not None for word in (flag, str(value))]
        return options + [f"--{name.replace('_', '-')}" for name, given in self.permissions().items() if given]


def mask_of(reasons: Iterable[tuple[str | int, str]]) -> Mask:
    """Return the mask of points with their reasons, as a page states them.

    Raises
    ------
    FileError
        If a reason is empty or too long.
    """
    return Mask({point: checked_reason(reason, "the mask") for point, reason in reasons}, "the mask")
