"""``truepose update``: add new samples to an existing map."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.cli.options import Force, Json, MapPath
from truepose.cli.output import emit_json, overwrite, say, table, working
from truepose.cli.store_record import RecordIn, map_to_use, record_update, recorder
from truepose.cli.summaries import show_facts
from truepose.errors import RefusedError

if TYPE_CHECKING:
    from truepose.error_map import ErrorMap


class Refit(StrEnum):
    """The part of a map that alone is fitted again."""

    station = "station"
    tool = "tool"
    both = "both"


def update(
    map_path: MapPath,
    samples_path: Annotated[Path, typer.Argument(metavar="SAMPLES", help="Table of new samples, as for fit.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="The map to write; without it, the map is only tested.")
    ] = None,
    refit: Annotated[
        Refit | None,
        typer.Option(help="Fit only the tracker station, the tool point or both again; keep everything else."),
    ] = None,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Add the samples even if the map is not valid for them.")
    ] = False,
    store: RecordIn = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Test whether a map is still valid for new samples, and add them to it."""
    import numpy as np

    from truepose.error_map import recheck, update_map
    from truepose.error_map.figures import facts_data
    from truepose.samples import read_samples

    overwrite(force, *([] if out is None else [out]))
    with recorder(store, "fit") as record:
        with working("Reading the map", quiet=as_json) as progress:
            error_map, row = map_to_use(record, map_path)
            samples = read_samples(samples_path)
            progress("Testing the map with the new samples")
            before = recheck(error_map, samples) if refit is None else None
        if before is not None and out is not None and before.holding.verdict == "does not hold" and not anyway:
            remedy = "use --refit, fit a new map, or add the samples with --anyway"
            raise RefusedError(f"{map_path}: {' '.join(before.words)} Nothing was written; {remedy}")
        only_tested = out is None and refit is None
        with working("Fitting the map again", quiet=as_json):
            new = (
                error_map
                if only_tested
                else update_map(error_map, samples, None if refit is None else refit.value, checked=before)
            )
            after = before if before is not None else recheck(new, samples)
        far = [samples.identify(i) for i in after.holding.far]
        if out is not None:
            new.save(out)
            if record is not None and row is not None:
                record_update(record, row, out, new, samples_path, samples)
    if as_json:
        emit_json(
            {
                "map": map_path,
                "samples": samples_path,
                "out": out,
                "refit": refit,
                **after.to_dict(),
                "far_points": far,
                "facts": facts_data(new),
            }
        )
        return
    say(*after.words)
    show_facts(new.facts)
    if after.holding.far:
        say(f"[yellow]Far from the prediction[/]: {samples.rows(np.array(after.holding.far))}.")
    if refit in (Refit.tool, Refit.both):
        _show_tool(error_map, new)
    if out is not None:
        what = f"{len(new.samples)} samples" if refit is None else f"{refit.value} from {len(samples)} samples"
        say(f"Wrote {out}: {what}.")


def _show_tool(old: ErrorMap, new: ErrorMap) -> None:
    p = new.tf_flange_tool[:3, 3]
    rows = zip("xyz", p.tolist(), (p - old.tf_flange_tool[:3, 3]).tolist(), strict=True)
    say(table("Tool point, flange frame", ["", "now [mm]", "moved by [mm]"], rows))
