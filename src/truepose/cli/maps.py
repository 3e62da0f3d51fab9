"""Commands about error maps: fit, predict, validate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.cli.output import Force, Json, accuracy_table, emit_json, overwrite, say, table, working

if TYPE_CHECKING:
    from truepose.error_map.worth import Worth

CellPath = Annotated[Path, typer.Argument(metavar="CELL", help="The cell file.")]
SamplesPath = Annotated[Path, typer.Argument(metavar="SAMPLES", help="The table of samples (CSV).")]
MapPath = Annotated[Path, typer.Argument(metavar="MAP", help="A map that 'truepose fit' wrote.")]

_WHEN = ("before", "after")


def fit(
    cell_path: CellPath,
    samples_path: SamplesPath,
    predictor: Annotated[str, typer.Option("--predictor", help="auto, or a name; a wrong one lists them.")] = "auto",
    out: Annotated[Path, typer.Option("--out", help="The map to write.")] = Path("map.truepose"),
    candidates: Annotated[
        str, typer.Option(help="Of auto: quick (one of each kind), all, or names with commas between.")
    ] = "quick",
    splits: Annotated[
        str, typer.Option(help="What auto leaves out: points, blocks, branches, with commas between.")
    ] = "points,blocks",
    workers: Annotated[int, typer.Option(help="Processes of auto; 0: one for each usable processor.", min=0)] = 0,
    accept_campaign: Annotated[
        bool,
        typer.Option(
            "--accept-campaign", help="Fit also where the tracker moved, lengths have a scale, or errors drift."
        ),
    ] = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Register, fit the tool if asked, and fit an error model; writes a map."""
    import numpy as np
    from rich.markup import escape

    from truepose.cell import load_cell
    from truepose.cli.calibration import calibration_data, calibration_of, show_calibration
    from truepose.cli.campaign import show_campaign
    from truepose.cli.choice import show_choice
    from truepose.error_map.fit import fit_cell
    from truepose.numerics.threads import cores
    from truepose.samples import read_samples
    from truepose.verification import summary

    overwrite(force, out)
    with working() as progress:
        error_map = fit_cell(
            load_cell(cell_path),
            read_samples(samples_path),
            predictor,
            candidates=candidates if candidates in ("quick", "all") else candidates.split(","),
            splits=splits.split(","),
            workers=workers or cores(),
            progress=progress,
            accept_campaign=accept_campaign,
        )
        error_map.save(out)
    registered, left_out = summary(error_map.e), summary(error_map.leave_one_out()[0])
    tool, calibration = error_map.registration.p_flange_tool, calibration_of(error_map.predictor)
    parameters = {
        key: value for key, value in error_map.predictor.to_dict().items() if key not in ("weight", "weights")
    }
    data: dict[str, Any] = {
        "map": out,
        "hash": error_map.hash,
        "n": len(error_map.samples),
        "predictor": error_map.predictor_name,
        "parameters": parameters,
        "tool_mm": None if tool is None else np.round(tool, 4),
        "hint": error_map.registration.hint,
        "registered": registered,
        "leave_one_out": left_out,
        "ranking": error_map.ranking,
        "expected": error_map.expected,
        "excluded": error_map.excluded,
        "campaign": error_map.campaign,
        "arm_check": error_map.arm_check.to_dict(),
        "worth": error_map.worth.to_dict(),
    }
    if calibration is not None:
        data["calibration"] = calibration_data(calibration)
    if as_json:
        emit_json(data)
        return
    if tool is not None:
        std = np.sqrt(np.diag(error_map.registration.covariance)[6:9])
        parts = ", ".join(f"{axis} {value:.3f} ± {s:.3f}" for axis, value, s in zip("xyz", tool, std, strict=True))
        say(f"Tool found with the station, flange to measured point: {parts} mm")
    colour = "green" if error_map.arm_check.checked else "yellow"
    say(f"[{colour}]Arm and tool[/]: {escape(error_map.arm_check.words)}")
    if error_map.registration.hint:
        say(f"[yellow]Note[/]: {error_map.registration.hint}.")
    show_campaign(error_map.campaign)
    for row in error_map.excluded:
        say(f"[yellow]Left out[/]: row {row['row']}, {row['reason']}.")
    if error_map.ranking:
        show_choice(error_map.ranking, error_map.expected)
    if calibration is not None:
        show_calibration(calibration)
    say_worth(error_map.worth)
    title = f"{error_map.predictor_name}: after registration, and predicted without the sample itself"
    say(accuracy_table(title, {"before": registered, "after": left_out}), f"Wrote {out}.")


def predict(
    map_path: MapPath,
    poses_path: Annotated[Path, typer.Argument(metavar="POSES", help="Columns q1_deg … or x_cmd_mm ….")],
    out: Annotated[Path, typer.Option("--out", help="The table to write.")] = Path("predicted.csv"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Predict where the tracker will see the measured point, with the deviation that a corrected position has."""
    import numpy as np

    from truepose.error_map import load_map
    from truepose.samples import append_columns, read_poses

    overwrite(force, out)
    error_map = load_map(map_path)
    p, std = error_map.predict_measured(read_poses(poses_path))
    total = np.linalg.norm(std, axis=1)
    columns = {f"{axis}_pred_mm": p[:, k] for k, axis in enumerate("xyz")}
    columns |= {"std_mm": total, **{f"{axis}_pred_std_mm": std[:, k] for k, axis in enumerate("xyz")}}
    append_columns(poses_path, out, columns)
    if as_json:
        emit_json({"out": out, "n": len(p), "mean_std_mm": float(total.mean()), "max_std_mm": float(total.max())})
    else:
        say(f"Wrote {out}: {len(p)} poses, deviation {total.mean():.3f} mm in the mean, {total.max():.3f} mm at most.")


def validate(
    map_path: MapPath, test_path: Annotated[Path, typer.Argument(metavar="TEST")], as_json: Json = False
) -> None:
    """Compare errors before and after on poses that the map has not seen."""
    from truepose.cli.campaign import show_campaign
    from truepose.error_map import load_map, recheck
    from truepose.samples import read_samples

    error_map = load_map(map_path)
    samples = read_samples(test_path)
    data, found = error_map.validate(samples), recheck(error_map, samples)
    if as_json:
        data["holding"] = found.holding.to_dict()
        data["campaign"] = error_map.campaign
        emit_json({"map": map_path, "test": test_path, "predictor": error_map.predictor_name, **data})
        return
    low, high = data["intervals_95"]["after_mean_mm"]
    cover = data["coverage"]
    say(
        accuracy_table(f"Held-out accuracy of {error_map.predictor_name}", data),
        f"95 % interval of the mean after: {low:.3f} … {high:.3f} mm.",
        f"Readings within the predicted 68 % intervals, their noise included: {100 * cover['within_68']:.0f} %; "
        f"within the 95 % intervals: {100 * cover['within_95']:.0f} %.",
    )
    say(found.words[0])
    if floor := data.get("noise_floor"):
        low, high = floor["ratio_interval_95"]
        say(
            f"Noise alone, of robot and tracker: {floor['mean_mm']:.3f} mm in the mean; the mean after is "
            f"{floor['ratio']:.2f} times that (95 %: {low:.2f} … {high:.2f})."
        )
    rows = [
        (name, part["name"], part["before"]["n"], *(part[when][key] for key in ("mean_mm", "max_mm") for when in _WHEN))
        for name, group in data["groups"].items()
        for part in group["parts"]
    ]
    if rows:
        columns = ["by", "part", "poses", "mean before", "mean after", "max before", "max after"]
        say(table("By parts [mm]", columns, rows))
    for name, group in data["groups"].items():
        low, high = group["interval_95_mean_mm"]
        say(f"95 % interval of the mean after, other {name} drawn: {low:.3f} … {high:.3f} mm.")
    show_campaign(error_map.campaign)
    say_worth(error_map.worth)
    if data["seen"]:
        say(f"[yellow]Warning[/]: {data['seen']} of these poses took part in the fit; the figures flatter the map.")


def say_worth(worth: Worth) -> None:
    """Say whether a map is better than none; a weak one with the way to use it all the same."""
    sentence = f"{worth.words[0].upper()}{worth.words[1:]}"
    if worth.weak:
        say(f"[yellow]Weak map[/]: {sentence}. 'truepose correct' refuses it without --accept-weak-map.")
    else:
        say(f"{sentence}.")
