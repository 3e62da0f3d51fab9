"""Commands that use a map: predict and validate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from truepose.cli.options import Force, Json, MapPath
from truepose.cli.output import accuracy_table, emit_json, overwrite, say, table, working
from truepose.cli.summaries import show_better, show_campaign, show_worth

_STATES = ("before", "after")


def predict(
    map_path: MapPath,
    poses_path: Annotated[
        Path, typer.Argument(metavar="POSES", help="Table of poses with columns q1_deg … or x_cmd_mm ….")
    ],
    out: Annotated[Path, typer.Option("--out", help="The table to write.")] = Path("predicted.csv"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Predict the measured position of commanded poses, and the standard deviation of a corrected position."""
    import numpy as np

    from truepose.error_map import load_map
    from truepose.samples import append_columns
    from truepose.trackers import read_plan

    overwrite(force, out)
    with working("Reading the map", quiet=as_json) as progress:
        error_map = load_map(map_path)
        poses = read_plan(poses_path)
        progress(f"Predicting {len(poses)} poses")
        p, std = error_map.predict_measured(poses)
    total = np.linalg.norm(std, axis=1)
    columns = {f"{axis}_pred_mm": p[:, k] for k, axis in enumerate("xyz")}
    columns |= {"std_mm": total, **{f"{axis}_pred_std_mm": std[:, k] for k, axis in enumerate("xyz")}}
    append_columns(poses_path, out, columns)
    if as_json:
        emit_json({"out": out, "n": len(p), "mean_std_mm": float(total.mean()), "max_std_mm": float(total.max())})
    else:
        std_words = f"standard deviation {total.mean():.3f} mm on average, {total.max():.3f} mm at most"
        say(f"Wrote {out}: {len(p)} poses, {std_words}.")


def validate(
    map_path: MapPath,
    test_path: Annotated[Path, typer.Argument(metavar="TEST", help="Table of samples that were not in the fit.")],
    as_json: Json = False,
) -> None:
    """Compare the errors before and after correction on samples that were not in the fit."""
    from truepose.error_map import load_map, recheck
    from truepose.samples import read_samples

    with working("Reading the map", quiet=as_json) as progress:
        error_map = load_map(map_path)
        samples = read_samples(test_path)
        progress("Validating, and comparing with another predictor")
        validation, found = error_map.validate(samples), recheck(error_map, samples)
    data = validation.to_dict()
    if as_json:
        more = {"holding": found.holding.to_dict(), "campaign": error_map.campaign}
        emit_json({"map": map_path, "test": test_path, "predictor": error_map.predictor_name, **data, **more})
        return
    low, high = data["intervals_95"]["after_mean_mm"]
    cover = data["coverage"]
    say(
        accuracy_table(f"Held-out accuracy of {error_map.predictor_name}", data),
        f"95 % interval of the mean after: {low:.3f} … {high:.3f} mm.",
        f"Readings inside the predicted 68 % intervals (with measurement noise): {100 * cover['within_68']:.0f} %; "
        f"inside the 95 % intervals: {100 * cover['within_95']:.0f} %.",
        found.words[0],
    )
    if floor := data.get("noise_floor"):
        low, high = floor["ratio_interval_95"]
        say(
            f"Mean by noise of robot and tracker alone: {floor['mean_mm']:.3f} mm; the mean after is "
            f"{floor['ratio']:.2f} times that (95 %: {low:.2f} … {high:.2f})."
        )
    _show_groups(data["groups"])
    show_campaign(error_map.campaign)
    show_worth(error_map.worth)
    show_better(validation.better)
    if data["seen"]:
        say(f"[yellow]Warning[/]: {data['seen']} of these poses were in the fit; the figures are too favourable.")


def _show_groups(groups: Mapping[str, Any]) -> None:
    """Show the errors by parts of the samples, and the intervals of the mean over such parts."""
    rows = [
        (
            name,
            part["name"],
            part["before"]["n"],
            *(part[when][key] for key in ("mean_mm", "max_mm") for when in _STATES),
        )
        for name, group in groups.items()
        for part in group["parts"]
    ]
    if rows:
        columns = ["by", "part", "poses", "mean before", "mean after", "max before", "max after"]
        say(table("By parts [mm]", columns, rows))
    for name, group in groups.items():
        low, high = group["interval_95_mean_mm"]
        say(f"95 % interval of the mean after, bootstrap over {name}: {low:.3f} … {high:.3f} mm.")
