"""Fit, predict held-out samples, and write rows of figures: the common part of the accuracy studies."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from benchmarks.harness import about
from truepose import Cell, ErrorMap, Samples, fit_cell
from truepose._typing import FloatArray
from truepose.errors import TrueposeError
from truepose.verification import coverage

PACKAGES = ("truepose", "numpy", "scipy", "scikit-learn")


@dataclass(frozen=True)
class Figures:
    """The figures of one fit on held-out samples: lengths [mm], shares, and times [s].

    `rank` is the rank correlation of predicted standard deviations and lengths of residuals.
    """

    mean: float
    p95: float
    within_68: float
    within_95: float
    standardised: float
    largest: float
    rank: float
    fit_s: float
    predict_s: float
    error_map: ErrorMap = field(repr=False)


def held_out(cell: Cell, samples: Samples, test: Samples, predictor: str, **options: object) -> Figures | str:
    """Return the figures of a fit on held-out samples, or the reason of its failure."""
    try:
        start = time.perf_counter()
        found = fit_cell(cell, samples, predictor, **options)  # type: ignore[arg-type]
        fitted = time.perf_counter()
        expected, std = found.predict_reading(test)
        predicted = time.perf_counter()
    except TrueposeError as error:
        return f"{error}"
    residual = found.errors(test) - expected
    length, cover = np.linalg.norm(residual, axis=1), coverage(residual, std)
    return Figures(
        float(length.mean()),
        float(np.percentile(length, 95)),
        cover.within_68,
        cover.within_95,
        float(np.std(residual / std)),
        float(length.max()),
        _rank(np.linalg.norm(std, axis=1), length),
        fitted - start,
        predicted - fitted,
        found,
    )


def _rank(std: FloatArray, length: FloatArray) -> float:
    """Return the rank correlation; 0 where all standard deviations are equal."""
    return float(spearmanr(std, length).statistic) if np.ptp(std) > 1e-9 * std.max() else 0.0


def mean(figures: Sequence[Figures], name: str) -> float:
    """Return the mean of one figure."""
    return float(np.mean([getattr(one, name) for one in figures]))


class Page:
    """A Markdown page that prints and saves each row at once."""

    def __init__(self, title: str, path: Path | None) -> None:
        self._path = path
        packages = about(PACKAGES).split(". ", 1)[1]
        self._text = ""
        self._add(f"# {title}\n\n{packages}\n")

    def say(self, text: str) -> None:
        """Add a paragraph or a heading."""
        self._add(f"\n{text}\n")

    def head(self, columns: Iterable[str]) -> None:
        """Begin a table."""
        columns = list(columns)
        self._add("\n" + _row(columns) + "\n" + _row(["---"] * len(columns)) + "\n")

    def row(self, *cells: object) -> None:
        """Add a row; numbers with three decimals."""
        self._add(_row([f"{cell:.3f}" if isinstance(cell, float) else str(cell) for cell in cells]) + "\n")

    def _add(self, text: str) -> None:
        self._text += text
        print(text, end="", flush=True)
        if self._path is not None:
            self._path.write_text(self._text, "utf-8")


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"
