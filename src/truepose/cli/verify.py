"""``truepose verify``: compare re-measured targets of a program with nominal ones."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.cli.measurement import Measurement
from truepose.cli.options import Force, Json, MapPath, with_groups
from truepose.cli.output import emit_json, overwrite, say, table, working
from truepose.cli.programs import Reading
from truepose.cli.store_record import RecordIn, map_to_use, record_verification, recorder
from truepose.cli.summaries import show_facts

if TYPE_CHECKING:
    from truepose.programs import ProgramVerification

_LISTED = 60  # targets that are shown one by one
_COLOURS = {"pass": "green", "not assessed": "yellow", "undecided": "yellow", "fail": "red"}
_READING, _MEASUREMENT = Reading(), Measurement()


class Match(StrEnum):
    """The way to match readings with targets."""

    auto = "auto"
    name = "name"
    position = "position"


@with_groups
def verify(
    map_path: MapPath,
    program_path: Annotated[
        Path,
        typer.Argument(metavar="PROGRAM", help="The corrected program, with its record beside it, or an original."),
    ],
    readings_path: Annotated[
        Path, typer.Argument(metavar="READINGS", help="The tracker's file with the measured targets.")
    ],
    tolerance: Annotated[
        float | None, typer.Option("--tolerance", help="Tolerance of an error, mm; by default the cell file's.")
    ] = None,
    before: Annotated[
        Path | None, typer.Option("--before", help="Readings of the original program, for the errors before.")
    ] = None,
    register: Annotated[
        bool,
        typer.Option("--register", help="Register the readings to the targets (moved tracker). Hides a common shift."),
    ] = False,
    match: Annotated[Match, typer.Option("--match", help="Way to match readings with targets.")] = Match.auto,
    uncertainty: Annotated[
        float | None, typer.Option("--uncertainty", help="Standard uncertainty of a reading, mm (k = 1).")
    ] = None,
    measurement: Measurement = _MEASUREMENT,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="File to write: .csv, .xlsx, or .json for 'report --verification'."),
    ] = None,
    reading: Reading = _READING,
    store: RecordIn = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compare re-measured targets of a corrected program with nominal ones.

    It exits with 1 if a target fails the tolerance, or if the readings are those of another run.
    """
    import json

    from truepose._io.files import write_atomic
    from truepose._io.workbook import in_format
    from truepose.error_map.figures import facts_data
    from truepose.errors import FileError
    from truepose.programs import verify_program
    from truepose.trackers import read_measurement

    if out is not None and out.suffix.lower() not in (".csv", ".xlsx", ".json"):
        raise FileError(out, "expected a name that ends in .csv, .xlsx or .json")
    overwrite(force, *([] if out is None else [out]), *measurement.check())
    with recorder(store, "verify") as record, working("Reading the map", quiet=as_json) as progress:
        error_map, _ = map_to_use(record, map_path)
        cell, settings = reading.cell(), measurement.settings()
        progress("Comparing readings with targets")
        found = verify_program(
            error_map,
            program_path,
            read_measurement(readings_path, **settings),
            cell=cell,
            tolerance_mm=tolerance,
            before=None if before is None else read_measurement(before, **settings),
            register=register,
            match=match.value,
            uncertainty_mm=uncertainty,
            frames=reading.frames(cell or error_map.cell),
            options=reading.options(),
        )
        in_json = json.dumps(found.to_dict(), indent=1, ensure_ascii=False) + "\n"
        if out is not None:
            write_atomic(out, in_json if out.suffix.lower() == ".json" else in_format(out, found.to_csv()))
        if record is not None:
            record_verification(record, found, in_json.encode(), program_path, out)
    if as_json:
        emit_json({**found.to_dict(), "facts": facts_data(error_map)})
    else:
        _show(found)
        show_facts(error_map.facts)
        if out is not None:
            say(f"Wrote {out}.")
    if found.decision == "fail" or found.run:
        raise typer.Exit(1)


def _show(found: ProgramVerification) -> None:
    from rich.markup import escape

    from truepose.programs.record import DRAFT, head_of

    order = {"fail": 0, "undecided": 1, "pass": 2}
    shown = sorted(found.targets, key=lambda t: order[t.decision])[:_LISTED]
    shown = list(found.targets) if len(found.targets) <= _LISTED else shown
    rows = [
        (
            t.name,
            t.line,
            "–" if t.before_mm is None else f"{t.before_mm:.3f}",
            f"{t.error_mm:.3f}",
            f"{t.uncertainty_mm:.3f}",
            t.decision.upper(),
        )
        for t in shown
    ]
    columns = ["target", "line", "before", "error", "U", f"T = {found.tolerance_mm:g}"]
    say(table(f"Re-measured targets of {Path(found.program).name} [mm]", columns, rows))
    if len(found.targets) > len(shown):
        say(f"… and {len(found.targets) - len(shown)} more that pass (--out lists all).")
    if found.record and head_of(Path(found.record)).get("map_state") == DRAFT:
        say("[yellow]DRAFT[/]: the program was corrected with a map that was not released")
    verdict, *others = found.sentences()
    say(f"[{_COLOURS[found.decision]}]{escape(verdict)}[/]", *map(escape, others))
