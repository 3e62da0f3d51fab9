"""``truepose update``: new samples and a map that is there."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from truepose.cli.output import Force, Json, emit_json, overwrite, say, table
from truepose.errors import RefusedError


class Refit(StrEnum):
    """What alone is found again."""

    station = "station"
    tool = "tool"
    both = "both"


def update(
    map_path: Annotated[Path, typer.Argument(metavar="MAP")],
    samples_path: Annotated[Path, typer.Argument(metavar="SAMPLES", help="New readings, as those of fit.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="The map to write; without it the map is only tested.")
    ] = None,
    refit: Annotated[
        Refit | None,
        typer.Option(help="Find only the tracker's station, the tool point or both again; keep all else."),
    ] = None,
    anyway: Annotated[bool, typer.Option("--anyway", help="Let samples join that the map does not hold for.")] = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Test whether a map still holds for new samples, and let them join it."""
    import numpy as np

    from truepose.error_map import load_map, recheck, update_map
    from truepose.samples import read_samples

    overwrite(force, *([] if out is None else [out]))
    error_map, samples = load_map(map_path), read_samples(samples_path)
    before = recheck(error_map, samples) if refit is None else None
    if before is not None and out is not None and before.holding.verdict == "does not hold" and not anyway:
        raise RefusedError(
            f"{map_path}: {' '.join(before.words)} Nothing was written; --refit or a new fit is the remedy, or --anyway"
        )
    new = (
        error_map
        if out is None and refit is None
        else update_map(error_map, samples, None if refit is None else refit.value)
    )
    after = before if before is not None else recheck(new, samples)
    if out is not None:
        new.save(out)
    if as_json:
        emit_json({"map": map_path, "samples": samples_path, "out": out, "refit": refit, **after.to_dict()})
        return
    for sentence in after.words:
        say(sentence)
    if after.holding.far:
        say(f"[yellow]Far from what the map says[/]: {samples.rows(np.array(after.holding.far))}.")
    if refit is not None:
        moved = new.tf_flange_tool[:3, 3] - error_map.tf_flange_tool[:3, 3]
        rows = [(axis, float(p), float(d)) for axis, p, d in zip("xyz", new.tf_flange_tool[:3, 3], moved, strict=True)]
        if refit is not Refit.station:
            say(table("Tool point, flange frame", ["", "now [mm]", "moved by [mm]"], rows))
    if out is not None:
        count = len(new.samples)
        say(
            f"Wrote {out}: {count} samples."
            if refit is None
            else f"Wrote {out}: {refit.value} from {len(samples)} samples."
        )
