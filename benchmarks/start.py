"""Processor time of a start: imports, whole commands, and the first use of the compiled kernels; in fresh processes."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmarks.harness import REPEATS, cpu, version_of
from truepose.error_map import fit_cell
from truepose.samples import write_samples
from truepose.simulation import VirtualCell

PAGE = "start"
PACKAGES = ("numpy", "scipy", "numba", "typer", "pydantic")
COMPILING = 2
"""Runs of what compiles kernels, which takes long."""
LIBRARIES = "import numpy, scipy.optimize, numba"
FIRST_USE = """
import numpy as np
from truepose.error_map import *
from truepose.predictors import make_predictor
from truepose.similarity import experimental_variogram, fit_likelihood, fit_variogram
x = np.random.default_rng(0).uniform(0, 1000, (200, 3))
e = np.sin(x / 200)
fit_variogram(experimental_variogram(x, e))
for name in ("ordinary-kriging", "local-kriging"):
    make_predictor(name).fit(x, e).predict(x[:50], return_std=True)
fit_likelihood(x, e)
"""


@dataclass(frozen=True)
class Start:
    """What a fresh Python does, and what it should take; in a new cache of kernels if `compiles`."""

    name: str
    arguments: tuple[str, ...]
    wanted: str = ""
    compiles: bool = False


def starts(folder: Path) -> Iterator[Start]:
    """Yield what is measured; the libraries first, with which the others are compared."""
    virtual = VirtualCell("paper", seed=1)
    cell, held_out, saved = folder / "cell.toml", folder / "held_out.csv", folder / "map.truepose"
    cell.write_text(virtual.cell.to_toml())
    write_samples(held_out, virtual.measure(virtual.design(100, seed=2), seed=2))
    fit_cell(virtual.cell, virtual.measure(virtual.design(100, seed=1), seed=1), "kinematic-kriging").save(saved)
    hard = VirtualCell("hard", seed=1)
    hard_cell, samples, large = folder / "hard.toml", folder / "samples.csv", folder / "large.truepose"
    hard_cell.write_text(hard.cell.to_toml())
    write_samples(samples, hard.measure(hard.design(600, seed=1), seed=1))
    fit_cell(hard.cell, hard.measure(hard.design(600, seed=1), seed=1), "kinematic-kriging").save(large)
    program = folder / "panel.src"
    program.write_text("DEF panel()\n$TOOL = TOOL_DATA[1]\nLIN {X 1500, Y 0, Z 900, A 0, B 90, C 0}\nEND\n")
    (folder / "config.dat").write_text("TOOL_DATA[1]={X 0,Y 0,Z 200,A 0,B 0,C 0}\n")

    def command(name: str, *arguments: object, wanted: str = "", compiles: bool = False) -> Start:
        words = tuple(map(str, arguments))
        return Start(f"`truepose {name}`", ("-m", "truepose", name.split(",")[0], *words), wanted, compiles)

    yield Start(f"`{LIBRARIES}`", ("-c", LIBRARIES))
    yield Start("`from truepose.error_map import *`", ("-c", "from truepose.error_map import *"), "1.15 ×")
    yield command("--help", wanted="0.3 s")
    yield command("robots")
    yield command("init", folder / "new", "--robot", "kuka-kr150-2", "--force")
    yield command("check", program, "--cell", cell, "--config-dat", folder / "config.dat")
    yield command("validate, 100 poses", saved, held_out, wanted="libraries + 0.7 s")
    beyond = "`truepose.error_map` + 3 s"
    yield command("explain, 600 samples", large, wanted=beyond)
    yield command("similarity, 600 samples, --joint-wise", hard_cell, samples, "--joint-wise", wanted=beyond)
    yield command("report, 600 samples", large, "--out", folder / "report.html", "--force", wanted=beyond)
    yield command("plan, --n 60", cell, "--n", 60, "--out", folder / "plan", "--force", wanted="4 s")
    first = "imports, variogram, Kriging, local Kriging, likelihood"
    yield Start(f"{first}; kernels from the cache", ("-c", FIRST_USE))
    yield Start(f"{first}; first use ever", ("-c", FIRST_USE), "15 s", compiles=True)
    yield command("warm-up", compiles=True)


def seconds(start: Start, environment: Mapping[str, str]) -> float:
    """Return the processor time of a process and of those that it starts [s]."""
    with tempfile.TemporaryDirectory() as cache:
        given = {**environment, "NUMBA_CACHE_DIR": cache} if start.compiles else environment
        process = subprocess.Popen(
            [sys.executable, *start.arguments], env=given, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        assert process.stderr is not None
        message = process.stderr.read().decode()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        process.stderr.close()
        if process.returncode:
            raise RuntimeError(f"{start.name}: {message}")
    return usage.ru_utime + usage.ru_stime


def report(path: Path | None, *, quick: bool = False) -> None:
    """Measure all starts in turns, print the table, and write the page if a path is given."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory() as folder:
        listed = [one for one in starts(Path(folder)) if not (quick and one.compiles)]
        times: dict[Start, list[float]] = {one: [] for one in listed}
        for one in listed:
            if not one.compiles:
                seconds(one, environment)  # bytecode and kernels are in their caches now
        for turn in range(1 if quick else REPEATS):
            for one in listed if turn < COMPILING else [one for one in listed if not one.compiles]:
                times[one].append(seconds(one, environment))
    text = _page(times)
    print(text, end="")
    if path is not None:
        path.write_text(text, "utf-8")


def _page(times: Mapping[Start, list[float]]) -> str:
    libraries = min(next(iter(times.values())))
    rows = [
        f"| {one.name} | {min(found):.2f} s | {statistics.median(found):.2f} s | {min(found) / libraries:.2f} "
        f"| {one.wanted} |"
        for one, found in times.items()
    ]
    versions = ", ".join(f"{name} {version_of(name)}" for name in PACKAGES)
    count = len(next(iter(times.values())))
    about = (
        "Processor time of fresh processes and of those that they start, with Python's bytecode in its cache. "
        f"Minimum and median of {count} runs, in turns, {COMPILING} where kernels are compiled. "
        "Ratios are of minima, to the libraries alone. "
        f"{cpu()}; {os.environ.get('OMP_NUM_THREADS', 'all')} thread(s); Python {sys.version.split()[0]}; "
        f"{versions}. Made by `python -m benchmarks start --write`."
    )
    notes = (
        "Of the imports of `truepose.error_map` beyond the libraries, about two fifths are pydantic with the models of "
        "the cell file, the rest the modules of truepose. `validate` also loads kernels and fits a second predictor. "
        "`truepose warm-up` compiles all kernels on all processors, also those of kinematic Kriging and frozen maps, "
        "which the row above it does not need; frozen maps are half of it."
    )
    return "\n".join(
        [
            "# Start-up and first use",
            "",
            about,
            "",
            "| what | minimum | median | times the libraries | wanted |",
            "|---|---|---|---|---|",
            *rows,
            "",
            notes,
            "",
        ]
    )
