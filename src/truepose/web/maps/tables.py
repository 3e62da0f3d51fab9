"""Tables of maps as CSV: every column states its unit, and what its numbers are of."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, Literal

import numpy as np

from truepose._io.delimited import escaped
from truepose._typing import FloatArray
from truepose.error_map import ErrorMap
from truepose.error_map.figures import fit_figures

TableName = Literal["samples", "figures", "candidates", "curves", "excluded", "variogram"]


def written(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as CSV; texts that a spreadsheet would compute begin with an apostrophe."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, float):
        return "" if not np.isfinite(value) else f"{value:.9g}"
    if isinstance(value, str):
        return escaped(value)
    return "" if value is None else value


def samples(error_map: ErrorMap) -> str:
    """Return measured, left and predicted errors of each sample."""
    left, std = error_map.leave_one_out()
    predicted, predicted_std = error_map.predict_errors(error_map.samples)
    blocks: dict[str, FloatArray] = {
        "{}_cmd_mm": error_map.p_cmd,
        "{}_error_measured_mm": error_map.e,
        "{}_error_predicted_mm": predicted,
        "{}_std_predicted_mm": predicted_std,
        "{}_error_leave_one_out_mm": left,
        "{}_std_leave_one_out_mm": std,
    }
    columns = ["point", "line", *(name.format(axis) for name in blocks for axis in "xyz")]
    named = [error_map.samples.identify(row) for row in range(len(error_map.samples))]
    values = np.concatenate(list(blocks.values()), axis=1).tolist()
    rows = [[one.get("point"), one.get("line"), *row] for one, row in zip(named, values, strict=True)]
    return written(columns, rows)


def figures(error_map: ErrorMap) -> str:
    """Return the figures of error lengths, each with what it is of."""
    found = fit_figures(error_map)
    worth = found["worth"]
    kinds = ("n", "mean_mm", "rms_mm", "std_mm", "p95_mm", "max_mm")
    rows: list[list[object]] = [
        [of, kind, found[key][kind]]
        for of, key in (("samples after registration", "registered"), ("leave-one-out", "leave_one_out"))
        for kind in kinds
    ]
    rows += [["unseen blocks of samples", key, worth[key]] for key in ("nothing_mm", "left_mm", "registration_mm")]
    return written(["of", "figure", "value"], rows)


def candidates(error_map: ErrorMap) -> str:
    """Return the ranking by cross-validation."""
    splits = list(error_map.expected.get("splits", {}))
    columns = ["predictor", "mean_cross_validated_mm", "p95_cross_validated_mm"]
    columns += [f"mean_{name}_mm" for name in splits] + ["worse_by_low_mm", "worse_by_high_mm", "note"]
    return written(columns, [_candidate(row, splits) for row in error_map.ranking])


def _candidate(row: Mapping[str, Any], splits: Sequence[str]) -> list[object]:
    if "mean_mm" not in row:
        return [row["predictor"], *[None] * (len(splits) + 4), row.get("note", "")]
    low, high = row.get("worse_by_interval_mm") or (None, None)
    means = [row["splits"][name]["mean_mm"] for name in splits]
    return [row["predictor"], row["mean_mm"], row["p95_mm"], *means, low, high, row.get("note", "")]


def excluded(error_map: ErrorMap) -> str:
    """Return the samples that were left out of the fit, with the reasons."""
    rows = [[one.get("point"), one.get("line"), one.get("reason")] for one in error_map.excluded]
    return written(["point", "line", "reason"], rows)


def curves(known: Mapping[str, Any]) -> str:
    """Return the joints' own errors over their angles, of the description that `truepose explain` gives."""
    rows = [
        [one["joint"], *values]
        for one in known["joints"]
        for values in zip(one["angle_deg"], one["error_mrad"], one["std_mrad"], strict=True)
    ]
    return written(["joint", "angle_deg", "error_estimated_mrad", "std_mrad"], rows)


OF_MAP: Final[dict[TableName, Callable[[ErrorMap], str]]] = {
    "samples": samples,
    "figures": figures,
    "candidates": candidates,
    "excluded": excluded,
}
"""The tables that need the map only."""
