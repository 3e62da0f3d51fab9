"""Commands that use a map: predict and validate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.cli.options import Execution, Force, Json, MapPath, with_groups
from truepose.cli.output import accuracy_table, emit_json, overwrite, say, table, working
from truepose.cli.store_record import RecordIn, record_validation, recorder
from truepose.cli.summaries import show_better, show_campaign, show_facts, show_worth

if TYPE_CHECKING:
    from truepose._typing import FloatArray
    from truepose.cli.output import Steps

_STATES = ("before", "after")
_EXECUTION = Execution()
_WORTH_PROCESSES = 150_000  # poses


class _Totals:
    """What a prediction says about all poses, and how many are done."""

    def __init__(self, n: int, progress: Steps) -> None:
        self.done, self.sum, self.largest = 0, 0.0, 0.0
        self._n, self._progress = n, progress

    def add(self, p: FloatArray, std: FloatArray) -> dict[str, FloatArray]:
        """Count a part; return its columns."""
        import numpy as np

        total = np.linalg.norm(std, axis=1)
        self.done, self.sum = self.done + len(p), self.sum + float(total.sum())
        self.largest = max(self.largest, float(total.max()))
        self._progress.count(self.done, self._n)
        columns = {f"{axis}_pred_mm": p[:, k] for k, axis in enumerate("xyz")}
        return columns | {"std_mm": total, **{f"{axis}_pred_std_mm": std[:, k] for k, axis in enumerate("xyz")}}


@with_groups
def predict(
    map_path: MapPath,
    poses_path: Annotated[
        Path, typer.Argument(metavar="POSES", help="Table (CSV, .xlsx, .parquet) with columns q1_deg … or x_cmd_mm ….")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="The table to write; by default predicted.csv or predicted.parquet.")
    ] = None,
    temperature: Annotated[
        float | None, typer.Option("--temperature", metavar="C", help="Temperature in °C of poses that state none.")
    ] = None,
    payload: Annotated[
        float | None, typer.Option("--payload", metavar="KG", help="Payload in kg of poses that state none.")
    ] = None,
    execution: Execution = _EXECUTION,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Predict the measured position of commanded poses, and the standard deviation of a corrected position."""
    import numpy as np

    from truepose.cell import conditions_at_work
    from truepose.error_map import load_map
    from truepose.error_map.bulk import ROWS, in_parts, predict_parts
    from truepose.errors import DataError
    from truepose.samples import append_columns
    from truepose.samples.parquet import ParquetTable, is_parquet, write_parts
    from truepose.trackers import read_plan

    large = is_parquet(poses_path)
    out = out or Path("predicted.parquet" if large else "predicted.csv")
    if is_parquet(out) != large:
        raise DataError(f"{poses_path} and {out}: give both as Parquet (.parquet) or none of them")
    overwrite(force, out)
    with working("Reading the map", quiet=as_json) as progress:
        error_map = load_map(map_path).at_work(conditions_at_work(temperature, payload))
        poses = ParquetTable(poses_path) if large else read_plan(poses_path)
        progress(f"Predicting {len(poses)} poses")
        with execution.executor("prediction", pays=len(poses) > _WORTH_PROCESSES) as executor:
            totals = _Totals(len(poses), progress)
            if isinstance(poses, ParquetTable):
                parts = predict_parts(error_map, poses.parts(ROWS), executor)
                write_parts(out, ((part, totals.add(p, std)) for part, p, std in parts))
            else:
                found = [totals.add(p, std) for _, p, std in predict_parts(error_map, in_parts(poses), executor)]
                append_columns(
                    poses_path, out, {name: np.concatenate([one[name] for one in found]) for name in found[0]}
                )
    mean, largest = totals.sum / totals.done, totals.largest
    if as_json:
        emit_json({"out": out, "n": totals.done, "mean_std_mm": mean, "max_std_mm": largest})
    else:
        std_words = f"standard deviation {mean:.3f} mm on average, {largest:.3f} mm at most"
        say(f"Wrote {out}: {totals.done} poses, {std_words}.")


def validate(
    map_path: MapPath,
    test_path: Annotated[Path, typer.Argument(metavar="TEST", help="Table of samples that were not in the fit.")],
    store: RecordIn = None,
    as_json: Json = False,
) -> None:
    """Compare the errors before and after correction on samples that were not in the fit."""
    import numpy as np

    from truepose.error_map import load_map, recheck
    from truepose.error_map.figures import facts_data
    from truepose.samples import read_samples

    with recorder(store, "verify") as record, working("Reading the map", quiet=as_json) as progress:
        error_map, row = (load_map(map_path), None) if record is None else record.load_map(map_path)
        samples = read_samples(test_path)
        progress("Validating, and comparing with another predictor")
        validation, found = error_map.validate(samples), recheck(error_map, samples)
        gross = validation.gross_rows
        kept = recheck(error_map, samples[np.delete(np.arange(len(samples)), gross)]) if gross else None
        data = validation.to_dict()
        if record is not None and row is not None:
            record_validation(record, row, test_path, samples, data)
    if as_json:
        more = {
            "holding": found.holding.to_dict(),
            "holding_without_gross": None if kept is None else kept.holding.to_dict(),
            "campaign": error_map.campaign,
            "facts": facts_data(error_map),
        }
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
        f"Left{validation.words_left_out.removeprefix('left')}.",
    )
    if kept is not None:
        say(f"[yellow]Warning[/]: {validation.words_of_gross}.", f"Without gross readings: {kept.words[0]}")
    if floor := data.get("noise_floor"):
        low, high = floor["ratio_interval_95"]
        say(
            f"Mean by noise of robot and tracker alone: {floor['mean_mm']:.3f} mm; the mean after is "
            f"{floor['ratio']:.2f} times that (95 %: {low:.2f} … {high:.2f})."
        )
    _show_groups(data["groups"])
    show_campaign(error_map.campaign)
    show_facts(error_map.facts)
    show_worth(error_map.worth)
    show_better(validation.better)
    if data["seen"]:
        say(f"[yellow]Warning[/]: {data['seen']} of these poses were in the fit; the figures are too favourable.")


def _show_groups(groups: Mapping[str, Any]) -> None:
    """Show the errors by parts of the samples, and the intervals of the mean over such parts."""
    from truepose.verification.held_out import words_of_groups

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
        words = words_of_groups(name, group)
        say(f"{words[0].upper()}{words[1:]}.")
