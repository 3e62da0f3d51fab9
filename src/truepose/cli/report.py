"""The report of a map, as a page or as a PDF."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.cli.output import Force, Json, emit_json, overwrite, say, working


def report(
    map_path: Annotated[Path, typer.Argument(metavar="MAP", help="A map that 'truepose fit' wrote.")],
    out: Annotated[Path, typer.Option("--out", help="What to write: a .html page or a .pdf.")] = Path("report.html"),
    test: Annotated[
        Path | None, typer.Option(help="Samples held out of the fit, for accuracy before and after.")
    ] = None,
    programs: Annotated[
        list[Path] | None, typer.Option("--program", help="Record (JSON) of a corrected program; may be repeated.")
    ] = None,
    locale: Annotated[str, typer.Option(help="Language: en, de, zh.")] = "en",
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a report about a map to sign: accuracy, similarity, model, maps, corrected programs, provenance."""
    from truepose.error_map import load_map
    from truepose.report import write_report
    from truepose.samples import read_samples

    overwrite(force, out)
    with working() as progress:
        error_map = load_map(map_path)
        held_out = None if test is None else read_samples(test)
        progress("Writing the report")
        write_report(error_map, out, held_out, sidecars=programs or [], locale=locale)
    if as_json:
        emit_json({"report": out})
    else:
        say(f"Wrote {out}.")
