"""Run the benchmarks: all topics, or those named."""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
RESULTS = FOLDER.parent / "docs" / "validation"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def main() -> int:
    """Parse the command line, run, print; write the tables when asked."""
    topics = sorted({module.name for module in pkgutil.iter_modules([str(FOLDER)])} - {"harness", "__main__"})
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help=f"of {', '.join(topics)}; all when not given")
    parser.add_argument("--quick", action="store_true", help="small sizes: does it run?")
    parser.add_argument("--write", action="store_true", help=f"also write {RESULTS.name}/benchmarks-TOPIC.md")
    parser.add_argument("--threads", type=int, default=1, help="of BLAS, OpenMP and numba (1)")
    arguments = parser.parse_args()
    unknown = set(arguments.topics) - set(topics)
    if unknown:
        parser.error(f"no topic {', '.join(sorted(unknown))}; there are {', '.join(topics)}")
    for variable in THREADS:  # before the first import of numpy
        os.environ[variable] = str(arguments.threads)
    harness = importlib.import_module("benchmarks.harness")
    for name in arguments.topics or topics:
        topic = importlib.import_module(f"benchmarks.{name}")
        results = []
        for job in topic.jobs(quick=arguments.quick):
            print(f"{name}: {job.task}", file=sys.stderr, flush=True)
            results.append((job, harness.measure(job)))
        text = harness.table(topic.TITLE, topic.PACKAGES, results)
        print(text)
        if arguments.write:
            RESULTS.mkdir(parents=True, exist_ok=True)
            (RESULTS / f"benchmarks-{name}.md").write_text(text, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
