"""The choice among predictors, shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from truepose.cli.output import say, table


def show_choice(ranking: Sequence[Mapping[str, Any]], expected: Mapping[str, Any]) -> None:
    """Show a ranking as `truepose.predictors.Choice` has it, and what the choice itself leaves."""
    splits = list(expected["splits"])
    rows = [
        (
            row["predictor"],
            row["mean_mm"],
            *(row["splits"][name]["mean_mm"] for name in splits),
            row["p95_mm"],
            _worse(row) if k else "taken",
        )
        if "mean_mm" in row
        else (row["predictor"], *["–"] * (len(splits) + 2), row["note"])
        for k, row in enumerate(ranking)
    ]
    columns = ["predictor", "mean [mm]", *splits, "P95", "worse by, 95 %"]
    say(table(f"Candidates, predicted without {' and without '.join(splits)}", columns, rows))
    low, high = expected["mean_interval_mm"]
    say(
        f"Samples that took part neither in the fit nor in the choice: mean {expected['mean_mm']:.3f} mm "
        f"(95 % interval {low:.3f} … {high:.3f}); taken without them: "
        + ", ".join(f"{name} {count} times" for name, count in expected["chosen"].items())
        + "."
    )


def _worse(row: Mapping[str, Any]) -> str:
    low, high = row["worse_by_interval_mm"]
    return "level" if row["level"] else f"{low:.3f} … {high:.3f}"
