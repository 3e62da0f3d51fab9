"""Held-out accuracy of every predictor on measured robots: ``python -m benchmarks accuracy --data FOLDER``."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.held_out import Page, held_out
from benchmarks.measured_robots import MeasuredRobot, Split, read_robots
from truepose import __version__
from truepose.errors import FileError
from truepose.predictors import PREDICTORS, predictor_spec

PAGE: Final = "accuracy-data"
PAPER: Final = "ordinary-kriging"
"""The paper's method: rigid registration, then ordinary Kriging of each component over the commanded position."""
CANDIDATES: Final = (*PREDICTORS, "auto")
FIGURES: Final = ("mean", "p95", "largest", "within_95", "rank", "fit_s", "predict_s")
COLUMNS: Final = ("robot", "split", "n_fit", "n_test", "predictor", *FIGURES, "failed", "data_sha256", "truepose")


def check(folder: Path) -> None:
    """Read all robots, and say what is in them."""
    for robot in read_robots(folder):
        print(f"{robot.name}: {robot.title}; {len(robot.samples)} samples, robot {robot.cell.robot.model}")
        for split in robot.splits:
            print(f"  {split.name}: {_sizes(split)}")
    print("All files can be read.")


def report_data(folder: Path, page_path: Path | None, out: Path, predictors: Sequence[str] = ()) -> None:
    """Fit and try each predictor on each split; rows that `out` has already are kept.

    Parameters
    ----------
    folder : Path
        The folder of the robots.
    page_path : Path or None
        Where to write the table as a page.
    out : Path
        The table as CSV, written anew with each row.
    predictors : sequence of str
        The predictors with their options; default: all, and the choice among them.
    """
    for name in predictors:
        if name != "auto":
            predictor_spec(name)  # refuses one that is not known, before the others take their time
    robots = list(read_robots(folder))
    done = _finished(out)
    page = Page("Accuracy on folders of measured robots", page_path)
    page.say(
        "Length of held-out residuals [mm], readings' noise included; coverage of 95 % intervals of components; rank "
        "correlation of predicted standard deviations and lengths of residuals. Held-out samples take no part in the "
        f"fit, nor in the choice of `auto`. `{PAPER}` is the paper's method. Made by `python -m benchmarks accuracy "
        "--data FOLDER`."
    )
    for robot in robots:
        page.say(f"## {robot.name}\n\n{robot.title}. Robot `{robot.cell.robot.model}`, data {robot.sha256[:12]}.")
        for split in robot.splits:
            page.say(f"Split `{split.name}`: {_sizes(split)}.")
            page.head(["predictor", "mean", "P95", "largest", "in 95 %", "rank", "fit [s]", "predict [s]"])
            for name in predictors or CANDIDATES:
                key = (robot.name, split.name, name, robot.sha256, __version__)
                if (row := done.get(key)) is None:
                    row = done[key] = _row(robot, split, name)
                    _write(out, done.values())
                page.row(f"`{name}`", *_cells(row))


def _sizes(split: Split) -> str:
    repeated = f"; {split.repeated} of these repeat a fitted pose" if split.repeated else ""
    return f"{len(split.fit)} samples to fit, {len(split.test)} held out{repeated}"


def _row(robot: MeasuredRobot, split: Split, name: str) -> dict[str, Any]:
    found = held_out(robot.cell, robot.samples[split.fit], robot.samples[split.test], name)
    good = {} if isinstance(found, str) else {one: f"{getattr(found, one):.6g}" for one in FIGURES}
    return {
        **dict.fromkeys(COLUMNS, ""),
        "robot": robot.name,
        "split": split.name,
        "predictor": name,
        "n_fit": len(split.fit),
        "n_test": len(split.test),
        **good,
        "failed": found if isinstance(found, str) else "",
        "data_sha256": robot.sha256,
        "truepose": __version__,
    }


def _cells(row: dict[str, Any]) -> list[str]:
    if row["failed"]:
        return [row["failed"].replace("|", "/"), *[""] * (len(FIGURES) - 1)]
    value = {name: float(row[name]) for name in FIGURES}
    return [
        *(f"{value[name]:.3f}" for name in ("mean", "p95", "largest")),
        f"{100 * value['within_95']:.0f} %",
        *(f"{value[name]:.2f}" for name in ("rank", "fit_s", "predict_s")),
    ]


def _finished(out: Path) -> dict[tuple[str, ...], dict[str, Any]]:
    """Return the rows of an earlier run of the same data and version."""
    if not out.exists():
        return {}
    with out.open(encoding="utf-8", newline="") as file:
        table = csv.DictReader(file)
        if tuple(table.fieldnames or ()) != COLUMNS:
            raise FileError(out, "is no table of this benchmark; name another file with --out")
        rows = list(table)
    return {(r["robot"], r["split"], r["predictor"], r["data_sha256"], r["truepose"]): r for r in rows}


def _write(out: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write the table anew; an interruption leaves the one before."""
    draft = out.with_name(f"{out.name}.part")
    try:
        with draft.open("w", encoding="utf-8", newline="") as file:
            table = csv.DictWriter(file, COLUMNS)
            table.writeheader()
            table.writerows(rows)
        draft.replace(out)
    except OSError as error:
        raise FileError(out, f"cannot be written: {error.strerror or error}; name another file with --out") from None
