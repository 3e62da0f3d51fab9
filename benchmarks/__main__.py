"""Run the benchmarks: all topics, or those named."""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import subprocess
import sys
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
RESULTS = FOLDER.parent / "docs" / "validation"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
NO_TOPICS = {
    "accuracy_data",
    "harness",
    "held_out",
    "measured_robots",
    "pages",
    "plain",
    "scale_commands",
    "trust_cells",
    "__main__",
}
WITH_THREADS = ("frozen", "growth", "kriging", "similarity")
"""Topics that use all cores, as their peers do; the others are compared in one thread."""


def main() -> int:
    """Parse the command line, run, print; write the tables when asked."""
    topics = sorted({module.name for module in pkgutil.iter_modules([str(FOLDER)])} - NO_TOPICS)
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help=f"of {', '.join(topics)}; all when not given")
    parser.add_argument("--quick", action="store_true", help="small sizes: does it run?")
    parser.add_argument("--write", action="store_true", help=f"also write pages to {RESULTS.name}")
    parser.add_argument("--threads", type=int, help="of BLAS, OpenMP and numba (1; all in some topics)")
    data = parser.add_argument_group("accuracy on measured robots", "python -m benchmarks accuracy --data FOLDER")
    data.add_argument(
        "--data",
        type=Path,
        metavar="FOLDER",
        help="a folder for each robot, see docs/how-to",
    )
    data.add_argument("--check", action="store_true", help="only read and check the folder")
    data.add_argument("--predictor", action="append", default=[], help="one predictor; may be repeated (all)")
    data.add_argument("--out", type=Path, default=Path("accuracy.csv"), help="the table; an earlier one is continued")
    arguments = parser.parse_args()
    if arguments.data is None and (arguments.check or arguments.predictor):
        parser.error("--check and --predictor need --data")
    if arguments.data is not None and arguments.topics != ["accuracy"]:
        parser.error("--data belongs to the topic accuracy alone")
    unknown = set(arguments.topics) - set(topics)
    if unknown:
        parser.error(f"no topic {', '.join(sorted(unknown))}; there are {', '.join(topics)}")
    names = arguments.topics or topics
    if len(names) > 1:  # each in a process of its own, with its own number of threads
        given = [word for word in sys.argv[1:] if word not in topics]
        return max(subprocess.run([sys.executable, "-m", "benchmarks", name, *given]).returncode for name in names)
    threads = arguments.threads or (os.cpu_count() if names[0] in WITH_THREADS else None) or 1
    for variable in THREADS:  # before the first import of numpy
        os.environ[variable] = str(threads)
    if arguments.data is not None:
        return _run_data(arguments)
    _run(names[0], arguments.quick, arguments.write)
    return 0


def _run_data(arguments: argparse.Namespace) -> int:
    """Check a folder of measured robots, or try all predictors on it."""
    from benchmarks import accuracy_data
    from truepose.errors import TrueposeError

    try:
        if arguments.check:
            accuracy_data.check(arguments.data)
            return 0
        page = RESULTS / f"{accuracy_data.PAGE}.md" if arguments.write else None
        accuracy_data.report_data(arguments.data, page, arguments.out, arguments.predictor)
    except TrueposeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"interrupted; the same command continues {arguments.out}", file=sys.stderr)
        return 130
    return 0


def _run(name: str, quick: bool, write: bool) -> None:
    """Run one topic; every row is printed, and the table written anew, as soon as its job is done."""
    harness = importlib.import_module("benchmarks.harness")
    topic = importlib.import_module(f"benchmarks.{name}")
    if write:
        RESULTS.mkdir(parents=True, exist_ok=True)
    if hasattr(topic, "report"):  # a study of accuracy: nothing is timed against others
        topic.report(RESULTS / f"{topic.PAGE}.md" if write else None, quick=quick)
        return
    results: list[tuple[Any, Any]] = []
    print(harness.table(topic.TITLE, topic.PACKAGES, []), end="", flush=True)
    for job in topic.jobs(quick=quick):
        results.append((job, harness.measure(job)))
        print(*harness.rows(*results[-1]), sep="\n", flush=True)
        if write:
            (RESULTS / f"benchmarks-{name}.md").write_text(harness.table(topic.TITLE, topic.PACKAGES, results), "utf-8")


if __name__ == "__main__":
    sys.exit(main())
