"""``truepose report``: a report about a map, for signature."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from truepose.cli.options import Force, Json, MapPath
from truepose.cli.output import emit_json, overwrite, say, working
from truepose.cli.store_record import RecordIn, record_report, recorder
from truepose.cli.summaries import show_facts


def report(
    map_path: MapPath,
    out: Annotated[Path, typer.Option("--out", help="The .html or .pdf file to write.")] = Path("report.html"),
    test: Annotated[
        Path | None, typer.Option(help="Table of held-out samples, for the accuracy before and after.")
    ] = None,
    programs: Annotated[
        list[Path] | None,
        typer.Option("--program", help="Record (JSON) of a corrected program, or a folder with records; repeatable."),
    ] = None,
    verifications: Annotated[
        list[Path] | None,
        typer.Option("--verification", help="File of 'truepose verify --out FILE.json'; may be repeated."),
    ] = None,
    cell_path: Annotated[
        Path | None, typer.Option("--cell", help="Cell file with the facts of the report; by default the map's own.")
    ] = None,
    locale: Annotated[str, typer.Option(help="Language: en, de or zh.")] = "en",
    interactive: Annotated[
        bool, typer.Option("--interactive", help="Add a view of errors and arm that can be turned (.html only).")
    ] = False,
    store: RecordIn = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a report for signature: conformity, accuracy, similarity, model, maps, corrected programs, provenance.

    It exits with 1 where the decision at its head is FAIL.
    """
    from truepose.cell import load_cell
    from truepose.error_map import load_map
    from truepose.error_map.figures import facts_data
    from truepose.report import write_report
    from truepose.samples import read_samples

    overwrite(force, out)
    with recorder(store, "view") as record, working(quiet=as_json) as progress:
        error_map, row = (load_map(map_path), None) if record is None else record.load_map(map_path)
        entry = None if record is None or row is None else record.entry(row)
        held_out = None if test is None else read_samples(test)
        cell = None if cell_path is None else load_cell(cell_path)
        progress("Writing the report")
        decided = write_report(
            error_map,
            out,
            held_out,
            cell=cell,
            sidecars=[record for path in programs or [] for record in _records(path)],
            verifications=verifications or [],
            locale=locale,
            interactive=interactive,
            store=entry,
        )
        if record is not None and row is not None and entry is not None:
            record_report(record, out, row, entry.head)
    if as_json:
        emit_json({"report": out, **asdict(decided), "facts": facts_data(error_map)})
    else:
        show_facts(error_map.facts)
        say(f"{decided.decision.upper()}: the worst of held-out poses and verified programs.", f"Wrote {out}.")
    if decided.decision == "fail":
        raise typer.Exit(1)


def _records(path: Path) -> list[Path]:
    """Return a record, or all records in a folder and below it."""
    from truepose.errors import FileError
    from truepose.programs.record import SUFFIX

    if not path.is_dir():
        return [path]
    found = sorted(path.rglob(f"*{SUFFIX}"))
    if not found:
        raise FileError(path, f"holds no record of a corrected program (*{SUFFIX})")
    return found
