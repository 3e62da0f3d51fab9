"""The options of how measurement files are read, shared by import and verify."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.cli.options import check_pairs

if TYPE_CHECKING:
    from truepose.trackers import Columns


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """The options of how measurement files are read; see `truepose.cli.options.with_groups`."""

    columns: Annotated[
        str | None,
        typer.Option("--columns", help="Columns of the quantities: 'x=4, y=5, z=6, unit=m', or a saved .toml file."),
    ] = None
    unit: Annotated[
        str | None, typer.Option("--unit", help="Unit of lengths in a file that states none: mm, m, cm or in.")
    ] = None
    save_columns: Annotated[Path | None, typer.Option("--save-columns", help="Save --columns to this .toml file.")] = (
        None
    )
    reflectors: Annotated[
        str | None,
        typer.Option(
            "--reflectors",
            help="Reflectors read per pose: their number, a file with their positions in mm, or each: keep all.",
        ),
    ] = None
    keep: Annotated[int | None, typer.Option("--keep", help="Number of the one reflector to keep, from 1.")] = None

    def check(self) -> list[Path]:
        """Refuse options without those that they depend on; return the files that `settings` writes."""
        check_pairs(
            ("--save-columns", self.save_columns, "--columns", self.columns),
            ("--keep", self.keep, "--reflectors", self.reflectors),
        )
        return [] if self.save_columns is None else [self.save_columns]

    def settings(self) -> dict[str, Any]:
        """Return the options of `truepose.trackers.read_measurement`; save the columns if they are to be saved."""
        return {
            "columns": self._columns(),
            "unit": self.unit,
            "reflectors": self._reflectors(),
            "keep": self.keep,
        }

    def _columns(self) -> Columns | None:
        """Return the columns that the option states, or those of the file that it names."""
        from truepose.trackers import Columns

        if self.columns is None:
            return None
        columns = Columns.parse(self.columns) if "=" in self.columns else Columns.load(self.columns)
        if self.save_columns is not None:
            columns.save(self.save_columns)
        return columns

    def _reflectors(self) -> Any:
        """Return the number of reflectors, their positions on the tool (m, 3) [mm] from a file, or "each"."""
        from truepose._io.strict import is_whole
        from truepose.trackers import read_readings
        from truepose.trackers.each_reflector import EACH

        if self.reflectors == EACH:
            return EACH
        if self.reflectors is None or is_whole(self.reflectors):
            return self.reflectors and int(self.reflectors)
        return read_readings(self.reflectors).p
