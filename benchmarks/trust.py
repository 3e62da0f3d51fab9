"""What the tool promises, the test of each promise, and what becomes of corrected targets on virtual cells."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import NamedTuple

import numpy as np

from benchmarks.held_out import Page
from benchmarks.trust_cells import KINDS, SAMPLES, TARGETS, Fate, fates
from benchmarks.trust_faults import FAULTS, fates_of_fault
from benchmarks.trust_faults import PREDICTORS as OF_FAULTS
from truepose.numerics.threads import become_worker, cores
from truepose.predictors import FORMER_NAMES, PREDICTORS

PAGE = "trust"
ROOT = Path(__file__).parent.parent
SEEDS, FEW_SEEDS = range(20), range(2)
QUICK_PREDICTORS = ("ordinary-kriging", "kinematic-kriging")
ALL_PREDICTORS = tuple(
    sorted([*PREDICTORS, *FORMER_NAMES.values()], key=lambda name: [*PREDICTORS].index(name.split(":")[0]))
)
"""Every name, each followed by its options that are worth a row."""
USUAL = ("ordinary-kriging", "ordinary-kriging-joint", "calibration", "kinematic-kriging")
"""The predictors with all seeds. One cell takes a minute for all others together, so these have few seeds."""
COLUMNS = (
    *(
        "kind",
        "predictor",
        "corrected",
        "worse",
        "worst cell",
        "below",
        "inside",
        "lowest",
        "highest",
        "readings",
        "worst",
        "refused",
    ),
    *("before [mm]", "after [mm]"),
)
FEWEST_COMPONENTS = 30  # of a cell's corrected targets, for a share inside their intervals


class Promise(NamedTuple):
    """A test that shows a promise."""

    promise: str
    test: str
    cases: int
    failures: int


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the tests of all promises, then the study; with `quick` two tests' files, two kinds, and one seed."""
    page = Page("Trust: promises, and what becomes of corrected targets", path)
    _promises(page, ("tests/compensation",) if quick else ("tests",))
    seeds = range(1) if quick else SEEDS
    _study(page, ("paper", "creep") if quick else KINDS, seeds, quick=quick)
    _faults(page, tuple(FAULTS)[:1] if quick else tuple(FAULTS), seeds)


def _promises(page: Page, where: Sequence[str]) -> None:
    page.say("## Promises")
    page.say(
        "Each promise is shown by a test that is marked with it (`pytest -m promise`). Cases: how many inputs, faults "
        "or places the test goes through. Failures: tests that failed when this page was made."
    )
    page.head(["promise", "test", "cases", "failures"])
    found = run_promises(where)
    for one in found:
        page.row(one.promise, f"`{one.test}`", one.cases, one.failures)
    failures = sum(one.failures for one in found)
    page.say(f"{len(found)} promises, {sum(one.cases for one in found)} cases, {failures} failures.")


def run_promises(where: Sequence[str], root: Path = ROOT) -> list[Promise]:
    """Run the tests that are marked as promises, and return them in the order of their files."""
    with TemporaryDirectory() as folder:
        results, plugin = Path(folder) / "results.xml", Path(folder) / "promise_names.py"
        plugin.write_text(_PLUGIN, "utf-8")
        given = os.environ.get("PYTHONPATH")
        options = ["-p", "promise_names", f"--junitxml={results}", "-o", "junit_family=xunit1"]
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-m", "promise", *options, *where],
            cwd=root,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([folder, *([given] if given else [])])},
            capture_output=True,
            text=True,
        )
        if not results.exists():
            raise RuntimeError(f"pytest wrote no results:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
        tests = ET.parse(results).getroot().iter("testcase")
        return _together(tests)


_PLUGIN = """
def pytest_collection_modifyitems(items):
    for item in items:
        for mark in item.iter_markers("promise"):
            item.user_properties.append(("promise", mark.args[0]))
            item.user_properties.append(("test", item.nodeid.split("[")[0]))
"""
"""Puts the promise of each test into pytest's results."""


def _together(tests: Iterator[ET.Element]) -> list[Promise]:
    """Add up the tests of the same promise and name: those of one function with several parameters."""
    sums: dict[tuple[str, str], list[int]] = {}
    for test in tests:
        known = {entry.get("name", ""): entry.get("value", "") for entry in test.iter("property")}
        if "promise" not in known or test.find("skipped") is not None:
            continue
        failed = test.find("failure") is not None or test.find("error") is not None
        counts = sums.setdefault((known["promise"], known["test"]), [0, 0])
        counts[0] += int(known.get("cases", 1))
        counts[1] += failed
    return [Promise(promise, test, *counts) for (promise, test), counts in sums.items()]


def _study(page: Page, kinds: Sequence[str], seeds: range, *, quick: bool) -> None:
    page.say("## Corrected targets that got worse")
    page.say(
        f"Virtual cells (see [The virtual cell](../virtual-cell.md)), seeds {seeds[0]}–{seeds[-1]} (of "
        f"names other than {', '.join(USUAL)}: {FEW_SEEDS[0]}–{FEW_SEEDS[-1]}): {SAMPLES} samples, "
        f"a map by each predictor, and a work program of {TARGETS} targets inside the region, corrected under "
        '`on_guard = "skip"` with the default limits. The true error of a target is that of the tool at work without '
        "noise, in the base frame of the map. Worse: corrected targets whose true error is larger than before, of all "
        "cells of the row, and in the worst cell with 30 corrected targets or more. Inside: components of the true "
        "errors of corrected targets inside their 95 % intervals, median over the cells with at least "
        f"{FEWEST_COMPONENTS} components, and the lowest and highest such cell. Readings: the same share of new "
        "readings at all targets, as `validate` states it, measured in the conditions of the samples. Maps refused: "
        "weak, or of a campaign that was refused. `below`: targets that stay nominal since their correction is below "
        "its uncertainty."
    )
    names = QUICK_PREDICTORS if quick else ALL_PREDICTORS
    _rows(page, fates, kinds, {name: seeds if name in USUAL else FEW_SEEDS for name in names}, excused="other-payload")
    page.say(
        "Limit: a map holds for the payload that it was measured with. No sample of such a map can show what another "
        "payload does (`other-payload`: measured with 120 kg, used with 30 kg); measure with the payload of the work."
    )


def _faults(page: Page, faults: Sequence[str], seeds: range) -> None:
    page.say("## Wrong statements, and conditions that no sample had")
    page.say(
        "As above, each row with one fault. A target is worse here if its error grew by more than twice the "
        "repeatability. The faults are:\n\n"
        "- wrong serial: the programs are those of another robot of the same type.\n"
        "- turned base: the model's base is turned by 180° against the controller's base.\n"
        "- repeatability slip: the cell file states ten times the true repeatability.\n"
        "- one-sided samples: the joints have lost motion. Samples come from one side and work from both, which the "
        "program shows.\n"
        "- payload not told: the samples have three payloads. At work the payload is the largest of them, "
        "and no file states it.\n"
        "- reflector off: the reflector is 12.7 mm from its stated place.\n"
        "- alternating reflectors: two reflectors, 0.5 mm apart, are used in turn.\n"
        "- flipped approach: the sides of the samples are stated with the wrong sign."
    )
    _rows(page, fates_of_fault, faults, dict.fromkeys(OF_FAULTS, seeds))


def _rows(
    page: Page,
    made: Callable[..., list[Fate]],
    kinds: Sequence[str],
    seeds: Mapping[str, range],
    excused: str = "",
) -> None:
    """Write a row for each kind and predictor, and in which more than 1 % got worse, but for an excused kind.

    `seeds` are those of each predictor.
    """
    page.head(COLUMNS)
    failed, names = [], tuple(seeds)
    for kind in kinds:
        of_kind: list[Fate] = []
        for some in dict.fromkeys(seeds.values()):
            of_kind += _of_kind(made, kind, some, tuple([name for name in names if seeds[name] == some]))
        for name in names:
            row = Row.of([fate for fate in of_kind if fate.predictor == name])
            page.row(kind, name, *row.cells())
            if row.worse > 0.01 and kind != excused:
                failed.append(f"{kind}, {name}: {100 * row.worse:.1f} %")
    but = f" but those of {excused}" if excused else ""
    page.say(
        "More than 1 % of the corrected targets got worse in: " + "; ".join(failed) + "."
        if failed
        else f"At most 1 % of the corrected targets got worse, in every row{but}."
    )


class Row(NamedTuple):
    """Figures of one predictor on all cells of one kind."""

    corrected: float
    worse: float
    worst_cell: float
    below: int
    inside: float
    lowest_inside: float
    highest_inside: float
    readings: float
    worst_readings: float
    refused: str
    before_mm: float
    after_mm: float

    @classmethod
    def of(cls, cells: Sequence[Fate]) -> Row:
        """Add up cells."""
        corrected = sum(cell.corrected for cell in cells)
        inside = [cell.coverage for cell in cells if cell.components >= FEWEST_COMPONENTS]
        worse = [cell.worse / cell.corrected for cell in cells if cell.corrected >= FEWEST_COMPONENTS]
        readings = [cell.of_readings for cell in cells if not np.isnan(cell.of_readings)]
        used = [cell for cell in cells if cell.corrected]
        weights = [cell.corrected for cell in used]
        return cls(
            corrected / sum(cell.targets for cell in cells),
            sum(cell.worse for cell in cells) / corrected if corrected else 0.0,
            max(worse, default=0.0),
            sum(cell.below for cell in cells),
            float(np.median(inside)) if inside else float("nan"),
            min(inside, default=float("nan")),
            max(inside, default=float("nan")),
            float(np.median(readings)) if readings else float("nan"),
            min(readings, default=float("nan")),
            f"{sum(bool(cell.refused) for cell in cells)} of {len(cells)}",
            float(np.average([cell.before_mm for cell in used], weights=weights)) if used else float("nan"),
            float(np.average([cell.after_mm for cell in used], weights=weights)) if used else float("nan"),
        )

    def cells(self) -> list[str]:
        """Return what a table shows."""
        return [
            _percent(self.corrected, 0),
            _percent(self.worse, 2) if self.corrected else "–",
            _percent(self.worst_cell, 1) if self.corrected else "–",
            str(self.below),
            _percent(self.inside, 1),
            _percent(self.lowest_inside, 1),
            _percent(self.highest_inside, 1),
            _percent(self.readings, 1),
            _percent(self.worst_readings, 1),
            self.refused,
            _millimetres(self.before_mm),
            _millimetres(self.after_mm),
        ]


def _percent(share: float, digits: int) -> str:
    return "–" if np.isnan(share) else f"{100 * share:.{digits}f} %"


def _millimetres(length: float) -> str:
    return "–" if np.isnan(length) else f"{length:.3f}"


def _of_kind(made: Callable[..., list[Fate]], kind: str, seeds: range, names: tuple[str, ...]) -> list[Fate]:
    """Return the fates on all cells of a kind or fault; those that an interrupted run of this code did are kept.

    Processes with one thread each; every cell that is done is kept in a file of the system's temporary folder.
    """
    folder = Path(gettempdir()) / f"truepose-trust-{_code()[:16]}"
    folder.mkdir(exist_ok=True)

    def kept(seed: int) -> Path:
        return folder / f"{kind.replace(' ', '-')}-{seed}-{len(names)}.json"

    missing = [seed for seed in seeds if not kept(seed).exists()]
    workers = max(1, min(len(missing), cores()))
    with ProcessPoolExecutor(workers, get_context("spawn"), become_worker) as pool:
        running: dict[Future[list[Fate]], int] = {
            pool.submit(made, kind, seed, predictors=names): seed for seed in missing
        }
        for done in as_completed(running):
            draft = folder / f"{os.getpid()}.draft"
            draft.write_text(json.dumps([fate.to_dict() for fate in done.result()]), "utf-8")
            draft.replace(kept(running[done]))
            print(f"{kind}: seed {running[done]} done", file=sys.stderr, flush=True)
    return [Fate(**values) for seed in seeds for values in json.loads(kept(seed).read_text("utf-8"))]


def _code() -> str:
    """Return a hash of the code that the figures come from."""
    digest = hashlib.sha256()
    for file in sorted(
        [*(ROOT / "src").rglob("*.py"), *(ROOT / "src").rglob("*.toml"), *Path(__file__).parent.glob("trust*.py")]
    ):
        digest.update(file.read_bytes())
    return digest.hexdigest()
