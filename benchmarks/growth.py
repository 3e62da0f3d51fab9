"""Time and memory of fits against the number of samples, with their exponents and a picture."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import Memory, peak_memory
from benchmarks.held_out import Page
from truepose import VirtualCell
from truepose.error_map.selection import CellSamples
from truepose.predictors import PositionalErrors
from truepose.similarity import experimental_variogram

PAGE: Final = "growth"
SIZES: Final = (250, 500, 1_000, 2_000, 4_000, 8_000, 16_000, 32_000)
PATIENCE: Final = 240.0
"""Processor time [s] that the next size may be expected to take; beyond it the row ends."""
LAST: Final = 3
"""Sizes from whose times and memory the exponents are."""


def _samples(n: int) -> PositionalErrors:
    """Return the errors at n random poses of a virtual robot, registered."""
    virtual = VirtualCell("paper", seed=1)
    measured = CellSamples(virtual.cell, virtual.robot, virtual.measure(virtual.design(n, seed=1), seed=1))
    return measured.errors(*measured.register())


def _fit(name: str, errors: PositionalErrors) -> None:
    errors.fit(name)


def _fit_and_predict(name: str, errors: PositionalErrors) -> None:
    model, _ = errors.fit(name)
    model.predict(errors.coordinates["cartesian"][:1_000] + 1.0, return_std=True)


def _variogram(errors: PositionalErrors) -> None:
    experimental_variogram(errors.coordinates["cartesian"], errors.e)


METHODS: Final[dict[str, Callable[[PositionalErrors], None]]] = {
    "experimental variogram": _variogram,
    "ordinary Kriging, fit with hyperparameters": partial(_fit, "ordinary-kriging"),
    "local Kriging, fit and 1,000 predictions": partial(_fit_and_predict, "local-kriging"),
    "Vecchia, fit and 1,000 predictions": partial(_fit_and_predict, "vecchia-kriging"),
    "kinematic Kriging, fit with hyperparameters": partial(_fit, "kinematic-kriging"),
}


@dataclass(frozen=True)
class Growth:
    """What one method takes at each size: n, processor time [s], and MB beyond those of the samples."""

    name: str
    n: list[int]
    seconds: list[float]
    megabytes: list[float]

    @property
    def exponents(self) -> tuple[float, float]:
        """Slopes of time and memory against n over the last sizes, both axes logarithmic."""
        n = np.log(self.n[-LAST:])
        grown = np.maximum(self.megabytes[-LAST:], 1.0)
        return tuple(float(np.polyfit(n, np.log(y), 1)[0]) for y in (self.seconds[-LAST:], grown))  # type: ignore[return-value]  # two


class _Run:
    """A method on n samples, made in the process that runs it."""

    def __init__(self, name: str, n: int) -> None:
        self.name, self.n = name, n
        self.errors: PositionalErrors | None = None

    def first(self) -> None:
        """Make the samples, and load the compiled kernels with a few of them."""
        METHODS[self.name](_samples(60))
        self.errors = _samples(self.n)

    def __call__(self) -> None:
        """Run the method."""
        assert self.errors is not None  # `first` came before
        METHODS[self.name](self.errors)


def grow(name: str, sizes: tuple[int, ...]) -> Growth:
    """Return what a method takes at each size, until the next one would take too long."""
    found = Growth(name, [], [], [])
    for n in sizes:
        if len(found.n) > 1 and found.seconds[-1] ** 2 / found.seconds[-2] > PATIENCE:
            break
        run = _Run(name, n)
        run.first()
        found.n.append(n)
        start = time.process_time()
        run()
        found.seconds.append(time.process_time() - start)
        run = _Run(name, n)
        found.megabytes.append(peak_memory(Memory(run.first, run)))
    return found


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the benchmark."""
    page = Page("Growth with the number of samples", path)
    page.say(
        'Virtual cell "paper", random poses; one run of each size. Time is processor time of the call, all threads, in '
        "a warm process; memory is what the call adds in a fresh one to the peak of making the samples. Exponents are "
        f"the slopes over the last three sizes. A row ends where the next size would take more than {PATIENCE:.0f} s. "
        "`fit` replaces ordinary Kriging by Vecchia's approximation above 5,000 samples."
    )
    page.head(["method", "n", "time", "memory", "exponents of time; memory"])
    sizes = SIZES[:3] if quick else SIZES
    found = []
    for name in METHODS:
        growth = grow(name, sizes)
        found.append(growth)
        time, memory = growth.exponents
        for k, n in enumerate(growth.n):
            last = f"{time:.2f}; {memory:.2f}" if k == len(growth.n) - 1 else ""
            time_taken, memory_taken = f"{growth.seconds[k]:.3g} s", f"{growth.megabytes[k]:.0f} MB"
            page.row("" if k else name, f"{n:,}", time_taken, memory_taken, last)
    if path is not None:
        picture(found).savefig(path.with_suffix(".svg"), metadata={"Date": None})
        page.say(f"![Time and memory against the number of samples]({path.stem}.svg)")


def picture(found: list[Growth]) -> Figure:
    """Return time and memory against n, both axes logarithmic."""
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    for axes, what in zip(figure.subplots(1, 2), ("seconds", "megabytes"), strict=True):
        for growth, marker in zip(found, "osD^v", strict=True):
            exponent = growth.exponents[what == "megabytes"]
            shown = np.maximum(getattr(growth, what), 0.5 if what == "megabytes" else 0.0)
            axes.loglog(growth.n, shown, marker=marker, label=f"{growth.name.split(',')[0]}: n^{exponent:.1f}")
        axes.set_xticks(SIZES, [f"{n:,}" for n in SIZES], rotation=45)
        axes.set_xlim(SIZES[0] / math.sqrt(2), SIZES[-1] * math.sqrt(2))
        axes.minorticks_off()
        axes.set_xlabel("samples n")
        axes.set_ylabel("processor time [s]" if what == "seconds" else "memory [MB]")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
    return figure
